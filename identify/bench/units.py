"""Bench units to SI and back, by one pint registry that is built when the first unit is read (it takes 0.2 s)."""

import functools
import math
import re
import warnings
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from .errors import LONGEST_TEXT, quoted, suggestion
from .shown_units import KINDS


# What engineers write and pint does not know. Gauge pressures: all pressures of a record are gauge.
DEFINITIONS = ("gpm = gallon / minute", "lpm = liter / minute", "barg = bar", "psig = psi", "psid = psi", "cc = cm**3")
ABSOLUTE = {"psia", "bara", "bar_a", "psi_a", "bar(a)", "psi(a)"}  # refused: a record's pressures are gauge
# Units of a bench that loggers also write in other letter case ("PSI", "Bar", "L/MIN"). Within one kind no two of them
# differ by case alone: millipascals and megametres are on no bench.
WRITTEN = {
    "length": ("um", "mm", "cm", "m", "nm", "in", "inch", "mil", "thou"),
    "flow": ("l/min", "ml/min", "cc/min", "cm^3/min", "cm^3/s", "l/s", "l/h", "m^3/s", "m^3/min", "m^3/h", "gpm", "lpm",
             "gal/min", "in^3/min", "in^3/s"),
    "pressure": ("bar", "mbar", "Pa", "hPa", "kPa", "MPa", "psi", "psig", "psid", "barg", "kgf/cm^2"),
    "temperature": ("degC", "degF", "K", "°C", "°F", "kelvin"),
    "current": ("mA", "uA", "A"),
    "time": ("s", "ms", "us", "min", "h", "sec", "second", "seconds"),
    "force": ("N", "kN", "lbf"),
    "velocity": ("mm/s", "m/s", "um/s", "in/s"),
    "frequency": ("Hz", "kHz", "rad/s"),
    "angle": ("deg", "rad"),
    "voltage": ("V", "mV", "volt", "volts"),
    "number of counts": ("count", "counts"),
    "kinematic viscosity": ("cSt", "mm^2/s"),
    "density": ("kg/m^3", "g/cm^3", "kg/l"),
}  # fmt: skip
# Short names that pint takes for something else (C is its coulomb, F its farad): read by the kind of the column only.
SHORT = {
    "temperature": {"c": "degC", "f": "degF", "celsius": "degC", "fahrenheit": "degF"}
    | {"gradc": "degC", "deg.c": "degC", "deg.f": "degF", "degk": "K"},
    "pressure": {"bar(g)": "bar", "psi(g)": "psi", "kpa(g)": "kPa", "mpa(g)": "MPa", "kpag": "kPa", "mpag": "MPa"},
    "flow": {"usgpm": "gal/min", "ccm": "cm^3/min", "ltr/min": "l/min", "lit/min": "l/min"},
    "length": {"micron": "um", "microns": "um", "mils": "mil"},
    "number of counts": {"cts": "count", "digit": "count", "digits": "count"},
}
COMMON = (
    "um", "mm", "inch", "thou", "l/min", "gal/min", "m^3/s", "bar", "psi", "MPa", "degC", "degF", "K", "mA", "A", "s",
    "cSt", "%",
)  # fmt: skip
# Names, single-digit powers, products, quotients. Anything else, towers of powers first of all, never reaches pint. A name is taken
# whole (*+): tried in pieces, "aaa...a!" has as many readings as subsets.
SAFE = re.compile(
    r"(?:1(?=\s*/)|[^\W\d]\w*+|[°%]|(?:\^|\*\*)\s*-?\d(?!\s*(?:[\d.^]|\*\*))|(?<=[\w)%])\*(?=[\s\w(])|[/()]|\s)+"
)
NUMBER = re.compile(r"\s*([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)(?![\d.,])\s*(.*)", re.DOTALL)
LONGEST_UNIT = 40  # characters
SIGNS = {"²": "^2", "³": "^3", "⁻¹": "^-1", "·": "*", "⋅": "*", "×": "*", "º": "°", "℃": "°C", "℉": "°F"}


class UnitError(ValueError):
    """A unit or quantity that cannot be used; the message is one sentence that says what would be right."""


@dataclass(frozen=True)
class Unit:
    """A linear unit: SI value = scale * value + offset (the offset is that of degC and degF)."""

    text: str
    scale: float
    offset: float

    def to_si(self, values: np.ndarray) -> np.ndarray:
        return self.scale * values + self.offset


def expected(kind: str) -> str:
    """ "a flow such as l/min": how messages name what would be right."""
    return f"{_article(kind)} such as {KINDS[kind].label}"


