"""Logs with one nuisance off are otherwise the same."""

import numpy as np
import pytest
from reference.nuisance_logs import NUISANCES, Log, draw, record_of


def columns(log: Log, test: str) -> dict[str, np.ndarray]:
    lines = record_of(log, "log").csv[f"{test}.csv"].splitlines()
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    return dict(zip(lines[0].split(","), rows.T, strict=True))


@pytest.mark.parametrize("off", NUISANCES)
def test_a_log_is_the_same_but_for_the_nuisance_that_is_off(off):
    seed = next(s for s in range(1, 50) if draw(s).phi > 0.0 and not draw(s).current)
    whole, without = (draw(seed, off=o, most_rows=1200) for o in ((), (off,)))
    assert (whole.valve, whole.effects, whole.runs[0][:3], whole.rows) == (
        without.valve, without.effects, without.runs[0][:3], without.rows,
    )  # fmt: skip
    here, there = columns(whole, "leakage"), columns(without, "leakage")
    assert list(here) == list(there)
    # What does not hang on it is the same to the last digit.
    same = {name for name in here if np.array_equal(here[name], there[name])}
    untouched = {
        "conditions": {"time [s]", "spool_position [um]", "leakage_flow [l/min]"},
        "position": {"time [s]", "supply_pressure [bar]", "temperature [degC]", "leakage_flow [l/min]"},
        "rounding": {"time [s]", "supply_pressure [bar]", "temperature [degC]"},
        "dither": {"time [s]", "supply_pressure [bar]", "temperature [degC]"},
        "wander": {"time [s]", "spool_position [um]"},
        "share": {"time [s]", "spool_position [um]", "supply_pressure [bar]", "temperature [degC]"},
        "memory": {"time [s]", "spool_position [um]", "supply_pressure [bar]", "temperature [degC]"},
        "rates": {"run"},
    }
    assert untouched[off] <= same
    assert len(same) < len(here)
