"""When is oil stored at the ports worth the program that fits it?

That program takes as long to compile as the one for all plain effects. Storage acts in another way at every amount, so that its
score alone does not say what it could do: it is judged at several amounts, as exactly as a fit would be there, but for the
parameters, which stay as linear as in any score.
"""

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.fitting.library import stores
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit

from .screening import Screen


# Scores and gains that are linear in the parameters may be wrong by this much chi-square, or by this share.
REACH, RELATIVE_REACH = 30.0, 0.3
AMOUNTS = (0.1, 0.3, 1.0, 3.0, 10.0)  # of an effect's scale


def within_reach(gain: float, scale: float = 1.0) -> float:
    """The least gain on paper of what could explain as much as a refit that gained `gain`. scale: of chi-square."""
    return gain - max(REACH * scale, RELATIVE_REACH * gain)


def could_explain(problem: Problem, fit: Fit, scores: Screen, least: float) -> list[str]:
    """The effects storing oil that would take `least` or more off the chi-square of `fit`, beside which `scores` were found.

    All of them where the fit stores oil already: its program is there.
    """
    names = list(dict.fromkeys(s.name for s in scores.signatures if stores(s.name)))
    if any(map(stores, fit.effects)) or not names:
        return names
    before = problem.stored_beside(fit)[0][fit.used]

    def gain(name: str, amount: float) -> float:
        change = problem.stored_beside(fit, **{name: amount})[0][fit.used] - before
        after = scores.residual + scores.projection(change)
        return float(scores.residual @ scores.residual - after @ after)

    found = []
    for name in names:
        best = scores.best(name)
        gains = [gain(name, share * effect_info(name).scale) for share in AMOUNTS]
        gains.append(0.0 if best is None else best.gain)
        if np.nanmax(gains) >= least:
            found.append(name)
    return found
