"""Score every effect of the library beside a fitted model by Rao's score test, from its derivative and from a finite step.

An effect's signature is the change of the whitened residuals per unit of its amount. It is projected off the columns of what
the model already adjusts, and the score is the residual's component along what is left; see also Sörbom's modification index.
What is left also says which amounts this record could show at all, and which effects the parameters absorb.

The projection is by Gram-Schmidt, never by normal equations; not by LAPACK, whose threads wait for one another where other
threads run (see `gram_schmidt` in `thermohyd.identify.fitting.trust_region`).

Also here: how far apart two rivals would lie if the pressure of each port were read, and not only their difference.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from thermohyd.effects.library import DYNAMIC_EFFECTS, EFFECTS, effect_info, with_effects
from thermohyd.identify.fitting.bench_faults import info_of
from thermohyd.identify.fitting.library import Library, stores, with_heat
from thermohyd.identify.fitting.parameters import PARAMETERS
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.sensed import sensed
from thermohyd.identify.fitting.static_readings import base_valve, conditions_of, mean_over_nodes, row_weights
from thermohyd.static_tests import blocked_port_readings

from .max_t import MaxT, NoiseFreedom, normal_score
from .result import Candidate


# A column that keeps less than this of its length beside the others adds nothing but rounding.
DEPENDENT = 1e-7


@dataclass(frozen=True)
class Projection:
    """P = I - Q Q' beside nuisance columns; `q` (rows, k) orthonormal."""

    q: np.ndarray

    @classmethod
    def beside(cls, columns: np.ndarray) -> "Projection":
        """Columns (rows, k), of any scale; dependent ones are dropped."""
        basis = np.empty((columns.shape[1], len(columns)))
        count = 0
        for column in columns.T:
            length = float(np.linalg.norm(column))
            if not length > 0.0:
                continue
            unit = column / length
            for _ in range(2):  # twice is enough (Kahan, in Parlett, "The Symmetric Eigenvalue Problem", 1980)
                unit = unit - basis[:count].T @ (basis[:count] @ unit)
            left = float(np.linalg.norm(unit))
            if left > DEPENDENT:
                basis[count] = unit / left
                count += 1
        return cls(basis[:count].T)

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """P values for (rows,) or (rows, k); twice, because once leaves rounding of the order of the input."""
        once = values - self.q @ (self.q.T @ values)
        return once - self.q @ (self.q.T @ once)

    @property
    def rank(self) -> int:
        return self.q.shape[1]

    def with_columns(self, columns: np.ndarray) -> "Projection":
        """The projection beside these columns too."""
        more = Projection.beside(self(columns))
        return Projection(np.concatenate([self.q, more.q], axis=1))


POWER = 0.8  # the custom of power analyses (Cohen, 1988)
# Share of a signature that the free parameters must leave for an effect to be more than another word for them.
LEAST_KEPT = 1e-3
# A finite step is another direction than the derivative where their cosine is below this: at five standard errors, where names begin,
# the two then differ by half a unit of chi-square.
SAME_DIRECTION = 0.99


@dataclass(frozen=True)
class Signature:
    """One effect beside a model. direction (rows,): unit, projected. size: projected length per unit of amount.

    score: signed so that a positive one asks for a positive amount. kept: share of the length left by the projection.
    freedom: degrees of freedom of the noise that the score is counted in.
    """

    name: str
    direction: np.ndarray
    size: float
    score: float
    kept: float
    freedom: float = np.inf

    @property
    def one_sided(self) -> bool:
        return info_of(self.name).lower == 0.0

    @property
    def strength(self) -> float:
        """The normal score as rare as the score, where its sign is possible."""
        return normal_score(self.score if self.one_sided else abs(self.score), self.freedom)

    @property
    def gain(self) -> float:
        """Chi-square that it takes off on paper, where its sign is possible."""
        return (max(self.score, 0.0) if self.one_sided else self.score) ** 2

    @property
    def estimate(self) -> float:
        """Amount by one linear step, 0 where the sign forbids it."""
        return max(self.score, 0.0) / self.size if self.one_sided else self.score / self.size


