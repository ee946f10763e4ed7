"""Where a misfit remains: which rivals do the data allow beside what every model of the library misses?

Compared by the noise alone, models are told apart by how each bends to a misfit that none of them explains: hundreds of chi-square either
way, which the next rounding turns round. Here what is missed (`remaining_misfit`) is a part of the readings' error for both (Kennedy and
O'Hagan, Journal of the Royal Statistical Society B 63, 2001), with the curves and sizes of the named model. docs/diagnosis.md section 10.3.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.side_by_side import by_name, each

from .remaining_misfit import Remaining, chi2_on_paper
from .rivals import ALIKE, HALF_WAY, Rival, Rivals
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
    missed = believed.discrepancy
    beside, on_paper = problem.with_discrepancy(missed), lambda fit: chi2_on_paper(fit, missed) / believed.scale
    own = on_paper(final)
    enough = believed.fit.chi2 + believed.scale * (ALIKE + implausible(believed.fit))

    def compared(rival: Rival, gain: float) -> Rival:
        paper = on_paper(rival.fit) - own
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

    def of(name: str) -> Rivals:
        those = rivals[name]
        gain = on_paper(those.without) - own
        tried = each(lambda rival: compared(rival, gain), those.tried)
        return replace(those, tried=tuple(sorted(tried, key=lambda r: r.chi2_more)))

    return by_name(of, rivals)


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
