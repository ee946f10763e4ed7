"""Where a misfit remains: which parameters predict best, and how far may they be trusted?

Beside its noise each channel has what the model misses: a curve over the position that all its sweeps share, and one that each sweep has
of its own (in motion over the time, of the runs), with a size and a length of their own (Kennedy and O'Hagan, Journal of the Royal
Statistical Society B 63, 2001). Sizes are those of highest restricted likelihood (MacKay, Neural Computation 4, 1992), the length is the
one under which runs that were left out are least surprising (log score: Gneiting and Raftery, Journal of the American Statistical
Association 102, 2007). Error bars hold that. Whether readings are weighed by it as well, or by their noise alone, is asked of the same
runs: by which parameters their readings are met best. docs/diagnosis.md section 14.3.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from thermohyd.identify.bench.test_record import TestRecord, dynamic_among
from thermohyd.identify.fitting.discrepancy import Discrepancy
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.problem_solution import gls_covariance, misfit_scale
from thermohyd.identify.fitting.uncertainty import Covariance
from thermohyd.identify.reduction.monotone_pieces import piece_bounds, sweep_ids
from thermohyd.side_by_side import each

from .confirmation import MOST, fit_of_rows_left, parts_left_out
from .held_out import conditions_of_rows
from .left_over import whitened
from .result import ChannelDiscrepancy
from .screening import Projection


# Shares of a sweep's readings over which what is missed stays alike: narrower is noise, wider the parameters follow.
LENGTHS = (0.05, 0.15, 0.5)
CURVES = {0.05: 24, 0.15: 12, 0.5: 6}  # of a sweep: three for each length, so that the law between them is the kernel's
# Of all sweeps of a channel, and of one sweep; where there are more sweeps than that allows, some share theirs.
MOST_CURVES, FEWEST_CURVES = 300, 3
ROUNDS, SETTLED = 4, 0.05  # of size and fit in turn, until no size changes by more than this
MOST_TURNS = 40  # of the search for the sizes
SMALLEST, LARGEST = 1e-8, 1e8  # variance of a curve, against the noise
BETTER = 0.95  # mean square misfit of runs left out, from which on other weights are worth their while
WITHIN = 5.0  # natural steps that a parameter may lie away where the runs left say nothing of it


@dataclass(frozen=True)
class Beside:
    """A fit beside a discrepancy, curves of one length and of these sizes (variances, in those of the noise); None: beside the noise.

    fit: rows whitened by noise and discrepancy. scale: reduced chi-square of it, at least 1.
    """

    fit: Fit
    scale: float
    length: float = 0.0
    sizes: np.ndarray | None = None
    discrepancy: Discrepancy | None = None


@dataclass(frozen=True)
class Remaining:
    """What a model misses as a part of the readings' error. believed: under which runs left out are least surprising.

    weighed: what the fit that is kept weighs its readings by.
    """

    weighed: Beside
    believed: Beside
    channels: tuple[ChannelDiscrepancy, ...]

    @property
    def fit(self) -> Fit:
        return self.weighed.fit

    def covariance(self, fit: Fit, priors: int) -> Covariance:
        """Of a fit weighed as this one: the sandwich of `weighed` between what is `believed`. priors: rows that are no readings."""
        plain = gls_covariance(fit, 1.0, priors)
        bread = plain.matrix[np.ix_(plain.alive, plain.alive)]
        columns = fit.columns[:, [fit.order.index(fit.free[i]) for i in plain.alive]].T
        back = columns if self.weighed.discrepancy is None else self.weighed.discrepancy.whitened(columns)
        size = np.sqrt(np.append(np.full(back.shape[1] - priors, self.believed.scale), np.ones(priors)))
        believed = self.believed.discrepancy
        half = back * size if believed is None else np.concatenate([back * size, back @ believed.columns], axis=1)
        matrix = np.zeros_like(plain.matrix)
        matrix[np.ix_(plain.alive, plain.alive)] = bread @ (half @ half.T) @ bread
        return replace(plain, matrix=0.5 * (matrix + matrix.T))

    def by_noise(self, problem: Problem, fit: Fit) -> "Remaining":
        """The same beside a fit whose readings are weighed by their noise."""
        return replace(self, weighed=Beside(fit, misfit_scale(problem, fit)))

    def weighing(self, problem: Problem) -> Problem:
        """A problem of the same tests whose fits are weighed likewise; of the rows that it uses, if not all."""
        return weighing(problem, self.weighed)

    def believing(self, problem: Problem) -> Problem:
        """A problem of the same tests whose readings are known to what is believed."""
        return weighing(problem, self.believed)


def weighing(problem: Problem, beside: Beside) -> Problem:
    """A problem whose readings are known to the noise and to a discrepancy, in the rows that it uses."""
    if beside.sizes is None or problem.used is None:
        return problem.with_discrepancy(beside.discrepancy)
    curves = curves_of(problem, beside.length, len(beside.fit.residual))
    columns = [own * np.sqrt(size) for own, size in zip(curves, beside.sizes, strict=True)]
    return problem.with_discrepancy(Discrepancy(np.concatenate(columns, axis=1)))


def remaining_misfit(problem: Problem, fit: Fit, say: Callable[[str], None] = lambda _: None) -> Remaining:
    """The discrepancy beside `fit`, and the fit that predicts runs left out best."""
    say("how far readings may be trusted beside the misfit")
    parts = runs_left_out(problem.tests)
    alone = Beside(fit, misfit_scale(problem, fit))
    # In motion a refit takes ten seconds, and thirty would be asked for.
    on_paper = bool(dynamic_among(problem.tests))
    fitted = _on_paper if on_paper else _fitted
    tried = [(alone, fit), *each(lambda length: fitted(problem, fit, length), LENGTHS)]
    scores = each(lambda one: left_out_score(problem, *one, parts), tried)
    believed, _ = tried[max(range(len(tried)), key=scores.__getitem__)]
    weighed = alone
    if believed is not alone:
        say("which weights predict runs left out best")
        white = _seen_by(problem.with_noise(problem.noise.white), fit) if on_paper else None
        errors_of = lambda beside: (
            left_out_errors(problem, beside, parts) if white is None else errors_on_paper(problem, beside, white, parts)
        )
        errors = errors_of(believed) / errors_of(alone)
        if np.exp(np.mean(np.log(errors))) < BETTER:
            beside = problem.with_discrepancy(believed.discrepancy)
            again = beside.fit(fit.effects, believed.fit.values, hop_basins=True)
            # Parameters that no search settled on predict by luck.
            weighed = replace(believed, fit=again) if again.converged else alone
    return Remaining(weighed, believed, tuple(_channels(problem, believed)))


def runs_left_out(tests: Mapping[str, TestRecord]) -> np.ndarray:
    """Number of the part (rows,) that each row belongs to, below 0 where it is in every fit.

    Conditions and rates of each test that has several, so that another rate of the same test stays; else as for the proof of a name.
    """
    count, by_test = 0, {}
    for name, test in tests.items():
        number = np.zeros(test.rows, dtype=int) if test.in_motion else conditions_of_rows(test)[1]
        several = len(np.unique(number)) > 1
        by_test[name] = count + number if several else np.full(test.rows, -1)
        count += len(np.unique(number)) if several else 0
    if count == 0:
        return parts_left_out(tests)
    by_test = {name: np.where(number < 0, -1, number % MOST) for name, number in by_test.items()}
    return np.concatenate([by_test[name] for name, test in tests.items() for _ in test.channels])


def _all_curves(problem: Problem, fit: Fit, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Columns of `curves_of` (rows, k), and the group (k,) of each."""
    curves = list(curves_of(problem, length, len(fit.residual)))
    return np.concatenate(curves, axis=1), np.repeat(np.arange(len(curves)), [own.shape[1] for own in curves])


