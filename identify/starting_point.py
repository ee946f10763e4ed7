"""Where the hydraulic null lies, read off the curves: a start that spares the fit a search for it. NumPy only."""

import numpy as np

from .record import TestRecord


def _sweeps(test: TestRecord) -> list[np.ndarray]:
    """Row numbers of each stretch of one run in one direction under the same nominal conditions."""
    changed = (np.diff(test.run) != 0) | (np.diff(test.direction) != 0)
    return [part for part in np.split(np.arange(test.rows), np.flatnonzero(changed) + 1) if len(part) >= 5]


def _crossing(position: np.ndarray, value: np.ndarray) -> float | None:
    """Position where a reading crosses zero, by a line through the points around its middle sign change."""
    order = np.argsort(position, kind="stable")
    x, y = position[order], value[order]
    changes = np.flatnonzero(np.sign(y[:-1]) * np.sign(y[1:]) < 0)
    if len(changes) == 0:
        return None
    i = int(changes[len(changes) // 2])
    return float(x[i] - y[i] * (x[i + 1] - x[i]) / (y[i + 1] - y[i]))


def _peak(position: np.ndarray, value: np.ndarray) -> float | None:
    """Centre of gravity of the part of a leakage curve above the middle of its range, if the curve has both flanks."""
    half = 0.5 * (value.min() + value.max())
    high = value > half
    order = np.argsort(position, kind="stable")
    if high.sum() < 3 or high[order[0]] or high[order[-1]]:
        return None
    return float(np.average(position[high], weights=value[high] - half))


def null_position(tests: dict[str, TestRecord]) -> float | None:
    """Spool position at hydraulic null [m], from the sharpest test that shows it; None where none does.

    The pressure gain crosses zero most steeply, then the flow; the leakage's peak is the least sharp. Sweeps up and
    down, and runs, are combined by their median.
    """
    ways = (
        ("pressure_gain", "load_pressure", _crossing),
        ("flow_gain", "flow", _crossing),
        ("leakage", "leakage_flow", _peak),
    )
    for name, channel_name, way in ways:
        test = tests.get(name)
        channel = None if test is None else next((c for c in test.channels if c.name == channel_name), None)
        if test is None or channel is None:
            continue
        found = [way(test.spool_position[rows], channel.value[rows]) for rows in _sweeps(test)]
        sure = [null for null in found if null is not None]
        if sure:
            return float(np.median(sure))
    return None
