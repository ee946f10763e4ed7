"""When does a valve reach a limit? Limits from a file, and the time at which a line with error bars crosses one.

["MOOG 76-101"]                # a type; "*" holds for every type
clearance = { max = "6 um" }   # a parameter or effect, with min, max or both
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from thermohyd.identify.bench.errors import BenchInputError, quoted
from thermohyd.identify.bench.toml_file import TomlSource, TomlTable

from .pooling import Pooled


ANY_TYPE = "*"
FAR = 100.0  # spans of the records so far, beyond which "never" is said
LEVEL = 0.95


@dataclass(frozen=True)
class Limit:
    """As it is written; a text with a unit, since which unit is SI depends on what it is compared with."""

    low: str | None
    high: str | None

    def values(self, unit: str) -> dict[str, float]:
        """{"min", "max": SI} for a quantity whose SI unit this is. Raises ValueError where the units do not fit."""
        return {key: in_unit(text, unit) for key, text in (("min", self.low), ("max", self.high)) if text is not None}


def in_unit(text: str, unit: str) -> float:
    """ "6 um" in m. Raises ValueError."""
    from pint import Quantity
    from pint.errors import PintError

    try:
        quantity = Quantity(text)
        return float(quantity.to(unit if unit not in ("", "1", "-") else "dimensionless").magnitude)
    except (PintError, ValueError, TypeError, AttributeError, AssertionError) as error:
        raise ValueError(f"{quoted(text)} is not a quantity in {unit or 'dimensionless'} ({error})") from None


def read_limits(path: Path) -> dict[str, dict[str, Limit]]:
    """{type: {quantity: limit}}. Raises BenchInputError."""
    root = TomlSource(path).root
    found: dict[str, dict[str, Limit]] = {}
    for type_ in root.data:
        table = root.table(type_)
        assert table is not None
        found[type_] = {name: _limit(table, name) for name in table.data}
    return found


def _limit(table: TomlTable, name: str) -> Limit:
    entry = table.table(name) if isinstance(table.data[name], dict) else None
    if entry is None:
        raise table.error('must be a table, such as { max = "6 um" }', name)
    entry.refuse_unknown(("min", "max"))
    ends = [None if (value := entry.data.get(key)) is None else str(value) for key in ("min", "max")]
    if ends == [None, None]:
        raise table.error("needs min, max or both", name)
    return Limit(*ends)


def limits_of(limits: Mapping[str, Mapping[str, Limit]], type_: str, name: str, unit: str) -> dict[str, float]:
    """{"min", "max": SI} of a quantity of a type. Raises BenchInputError where a unit does not fit."""
    limit = limits.get(type_, {}).get(name) or limits.get(ANY_TYPE, {}).get(name)
    if limit is None:
        return {}
    try:
        return limit.values(unit)
    except ValueError as error:
        raise BenchInputError(f"limit of {name}: {error}") from None


@dataclass(frozen=True)
class Crossing:
    """When a line reaches a limit, counted from `now` in the unit of the time; infinite where it may never.

    low, high: of the 95 % interval; middle: by then it is as likely as not. now_beyond: probability that it is beyond already.
    """

    low: float
    middle: float
    high: float
    now_beyond: float


def crossing(pooled: Pooled, valve: int, now: float, limit: float, above: bool, span: float) -> Crossing:
    """above: the limit is an upper one. span: of the records, which says what is far.

    By t it is reached with the probability that the line lies beyond there: level and slope are jointly normal, so that the
    bounds of the interval are where the band of the line meets the limit (Fieller, Quarterly J. Pharmacy 17, 1944).
    """
    sign = 1.0 if above else -1.0

    def score(t: float) -> float:
        value, std = pooled.at(valve, t)
        return sign * (float(value[0]) - limit) / max(float(std[0]), 1e-300)

    ends = []
    for probability in (0.5 - LEVEL / 2, 0.5, 0.5 + LEVEL / 2):
        z = float(norm.ppf(probability))
        ends.append(_first(lambda t, z=z: score(t) - z, now, FAR * max(span, 1e-9)) - now)
    return Crossing(*ends, now_beyond=float(norm.cdf(score(now))))


def _first(function, start: float, reach: float) -> float:
    """Where it first rises above zero from `start` on; infinite where it does not within `reach`."""
    if function(start) >= 0.0:
        return start
    grid = start + reach * np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 60)])
    for low, high in pairwise(grid):
        if function(float(high)) >= 0.0:
            root: Any = brentq(function, float(low), float(high), xtol=1e-9 * reach)
            return float(root)
    return math.inf
