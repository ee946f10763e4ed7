"""Dates and times of day in a log as seconds since its first row: ISO 8601, 31.12.2026, 12/31/2026, or a time alone."""

import re
from typing import Any

import numpy as np
import pandas as pd


DAY = 86400.0  # s
TIME = r"\d{1,2}:\d{2}(?::\d{2}(?:[.,]\d+)?)?(?:\s*[AaPp][Mm])?(?:\s*(?:Z|[+-]\d{2}:?\d{2}))?"
DATE = r"(?:\d{4}([-/.])\d{1,2}\1\d{1,2}|\d{1,2}([-/.])\d{1,2}\2\d{4})"
# A time alone needs its seconds: "12:30" may be hours and minutes, or minutes and seconds.
CLOCK = re.compile(rf"{DATE}[T ,]\s*{TIME}|\d{{1,3}}:\d{{2}}:\d{{2}}(?:[.,]\d+)?(?:\s*[AaPp][Mm])?")
PARTS = (
    r"^(?:(?P<a>\d{1,4})(?P<mark>[-/.])(?P<b>\d{1,2})[-/.](?P<c>\d{1,4})[T ,]\s*)?"
    r"(?P<hour>\d{1,3}):(?P<minute>\d{2})(?::(?P<second>\d{2}(?:[.,]\d+)?))?"
    r"(?:\s*(?P<half>[AaPp])[Mm])?(?:\s*(?P<zone>Z|[+-]\d{2}:?\d{2}))?$"
)


def is_clock_time(cell: str) -> bool:
    """Whether a cell is a date with a time, or a time of day with seconds."""
    return len(cell) <= 40 and CLOCK.fullmatch(cell) is not None


def clock_seconds(series: pd.Series, text: pd.Series) -> np.ndarray:
    """Seconds since the first row (n,), NaN where a cell is neither date nor time. text: the series as stripped text.

    Raises ValueError with a sentence where day and month cannot be told apart and it matters.
    """
    if series.dtype.kind == "M":
        found = (series - series.dropna().iloc[0] if series.notna().any() else series - series).dt.total_seconds()
        return found.to_numpy(dtype=float)
    if series.dtype.kind == "m":
        found = series.dt.total_seconds().to_numpy(dtype=float)
        return found - found[np.isfinite(found)][0] if np.isfinite(found).any() else found
    parts = text.str.extract(PARTS)
    hour = _numbers(parts["hour"])
    half = parts["half"].str.lower()
    hour = np.where(half.notna(), hour % 12 + 12.0 * (half == "p"), hour)
    second = _numbers(parts["second"].str.replace(",", ".", regex=False))
    minute = _numbers(parts["minute"])
    seconds = 3600.0 * hour + 60.0 * minute + np.nan_to_num(second) - _zone(parts["zone"])
    seconds[(minute > 59.0) | (second >= 61.0)] = np.nan
    if parts["a"].notna().any():
        seconds[hour > 24.0] = np.nan
        days = _days(parts)
        seconds += DAY * (days - _first(days))
    else:  # over midnight a time of day falls by almost a day
        valid = np.flatnonzero(np.isfinite(seconds))
        seconds[valid[1:]] += DAY * np.cumsum(np.diff(seconds[valid]) < -0.5 * DAY)
    return seconds - _first(seconds)


def _first(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(finite[0]) if len(finite) else 0.0


def _numbers(column: Any) -> np.ndarray:
    return np.array(pd.to_numeric(column, errors="coerce"), dtype=float)


def _zone(column: pd.Series) -> np.ndarray:
    """Seconds by which each row's clock is ahead of UTC; 0 where none is given."""
    number = np.nan_to_num(_numbers(column.str.replace(":", "", regex=False)))  # "Z" becomes 0
    return np.sign(number) * (np.abs(number) // 100 * 3600.0 + np.abs(number) % 100 * 60.0)


def _days(parts: pd.DataFrame) -> np.ndarray:
    """Days since 1970 of each row, NaN where the date is none."""
    a, b, c = (_numbers(parts[name]) for name in "abc")
    if (a > 31.0).any():  # the year stands first
        return _day_numbers(a, b, c)
    day, month = a, b
    if "." not in set(parts["mark"]):  # with dots, the day stands first everywhere
        if (a > 12.0).any() and (b > 12.0).any():
            return np.full(len(parts), np.nan)
        if (b > 12.0).any():
            day, month = b, a
        elif not (a > 12.0).any() and len({*zip(a[np.isfinite(a)], b[np.isfinite(a)], strict=True)}) > 1:
            raise ValueError(
                "the day and the month of these dates cannot be told apart; write them as 2026-03-01 or 01.03.2026"
            )
    return _day_numbers(c, month, day)


def _day_numbers(year: np.ndarray, month: np.ndarray, day: np.ndarray) -> np.ndarray:
    stamps = pd.to_datetime(pd.DataFrame({"year": year, "month": month, "day": day}), errors="coerce")
    days = (stamps - pd.Timestamp(1970, 1, 1)).dt.total_seconds() / DAY
    return days.to_numpy(dtype=float)
