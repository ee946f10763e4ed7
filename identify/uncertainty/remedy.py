"""Which test would narrow a parameter most? The menu of `diagnosis/next_test.py`, read once more as a question of error bars.

D-optimal design asks for all parameters at once (Atkinson, Donev and Tobias, Optimum Experimental Designs, 2007); here every
parameter has its own answer, as a reader looks for it in that parameter's row.
"""

from collections.abc import Callable, Iterable

import numpy as np

from thermohyd.identify.diagnosis.next_test import menu

from .finished_fit import FinishedFit, effects_of
from .result import Remedy


WORTH_SAYING = 0.9  # of today's standard error: what narrows less is no remedy


def remedies(
    around: FinishedFit, names: Iterable[str], say: Callable[[str], None] = lambda _: None
) -> dict[str, Remedy]:
    """{parameter: the change of conditions under which its standard error falls most, its tests run once more that way}.

    Parameters at a limit are freed for it, as the new test is to tell them apart from it. Without those that no change helps.
    """
    names = tuple(names)
    if not names:
        return {}
    say("which test would tell more")
    problem, effects, values = around.problem, effects_of(around.fitted), around.fitted.values
    free = around.fitted.free
    scale = np.array([problem.scale_of(name) for name in free])
    here = problem.evaluate(values, effects)
    now = here.columns[:, [here.order.index(name) for name in free]] * scale
    today = _spread(now)
    found: dict[str, Remedy] = {}
    for words, tests in menu(problem.tests):
        there = problem.under(tests, here).evaluate(values, effects)
        columns = there.columns[: -len(problem.parameters), [there.order.index(name) for name in free]] * scale
        if not np.isfinite(columns).all():
            continue
        after = _spread(np.concatenate([now, columns]))
        for name in names:
            i = free.index(name)
            factor = float(after[i] / today[i])
            if factor < WORTH_SAYING and (name not in found or factor < found[name].factor):
                found[name] = Remedy(f"repeat the tests {words}", factor)
    return found


def _spread(columns: np.ndarray) -> np.ndarray:
    """Standard errors (p,) beside columns (rows, p) in natural steps; a direction that nobody sees is as wide as 1e6 of them."""
    return np.sqrt(np.diag(np.linalg.inv(columns.T @ columns + 1e-12 * np.eye(columns.shape[1]))))
