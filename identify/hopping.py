"""Out of the wrong valley: an edge that closes exactly at a measured position makes a kink, and between kinks lie local minima.

Where an opening passes zero the overlapped land starts at once, so every row near null puts a kink into the chi-square
as a function of the underlap. A search that slid into a valley between two kinks is set down on the other side of them.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .least_squares import LeastSquaresResult


MICRON = 1e-6
# Tried on both sides, nearest last: rows near null lie a fraction of a micron to some microns apart.
HOPS = (6.0, 3.0, 1.5, 0.75, 0.35)
MOST_ROUNDS = 6
BETTER = 1e-6  # relative fall of the cost that counts
# A minimum on a kink has slopes on both sides, of this many standard errors at most; beyond it something else is wrong.
STEEPEST_KINK = 1.0


def hop(
    best: LeastSquaresResult,
    names: tuple[str, ...],
    solve_from: Callable[[np.ndarray], LeastSquaresResult],
    *,
    hops: tuple[float, ...] = HOPS,
    rounds: int = MOST_ROUNDS,
) -> LeastSquaresResult:
    """Restart from `best` with the underlap moved, take what is lower, until no move helps. Few, warm, cheap solves.

    Where the search from every side ends at the same place and finds no way down, that place is a minimum although its
    slope does not vanish: it lies on a kink, and the result says so.
    """
    if "underlap" not in names:
        return best
    i = names.index("underlap")
    start = None
    for _ in range(rounds):
        start = best
        for step in hops:
            for side in (step, -step):
                moved = start.p.copy()
                moved[i] += side * MICRON
                tried = solve_from(moved)
                if tried.cost < best.cost * (1.0 - BETTER):
                    best = tried
        if best is start:
            break
    if best.converged:
        return best
    # A search that creeps along a kink for ever has ended too, once no hop from there leads lower.
    return on_a_kink(replace(best, exhausted=True) if best is start else best)


def on_a_kink(result: LeastSquaresResult) -> LeastSquaresResult:
    """The same result, believed if its search ended by itself with no more slope than a kink has."""
    if not (result.exhausted and result.relative_offset <= STEEPEST_KINK and np.all(np.isfinite(result.jacobian))):
        return result
    message = f"converged in {result.steps} steps, on a kink where an edge closes at a measured position"
    return replace(result, converged=True, message=message)
