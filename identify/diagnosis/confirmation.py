"""Must a name prove itself? Every condition is left out once, and effects must predict it better than the model without them.

2 ln E = sum(r0^2 - r1^2) over all rows, each predicted by a fit that did not see its condition: r0 without the effects, r1 with
them (E-values: Vovk and Wang, Annals of Statistics 49, 2021; leaving out groups of rows that share an error: Roberts et al.,
Ecography 40, 2017). A wrong label, or a misfit of one condition that several effects were bent to, predicts nothing elsewhere.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.bench_faults import condition_levels, info_of, is_fault
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.reduction.monotone_pieces import piece_bounds, run_ids

from .screening import Projection


PROVEN = 10.6  # 2 ln 200: a likelihood ratio of 200 on rows not seen, a p-value of 0.005 at most
# Standard errors from which on an effect would be beyond chance even if the noise had twice the variance that was estimated: the squared
# critical score of a library is 14 to 16.
NEAR_CHANCE = 5.5
# Parts that are left out in turn: about the five to ten of Hastie et al., The Elements of Statistical Learning, 2009, section 7.10.
FEWEST, MOST = 4, 8
STRETCHES = 12  # of each sweep, where a record has too few conditions and runs
# Of a parameter's own scale per unit of chi-square: holds what the rows left cannot show, and nothing else.
RIDGE = 1e-4
# Of a fault's column, below which a part has it all: what the noise model carries over from row to row is no sign of it elsewhere.
ELSEWHERE = 0.1


def parts_left_out(tests: Mapping[str, TestRecord]) -> np.ndarray:
    """Number of the part (rows,) that each row of a fit's residual belongs to, priors not included: conditions, of all tests
    at once; runs where these are too few; stretches of sweeps where these are, too."""
    by_test = _common(condition_levels(tests))
    count = _count(by_test)
    if count < FEWEST:
        by_test = {name: code + count * _ranks(tests[name].run) for name, code in by_test.items()}
    by_test = _common(by_test)
    if _count(by_test) < FEWEST:
        by_test = {name: _stretches(test) for name, test in tests.items()}
    # Neighbouring conditions apart, so that a corner of the range is not left out as a whole.
    by_test = {name: code % MOST for name, code in by_test.items()}
    return np.concatenate([by_test[name] for name, test in tests.items() for _ in test.channels])


def _common(codes: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The codes as numbers 0, 1, ... that all tests share."""
    known = np.unique(np.concatenate([*codes.values()]))
    return {name: np.searchsorted(known, code) for name, code in codes.items()}


def _count(codes: Mapping[str, np.ndarray]) -> int:
    return 1 + max((int(code.max()) for code in codes.values()), default=-1)


def _ranks(run: np.ndarray) -> np.ndarray:
    return np.unique(run, return_inverse=True)[1].reshape(-1)