def _article(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"


@functools.cache
def _registry() -> Any:
    import pint

    registry = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    for definition in DEFINITIONS:
        registry.define(definition)
    return registry


@functools.lru_cache(maxsize=512)
def _linear(text: str) -> tuple[float, float, frozenset]:
    """(scale, offset, dimension) of a unit against coherent SI."""
    plain = text.strip()
    if len(plain) > LONGEST_UNIT:
        raise UnitError(f"{quoted(text)} is not a unit")
    for sign, meaning in SIGNS.items():
        plain = plain.replace(sign, meaning)
    plain = re.sub(r"\s*(\*\*|[*/^])\s*", r"\1", plain)
    plain = re.sub(r"(?<=[A-Za-z])([23])(?![\w^])", r"^\1", plain)  # cm2 as loggers write it
    if re.sub(r"\s", "", plain).casefold() in ABSOLUTE:
        raise UnitError(f"{quoted(text)} is an absolute pressure, but the pressures of a record are gauge")
    if plain in ("1", "-"):
        return 1.0, 0.0, frozenset()
    if not SAFE.fullmatch(plain) or re.search(r"\)\s*(?:\^|\*\*)", plain):
        raise UnitError(f"{quoted(text)} is not a unit")
    registry = _registry()
    try:
        unit = registry.parse_units(plain)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a logarithmic unit overflows at the third point
            # Three points: far apart, so that an offset unit's scale keeps its digits, and to see that it is linear.
            zero, one, large = (float(registry.Quantity(v, unit).to_base_units().magnitude) for v in (0.0, 1.0, 1e6))
        dimension = frozenset((str(name), float(power)) for name, power in unit.dimensionality.items())
    except Exception:  # pint raises whatever its parser trips over; every one of them means the same to a user
        raise UnitError(f"{quoted(text)} is not a unit") from None
    scale = (large - zero) / 1e6 if zero else one
    if not (math.isfinite(large) and scale > 0.0 and math.isclose(large - zero, 1e6 * (one - zero), rel_tol=1e-9)):
        raise UnitError(f"{quoted(text)} is not a linear unit")
    return scale, zero, dimension


def parse_unit(text: str, kind: str, full_scale: float | None = None) -> Unit:
    """The unit of a column or quantity, which must be of the given kind (a key of KINDS).

    `full_scale` (SI) is what `%` stands for, where percent are allowed. Raises UnitError.
    """
    if text.strip() in ("%", "percent") and full_scale is not None:
        return Unit(text, 0.01 * full_scale, 0.0)
    if not text.strip():
        raise UnitError(f"the unit is missing; expected {expected(kind)}")
    try:
        scale, offset, dimension = _linear(text)
        if dimension != _linear(KINDS[kind].label)[2] and (written := _as_written(text, kind)):
            scale, offset, dimension = _linear(written)
    except UnitError as error:
        if written := _as_written(text, kind):
            return Unit(text, *_linear(written)[:2])
        close = suggestion(text[:LONGEST_UNIT], COMMON)
        raise UnitError(f"{error}; {close if close.endswith('?') else f'expected {expected(kind)}'}") from None
    if dimension != _linear(KINDS[kind].label)[2]:
        same = (_article(name) for name, shown in KINDS.items() if _linear(shown.label)[2] == dimension)
        raise UnitError(f"{quoted(text)} is {next(same, 'of another dimension')}; expected {expected(kind)}")
    return Unit(text, scale, offset)


@functools.cache
def _spellings(kind: str) -> dict[str, str]:
    return {unit.casefold(): unit for unit in WRITTEN.get(kind, ())} | SHORT.get(kind, {})


def _as_written(text: str, kind: str) -> str | None:
    """The unit that a text means in a column of this kind, whatever its letter case and blanks; None if it is none."""
    plain = text[: LONGEST_UNIT + 1]
    for sign, meaning in SIGNS.items():
        plain = plain.replace(sign, meaning)
    plain = re.sub(r"\s+", "", plain).replace("**", "^").casefold()
    known = _spellings(kind)
    return known.get(plain) or known.get(re.sub(r"(?<=[a-z])([23])", r"^\1", plain))


def parse_quantity(text: str, kind: str, full_scale: float | None = None) -> float:
    """ "213 um" as a number in SI. Raises UnitError."""
    match = NUMBER.match(text) if len(text) <= LONGEST_TEXT else None
    if match is None:
        example = f"1.5 {KINDS[kind].label}"
        raise UnitError(f'{quoted(text)} is not a quantity; expected a number with a unit, such as "{example}"')
    bare = kind == "plain number" and not match[2].strip()
    unit = parse_unit("1" if bare else match[2], kind, full_scale)
    value = unit.scale * float(match[1]) + unit.offset
    if not math.isfinite(value):
        raise UnitError(f"{quoted(text)} is not finite")
    return value


def number_of(text: str | float) -> float:
    """213.0 of "213 um", a text that `parse_quantity` takes; a number stays what it is."""
    if not isinstance(text, str):
        return float(text)
    match = NUMBER.match(text)
    assert match is not None
    return float(match[1])


@overload
def to_si(values: float, unit: str) -> float: ...
@overload
def to_si(values: np.ndarray, unit: str) -> np.ndarray: ...
def to_si(values: float | np.ndarray, unit: str) -> float | np.ndarray:
    """Values in a bench unit as SI."""
    scale, offset, _ = _linear(unit)
    return scale * values + offset


@overload
def from_si(values: float, unit: str) -> float: ...
@overload
def from_si(values: np.ndarray, unit: str) -> np.ndarray: ...
def from_si(values: float | np.ndarray, unit: str) -> float | np.ndarray:
    """SI values in a bench unit, the inverse of `to_si`."""
    scale, offset, _ = _linear(unit)
    return (values - offset) / scale
