"""The least amount of each effect that planned tests show, and what could stand in its place there.

An effect of amount a changes the readings by f(a) - f(0); what the free parameters leave of it, in units of the noise, is the score
that it will have (docs/diagnosis.md section 7), but for the noise itself. It is found where the score passes the critical one and,
if it is near that, where a quarter of the rows predicted from the others says so too (section 11.1). Another effect explains it as well
where it comes within a likelihood ratio of 20 (section 10), in records in which the effect is found.
"""

import functools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import root_scalar
from scipy.special import log_ndtr, ndtr, ndtri

from thermohyd.effects.library import effect_info
from thermohyd.identify.diagnosis.case import LEVEL_OF_ALL_ROWS
from thermohyd.identify.diagnosis.confirmation import NEAR_CHANCE
from thermohyd.identify.diagnosis.held_out import SHARE
from thermohyd.identify.diagnosis.result import MOST_USUAL
from thermohyd.identify.diagnosis.rivals import ALIKE
from thermohyd.identify.diagnosis.screening import LEAST_KEPT, Projection, finite_steps, screen
from thermohyd.identify.diagnosis.search import BEYOND_TYPICAL
from thermohyd.identify.fitting.library import stores

from .planned_problem import Prospect


POWER = 0.9  # chance to find what is as large as the least amount said: usual for the size of a trial
AMOUNTS = 241  # tried, from nothing to five times the largest usual one
ROUNDS, ENOUGH = 5, 0.02  # of a search for an amount, and the relative error of its score


@dataclass(frozen=True)
class Sight:
    """One effect in the planned tests. change (rows,): projected change of the whitened readings at `amount`, strength its length.

    amount: the least that is found, or the largest usual one where not even five times that is. kept: share of the change that the
    free parameters leave. strength_of_usual: at the largest usual amount, along the same direction.
    """

    name: str
    amount: float
    change: np.ndarray
    kept: float
    visible: bool
    strength_of_usual: float

    @property
    def strength(self) -> float:
        return float(np.linalg.norm(self.change))


@dataclass(frozen=True)
class View:
    """Every effect that the tests can speak of, beside the free parameters. critical: the score that names one."""

    sights: tuple[Sight, ...]
    blind: dict[str, str]  # {effect: why nothing is seen of it}
    critical: float
    correlation: np.ndarray  # of the changes, in the order of the sights

    @property
    def wanted(self) -> float:
        """The score to expect of what is found in a share `POWER` of records."""
        return score_found(self.critical)

    def place(self, name: str) -> int:
        return next(i for i, sight in enumerate(self.sights) if sight.name == name)


def chance_of_naming(score: float, critical: float) -> float:
    """Share of records in which an effect of this expected score is found.

    Its score by the rows that take part in the choice is z, normal about sqrt(3/4) of what is expected, by the others h, about half; by all
    sqrt(3/4) z + h/2. With the amount of the first the others do better by 2 a h - a^2, where a = z/sqrt(3): that is above 0, or the score
    by all is at least `NEAR_CHANCE`.
    """
    own, other = float(np.sqrt(1.0 - SHARE)), float(np.sqrt(SHARE))
    normal, weight = np.polynomial.hermite_e.hermegauss(80)
    z = own * score + normal
    least = lambda total: (total - own * z) / other  # h at which the score by all is so large
    needed = np.maximum(least(critical), np.minimum(0.5 * other / own * z, least(NEAR_CHANCE)))
    return float(weight @ ndtr(other * score - needed) / weight.sum())


@functools.cache
def score_found(critical: float) -> float:
    """The expected score of an effect that is found in a share `POWER` of records."""
    least = critical + float(ndtri(POWER))
    return float(
        root_scalar(lambda score: chance_of_naming(score, critical) - POWER, bracket=(0.5 * least, 2.0 * least)).root
    )


def view_of(prospect: Prospect, say: Callable[[str], None] = lambda _: None) -> View:
    """Find the least visible amount of every effect of the library."""
    problem, fit = prospect.problem, prospect.fit
    names = problem.library.names
    say("what each effect would do")
    steps = finite_steps(problem, fit, names)
    critical = screen(fit, names, steps, level=LEVEL_OF_ALL_ROWS).critical
    projection = Projection.beside(prospect.nuisance)
    sights, blind = [], dict(problem.library.impossible)
    for name in names:
        say(f"the least visible amount of {name}")
        found = _sight(prospect, projection, name, critical)
        if isinstance(found, str):
            blind[name] = found
        else:
            sights.append(found)
    directions = (
        np.stack([s.change / s.strength for s in sights], axis=1) if sights else np.zeros((len(fit.residual), 0))
    )
    return View(tuple(sights), blind, critical, directions.T @ directions)


def change_at(prospect: Prospect, name: str, amount: float) -> np.ndarray:
    """f(amount) - f(0) of the whitened residuals (rows,); the readings are the model's own, so that f(0) is 0."""
    problem, fit = prospect.problem, prospect.fit
    if stores(name):
        before, after = (problem.stored_beside(fit, **{name: value})[0] for value in (0.0, amount))
        return after - before
    held = {n: v for n, v in fit.values.items() if n in problem.plans}
    return problem.evaluate({**held, name: amount}, (name,)).residual - prospect.fit.residual


