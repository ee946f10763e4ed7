"""Rows of a test that is yet to be run, from the `plan` table of its `[tests.<name>]`: sweeps, conditions, rates. No JAX.

Each condition is swept up and down once, denser near null where the curves bend; repeats come after all conditions, so that they
measure the noise. What the table makes goes the way of a file's rows.
"""

from itertools import product

import numpy as np
import pandas as pd

from .record import ValveData
from .sheets import SheetRows
from .shown_units import BAR, CELSIUS, UM
from .test_tables import StaticTest
from .toml_file import TomlTable


KEYS = ("reach", "points", "temperatures", "supply_pressures", "load_pressures", "rates", "repeats")
REACH = {"pressure_gain": 0.3}  # of the stroke, where nothing is said; else all of it
POINTS, FEWEST, MOST_ROWS = 41, 5, 200_000
DENSER = 3.5  # of sinh: points near null lie thirty times as close as at the ends


def planned_rows(test: StaticTest, valve: ValveData) -> SheetRows:
    """The rows as those of a sheet, numbered from 1. Raises BenchInputError."""
    table = test.table.table("plan")
    assert table is not None
    table.refuse_unknown(KEYS)
    points, repeats = _count(table, "points", POINTS, FEWEST), _count(table, "repeats", 1, 1)
    given = table.quantity("reach", "length", full_scale=valve.stroke, sign="positive")
    x = _cycle(REACH.get(test.name, 1.0) * valve.stroke if given is None else given, points)
    levels = {
        "temperature [degC]": [value - CELSIUS for value in _list(table, "temperatures", "temperature")],
        "supply_pressure [bar]": [value * BAR for value in _list(table, "supply_pressures", "pressure")],
        "load_pressure [bar]": [value * BAR for value in _list(table, "load_pressures", "pressure")],
    }
    if test.name == "load_flow" and not levels["load_pressure [bar]"]:
        raise table.error('load_pressures is missing: load_pressures = ["-100 bar", "0 bar", "100 bar"]')
    if test.name != "load_flow" and levels["load_pressure [bar]"]:
        raise table.error(
            "is of load_flow only: in this test the load pressure is none of the conditions", "load_pressures"
        )
    rates = _list(table, "rates", "velocity")
    if any(not rate > 0.0 for rate in rates):
        raise table.error("must all be positive; sweeps go up and down by themselves", "rates")
    names = [name for name, values in levels.items() if values]
    # By places and not by values: rates take turns from one condition to the next in every direction.
    places = list(product(*(range(len(levels[name])) for name in names)))
    if repeats * len(places) * len(x) > MOST_ROWS:
        raise table.error(f"makes more than {MOST_ROWS:,} rows; plan fewer points or conditions")
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))])
    blocks = []
    for run, (again, place) in enumerate(product(range(repeats), places), start=1):
        del again
        block = {"run": np.full(len(x), str(run)), "spool_position [um]": x * UM}
        block |= {name: np.full(len(x), levels[name][i]) for name, i in zip(names, place, strict=True)}
        if rates:
            block["time [s]"] = way / rates[sum(place) % len(rates)]
        blocks.append(pd.DataFrame(block))
    frame = pd.concat(blocks, ignore_index=True)
    header = list(frame.columns)
    return SheetRows(test.file, header, 0, np.arange(1, len(frame) + 1), frame.set_axis(range(len(header)), axis=1))


def _cycle(reach: float, points: int) -> np.ndarray:
    """Positions [m] up and down; those of the way down lie between those of the way up."""
    s = np.linspace(-1.0, 1.0, points)
    between = np.concatenate([0.5 * (s[:-1] + s[1:]), s[:1]])
    down = np.sort(between)[::-1]
    return reach * np.sinh(DENSER * np.concatenate([s, down])) / np.sinh(DENSER)


def _count(table: TomlTable, key: str, default: int, least: int) -> int:
    value = table.data.get(key, default)
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise table.error(f"must be a whole number of {least} or more", key)
    return value


def _list(table: TomlTable, key: str, kind: str) -> list[float]:
    if key not in table:
        return []
    texts = table.data[key]
    if not isinstance(texts, list) or not texts:
        raise table.error("must be a list of quantities in brackets", key)
    return [table.as_quantity(key, text, kind) for text in texts]
