"""Read the TOML file of a study's settings: conditions, tolerances, noise, actuator. Every key is optional."""

from dataclasses import dataclass, field
from pathlib import Path

from thermohyd.identify.bench.errors import quoted
from thermohyd.identify.bench.record import ValveData
from thermohyd.identify.bench.test_tables import ACTUATOR, CONTROLLER, read_actuator
from thermohyd.identify.bench.toml_file import TomlSource, TomlTable
from thermohyd.identify.model.model import Model

from .factors import FACTORS, Factor, default_kind, factors_of


TESTS = ("leakage", "pressure_gain", "flow_gain")
_NOISE_KIND = {"leakage": "flow", "pressure_gain": "pressure", "flow_gain": "flow"}


@dataclass(frozen=True)
class Settings:
    """What a study's TOML file says, SI; None and missing keys take the study's defaults.

    tolerances: {factor: half width}, shares: {factor: half width as a share of the value}. noise: {test: standard deviation}.
    actuator: fields of `thermohyd.Actuator`.
    """

    temperature: float | None = None
    temperatures: tuple[float, ...] = ()
    supply_pressure: float | None = None
    return_pressure: float | None = None
    tolerances: dict[str, float] = field(default_factory=dict)
    shares: dict[str, float] = field(default_factory=dict)
    noise: dict[str, float] = field(default_factory=dict)
    actuator: dict[str, float] = field(default_factory=dict)


def read_settings(path: Path | str) -> Settings:
    """Read a settings file such as

        [conditions]
        temperature = "40 degC"                 # where the study stands
        temperatures = ["0 degC", "70 degC"]    # where curves are drawn and tests may be run
        supply_pressure = "70 bar"

        [tolerances]                            # half widths; % is of the factor's value
        clearance = "0.3 um"
        viscosity = "5 %"
        temperature = "2 K"

        [noise]                                 # standard deviations of the tests' readings
        leakage = "0.01 l/min"

        [actuator]                              # as in a bench.toml; without it an example
        piston_area = "12 cm^2"

    Raises BenchInputError with file, line and key.
    """
    root = TomlSource(Path(path)).root
    root.refuse_unknown(("conditions", "tolerances", "noise", "actuator"), "table")
    found = _conditions(root.table("conditions"))
    tolerances, shares = _tolerances(root.table("tolerances"))
    noise = root.table("noise")
    deviations: dict[str, float] = {}
    if noise is not None:
        noise.refuse_unknown(TESTS, "test")
        for test in noise.data:
            std = noise.quantity(test, _NOISE_KIND[test], sign="positive")
            assert std is not None
            deviations[test] = std
    actuator = _actuator(root.table("actuator"))
    return Settings(**found, tolerances=tolerances, shares=shares, noise=deviations, actuator=actuator)


def _actuator(table: TomlTable | None) -> dict[str, float]:
    if table is None:
        return {}
    read_actuator(table, ValveData("", 1.0, 1.0, rated_current=1.0))  # refuses what cannot be
    keys = {key: kind for key, (kind, _, _) in ACTUATOR.items()}
    found = {key: table.quantity(key, kind) for key, kind in keys.items()}
    controller = table.table("controller")
    if controller is not None:
        found |= {key: controller.quantity(key, kind) for key, kind in CONTROLLER.items()}
    return {key: value for key, value in found.items() if value is not None}


def _conditions(table: TomlTable | None) -> dict:
    if table is None:
        return {}
    table.refuse_unknown(("temperature", "temperatures", "supply_pressure", "return_pressure"))
    found: dict = {
        "temperature": table.quantity("temperature", "temperature"),
        "supply_pressure": table.quantity("supply_pressure", "pressure", sign="positive"),
        "return_pressure": table.quantity("return_pressure", "pressure", sign="not negative"),
    }
    if "temperatures" in table:
        several = table.data["temperatures"]
        if not isinstance(several, list) or not 1 <= len(several) <= 6:
            raise table.error('must be a list of one to six temperatures: ["0 degC", "70 degC"]', "temperatures")
        found["temperatures"] = tuple(table.as_quantity("temperatures", t, "temperature") for t in several)
    for key, temperatures in (
        ("temperature", (found["temperature"],)),
        ("temperatures", found.get("temperatures", ())),
    ):
        if any(t is not None and not 180.0 < t < 500.0 for t in temperatures):
            raise table.error("must lie between -93 and 226 degC", key)
    supply, back = found["supply_pressure"], found["return_pressure"]
    if supply is not None and back is not None and back >= supply:
        raise table.error("must be below supply_pressure", "return_pressure")
    return found


def _tolerances(table: TomlTable | None) -> tuple[dict[str, float], dict[str, float]]:
    tolerances: dict[str, float] = {}
    shares: dict[str, float] = {}
    if table is None:
        return tolerances, shares
    table.refuse_unknown(FACTORS, "factor")
    for name, value in table.data.items():
        if isinstance(value, str) and value.strip().endswith(("%", "percent")):
            share = table.as_quantity(name, value, "plain number", full_scale=1.0, sign="positive")
            shares[name] = share
            continue
        kind = default_kind(name)
        if kind == "temperature":
            tolerances[name] = _kelvins(table, name, value)
            continue
        tolerances[name] = table.as_quantity(name, value, kind, sign="positive")
    return tolerances, shares


def _kelvins(table: TomlTable, name: str, value: object) -> float:
    """A difference of temperatures: only kelvins are, as degC has an offset."""
    words = value.split() if isinstance(value, str) else []
    if len(words) != 2 or words[1] not in ("K", "kelvin"):
        raise table.error(f'{quoted(value)} is not a difference of temperatures; write it in K, such as "5 K"', name)
    return table.as_quantity(name, value, "temperature", sign="positive")


def factors_with(
    settings: Settings, model: Model, temperature: float, supply_pressure: float, return_pressure: float
) -> tuple[Factor, ...]:
    """`factors_of` with the tolerances of the settings."""
    about = (model, temperature, supply_pressure, return_pressure)
    own = {f.name: settings.shares[f.name] * abs(f.value) for f in factors_of(*about) if f.name in settings.shares}
    return factors_of(*about, tolerances={**settings.tolerances, **own})
