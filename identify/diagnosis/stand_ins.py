"""Do the names only stand in for something that the library lacks? One place of the circuit is asked beside several names.

Two or three effects of the library together can bend a model into what one missing effect does. Where one typed term beside the plain
model explains the readings better than they do, with fewer amounts, they are no finding: the term is told, the names are suspects.
"""

from dataclasses import replace

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.fitting.library import stores
from thermohyd.identify.report.term_words import term_name

from .case import Case, Progress
from .confirmation import PROVEN, strength
from .final_model import FinalModel
from .held_out import Split
from .left_over import misfit_left, smooth_block
from .result import Suspect
from .rivals import all_rivals
from .search import times_usual
from .typed_terms import terms_of


# Several names are always asked; one, or a fault of the bench, only where smooth curves still find something at this level, which is
# one right answer in twenty.
UNCLEAN = 0.05


def without_stand_ins(case: Case, model: FinalModel, split: Split, say: Progress = lambda _: None) -> FinalModel:
    """The final model, or the plain one with the typed terms that do better than all of its effects together.

    Better: a chi-square lower by more than 10.6 in units of the misfit left, as of a proof (docs/diagnosis.md section 11.1), and BIC;
    and the term holds. Faults of the bench stay beside it, unless they are the whole answer. A model that is left unexplained anyhow is
    asked later.
    """
    problem, fit = case.problem, model.fit
    names = fit.physics
    if model.disagrees or not (len(names) > 1 or (fit.effects and model.left.p_value < UNCLEAN)):
        return model
    if any(stores(name) for name in fit.effects):  # ports that store oil have no terms of their own
        return model
    say("asking whether one place does what the names do")
    beside = fit.faults if names else ()
    base = problem.fit(beside, model.base.values, hop_basins=True) if beside else model.base
    found = terms_of(problem, base, split, say, below=fit.chi2 - PROVEN * model.scale)
    if not found or not found[0].holds:
        return model
    best = found[0].fitted
    count = float(np.log(max(int(fit.used.sum()), 2)))
    gain = (fit.chi2 - best.fit.chi2) / model.scale
    if min(gain, gain + count * (len(fit.effects) - len(beside) - len(best.term.coefficients))) <= PROVEN:
        return model
    times, proof, outdone = times_usual(fit), model.proof, term_name(best.term)
    suspects = tuple(
        Suspect(
            name,
            fit.values[name],
            effect_info(name).unit,
            float("nan") if proof is None else proof.each[name],
            times[name],
            strength(fit, model.rivals[name].without, model.scale),
            outdone,
        )
        for name in names
    )
    rows = max(int(base.used.sum()) - len(problem.plans) - len(base.free), 1)
    scale = max(base.chi2 / rows, 1.0)
    rivals = all_rivals(problem, base, case.steps, scale, case.freedom) if base.faults else {}
    return replace(
        model,
        fit=base,
        rivals=rivals,
        p_values={name: rival.p_value for name, rival in rivals.items()},
        left=misfit_left(problem, base, smooth_block(problem, len(base.residual))),
        scale=scale,
        disagrees=True,
        proof=None,
        suspects=(*model.suspects, *suspects),
        terms=found,
    )