@dataclass(frozen=True)
class Screen:
    """Scores of all candidates beside one model."""

    signatures: tuple[Signature, ...]
    law: MaxT
    critical: float
    residual: np.ndarray  # projected, rows used
    projection: Projection

    def best(self, name: str) -> Signature | None:
        """The stronger of an effect's directions; None where nothing is left of it."""
        directions = [s for s in self.signatures if s.name == name]
        return max(directions, key=lambda s: s.strength, default=None)

    def p_value(self, signature: Signature) -> float:
        return self.law.p_value(signature.strength, two_sided=not signature.one_sided)

    @property
    def ranked(self) -> list[Signature]:
        """The best direction of every effect, the strongest first."""
        names = dict.fromkeys(s.name for s in self.signatures)
        found = [signature for name in names if (signature := self.best(name)) is not None]
        return sorted(found, key=lambda s: -s.strength)


def screen(
    fit: Fit,
    names: Iterable[str],
    steps: dict[str, np.ndarray],
    *,
    level: float,
    freedom: NoiseFreedom | None = None,
    scale: float = 1.0,
    columns: Mapping[str, np.ndarray] | None = None,
) -> Screen:
    """Score the named effects beside `fit`. steps: finite-step signatures per unit amount, {name: (rows,)}.

    freedom: of the noise; None where it is stated.
    scale: standard deviation of the whitened noise where it is not 1. columns {name: (rows,)}: where they are not the fit's own,
    else every name must be in its program.
    """
    used = fit.used
    projection = Projection.beside(fit.nuisance[used])
    residual = projection(fit.residual[used])
    signatures: list[Signature] = []
    for name in names:
        mine: list[Signature] = []
        own = fit.column(name) if columns is None else columns[name]
        for raw in (own[used], steps[name][used] if name in steps else None):
            if raw is None:
                continue
            length = float(np.linalg.norm(raw))
            if length == 0.0 or not np.isfinite(length):
                continue
            left = projection(raw)
            size = float(np.linalg.norm(left))
            if size <= LEAST_KEPT * length:
                continue
            unit = left / size
            if mine and abs(float(unit @ mine[0].direction)) > SAME_DIRECTION:
                continue
            score = -float(unit @ residual) / scale
            known = np.inf if freedom is None else freedom.along(unit, used)
            mine.append(Signature(name, unit, size / scale, score, size / length, known))
        signatures += mine
    directions = np.stack([s.direction for s in signatures], axis=1) if signatures else np.zeros((len(residual), 0))
    law = MaxT.of(directions, np.array([s.one_sided for s in signatures], dtype=bool))
    return Screen(tuple(signatures), law, law.critical(level), residual, projection)


def is_effect(name: str) -> bool:
    """Whether an entry of a fit is an effect's amount, not a parameter."""
    return name in EFFECTS or name in DYNAMIC_EFFECTS


def finite_steps(problem: Problem, fit: Fit, names: Iterable[str]) -> dict[str, np.ndarray]:
    """(f(amount) - f(0))/amount at a typical amount: what an effect does that has no slope at neutral, or bends."""
    found = {}
    held = {name: value for name, value in fit.values.items() if not is_effect(name) or name in fit.effects}
    for name in names:
        if name in fit.effects:
            continue
        amount = effect_info(name).scale
        if stores(name) and not any(map(stores, fit.effects)):
            before, after = (problem.stored_beside(fit, **{name: value})[0] for value in (0.0, amount))
        else:
            before, after = fit.residual, problem.evaluate({**held, name: amount}, (*fit.effects, name)).residual
        found[name] = (after - before) / amount
    return found


def least_visible(signature: Signature, critical: float) -> float:
    """Smallest amount that the search would show with 80 % probability."""
    return (critical + float(ndtri(POWER))) / signature.size


# An effect that would have to exceed its usual largest amount this many times before the record showed it is absorbed.
VISIBLE_WITHIN = 1.0


