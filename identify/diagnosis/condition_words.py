"""Conditions as an engineer says them: "-12 to 35 um, 60 to 71 degC, falling"."""

from collections.abc import Mapping

from ..display_units import reading_unit, significant


# {column: (unit, factor, offset)}: shown = factor * SI + offset
_SHOWN = {
    "spool_position": ("um", 1e6, 0.0),
    "supply_pressure": ("bar", 1e-5, 0.0),
    "return_pressure": ("bar", 1e-5, 0.0),
    "load_pressure": ("bar", 1e-5, 0.0),
    "pressure_drop": ("bar", 1e-5, 0.0),
    "temperature": ("degC", 1.0, -273.15),
    "rate": ("um/s", 1e6, 0.0),
    "opening": ("um", 1e6, 0.0),
    "time": ("s", 1.0, 0.0),
    "frequency": ("Hz", 1.0, 0.0),
    "elapsed": ("s", 1.0, 0.0),
}
_AFTER = {"supply_pressure": " supply", "return_pressure": " return", "load_pressure": " load"}


def condition_unit(column: str) -> tuple[str, float, float]:
    """(unit, factor, offset) with shown = factor * SI + offset; a column without a bench unit is shown as it is."""
    return _SHOWN.get(column, ("", 1.0, 0.0))


def direction_word(direction: float) -> str:
    """How the spool moved."""
    return "rising" if direction > 0 else "falling"


def region_words(limits: Mapping[str, tuple[float, float]], run_names: tuple[str, ...] = ()) -> str:
    """The box in words, position first; "everywhere" where nothing bounds it. Limits are SI."""
    columns = sorted(limits, key=lambda column: column not in ("spool_position", "time", "frequency"))
    words = [_range(column, *limits[column], run_names) for column in columns]
    return ", ".join(word for word in words if word) or "everywhere"


def miss_words(channel: str, mean: float, rms: float) -> tuple[str, str]:
    """(size with its unit, side) of a misfit: its mean, "high" or "low"; where both signs outweigh it, its RMS, "off"."""
    unit = reading_unit(channel)
    size, side = abs(mean), "high" if mean > 0 else "low"
    if rms > 2.0 * size:
        size, side = rms, "off"
    return f"{significant(size * unit.factor, 2)} {unit.label}", side


def _range(column: str, low: float, high: float, run_names: tuple[str, ...]) -> str:
    if column == "direction":
        return "" if low != high else f"{direction_word(low)} sweeps"
    if column == "run":
        return _runs(round(low), round(high), run_names)
    unit, factor, offset = condition_unit(column)
    low, high = low * factor + offset, high * factor + offset
    # A step test lasts a second, a sweep minutes.
    digits = 3 if column == "time" else 0 if max(abs(low), abs(high)) >= 10.0 else 2
    first, last = (f"{value:.{digits}f}" if unit else significant(value, 3) for value in (low, high))
    if first == "-0":
        first = "0"
    figures = first if first == last else f"{first} to {last}"
    if not unit:
        return f"{column} {figures}"
    return f"{figures} {unit}{_AFTER.get(column, '')}"


def _runs(low: int, high: int, names: tuple[str, ...]) -> str:
    if 0 <= low <= high < len(names):
        return f"run {names[low]}" if low == high else f"runs {names[low]} to {names[high]}"
    return f"run {low}" if low == high else f"runs {low} to {high}"
