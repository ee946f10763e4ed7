"""What a servo study was asked for on the command line: temperatures, step, pressures, gain; checked before JAX starts."""

import re
from dataclasses import dataclass

from thermohyd.identify.bench.errors import BenchInputError, quoted
from thermohyd.identify.bench.units import UnitError, parse_quantity
from thermohyd.identify.sensitivity.settings import Settings


TEMPERATURES = "-40 -20 0 20 40 70 degC"
STEP = "5 mm"
COLDEST, HOTTEST, MOST = 180.0, 500.0, 12  # K, K, temperatures in one sweep
_SEVERAL = re.compile(r"\s*((?:[+-]?[\d.]+(?:[eE][+-]?\d+)?[\s,;]+)*[+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*([^\d\s,;].*)")


@dataclass(frozen=True)
class Request:
    """What a servo study is asked for, SI; None: as the record, the model or the settings have it. temperatures: rising."""

    temperatures: tuple[float, ...]
    step: float
    supply_pressure: float | None = None
    return_pressure: float | None = None
    amplifier_gain: float | None = None


def read_request(
    temperatures: str | None, step: str, supply: str | None, gain: str | None, settings: Settings
) -> Request:
    """The options in SI, those of the settings file where an option is not given. Raises BenchInputError."""
    size = _quantity("--step", step, "length")
    if size == 0.0:
        raise BenchInputError("--step: a step of nothing has no response")
    return request_of(
        settings,
        None if temperatures is None else read_temperatures(temperatures),
        size,
        None if supply is None else _quantity("--supply", supply, "pressure", positive=True),
        None if gain is None else _quantity("--gain", gain, "amplifier gain", positive=True),
    )


def request_of(
    settings: Settings,
    temperatures: tuple[float, ...] | None,
    step: float,
    supply_pressure: float | None,
    amplifier_gain: float | None,
) -> Request:
    """The same of numbers in SI, rising temperatures; where one is None, that of the settings, else the default."""
    if temperatures is None:
        temperatures = tuple(sorted(settings.temperatures)) or read_temperatures(TEMPERATURES)
    supply_pressure = settings.supply_pressure if supply_pressure is None else supply_pressure
    return Request(temperatures, step, supply_pressure, settings.return_pressure, amplifier_gain)


def read_temperatures(text: str) -> tuple[float, ...]:
    """ "-40 0 70 degC" as rising kelvins. Raises BenchInputError."""
    found = _SEVERAL.fullmatch(text)
    if found is None:
        raise BenchInputError(
            f'--temperatures: {quoted(text)} is not a list of numbers and a unit such as "-40 0 70 degC"'
        )
    words = re.split(r"[\s,;]+", found[1])
    if len(words) > MOST:
        raise BenchInputError(f"--temperatures: at most {MOST} temperatures, not {len(words)}")
    warm = sorted({_quantity("--temperatures", f"{word} {found[2]}", "temperature") for word in words})
    if not COLDEST < warm[0] <= warm[-1] < HOTTEST:
        raise BenchInputError("--temperatures: must lie between -93 and 226 degC")
    return tuple(warm)


def _quantity(option: str, text: str, kind: str, positive: bool = False) -> float:
    try:
        value = parse_quantity(text, kind)
    except UnitError as error:
        raise BenchInputError(f"{option}: {error}") from None
    if positive and not value > 0.0:
        raise BenchInputError(f"{option}: must be positive, not {quoted(text)}")
    return value
