"""Where most readings agree with a model: least trimmed squares, for a model that lacks something.

A fit to all rows lets the rows that the model cannot meet bend it, far enough to end in another valley. Least trimmed squares fit the
share of the rows that agrees best, whichever these are (Rousseeuw and Van Driessen, Data Mining and Knowledge Discovery 12, 2006:
concentration steps from small subsets). A subset here is what one test shows.
"""

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from thermohyd.side_by_side import each

from .uncertainty import Key


FAR = 3.0  # reduced chi-square from which a model counts as bent by what it misses
SHARE = 0.6  # of the rows: with what one test shows left out, more than half are left in most records
STEPS = 6  # of concentration, at most: each lowers the trimmed chi-square, the first few by nearly all
SETTLED = 0.98  # of the last trimmed chi-square: steps that gain less only polish, which the fit does


def trimmed_points[Point](
    start: Point,
    rows: Mapping[Key, slice],
    asked: np.ndarray,
    fit_to: Callable[[np.ndarray, Point], Point],
    residual_at: Callable[[Point], np.ndarray],
) -> list[Point]:
    """Points at which most rows agree, the best first: one each from all rows and from every test alone.

    rows: of each channel, among `asked` (rows,), which says which ones count. fit_to(mask, point): the fit to these rows from a
    point; residual_at(point): (rows,), of all rows, in standard deviations.
    """

    def agreeing(begin: np.ndarray) -> tuple[float, Point] | None:
        at, last, best = fit_to(begin, start), np.inf, None
        for _ in range(STEPS):
            size = np.where(asked, np.square(residual_at(at)), np.inf)
            if not np.isfinite(size[asked]).all():
                break
            kept = size <= np.quantile(size[asked], SHARE)
            chi2 = float(np.sum(size[kept]))
            if chi2 > SETTLED * last:
                break
            last, best = chi2, at
            at = fit_to(kept, at)
        return None if best is None else (last, best)

    subsets = [begin & asked for begin in _subsets(rows, len(asked)) if (begin & asked).any()]
    found = [one for one in each(agreeing, subsets) if one is not None]
    return [point for _, point in sorted(found, key=lambda item: item[0])]


def _subsets(rows: Mapping[Key, slice], count: int) -> Iterable[np.ndarray]:
    yield np.ones(count, dtype=bool)
    tests = dict.fromkeys(test for test, _ in rows)
    for test in tests if len(tests) > 1 else ():
        own = np.zeros(count, dtype=bool)
        for key, place in rows.items():
            own[place] |= key[0] == test
        yield own
