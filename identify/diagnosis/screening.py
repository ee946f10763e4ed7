"""Every effect of the library beside a fitted model, by its derivative and by a finite step: score, size, visibility.

Rao's score test projected off what the model already adjusts; see also Sörbom's modification index.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from thermohyd.effects.registry import DYNAMIC_EFFECTS, EFFECTS, effect_info

from .library_fit import LibraryFit, LibraryProblem
from .max_t import MaxT, normal_score
from .projection import Projection


POWER = 0.8
# Share of a signature that the free parameters must leave for an effect to be more than another word for them.
LEAST_KEPT = 1e-3
# A finite step is another direction than the derivative where their cosine is below this.
SAME_DIRECTION = 0.99


@dataclass(frozen=True)
class Signature:
    """One effect beside a model. direction (rows,): unit, projected. size: projected length per unit of amount.

    score: signed so that a positive one asks for a positive amount. kept: share of the length left by the projection.
    """

    name: str
    direction: np.ndarray
    size: float
    score: float
    kept: float

    @property
    def one_sided(self) -> bool:
        return effect_info(self.name).lower == 0.0

    @property
    def strength(self) -> float:
        """The score where its sign is possible."""
        return self.score if self.one_sided else abs(self.score)

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
        own = [s for s in self.signatures if s.name == name]
        return max(own, key=lambda s: s.strength, default=None)

    def p_value(self, signature: Signature) -> float:
        return self.law.p_value(signature.strength, two_sided=not signature.one_sided)

    @property
    def ranked(self) -> list[Signature]:
        """The best direction of every effect, the strongest first."""
        names = dict.fromkeys(s.name for s in self.signatures)
        found = [signature for name in names if (signature := self.best(name)) is not None]
        return sorted(found, key=lambda s: -s.strength)


def screen(
    fit: LibraryFit,
    names: Iterable[str],
    steps: dict[str, np.ndarray],
    *,
    level: float,
    freedom: float = np.inf,
    scale: float = 1.0,
) -> Screen:
    """Score the named effects beside `fit`. steps: finite-step signatures per unit amount, {name: (rows,)}.

    scale: standard deviation of the whitened noise where it is not 1. Every name must be in the fit's program.
    """
    used = fit.used
    projection = Projection.beside(fit.nuisance[used])
    residual = projection(fit.residual[used])
    found: list[Signature] = []
    for name in names:
        mine: list[Signature] = []
        for raw in (fit.column(name)[used], steps[name][used] if name in steps else None):
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
            score = normal_score(-float(unit @ residual) / scale, freedom)
            mine.append(Signature(name, unit, size / scale, score, size / length))
        found += mine
    directions = np.stack([s.direction for s in found], axis=1) if found else np.zeros((len(residual), 0))
    law = MaxT.of(directions, np.array([s.one_sided for s in found], dtype=bool))
    return Screen(tuple(found), law, law.critical(level), residual, projection)


def is_effect(name: str) -> bool:
    """Whether an entry of a fit is an effect's amount, not a parameter."""
    return name in EFFECTS or name in DYNAMIC_EFFECTS


def finite_steps(problem: LibraryProblem, fit: LibraryFit, names: Iterable[str]) -> dict[str, np.ndarray]:
    """(f(amount) - f(0))/amount at a typical amount: what an effect does that has no slope at neutral, or bends."""
    found = {}
    held = {name: value for name, value in fit.values.items() if not is_effect(name) or name in fit.effects}
    for name in names:
        if name in fit.effects:
            continue
        amount = effect_info(name).scale
        moved = problem.evaluate({**held, name: amount}, (*fit.effects, name))
        found[name] = (moved.residual - fit.residual) / amount
    return found


def least_visible(signature: Signature, critical: float) -> float:
    """Smallest amount that the search would show with 80 % probability."""
    return (critical + float(ndtri(POWER))) / signature.size
