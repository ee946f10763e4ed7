"""The final model: what was chosen, refitted to all rows, its rivals, and whether it leaves a misfit."""

from dataclasses import dataclass

import numpy as np

from .case import Case, Progress
from .choice import LEVEL_OF_ALL_ROWS
from .library_fit import LibraryFit
from .rivals import Rivals, settle_rivals
from .search import Found, search
from .smooth_basis import LackOfFit, lack_of_fit, smooth_block


LEVEL_OF_LEFT_OVER = 1e-3
# Share of the gap that an effect must close to be named while a misfit of unknown cause remains.
WORTH_NAMING = 0.1
# A reduced chi-square beyond this, and beyond chance, is a misfit even where it is not smooth.
MISFIT, MISFIT_SCORE = 1.08, 5.0


@dataclass(frozen=True)
class FinalModel:
    """excess: chi-square of the ideal valve beyond noise. scale: reduced chi-square of `fit`, at least 1.

    left: what smooth curves still find beside `fit`. disagrees: a misfit beyond noise remains.
    seen_apart: every effect was found without the rows held out.
    """

    fit: LibraryFit
    rivals: dict[str, Rivals]
    p_values: dict[str, float]
    left: LackOfFit
    excess: float
    scale: float
    disagrees: bool
    seen_apart: bool

    def gap_closed(self, without: LibraryFit) -> float:
        """Share of the gap that opens again in the model `without` something."""
        loss = without.chi2 - self.fit.chi2
        return float(np.clip(loss / max(self.excess, loss, 1e-300), 0.0, 1.0))


def final_model(case: Case, found: Found, say: Progress = lambda _: None) -> FinalModel:
    """Refit what the search found to all rows, ask all rows for more, settle rivals, test what is left."""
    problem, base = case.problem, case.base
    say("refitting with all rows")
    begin = problem.fit(found.effects, found.final.values) if found.effects else None
    whole = search(problem, base, case.steps, begin=begin, level=LEVEL_OF_ALL_ROWS, say=say)
    rows = len(base.residual) - len(problem.plans)
    freedom = max(rows - len(base.free), 1)
    scale = lambda fit: max(fit.chi2 / max(rows - len(fit.free), 1), 1.0)
    fit, rivals = settle_rivals(problem, whole.final, case.steps, scale=scale(whole.final))

    say("looking at what is left")
    block = smooth_block(problem, len(base.residual))
    excess = base.chi2 - freedom
    left = lack_of_fit(problem, fit, block)
    while left.p_value < LEVEL_OF_LEFT_OVER and fit.effects:
        # Beside a misfit of unknown cause small gains are found everywhere: only what closes a good part may be named.
        closes = {name: (rival.without.chi2 - fit.chi2) / max(excess, 1e-300) for name, rival in rivals.items()}
        weakest = min(closes, key=lambda name: closes[name])
        if closes[weakest] >= WORTH_NAMING:
            break
        fit = problem.fit([n for n in fit.effects if n != weakest], fit.values, hops=True)
        fit, rivals = settle_rivals(problem, fit, case.steps, scale=scale(fit))
        left = lack_of_fit(problem, fit, block)
    known = all(n.known for n in case.noise.values())
    rough = known and scale(fit) > MISFIT and (scale(fit) - 1.0) * np.sqrt(freedom / 2.0) > MISFIT_SCORE
    p_values = {**whole.p_values, **found.p_values}
    worst = max(p_values.values(), default=1.0)  # of one that took a rival's place
    return FinalModel(
        fit=fit,
        rivals=rivals,
        p_values={name: p_values.get(name, worst) for name in fit.effects},
        left=left,
        excess=excess,
        scale=scale(fit),
        disagrees=bool(left.p_value < LEVEL_OF_LEFT_OVER or rough),
        seen_apart=len(fit.effects) <= len(found.effects),
    )
