"""Where a misfit remains: which rivals do the data allow beside what every model of the library misses?

Compared by the noise alone, models are told apart by how each bends to a misfit that none of them explains: hundreds of chi-square either
way, which the next rounding turns round. Here what is missed (`remaining_misfit`) is a part of the readings' error for both (Kennedy and
O'Hagan, Journal of the Royal Statistical Society B 63, 2001), with the curves and sizes of the named model. docs/diagnosis.md section 10.3.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.side_by_side import each

from .remaining_misfit import Beside, Remaining
from .rivals import ALIKE, HALF_WAY, Rival, Rivals
from .screening import Projection
from .search import implausible


def rivals_beside_misfit(
    problem: Problem, final: Fit, rivals: Mapping[str, Rivals], remaining: Remaining
) -> dict[str, Rivals]:
    """The rivals of each effect of `final`, where what is missed allows more of them: with the chi-square that they need more beside it.

    Of those that one Gauss-Newton step brings half of what the named one gains, a refit decides; in motion, where one takes ten seconds,
    that step. What the noise alone allows stays a rival.
    """
    believed = remaining.believed
    if believed.discrepancy is None:
        return dict(rivals)
    beside, own = problem.with_discrepancy(believed.discrepancy), _on_paper(final, believed)
    enough = believed.fit.chi2 + believed.scale * (ALIKE + implausible(believed.fit))

    def compared(rival: Rival, gain: float) -> Rival:
        paper = _on_paper(rival.fit, believed) - own
        if rival.chi2_more < ALIKE or paper >= HALF_WAY * gain:
            return rival
        if problem.in_motion:
            more = paper + implausible(rival.fit) - implausible(final)
            return replace(rival, chi2_more=min(rival.chi2_more, more))
        # A valley by the noise need not be one beside the curves: begun in its own, a lag of the real valve ended 116 behind the loop in
        # whose place it stood, and 15 ahead where that loop's model had ended beside them.
        there = {**believed.fit.values, rival.instead_of: 0.0, rival.name: rival.fit.values[rival.name]}
        for start in (rival.fit.values, there):
            again = beside.fit(rival.fit.effects, start, goal=enough)
            # What a fault must gain for the many places that it was looked for in is left out: it explains what the effect does.
            more = (again.chi2 - believed.fit.chi2) / believed.scale + implausible(again) - implausible(believed.fit)
            if more < ALIKE and again.values[rival.name] != 0.0 and rival.name not in again.active:
                # A search that was left as hopeless by the noise has not come to its amount.
                fit = rival.fit if rival.fit.converged else problem.fit(again.effects, again.values)
                return replace(rival, fit=fit, chi2_more=more, beside=again)
        return rival

    asked = [(name, rival) for name, those in rivals.items() for rival in those.tried]
    gains = {name: _on_paper(those.without, believed) - own for name, those in rivals.items()}
    found = each(lambda one: (one[0], compared(one[1], gains[one[0]])), asked)
    of = lambda name: sorted((rival for key, rival in found if key == name), key=lambda r: r.chi2_more)
    return {name: replace(those, tried=tuple(of(name))) for name, those in rivals.items()}


def _on_paper(fit: Fit, beside: Beside) -> float:
    """Chi-square beside a discrepancy, in units of its scale, where one Gauss-Newton step from the fit leads."""
    assert beside.discrepancy is not None
    project = Projection.beside(beside.discrepancy.whitened(fit.nuisance.T).T)
    left = project(beside.discrepancy.whitened(fit.residual))
    return float(left @ left) / beside.scale


def weighed_again(problem: Problem, tried: Sequence[Rival], remaining: Remaining) -> tuple[Rival, ...]:
    """The rivals, fitted with the same weights as `remaining`."""
    if remaining.weighed.discrepancy is None:
        return tuple(tried)
    beside = remaining.weighing(problem)

    def again(rival: Rival) -> Rival:
        begun = rival.fit if rival.beside is None else rival.beside
        fit = beside.fit(begun.effects, begun.values)
        return replace(rival, fit=fit, chi2_more=(fit.chi2 - remaining.fit.chi2) / remaining.weighed.scale)

    return tuple(each(again, tried))
