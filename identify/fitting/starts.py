"""Where a fit starts: the hydraulic null read off the curves, and basin hopping out of local minima. NumPy only.

The null is where a curve crosses zero or peaks, which spares the fit a search for it.

Local minima come from kinks: where an opening passes zero the overlapped land starts at once, so every row near null puts a
kink into the chi-square as a function of the underlap. A search that slid into a valley between two kinks is set down on the
other side of them.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.reduction.monotone_pieces import piece_bounds, sweep_ids
from thermohyd.side_by_side import each

from .least_squares import LeastSquaresResult


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
        sweeps = piece_bounds(sweep_ids(test, across_conditions=True))
        found = [way(test.spool_position[a:b], channel.value[a:b]) for a, b in sweeps if b - a >= 5]
        sure = [null for null in found if null is not None]
        if sure:
            return float(np.median(sure))
    return None


MICRON = 1e-6
# Tried on both sides, nearest last: rows near null lie a fraction of a micron to some microns apart.
MOVES = (6.0, 3.0, 1.5, 0.75, 0.35)
# Tried as well [um]: what valves are made for. A hollow at a few tenths of a micron is missed by steps from one at ten.
PLACES = (0.0,)
MOST_ROUNDS = 6
BETTER = 1e-6  # relative fall of the cost that counts
# A minimum on a kink has slopes on both sides, of this many standard errors at most; beyond it something else is wrong.
STEEPEST_KINK = 1.0


def basin_hopping(
    best: LeastSquaresResult,
    names: tuple[str, ...],
    solve_from: Callable[[np.ndarray, float], LeastSquaresResult],
    *,
    moves: tuple[float, ...] = MOVES,  # of the underlap, um
    places: tuple[float, ...] = PLACES,
    rounds: int = MOST_ROUNDS,
    better: float = BETTER,
    usual: Mapping[str, float] = MappingProxyType({}),
) -> LeastSquaresResult:
    """Basin hopping in the underlap: restart from `best` with it moved, take what is lower, until no move helps. So of entries at a
    limit, from their `usual` values: where a flow is turbulent everywhere, say, no slope says that it is not.

    Few, warm, cheap solves. Where the search from every side ends at the same place and finds no way down, that place is a
    minimum although its slope does not vanish: it lies on a kink, and the result says so.
    solve_from: of a start and of the cost below which its end is of use: a search that will not get there may be given up.
    """
    start = None
    for _ in range(rounds):
        start = best
        trapped = {name: usual[name] for i, name in enumerate(names) if start.active[i] and name in usual}
        others = [trapped] if trapped else []
        if "underlap" in names:
            own = float(start.p[names.index("underlap")])
            beside = [own + side * MICRON for step in moves for side in (step, -step)]
            others += [{"underlap": underlap} for underlap in (*beside, *(place * MICRON for place in places))]
        if not others:
            return best
        below = start.cost * (1.0 - better)

        def move(other: Mapping[str, float], at: np.ndarray = start.p, below: float = below) -> LeastSquaresResult:
            return solve_from(np.array([other.get(n, value) for n, value in zip(names, at, strict=True)]), below)

        for tried in each(move, others):
            if tried.cost < best.cost * (1.0 - better):
                best = tried
        if best is start:
            break
    if best.converged:
        return best
    # A search that creeps along a kink for ever has ended too, once no move from there leads lower.
    return on_a_kink(replace(best, exhausted=True) if best is start else best)


def ended_on_a_slope(result: LeastSquaresResult) -> bool:
    """Whether a search found no way down from where the slope is steeper than a kink's: it is stuck, and this is no minimum."""
    return result.exhausted and not result.converged and result.relative_offset > STEEPEST_KINK


def on_a_kink(result: LeastSquaresResult) -> LeastSquaresResult:
    """The same result, believed if its search ended by itself with no more slope than a kink has."""
    if not (result.exhausted and result.relative_offset <= STEEPEST_KINK and np.all(np.isfinite(result.jacobian))):
        return result
    message = f"converged in {result.steps} steps, on a kink where an edge closes at a measured position"
    return replace(result, converged=True, nearly=False, message=message)
