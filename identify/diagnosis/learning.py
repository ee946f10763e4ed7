"""Add a smooth variation to the model at the user's word: its coefficients fitted together with everything else."""

from dataclasses import replace

import numpy as np

from .library_fit import LibraryFit, LibraryProblem
from .projection import Projection
from .result import Variation
from .variation_terms import ABSOLUTE, LearnedTerm
from .variations import term_columns


ROUNDS = 6
SETTLED = 1e-3  # of a coefficient's standard error


def learn(
    problem: LibraryProblem, fit: LibraryFit, variation: Variation
) -> tuple[LibraryProblem, LibraryFit, LearnedTerm]:
    """The problem with the variation as a term of the model, its fit, and the term.

    Gauss-Newton in the coefficients, with the parameters refitted at every round: the compiled fit takes the term as
    data, so learning compiles nothing.
    """
    term = LearnedTerm(
        variation.quantity, variation.variable, variation.centre, variation.reach,
        tuple(0.0 for _ in variation.coefficients), fit.values["underlap"], fit.values["null_bias"],
    )  # fmt: skip
    best, best_term = fit, term
    for _ in range(ROUNDS):
        columns = term_columns(problem.with_terms(term), fit, term)[fit.used]
        base = Projection.beside(fit.nuisance[fit.used])
        left, residual = base(columns), base(fit.residual[fit.used])
        own, singular, right = np.linalg.svd(left, full_matrices=False)
        seen = singular > 1e-6 * singular[0]
        loads = own[:, seen].T @ residual
        step = -(right[seen].T / singular[seen]) @ loads
        unit = 1e-6 if term.quantity in ABSOLUTE else 1.0
        term = replace(
            term, coefficients=(0.0, *(c + unit * s for c, s in zip(term.coefficients[1:], step, strict=True)))
        )
        fit = problem.with_terms(term).fit(fit.effects, fit.values)
        if fit.chi2 < best.chi2:
            best, best_term = fit, term
        if float(np.max(np.abs(loads))) < SETTLED:
            break
    return problem.with_terms(best_term), best, best_term