def _stretches(test: TestRecord) -> np.ndarray:
    parts = np.zeros(test.rows, dtype=int)
    for start, stop in piece_bounds(run_ids(test)):
        parts[start:stop] = (np.arange(stop - start) * STRETCHES // max(stop - start, 1)) % FEWEST
    return parts


def predicted_apart(fit: Fit, parts: np.ndarray) -> np.ndarray:
    """Whitened residuals (rows,) of each row, predicted by the model fitted without the row's part: one Gauss-Newton step from `fit`.

    An amount that the rows left do not show goes to 0, as nobody would then have added it. Not so a fault of the part itself: it is no
    claim about other rows, and at 0 its rows would drown what effects do there; it takes the amount that they show. Rows of a part
    below 0 are in every fit.
    """
    names = [name for name in fit.free if name not in fit.active]
    scales = np.array([_scale(name, fit) for name in names])
    columns = fit.columns[:, [fit.order.index(name) for name in names]] * scales
    # Weak knowledge beside the readings: an amount is about 0, to its largest usual size; a parameter is where it is.
    amounts = [name in fit.effects for name in names]
    weak = np.array(
        [
            scale / info_of(name).typical[1] if a else RIDGE
            for name, scale, a in zip(names, scales, amounts, strict=True)
        ]
    )
    start = np.array(
        [fit.values[name] / scale if a else 0.0 for name, scale, a in zip(names, scales, amounts, strict=True)]
    )
    faults = np.array([is_fault(name) for name in names], dtype=bool)
    found = fit.residual[: len(parts)].copy()
    whole = np.concatenate([parts, np.full(len(fit.residual) - len(parts), -1)])
    for part in np.unique(parts[parts >= 0]):
        kept = (whole != part) & fit.used
        left = parts == part
        size = np.linalg.norm(columns[kept], axis=0)
        own = faults & (size < ELSEWHERE * np.linalg.norm(columns[fit.used], axis=0))
        matrix = np.concatenate([columns[kept][:, ~own], np.diag(weak)[:, ~own]])
        target = np.concatenate([fit.residual[kept], weak * np.where(own, 0.0, start)])
        step = np.linalg.lstsq(matrix, -target, rcond=None)[0]
        found[left] += columns[: len(parts)][left][:, ~own] @ step
        if own.any():
            there = np.flatnonzero(left & fit.used[: len(parts)])
            found[there] = Projection.beside(columns[there][:, own])(found[there])
    return found


def fit_of_rows_left(rest: Problem, names: Iterable[str], values: Mapping[str, float]) -> Fit:
    """The fit of a model's effects and faults, begun at its values, to the rows that `rest` uses.

    Without what these cannot tell from a misfit of the whole: a fault of one place where none of the other rows of its test are left. It
    says that the place differs from those; without them it would take up anything.
    """
    told = tuple(name for name in names if not _alone(rest, name))
    return rest.fit(told, {**values, **{name: 0.0 for name in names if name not in told}})


def _alone(problem: Problem, name: str) -> bool:
    """Whether it is a fault of one place, and no other row of its test is used."""
    fault = problem.faults.get(name)
    if problem.used is None or fault is None or not fault.place:
        return False
    used = [problem.used[rows] for key, rows in problem.rows().items() if key[0] in fault.shapes]
    own = [fault.shapes[key[0]] != 0.0 for key in problem.rows() if key[0] in fault.shapes]
    return not any(bool(np.any(u & ~o)) for u, o in zip(used, own, strict=True))


def _scale(name: str, fit: Fit) -> float:
    """The amount's natural step; of a parameter what changes the residuals by about one."""
    if name in fit.effects:
        return info_of(name).scale
    length = float(np.linalg.norm(fit.column(name)))
    return 1.0 / length if length > 0.0 else 1.0


@dataclass(frozen=True)
class Confirmation:
    """2 ln E of all effects together over the model without them, and of each over the model without it. scale: of chi-square.

    held_out: of each that is near chance, on the rows alone that took no part in its choice, predicted by a fit that did not see them.
    """

    together: float
    each: dict[str, float]
    held_out: dict[str, float] = field(default_factory=dict)

    @property
    def weakest(self) -> str:
        return min(self.each, key=lambda name: self.each[name])

    def p_value(self, name: str) -> float:
        """1/E of an effect: what its p-value must not be below."""
        return float(np.exp(-0.5 * max(self.each[name], 0.0)))


def confirmation(
    problem: Problem, fit: Fit, base: Fit, without: Mapping[str, Fit], scale: float, held: np.ndarray
) -> Confirmation:
    """How the effects of `fit` do where they were not fitted. base: without any of them; without {effect: fit without it}.

    held (rows,): True in the rows that took no part in the choice.
    """
    parts = parts_left_out(problem.tests)
    square = lambda f: float(np.sum(predicted_apart(f, parts) ** 2))
    there = lambda f: float(np.sum(predicted_apart(f, np.where(held, 1, -1))[held] ** 2))
    own = square(fit)
    each = {name: (square(without[name]) - own) / scale for name in fit.physics}
    near = [name for name in fit.physics if strength(fit, without[name], scale) < NEAR_CHANCE]
    own_there = there(fit) if near else 0.0
    held_out = {name: (there(without[name]) - own_there) / scale for name in near}
    return Confirmation((square(base) - own) / scale, each, held_out)


def strength(fit: Fit, without: Fit, scale: float) -> float:
    """Of an effect: the root of the chi-square that its loss costs."""
    return float(np.sqrt(max(without.chi2 - fit.chi2, 0.0) / scale))


def unproven(found: Confirmation, names: Iterable[str], most_alike: int = 3) -> str | None:
    """The effect that has to go: the weakest where it makes things worse, or where all together, or of many each, prove nothing; and
    one near chance that makes the rows worse which took no part in its choice."""
    names = tuple(names)
    if not names:
        return None
    worst = min(found.held_out, key=lambda name: found.held_out[name], default=None)
    if worst is not None and found.held_out[worst] <= 0.0:
        return worst
    least = PROVEN if len(names) > most_alike else 0.0
    if found.each[found.weakest] <= least or found.together <= PROVEN:
        return found.weakest
    return None