def _on_paper(problem: Problem, fit: Fit, length: float) -> tuple[Beside, Fit]:
    """Sizes for curves of one length, and the misfit beside them, where parameters move as they would by one Gauss-Newton step; and the
    fit, which is as the noise alone shows it."""
    columns, which = _all_curves(problem, fit, length)
    sizes = likeliest_sizes(fit, columns, which, np.ones(int(which[-1]) + 1))
    discrepancy = Discrepancy(columns * np.sqrt(sizes)[which])
    rows = len(fit.residual) - len(problem.parameters)
    scale = max(chi2_on_paper(fit, discrepancy) / max(rows - len(fit.free), 1), 1.0)
    return Beside(fit, scale, length, sizes, discrepancy), fit


def chi2_on_paper(fit: Fit, discrepancy: Discrepancy) -> float:
    """Chi-square beside a discrepancy where one Gauss-Newton step from the fit leads."""
    left = Projection.beside(discrepancy.whitened(fit.nuisance.T).T)(discrepancy.whitened(fit.residual))
    return float(left @ left)


def _fitted(problem: Problem, fit: Fit, length: float) -> tuple[Beside, Fit]:
    """Sizes and fit in turn, for curves of one length; and that fit as the noise alone shows it."""
    columns, which = _all_curves(problem, fit, length)
    seen, found, sizes, discrepancy = fit, fit, np.ones(int(which[-1]) + 1), Discrepancy(columns)
    for _ in range(ROUNDS):
        before, sizes = sizes, likeliest_sizes(seen, columns, which, sizes)
        discrepancy = Discrepancy(columns * np.sqrt(sizes)[which])
        found = problem.with_discrepancy(discrepancy).fit(fit.effects, found.values)
        seen = _seen_by(problem, found)
        changed = np.abs(np.sqrt(sizes) - np.sqrt(before)) > SETTLED * np.sqrt(np.maximum(sizes, 1.0))
        if not changed.any():
            break
    return Beside(found, misfit_scale(problem, found), length, sizes, discrepancy), seen