def candidates(
    library: Library, screen: Screen, base: Fit, singles: Mapping[str, Fit], excess: float
) -> tuple[Candidate, ...]:
    """One line per effect of the whole library, in its order. excess: chi-square of `base` beyond noise."""
    found = []
    for name, info in {**EFFECTS, **DYNAMIC_EFFECTS}.items():
        if name not in library.names and name not in library.impossible:
            continue
        if name in library.impossible:
            found.append(_without_figures(name, "impossible", library.impossible[name]))
            continue
        best = screen.best(name)
        if best is None:
            found.append(_without_figures(name, "absorbed", "the free parameters do exactly the same"))
            continue
        least = least_visible(best, screen.critical)
        hidden = least > VISIBLE_WITHIN * info.typical[1] and best.strength < screen.critical
        why = f"would show only from {least / info.typical[1]:.1f} times its usual largest amount" if hidden else ""
        gap, amount = _refit(name, base, singles, best, excess)
        found.append(
            Candidate(
                name, info.unit, "absorbed" if hidden else "testable", why, best.score, screen.p_value(best), amount,
                best.kept, least, gap,
            )
        )  # fmt: skip
    return tuple(found)


def _refit(name: str, base: Fit, singles: Mapping[str, Fit], best: Signature, excess: float) -> tuple[float, float]:
    """(gap closed by this effect alone, its amount): of a refit, or linear where the search made none."""
    if name in singles:
        fit = singles[name]
        return _share(base.chi2 - fit.chi2, excess), fit.values[name]
    return _share(best.gain, excess), best.estimate


def _share(gain: float, excess: float) -> float:
    """Of the excess; where there is none to speak of, nothing can be closed."""
    return float(np.clip(gain / excess, 0.0, 1.0)) if excess > 0.0 else 0.0


def _without_figures(name: str, state: str, why: str) -> Candidate:
    nan = float("nan")
    return Candidate(name, effect_info(name).unit, state, why, nan, nan, nan, 0.0, nan, nan)


BOTH_PORTS = "with the pressure of each port read"
TEST = "pressure_gain"
STEP = 1e-3  # of a parameter's natural step: finite differences, for a handful of rows' worth of evidence


def can_measure_ports(problem: Problem) -> bool:
    """Whether the record has a pressure-gain test that reads the difference only."""
    test = problem.tests.get(TEST)
    return test is not None and [c.name for c in test.channels] == ["load_pressure"]


def ports_apart(problem: Problem, true: Fit, other: Fit) -> float:
    """Chi-square by which `other`, refitted, would miss both ports' pressures of a valve that follows `true`."""
    (gauge,) = problem.tests[TEST].channels
    behind = sensed(problem.tests[TEST], gauge)
    std = np.tile(problem.noise.std[TEST, "load_pressure"], 2)
    std = std if behind is None else std / abs(behind.factor(true.values))
    expected, claimed = _ports(problem, true.values, true), _ports(problem, other.values, other)
    columns = []
    for name in other.free:
        step = STEP * problem.scale_of(name)
        columns.append((_ports(problem, {**other.values, name: other.values[name] + step}, other) - claimed) / step)
    known = problem.evaluate(other.values, other.effects)
    old = known.columns[:, [known.order.index(name) for name in other.free]]
    columns_of_all = np.concatenate([old, np.stack(columns, axis=1) / std[:, None]])
    difference = np.concatenate([np.zeros(len(old)), (claimed - expected) / std])
    if not (np.isfinite(columns_of_all).all() and np.isfinite(difference).all()):
        return 0.0
    left = Projection.beside(columns_of_all)(difference)
    return float(left @ left)


def _ports(problem: Problem, values: dict[str, float], fit: Fit) -> np.ndarray:
    """p_A of every row, then p_B."""
    test = problem.tests[TEST]
    heat = with_heat(fit.effects)
    valve = base_valve(problem.record, {name: values[name] for name in PARAMETERS if name in values}, heat=heat)
    valve = with_effects(valve, {name: values[name] for name in fit.effects if info_of(name).rowwise})
    readings, weight = blocked_port_readings(valve, conditions_of(test)), row_weights(test)
    ports = [readings[channel] for channel in ("pressure_a", "pressure_b")]
    ports = ports if weight is None else [mean_over_nodes(port, weight) for port in ports]
    return np.concatenate([np.asarray(port)[: test.rows] for port in ports])
