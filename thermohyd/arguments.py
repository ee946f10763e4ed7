"""Check the arguments of public functions on the host: one sentence where a unit, a sign, a shape or a type is wrong.

Only values that are known are looked at: a tracer (inside jit, vmap, grad) passes untouched, and nothing is computed for it.
"""

from collections.abc import Sequence
from typing import Any, Literal

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array


COLDEST, HOTTEST = 150.0, 700.0  # K: far outside it no hydraulic oil flows, and numbers in degC or degF lie below
LOWEST_PRESSURE, HIGHEST_PRESSURE = -101325.0, 5e8  # Pa gauge: absolute vacuum; ten times any valve's
BAR_LIMIT = 1e3  # Pa: a supply below 0.01 bar was meant in bar
CONSTANT_BAR_LIMIT = 100.0  # Pa: so was a return or load pressure that stands at a whole fraction of a millibar
ZERO_CELSIUS = 273.15


# What stays of the throttling heat in the oil: a word, or its share eta.
Heat = Literal["adiabatic", "isothermal"]
SHARES: dict[str, float] = {"isothermal": 0.0, "adiabatic": 1.0}


class ArgumentValueError(ValueError):
    """A number that cannot be meant: in another unit, of the wrong sign, not finite, or of the wrong shape."""


class ArgumentTypeError(TypeError):
    """Something else than the number, array or module that the argument takes."""


def as_array(value: Any) -> Array:
    """A float array; what cannot be one comes back as it is, for the check that knows its name."""
    if isinstance(value, str | bytes):
        return value  # pyright: ignore[reportReturnType]
    try:
        return jnp.asarray(value, dtype=jnp.result_type(float))
    except (TypeError, ValueError):
        return value


def as_optional_array(value: Any) -> Array | None:
    """The same, where None means that there is none."""
    return None if value is None else as_array(value)


def share_of_heat(heat: Any) -> Any:
    """The share eta that a word stands for; a number, an array or None as it is. Raises ArgumentValueError."""
    if not isinstance(heat, str):
        return heat
    if heat not in SHARES:
        raise ArgumentValueError(
            f'heat must be "adiabatic", "isothermal" or a share from 0 to 1, not {described(heat)}'
        )
    return SHARES[heat]


def heat_of_chambers(heat: Any) -> Heat:
    """The word for how chambers keep their heat, given as that word, 0 or 1. Raises ArgumentValueError."""
    for word, share in SHARES.items():
        if heat == (word if isinstance(heat, str) else share):
            return "adiabatic" if share else "isothermal"
    given = described(heat) if isinstance(heat, str) else heat
    raise ArgumentValueError(
        f'heat must be "adiabatic" (1) or "isothermal" (0) here, not {given}: between the two, chambers exchange heat with '
        "their walls (walls=), and edges keep the valve's heat_retention"
    )


def described(value: Any) -> str:
    """What was given instead, for a sentence."""
    if isinstance(value, str):
        return f'the text "{value[:40]}"'
    kind = type(value).__name__
    return "None" if value is None else f"{'an' if kind[0] in 'AEIOUaeiou' else 'a'} {kind}"


def known(name: str, value: Any) -> np.ndarray | None:
    """The numbers of an argument, None where they are traced. Raises ArgumentTypeError, ArgumentValueError (not finite)."""
    if isinstance(value, Tracer):
        return None
    if isinstance(value, str | bytes) or not hasattr(value, "dtype"):
        raise ArgumentTypeError(f"{name} must be a number or an array of numbers in SI units, not {described(value)}")
    numbers = np.asarray(value)
    if numbers.size and not np.all(np.isfinite(numbers)):
        raise ArgumentValueError(f"{name} must be finite, not {_worst(numbers, ~np.isfinite(numbers)):g}")
    return numbers


def _worst(numbers: np.ndarray, wrong: Any) -> float:
    """The first of the numbers that are wrong; `wrong` is a bool where there is one number only."""
    return float(numbers.reshape(-1)[np.flatnonzero(wrong)[0]])


