"""The `[actuator]` table: the jack, its load and its loop, with the defaults that BENCH_FORMAT states."""

from .record import ActuatorData, ValveData
from .toml_source import TomlTable
from .units import parse_quantity


# Key: kind of quantity, sign, default (BENCH_FORMAT).
ACTUATOR = {
    "piston_area": ("area", "positive", "12 cm^2"),
    "chamber_volume": ("volume", "positive", "60 cm^3"),
    "piston_stroke": ("length", "positive", "50 mm"),
    "moving_mass": ("mass", "positive", "50 kg"),
    "viscous_friction": ("viscous friction", "not negative", "2000 N s/m"),
    "coulomb_friction": ("force", "not negative", "0 N"),
    "jack_leakage": ("leakage conductance", "not negative", "0 m^3/s/Pa"),
    "spool_frequency": ("frequency", "positive", "100 Hz"),
    "spool_damping": ("plain number", "positive", "0.7"),
    "external_force": ("force", "", "0 N"),
}
CONTROLLER = {"amplifier_gain": "amplifier gain", "sensor_gain": "sensor gain"}
HEAT = ("adiabatic", "isothermal")


def read_actuator(table: TomlTable, valve: ValveData) -> ActuatorData:
    """The table in SI. Raises BenchInputError where it says something that an actuator cannot be."""
    table.refuse_unknown((*ACTUATOR, "controller", "heat"))
    value = {}
    for key, (kind, sign, default) in ACTUATOR.items():
        given = table.quantity(key, kind, sign=sign)
        value[key] = parse_quantity(default, kind) if given is None else given
    swept = 0.5 * value["piston_area"] * value["piston_stroke"]
    if not value["chamber_volume"] > swept:
        key = "chamber_volume" if "chamber_volume" in table else None
        raise table.error(
            f"the chamber volume {value['chamber_volume'] * 1e6:.6g} cm^3 must be larger than piston_area * "
            f"piston_stroke / 2 = {swept * 1e6:.6g} cm^3, which the piston sweeps from mid stroke",
            key,
        )
    check_word(table, "heat", HEAT)
    gains: dict[str, float] = {}
    controller = table.table("controller")
    if controller is not None:
        controller.refuse_unknown(tuple(CONTROLLER))
        for key, kind in CONTROLLER.items():
            gain = controller.quantity(key, kind, sign="positive")
            if gain is None:
                raise controller.error(f"{key} is missing; a controller needs amplifier_gain and sensor_gain")
            gains[key] = gain
        if valve.rated_current is None:
            raise controller.error("a controller drives the valve by a current: [valve] needs rated_current")
    return ActuatorData(**value, **gains, heat=str(table.data.get("heat", HEAT[0])))


def check_word(table: TomlTable, key: str, words: tuple[str, ...]) -> None:
    """Raise BenchInputError where a key holds none of the words."""
    if key in table and table.data[key] not in words:
        raise table.error(f"must be one of {', '.join(words)}", key)