def _seen_by(problem: Problem, fit: Fit) -> Fit:
    """The point of a fit with the residual and columns that this problem has there."""
    return replace(problem.evaluate(fit.values, fit.effects), free=fit.free, active=fit.active)


def _channels(problem: Problem, beside: Beside) -> Iterator[ChannelDiscrepancy]:
    """What the channels' readings are known to beside their noise, of each whose curves are larger than nothing."""
    if beside.sizes is None:
        return
    for number, (test, channel) in enumerate(problem.rows()):
        common, own = beside.sizes[2 * number : 2 * number + 2]
        std = _typical(problem, (test, channel)) * np.sqrt(common + own)
        signal = problem.tests[test].channel(channel).signal
        yield ChannelDiscrepancy(test, channel, float(std), float(own / (common + own)), beside.length, signal)


def _typical(problem: Problem, key: tuple[str, str]) -> float:
    return float(np.sqrt(np.mean(problem.noise.std[key] ** 2)))


def curves_of(problem: Problem, length: float, rows: int) -> Iterator[np.ndarray]:
    """Of each channel the curves (rows, k) that its sweeps share, then those of each sweep; rows: of a fit's residual.

    Of unit variance at every row in units of the channel's typical noise, whitened, 0 elsewhere.
    """
    for key in problem.rows():
        test = problem.tests[key[0]]
        sweeps = list(piece_bounds(sweep_ids(test)))
        runs = sweeps if test.in_motion else [(0, test.rows)]
        rank = np.concatenate([_rank(test.place[start:stop]) for start, stop in runs])
        shared = kernel_curves(rank, length, CURVES[length])
        apart = min(len(sweeps), MOST_CURVES // FEWEST_CURVES)
        count = min(CURVES[length], MOST_CURVES // apart)
        of_one = kernel_curves(rank, length, count)
        own = np.zeros((test.rows, count * apart))
        for number, (start, stop) in enumerate(sweeps):
            first = number % apart * count
            own[start:stop, first : first + count] = of_one[start:stop]
        for columns in (shared, own):
            yield whitened(problem, key, columns * _typical(problem, key), rows)


def _rank(place: np.ndarray) -> np.ndarray:
    """0 to 1 in the order of the rows' places (rows,)."""
    rank = np.empty(len(place))
    rank[np.argsort(place, kind="stable")] = np.arange(len(place)) / max(len(place) - 1, 1)
    return rank


def kernel_curves(place: np.ndarray, length: float, count: int) -> np.ndarray:
    """(rows, count): sums of squares are the variance of a Matern 3/2 process of this length, 1 but for what `count` points miss.

    By inducing points (Quinonero-Candela and Rasmussen, Journal of Machine Learning Research 6, 2005). place (rows,): 0 to 1.
    """
    points = np.linspace(0.0, 1.0, count)

    def kernel(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        away = np.sqrt(3.0) * np.abs(a[:, None] - b[None, :]) / length
        return (1.0 + away) * np.exp(-away)

    lower = cholesky(kernel(points, points) + 1e-9 * np.eye(count), lower=True)
    return solve_triangular(lower, kernel(place, points).T, lower=True).T


def likeliest_sizes(fit: Fit, columns: np.ndarray, which: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Variance of each group of curves, in units of the noise, of highest likelihood of what the free parameters leave.

    columns (rows, k): of unit variance; which (k,): the group of each.
    """
    projection = Projection.beside(fit.nuisance)
    residual, left = projection(fit.residual), projection(columns)
    gram, load = left.T @ left, left.T @ residual
    sizes = np.clip(begin, 1e-3, LARGEST)
    groups = [which == number for number in range(len(begin))]
    for _ in range(MOST_TURNS):
        inverse = np.linalg.inv(gram + np.diag(1.0 / sizes[which]))
        mean, spread = inverse @ load, np.diag(inverse)
        before = sizes.copy()
        for number, own in enumerate(groups):
            known = float(own.sum() - np.sum(spread[own]) / before[number])  # coefficients that the readings determine
            sizes[number] = np.clip(float(mean[own] @ mean[own]) / max(known, 1e-9), SMALLEST, LARGEST)
        if np.all(np.abs(np.log(sizes / before)) < SETTLED) or np.all(sizes <= 10.0 * SMALLEST):
            break
    return sizes


def left_out_errors(problem: Problem, beside: Beside, parts: np.ndarray) -> np.ndarray:
    """Mean square misfit (channels,) of the rows of each part in units of their noise, each predicted by a fit without its part."""
    misses = np.zeros(len(parts))
    white = problem.with_noise(problem.noise.white)
    numbers = np.unique(parts[parts >= 0]).tolist()

    def missed(part: int) -> np.ndarray:
        rest = weighing(problem.with_rows(parts != part), beside)
        fit = fit_of_rows_left(rest, beside.fit.effects, beside.fit.values)
        return white.evaluate(fit.values, fit.effects).residual[: len(parts)][parts == part]

    for part, found in zip(numbers, each(missed, numbers), strict=True):
        misses[parts == part] = found
    return _of_channels(problem, misses, parts)


def errors_on_paper(problem: Problem, beside: Beside, white: Fit, parts: np.ndarray) -> np.ndarray:
    """`left_out_errors`, each part predicted by one Gauss-Newton step from the fit, which knows the noise alone. white: the same in units
    of white noise."""
    without = _Without.of(problem, beside, beside.fit, parts)
    columns = _in_natural_steps(problem, white)
    misses = np.zeros(len(parts))
    for part in without.numbers:
        left = parts == part
        step, _ = without.part(part)
        misses[left] = (white.residual + columns @ step)[: len(parts)][left]
    return _of_channels(problem, misses, parts)


def _of_channels(problem: Problem, misses: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """Mean squares (channels,) of the rows that belong to a part."""
    shown = [misses[place][parts[place] >= 0] for place in problem.rows().values()]
    return np.array([np.mean(own**2) for own in shown if len(own)])


def left_out_score(problem: Problem, beside: Beside, seen: Fit, parts: np.ndarray) -> float:
    """Log likelihood of the rows of each part, predicted by parameters that did not see it: one Gauss-Newton step from the fit. Curves
    are not predicted, only allowed for. seen: the fit as the noise alone shows it.
    """
    without, score = _Without.of(problem, beside, seen, parts), 0.0
    for part in without.numbers:
        left = without.parts == part
        step, matrix = without.part(part)
        spread = cholesky(np.linalg.inv(0.5 * (matrix + matrix.T)), lower=True)
        score += _log_likelihood(
            seen.residual[left] + without.columns[left] @ step,
            np.concatenate([without.curves[left], without.columns[left] @ spread], axis=1),
            beside.scale,
        )
    return score


@dataclass(frozen=True)
class _Without:
    """Parameters that do not see a part of the rows. columns (rows, n): of the free ones, each for its natural step, and residual, both
    beside the noise alone; curves (rows, k): of the discrepancy, none without one; parts (rows,): below 0 of rows in every fit."""

    columns: np.ndarray
    residual: np.ndarray
    curves: np.ndarray
    scale: float
    parts: np.ndarray

    @classmethod
    def of(cls, problem: Problem, beside: Beside, seen: Fit, parts: np.ndarray) -> "_Without":
        """parts: of the readings; priors belong to none."""
        rows = len(seen.residual)
        curves = np.zeros((rows, 0)) if beside.discrepancy is None else beside.discrepancy.columns
        whole = np.concatenate([parts, np.full(rows - len(parts), -1)])
        return cls(_in_natural_steps(problem, seen), seen.residual, curves, beside.scale, whole)

    @property
    def numbers(self) -> list[int]:
        return np.unique(self.parts[self.parts >= 0]).tolist()

    def part(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """The Gauss-Newton step (n,) of the rows of all other parts, in natural steps, and the inverse (n, n) of its covariance."""
        kept = self.parts != number
        both = np.concatenate([self.columns[kept], self.residual[kept, None]], axis=1)
        among = np.eye(self.curves.shape[1]) * self.scale + self.curves[kept].T @ self.curves[kept]
        across = self.curves[kept].T @ both
        normal = (both.T @ both - across.T @ cho_solve(cho_factor(among), across)) / self.scale
        matrix = normal[:-1, :-1] + np.eye(self.columns.shape[1]) / WITHIN**2
        return -np.linalg.solve(matrix, normal[:-1, -1]), matrix


def _in_natural_steps(problem: Problem, fit: Fit) -> np.ndarray:
    """Columns (rows, n) of what a fit adjusted, each for the natural step of its own."""
    return fit.nuisance * np.array([problem.scale_of(name) for name in fit.free if name not in fit.active])


def _log_likelihood(miss: np.ndarray, spread: np.ndarray, scale: float) -> float:
    """Of rows (n,) with the covariance scale + spread spread', without its constant."""
    lower = cholesky(np.eye(spread.shape[1]) * scale + spread.T @ spread, lower=True)
    explained = solve_triangular(lower, spread.T @ miss, lower=True)
    square = (float(miss @ miss) - float(explained @ explained)) / scale
    volume = 2.0 * float(np.sum(np.log(np.diag(lower)))) + (len(miss) - len(lower)) * np.log(scale)
    return -0.5 * (square + volume)