def check_temperature(name: str, value: Any) -> None:
    """Kelvins, 150 to 700: a smaller number is one in degC."""
    numbers = known(name, value)
    if numbers is None or numbers.size == 0:
        return
    if (cold := numbers < COLDEST).any():
        first = _worst(numbers, cold)
        instead = f": use {first + ZERO_CELSIUS:.6g}" if first > -ZERO_CELSIUS else ""
        raise ArgumentValueError(f"{name}: temperatures are in kelvin; {first:g} looks like degC{instead}")
    if (hot := numbers > HOTTEST).any():
        raise ArgumentValueError(
            f"{name}: temperatures are in kelvin; {_worst(numbers, hot):g} is beyond the {HOTTEST:g} K of any oil"
        )


def check_pressure(name: str, value: Any, *, supply: bool = False, difference: bool = False) -> None:
    """Pascals, gauge. supply: a column that stays below 0.01 bar was meant in bar; others only where they stand there.

    difference: of two pressures, of either sign.
    """
    numbers = known(name, value)
    if numbers is None or numbers.size == 0:
        return
    for wrong, why in (
        (numbers < (-HIGHEST_PRESSURE if difference else LOWEST_PRESSURE), "is below absolute vacuum; they are gauge"),
        (numbers > HIGHEST_PRESSURE, "is above 5000 bar"),
    ):
        if wrong.any():
            raise ArgumentValueError(f"{name}: pressures are in Pa; {_worst(numbers, wrong):g} {why}")
    most = float(np.max(np.abs(numbers)))
    in_bar = 0.0 < most < BAR_LIMIT if supply else 0.5 <= most <= CONSTANT_BAR_LIMIT and np.ptp(numbers) == 0.0
    if in_bar:
        first = float(numbers.reshape(-1)[int(np.argmax(np.abs(numbers)))])
        raise ArgumentValueError(f"{name}: pressures are in Pa; {first:g} looks like bar: use {first:g}e5")


def check_length(name: str, value: Any, *, limit: float = 0.1, unit: str = "um", sign: str = "any") -> None:
    """Metres, of a size below `limit`: larger numbers are in `unit` ("um", "mm"). sign: see `check_sign`."""
    numbers = known(name, value)
    if numbers is not None and (far := np.abs(numbers) >= limit).any():
        first = _worst(numbers, far)
        unit = "mm" if abs(first) < 1.0 else unit
        power = {"um": "e-6", "mm": "e-3"}[unit]
        raise ArgumentValueError(f"{name}: lengths are in m; {first:g} looks like {unit}: use {first:g}{power}")
    check_sign(name, value, sign)


def check_sign(name: str, value: Any, sign: str = "positive") -> None:
    """sign: "positive", "not negative" or "any"; every number must be finite."""
    numbers = known(name, value)
    if numbers is None or sign == "any":
        return
    wrong = numbers <= 0.0 if sign == "positive" else numbers < 0.0
    if wrong.any():
        must = "positive" if sign == "positive" else "zero or positive"
        raise ArgumentValueError(f"{name} must be {must}, not {_worst(numbers, wrong):g}")


def check_size(name: str, value: Any, low: float, high: float, hint: str) -> None:
    """Numbers between two limits (both included) that no legal value comes near; `hint` says which unit is meant."""
    numbers = known(name, value)
    if numbers is not None and (wrong := (numbers < low) | (numbers > high)).any():
        raise ArgumentValueError(f"{name} cannot be {_worst(numbers, wrong):g}: {hint}")


def check_word(name: str, value: Any, words: Sequence[str]) -> None:
    """Raise ArgumentValueError unless it is one of the words."""
    if value not in words:
        allowed = " or ".join(f'"{word}"' for word in words)
        raise ArgumentValueError(f"{name} must be {allowed}, not {described(value)}")


def check_module(name: str, value: Any, kind: type, instead: str) -> None:
    """Raise ArgumentTypeError unless it is a module of that kind; `instead` says how to get one."""
    if not isinstance(value, kind):
        raise ArgumentTypeError(f"{name} must be a thermohyd.{kind.__name__}, not {described(value)}: {instead}")
