"""What else would explain a difference: an effect that the parameters of each record absorb, or a few rows where no single one is sure.

A parameter's difference may be that of an effect which no single record shows beside its parameters. It is put into both models with
the parameter the same in both; where both records are then explained about as well, the data do not tell the two apart. Where several
rows trade off against each other, it is sure that something differs and not what: then the fewest rows that explain it are said.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.diagnosis.screening import Projection
from thermohyd.identify.diagnosis.search import penalty
from thermohyd.identify.fitting.library import asks_for_more, expensive_to_compile, stores

from .both_models import ALIKE, Diagnosed, of_the_bench
from .differences import LinearDifference, if_equal
from .joint_fit import JointFit, joint_fit
from .result import Explanation


SHORT_OF = 30.0  # chi-square, or the share below, by which a linear estimate may fall short of what a refit explains
SHARE = 0.3  # as of rivals (diagnosis.rivals)
MOST_REFITS, MOST_PARAMETERS, MOST_ROWS = 4, 3, 2  # of computing, and of what a reader takes in


def instead_of(
    name: str, a: Diagnosed, b: Diagnosed, fit: JointFit, shared: frozenset[str], same_bench: bool
) -> tuple[str, ...]:
    """Effects that explain the difference of a parameter: both records are fitted with the parameter the same and the effect in both."""
    own = (*a.fit.physics, *b.fit.physics)
    library = [n for n in a.problem.library.names if n in b.problem.library.names and n not in own]
    # Of one bench the oil and the instruments are the same; and what takes a program of its own is no rival of a difference.
    library = [
        n
        for n in library
        if not (same_bench and of_the_bench(n))
        and not expensive_to_compile((*own, n))
        and (not stores(n) or asks_for_more(own))
    ]
    losses = _linear_losses(name, library, a, b, fit)
    if not losses:
        return ()
    whole = losses.pop("")
    likely = sorted((n for n, loss in losses.items() if loss < SHORT_OF + SHARE * whole), key=lambda n: losses[n])
    found = []
    for other in likely[:MOST_REFITS]:
        pair = [d.fitted_with((*d.fit.physics, other)) for d in (a, b)]
        parts = [replace(p.part, scale=d.scale) for p, d in zip(pair, (a, b), strict=True)]
        there = joint_fit(parts[0], parts[1], shared | {name})
        implausible = sum(penalty(p.fit) - penalty(d.fit) for p, d in zip(pair, (a, b), strict=True))
        if there.converged and there.chi2 - fit.chi2 + implausible < ALIKE:
            found.append((there.chi2, other))
    return tuple(other for _, other in sorted(found))


def _linear_losses(name: str, library: list[str], a: Diagnosed, b: Diagnosed, fit: JointFit) -> dict[str, float]:
    """{effect: chi-square that is lost, to the linear order, with the parameter the same and this effect in both records}; under
    "" what is lost without any. Empty where the columns are not those of one kind of tests."""
    if any(len(d.problem.readings) > 1 or d.problem.in_motion for d in (a, b)):
        return {}
    places = [fit.free.index((d.name, name)) for d in (a, b)]
    entries = [(d.name, name) for d in (a, b)]
    apart = fit.values[entries[1]] - fit.values[entries[0]]
    displaced = fit.residual - apart * fit.columns[:, places[1]]
    rest = np.delete(fit.columns, places, axis=1)
    one = fit.columns[:, places].sum(axis=1)
    base = Projection.beside(np.column_stack([rest, one]))
    least = float(fit.residual @ Projection.beside(fit.columns)(fit.residual))
    left = base(displaced)
    found = {"": float(left @ left) - least}
    seen = [d.problem.with_all_columns(d.fit) for d in (a, b)]
    rows = [len(own.residual) for own in seen]
    for other in library:
        columns = np.zeros((sum(rows), 2))
        for k, (own, d) in enumerate(zip(seen, (a, b), strict=True)):
            place = slice(0, rows[0]) if k == 0 else slice(rows[0], None)
            column = own.column(other) / np.sqrt(d.scale)
            if effect_info(other).even or not np.any(column):
                values = {n: v for n, v in d.fit.values.items() if n in d.fit.effects or n in d.problem.plans}
                step = effect_info(other).scale
                moved = d.problem.evaluate({**values, other: step}, (*d.fit.effects, other)).residual
                column = (moved - own.residual) / step / np.sqrt(d.scale)
            columns[place, k] = column
        if np.isfinite(columns).all():
            beside = base.with_columns(columns)(displaced)
            found[other] = float(beside @ beside) - least
    return found


def explanations(
    differences: list[LinearDifference], differing: list[str], level: float, say: Callable[[str], None] = lambda _: None
) -> tuple[Explanation, ...]:
    """The fewest rows beside those that differ for certain with which the others may be equal; none where nothing is left to explain."""
    names = [d.name for d in differences]
    if if_equal(differences, [n for n in names if n not in differing]).p_value >= level:
        return ()
    say("the fewest differences that explain both records")
    left = [n for n in names if n not in differing]
    for count in range(1, MOST_ROWS + 1):
        found = []
        for chosen in combinations(left, count):
            rest = if_equal(differences, [n for n in left if n not in chosen])
            if rest.p_value >= level:
                found.append(Explanation(chosen, rest.p_value, {n: rest.others[n] for n in (*differing, *chosen)}))
        if found:
            return tuple(sorted(found, key=lambda e: -e.p_value))
    return ()
