"""What a reader is told of a term, and what the final model keeps of terms and smooth curves at the user's word."""

from dataclasses import dataclass, replace

import numpy as np

from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.problem_solution import gls_covariance
from thermohyd.identify.model.learned_terms import LearnedTerm
from thermohyd.identify.model.places import place_of
from thermohyd.identify.model.term_variables import VARIABLES
from thermohyd.identify.model.typed_terms import TypedTerm, with_covariance
from thermohyd.identify.report.term_words import confirmed_by, term_sentence

from .case import Progress
from .final_model import FinalModel
from .left_over import LackOfFit, learn as learn_term, misfit_left, smooth_block
from .result import Term, Variation
from .term_fit import with_coefficients
from .typed_terms import Found


@dataclass(frozen=True)
class Learned:
    """The final model with what was learned at the user's word, if anything. beside: columns of a typed term's coefficients."""

    problem: Problem
    fit: Fit
    left: LackOfFit
    terms: tuple[Term, ...]
    smooth: tuple[Variation, ...]
    term: LearnedTerm | TypedTerm | None = None
    beside: np.ndarray | None = None


def with_learned(
    problem: Problem,
    model: FinalModel,
    found: tuple[Found, ...],
    smooth: tuple[Variation, ...],
    learn: bool,
    say: Progress,
) -> Learned:
    """The leading typed term where one holds, else the leading smooth variation, where the user wants to learn."""
    terms = tuple(as_term(term) for term in found)
    if learn and found and found[0].learnable:
        best = found[0].fitted
        say(f"learning how {best.term.place} goes with {best.term.variable}")
        fit, whole = best.fit, with_coefficients(best)
        beside = whole.columns[:, len(fit.order) :]
        known = gls_covariance(fit, max(fit.chi2 / len(fit.residual), 1.0), len(problem.parameters), beside)
        term = with_covariance(best.term, fit.free, known.matrix)
        problem = best.problem.with_terms(term)
        left = misfit_left(problem, whole, smooth_block(problem, len(fit.residual)))
        return Learned(problem, fit, left, (replace(terms[0], learned=True), *terms[1:]), smooth, term, beside)
    if learn and smooth:
        say(f"learning how {smooth[0].quantity} varies with {smooth[0].variable}")
        problem, fit, term = learn_term(problem, model.fit, smooth[0])
        left = misfit_left(problem, fit, smooth_block(problem, len(fit.residual)))
        return Learned(problem, fit, left, terms, (_kept(smooth[0], term), *smooth[1:]), term)
    return Learned(problem, model.fit, model.left, terms, smooth)


def as_term(found: Found) -> Term:
    """What a reader is told of a term."""
    term, (value, std) = found.fitted.term, found.size
    place, (values, curve, band) = place_of(term.place), found.curve
    return Term(
        place=term.place,
        variable=term.variable,
        law=term.law,
        value=value,
        unit=term.unit,
        std=std if np.isfinite(std) else None,
        p_value=found.p_value,
        gap_closed=found.gap_closed,
        alternatives=found.alternatives,
        sentence=term_sentence(term, value, std),
        confirmed_by=confirmed_by(term.place, term.variable, term.law, moving=term.moving),
        coefficients=tuple(float(c) for c in term.coefficients),
        low=term.low,
        high=term.high,
        place_unit=place.unit,
        variable_unit=VARIABLES[term.variable].unit,
        proof=found.proof,
        holds=found.holds,
        on_held_out=found.fitted.joint is not None,
        moving=term.moving,
        variable_values=values,
        curve=curve,
        band=band,
    )


def _kept(variation: Variation, term: LearnedTerm) -> Variation:
    """The variation with the coefficients that the model now holds."""
    return replace(variation, coefficients=term.coefficients, learned=True)
