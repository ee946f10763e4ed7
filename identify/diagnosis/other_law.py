"""Would the other law of an edge ask for the same effects? The final model fitted with it, and what it does not need taken out.

Not a search of its own: nothing is looked for that only the other law would ask for (docs/diagnosis.md section 10.1).
"""

from dataclasses import dataclass

from thermohyd.identify.fitting.model_form import OTHER, refit
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.problem_solution import misfit_scale
from thermohyd.identify.fitting.result import FitResult
from thermohyd.identify.report.diagnosis_report import in_a_row

from .rivals import ALIKE
from .search import fits_without, implausible


ANOTHER_LAW = "another law of the edge"  # as a rival is named


@dataclass(frozen=True)
class OtherLawSays:
    """The final model with the other law of an edge. chi-squares are of the whitened rows, at one noise.

    fit: with all effects of the final model. needed: with those that this law asks for too. chi2_more: of `needed` over the
    final model with the record's own law, in units of the misfit left; negative where it does better.
    """

    problem: Problem
    fit: Fit
    needed: Fit
    chi2_more: float

    @property
    def in_place_of(self) -> tuple[str, ...]:
        """Effects that are asked for by the record's own law only: the other one does as well without them."""
        if self.chi2_more >= ALIKE:
            return ()
        return tuple(name for name in self.fit.physics if name not in self.needed.effects)


def what_the_other_law_says(problem: Problem, final: Fit, critical: float) -> OtherLawSays:
    """Fit the final model with the other law, then take out one effect after the other that it does not ask for.

    critical: the score from which on an effect is named. An effect that costs less than its square, in units of the misfit that
    the better of both laws leaves, would not have been found with the other law.
    """
    there, whole = refit(problem, final.effects, final.values)
    scale = min(misfit_scale(there, whole), misfit_scale(problem, final))
    needed = whole
    while needed.effects:
        least = min(fits_without(there, needed, needed.effects).values(), key=lambda fit: fit.chi2)
        least = there.fit(least.effects, least.values, hop_basins=True)
        if not (least.chi2 - needed.chi2) / scale < critical**2:
            break
        needed = least
    more = (needed.chi2 - final.chi2) / scale + implausible(needed) - implausible(final)
    return OtherLawSays(there, whole, needed, more)


def better_law(after: FitResult) -> str:
    """The other law of an edge where the data prefer it."""
    asked = after.other_law
    return "" if asked is None or asked.preferred != asked.law else asked.law


def of_the_other_law(says: OtherLawSays | None) -> tuple[str, ...]:
    """What stands under the headline where an effect is asked for by one law only."""
    if says is None or not says.in_place_of:
        return ()
    law = says.problem.record.valve.edge_law
    one = len(says.in_place_of) == 1
    return (
        f"With the {law} law of the edge the record is explained as well without {in_a_row(says.in_place_of)}: only the "
        f"{OTHER[law]} law asks for {'it, so it is' if one else 'them, so they are'} no finding about the valve.",
    )