def _sight(prospect: Prospect, projection: Projection, name: str, critical: float) -> Sight | str:
    info = effect_info(name)
    usual, wanted = info.typical[1], score_found(critical)
    most = min(MOST_USUAL * usual, info.upper)
    amount, found = info.scale, None
    for _ in range(ROUNDS):
        raw = change_at(prospect, name, amount)
        if not np.isfinite(raw).all():
            return "the model has no finite readings with it"
        left, whole = projection(raw), float(np.linalg.norm(raw))
        size = float(np.linalg.norm(left))
        if whole == 0.0:
            return "no reading depends on it"
        if size <= LEAST_KEPT * whole:
            return "the free parameters do exactly the same"
        found = (amount, left, size / whole)
        if abs(size / wanted - 1.0) < ENOUGH or (amount == most and size < wanted):
            break
        # Nearly linear or nearly quadratic: the power between the last two amounts is not worth a search of its own.
        amount = float(np.clip(amount * (wanted / size) ** (0.5 if info.even else 1.0), 1e-6 * usual, most))
    assert found is not None
    amount, left, kept = found
    size = float(np.linalg.norm(left))
    visible = size >= (1.0 - 5.0 * ENOUGH) * wanted
    if not visible:
        amount, left = usual, projection(change_at(prospect, name, usual))
        size = float(np.linalg.norm(left))
    power = 2.0 if info.even else 1.0
    return Sight(name, amount, left, kept, visible, size * (usual / amount) ** power)


def strength_for(sight: Sight, amount: float) -> float:
    """Score to expect of another amount, along the same direction."""
    power = 2.0 if effect_info(sight.name).even else 1.0
    return sight.strength * (amount / sight.amount) ** power


def chance_of_finding(sight: Sight, amount: float, critical: float) -> float:
    """Share of records with this amount in which it is found."""
    return chance_of_naming(strength_for(sight, amount), critical)


def chance_of_rival(view: View, true: str, rival: str, amount: float) -> float:
    """Share of the records in which this amount of `true` is found where `rival` does about as well in its place.

    Of a score s of the true effect the rival's is rho s + sqrt(1 - rho^2) e, e a normal deviate; it falls behind by s^2 less that squared.
    """
    sight, other = view.sights[view.place(true)], view.sights[view.place(rival)]
    cosine = float(view.correlation[view.place(true), view.place(rival)])
    # An effect of either sign may come with the sign that its rival can follow.
    if cosine < 0.0 and effect_info(rival).lower == 0.0 and effect_info(true).lower == 0.0:
        return 0.0
    beyond = view.critical - strength_for(sight, amount)
    # The mean of a score beyond the critical one.
    score = view.critical - beyond + float(np.exp(-0.5 * beyond**2 - log_ndtr(-beyond))) / float(np.sqrt(2.0 * np.pi))
    times = abs(cosine) * score / max(other.strength_of_usual, 1e-300)
    penalty = BEYOND_TYPICAL * float(np.log(times)) ** 2 if times > 1.0 else 0.0
    least = float(np.sqrt(max(score**2 - ALIKE + penalty, 0.0)))
    beside = float(np.sqrt(max(1.0 - cosine**2, 1e-12)))
    return float(ndtr((abs(cosine) * score - least) / beside))


def amount_told_apart(view: View, true: str, rival: str) -> float:
    """The amount of `true` from which on `rival` falls behind it in a share `POWER` of records; infinite where only from more than
    five times the largest usual one on."""
    info = effect_info(true)
    amounts = np.geomspace(1e-4, MOST_USUAL, AMOUNTS) * info.typical[1]
    behind = [amount for amount in amounts.tolist() if chance_of_rival(view, true, rival, amount) <= 1.0 - POWER]
    return behind[0] if behind else float("inf")


def confused_with(view: View, true: str) -> tuple[str, ...]:
    """Effects that planned tests do not tell from `true` even in its largest usual amount, the closest first; none of an effect that
    is itself not seen in it."""
    sight, usual = view.sights[view.place(true)], effect_info(true).typical[1]
    if sight.strength_of_usual < view.wanted:
        return ()
    others = [
        s.name for s in view.sights if s.name != true and chance_of_rival(view, true, s.name, usual) > 1.0 - POWER
    ]
    i = view.place(true)
    return tuple(sorted(others, key=lambda name: -abs(float(view.correlation[i, view.place(name)]))))


def groups(view: View, names: Iterable[str]) -> tuple[tuple[str, ...], ...]:
    """Effects that are not told from each other in any usual amount: every two of a group, by complete linkage."""
    left = list(names)
    confused = {name: set(confused_with(view, name)) for name in left}
    both = lambda a, b: b in confused[a] and a in confused[b]
    clusters = [[name] for name in left]
    while True:
        closest, pair = 0.0, None
        for i, first in enumerate(clusters):
            for j in range(i):
                if all(both(a, b) for a in first for b in clusters[j]):
                    least = min(
                        abs(float(view.correlation[view.place(a), view.place(b)])) for a in first for b in clusters[j]
                    )
                    if least > closest:
                        closest, pair = least, (i, j)
        if pair is None:
            return tuple(tuple(cluster) for cluster in clusters if len(cluster) > 1)
        i, j = pair
        clusters[j] += clusters.pop(i)


def with_more(view: View, changes: dict[str, np.ndarray], projection: Projection) -> View:
    """The same effects in more rows: changes {effect: (rows of old and new tests,)} at the sights' amounts, before projection."""
    sights = []
    for sight in view.sights:
        left, whole = projection(changes[sight.name]), float(np.linalg.norm(changes[sight.name]))
        size = float(np.linalg.norm(left))
        usual = effect_info(sight.name).typical[1]
        power = 2.0 if effect_info(sight.name).even else 1.0
        kept = size / whole if whole > 0.0 else 0.0
        own = replace(sight, change=left, kept=kept, strength_of_usual=size * (usual / sight.amount) ** power)
        sights.append(own)
    directions = np.stack([s.change / max(s.strength, 1e-300) for s in sights], axis=1)
    return View(tuple(sights), view.blind, view.critical, directions.T @ directions)
