"""Logs with one nuisance off are otherwise the same, and what a reduction says of their noise is what their noise is."""

from dataclasses import replace

import numpy as np
import pytest
from reference.nuisance_logs import NUISANCES, Log, draw, readings, record_of, true_rows, write

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.reduction.reduce import is_raw_log, reduce_test


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


def apart(log: Log, test: TestRecord) -> np.ndarray:
    """Squares (points,) of what the points of a reduced log are off, in their standard errors."""
    found, exact = reduce_test(test), replace(log, dither=0.0)
    assert found.rows_of_log is not None
    starts = np.append(0, np.cumsum(found.rows_of_log)[:-1])
    mean = lambda values: np.add.reduceat(values, starts) / found.rows_of_log
    true, place = readings(exact, test.name), mean(true_rows(exact, test.name)[1])
    squares = []
    for channel in found.channels:
        value = mean(true[channel.name])
        # Points stand on the smooth sweep, which is a little aside of the true one.
        slope = np.gradient(value, np.arange(len(value))) / np.where(
            np.gradient(place) == 0.0, np.inf, np.gradient(place)
        )
        part = 0.0 if channel.position_part is None else channel.position_part
        assert channel.std is not None
        off = channel.value - value - slope * (found.spool_position - place)
        squares.append(off**2 / (channel.std**2 + part**2))
    return np.concatenate(squares)


def test_points_of_logs_scatter_as_they_are_said_to(tmp_path):
    """Flow and pressure of logs with all nuisances, noise not stated: the median square of a normal error is 0.455."""
    medians = []
    for seed in (7, 13, 17):
        log = draw(seed)
        write(tmp_path / str(seed), log)
        for name, test in read_record(tmp_path / str(seed)).tests.items():
            if name != "leakage" and is_raw_log(test):
                medians.append(float(np.median(apart(log, test))))
    assert len(medians) >= 5
    assert 0.33 < np.mean(medians) < 0.6
