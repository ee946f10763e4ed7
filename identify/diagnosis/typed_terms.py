"""Ask at which place of the circuit something is missing, and with which quantity it goes: score tests over a table of typed terms.

A column of the table is what a shift of a place does to each reading (`Problem.with_places`) times a law of a variable. All are scored
at once beside the final model; the leading ones are fitted inside the model, parameters and all, and judged on rows that they were
not fitted to. A term says where and with what, never why: after Kristensen, Madsen and Jørgensen (Computers and Chemical Engineering
28, 2004), who ask which state of a grey-box model lacks something, here with places of the circuit and control of false ones.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.identify.fitting.library import stores
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.model.places import OF_READING
from thermohyd.identify.model.typed_terms import CURVES, KNOTS, basis
from thermohyd.side_by_side import each

from .case import Progress
from .confirmation import PROVEN, parts_left_out, predicted_apart
from .final_model import ON_HELD_OUT, closed, mean_square
from .held_out import Split
from .term_fit import (
    PATIENT,
    FittedTerm,
    as_wear,
    fitted_inside,
    from_both_sides,
    linear_only,
    mirrored,
    straightened,
    with_coefficients,
)
from .term_table import ALIKE, AS_GOOD, Scored, Table, blank, family, prior_of, table_of


LEVEL = 1e-3  # of the whole table
ASKED_BY_REFIT = 6  # pairs of place and variable
FROM_ONE_PLACE = 3  # of these at most
SUSPECTED, SUSPECTS = 0.05, 2  # level and number of what physics is known to do, beside these, in motion
MOST = 3  # terms that are told
SIMPLE_LAWS = 3  # of the leading place, that are asked in the end
BY_CHANCE = 2.0  # standard errors of a mean square, within which rows held out show no gap of their own
A_HAIR = 0.1  # chi-square, in units of what the best leaves: ten times what two refits of one curve end apart
# Chi-square, in units of what the best leaves, beyond what is told: a curve's five coefficients cost as much.
FAR_FROM_TOLD = 40.0
CURVE_POINTS = 41
BENT = 1.5  # reduced chi-square from which a model counts as bent
STRAIGHTENED = 3  # times that a table is asked anew
# Share of what a term must close, below which the best of a first round is not followed further in motion, where a round takes ten seconds:
# of five effects hidden at full strength the best of the first round was the best of all, to 0.3 of chi-square.
FAR_OFF = 0.9


Ask = Callable[[Sequence[Scored]], list[tuple[Scored, FittedTerm]]]  # each beside its refit


@dataclass(frozen=True)
class Found:
    """A term that chance does not explain. p_value: of the whole table; gap_closed: on rows held out; proof: 2 ln E, as of an effect.

    held_out: mean square misfit of the rows held out, without and with the term, in units of the noise; nan where no refit was made.
    """

    fitted: FittedTerm
    p_value: float
    gap_closed: float
    proof: float
    alternatives: tuple[tuple[str, str], ...]
    held_out: tuple[float, float]

    @property
    def holds(self) -> bool:
        """Whether it predicts what it was not fitted to, by the rule of effects."""
        return self.gap_closed > ON_HELD_OUT and self.proof > PROVEN

    @property
    def learnable(self) -> bool:
        """Whether it was fitted inside the model, and holds."""
        return self.holds and self.fitted.joint is not None

    @property
    def size(self) -> tuple[float, float]:
        """A law's coefficient and its standard error; of a curve the spread of the shift over what was seen, with its own."""
        term, std = self.fitted.term, self.fitted.std
        if term.law not in CURVES:
            return term.coefficients[0], float(std[0])
        _, shapes, shift = self._shown()
        slope = shapes[int(np.argmax(shift))] - shapes[int(np.argmin(shift))]
        return float(np.ptp(shift)), float(np.sqrt(max(slope @ self._covariance @ slope, 0.0)))

    @property
    def curve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The variable over what was seen, the shift there and its standard deviation, SI."""
        values, shapes, shift = self._shown()
        return values, shift, np.sqrt(np.maximum(np.einsum("ri,ij,rj->r", shapes, self._covariance, shapes), 0.0))

    def _shown(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values of the variable, what each coefficient multiplies there, and the shift.

        Of a local law without its straight line: parameters that the line resembles take it up, and its error bar says nothing.
        """
        term = self.fitted.term
        values = np.linspace(term.low, term.high, 4 * KNOTS - 3 if term.law == "local" else CURVE_POINTS)
        shapes = basis(term.law, values, term.low, term.high)
        if term.law == "local":
            line = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, len(values)), 2))[0]
            shapes = shapes - line @ (line.T @ shapes)
        return values, shapes, shapes @ np.asarray(term.coefficients)

    @property
    def _covariance(self) -> np.ndarray:
        """Of the coefficients (k, k)."""
        joint, others = self.fitted.joint, len(self.fitted.names)
        return np.diag(self.fitted.std**2) if joint is None else joint[others:, others:]


def leading(table: Table, level: float = LEVEL) -> list[Scored]:
    """Whom a refit asks: the best pairs at a level of the whole table, of one place a few.

    Of pairs that no reading tells apart an instrument's stands for all: it is checked without opening the valve.
    """
    chosen: list[Scored] = []
    for found in table.ranked:
        same = sum(family(c.entry.place) == family(found.entry.place) for c in chosen)
        twin = next((i for i, c in enumerate(chosen) if _alike(c, found)), None)
        if twin is not None:
            if _of_an_instrument(found) and not _of_an_instrument(chosen[twin]):
                chosen[twin] = found
            continue
        if same < FROM_ONE_PLACE and table.p_value(found) <= level:
            chosen.append(found)
        if len(chosen) == ASKED_BY_REFIT:
            break
    return [*chosen, *_usual_suspects(table, chosen)]


def _usual_suspects(table: Table, chosen: list[Scored]) -> list[Scored]:
    """In motion, and where chance does not explain the table: what physics is known to do by one coefficient, at a lower level.

    A run is far from linear in what it lacks: air in the oil gained 22 of chi-square by slopes and 412 by a refit, beside a bulk modulus
    that had stood in for it. What is told has to predict rows that it was not fitted to, whatever its score was.
    """
    if not chosen or not chosen[0].entry.moving:
        return []
    usual = [
        found
        for found in table.ranked
        if found.rank == 1
        and prior_of(found.entry) == 0.0
        and table.p_value(found) <= SUSPECTED
        and not any(_alike(one, found) for one in chosen)
    ]
    return usual[:SUSPECTS]


def _of_an_instrument(found: Scored) -> bool:
    """In motion nothing reads the position that edges are given; where it is read, it is a reading."""
    measured = not found.entry.moving and found.entry.place == "position"
    return measured or found.entry.place.startswith(OF_READING)


def terms_of(
    problem: Problem,
    fit: Fit,
    split: Split,
    say: Progress = lambda _: None,
    *,
    below: float = np.inf,
    level: float = LEVEL,
) -> tuple[Found, ...]:
    """The leading terms beside `fit`, which leaves a misfit: the best first; empty where none is beyond chance at a level of the table.

    below: chi-square that a term has to come below to be of use; empty too where in motion a first round of refits stays far above it.
    """
    say("asking where in the circuit, and with what")
    plain = problem
    table, problem = table_of(problem, fit)
    lead = leading(table, level)
    if not lead:
        return ()
    refits = not any(stores(name) for name in fit.effects)
    start = fit

    asked: list[tuple[Scored, FittedTerm]] = []

    def goal() -> float:
        """Chi-square up to which a refit may still be told, or be a rival of what is."""
        ended: dict[tuple[str, str], float] = {}
        for scored, fitted in asked:
            ended[scored.entry.pair] = min(fitted.fit.chi2, ended.get(scored.entry.pair, np.inf))
        if len(ended) < MOST:
            return np.inf
        best = sorted(ended.values())
        return best[MOST - 1] + FAR_FROM_TOLD * max(best[0] / max(table.rows, 1), 1.0)

    def ask(scored: Sequence[Scored]) -> list[tuple[Scored, FittedTerm]]:
        if problem.in_motion and scored:  # where each takes seconds
            say(f"fitting {len(scored)} terms: {', '.join(dict.fromkeys(s.entry.place for s in scored))}")
        within = goal()
        # One that has come within reach is not asked again from elsewhere: it ends where it did.
        there = {s.entry.key for s, f in asked if f.fit.chi2 < within < np.inf}
        scored = [s for s in scored if s.entry.key not in there]
        one = lambda s: (
            fitted_inside(problem, start, blank(s.entry, start, s.entry.columns.shape[1]), goal=within)
            if refits
            else linear_only(problem, fit, s, table.noise)
        )
        return list(zip(scored, each(one, scored), strict=True))

    asked += ask(lead)
    if refits and not problem.in_motion:
        sides_differ, within = [s for s in table.entries if mirrored(s)], goal()
        sides = each(lambda s: from_both_sides(problem, fit, s, within), sides_differ)
        both = [(s, f) for s, found in zip(sides_differ, sides, strict=True) for f in found]
        both = each(lambda item: as_wear(problem, fit, *item, sides_differ, within), both)
        asked += [(replace(s, gain=max(fit.chi2 - f.fit.chi2, 0.0)), f) for s, f in both]
        # Where most rows agree with the model, those that do not show what is missing, not what it bent.
        if fit.chi2 > BENT * table.rows:
            for values in plain.where_most_agree(fit)[:1]:
                start = straightened(problem, fit, replace(fit, values=fit.values | values))
                agreed, _ = table_of(problem.with_terms(), start)
                asked += ask(leading(agreed))
    if problem.in_motion and min(f.fit.chi2 for _, f in asked) > fit.chi2 - FAR_OFF * (fit.chi2 - below):
        return ()
    # A model that misses by far has bent its parameters to the misfit, and scores beside it say little: they are asked again beside
    # the parameters that the best term so far has straightened.
    for _ in range(STRAIGHTENED if refits else 0):
        best_so_far = min(f.fit.chi2 for _, f in asked)
        if fit.chi2 <= BENT * table.rows:
            break
        best_one = min((f for _, f in asked), key=lambda f: f.fit.chi2)
        start = straightened(problem, fit, fitted_inside(problem, best_one.fit, best_one.term, PATIENT).fit)
        table, _ = table_of(problem.with_terms(), start)
        asked += ask(leading(table))
        if min(f.fit.chi2 for _, f in asked) > 0.9 * best_so_far:
            break
    freedom = max(table.rows, 1)
    noise = max(min(f.fit.chi2 for _, f in asked) / freedom, 1.0)
    cost = lambda item: item[1].fit.chi2 / noise + item[0].cost(freedom)
    asked.sort(key=cost)
    if refits:
        asked = sorted([*asked, *_simpler(table, asked, AS_GOOD * noise, ask)], key=cost)
    if refits and not problem.in_motion:
        asked = sorted([*asked, *_other_edges(table, asked[0][0], [s for s, _ in asked], ask)], key=cost)
    if refits:
        asked = sorted([*asked, *_other_laws(table, asked[0], [s for s, _ in asked], ask)], key=cost)
        first, rough = asked[0]
        asked[0] = (first, fitted_inside(problem, rough.fit, rough.term, PATIENT))
        asked.sort(key=cost)
    best: dict[tuple[str, str], tuple[Scored, FittedTerm]] = {}
    for item in asked:
        best.setdefault(item[0].entry.pair, item)
    told = list(best.values())
    distinct = [told[i] for i in told_apart([(s.rank, f.fit.chi2) for s, f in told], noise)]
    shown = _on_rows_apart(plain, problem, fit, [fitted for _, fitted in distinct[:MOST]], split, table)
    found = []
    for (scored, fitted), (gap_closed, proof, held_out) in zip(distinct, shown, strict=False):
        near = [
            other
            for other, own in told
            if other is not scored and cost((other, own)) - cost((scored, fitted)) < AS_GOOD
        ]
        # And what no reading tells from these, or from the term itself.
        same = (pair for s in (scored, *near) for pair in _same_direction(table, s) if pair not in best)
        alike = tuple(dict.fromkeys([*(other.entry.pair for other in near), *same]))
        found.append(Found(fitted, table.p_value(scored), gap_closed, proof, alike, held_out))
    return tuple(found)


def _on_rows_apart(
    plain: Problem, problem: Problem, fit: Fit, fitted: Sequence[FittedTerm], split: Split, table: Table
) -> list[tuple[float, float, tuple[float, float]]]:
    """(gap closed, proof, mean square misfit without and with the term) of each term, on rows that it was not fitted to.

    plain, problem: without and with places. Where no refit was made: what the linear step closes, and no proof.
    """
    if any(stores(name) for name in fit.effects):
        excess = [max(fit.chi2 - table.rows, one.gain) for one in fitted]
        return [
            (float(np.clip(one.gain / all_, 0.0, 1.0)), np.nan, (np.nan, np.nan))
            for one, all_ in zip(fitted, excess, strict=True)
        ]
    without = plain.with_rows(~split.held).fit(fit.effects, fit.values)
    gap, kept = mean_square(plain, without, split), problem.with_rows(~split.held)
    parts = parts_left_out(problem.tests)
    apart = lambda f: float(np.sum(predicted_apart(f, parts) ** 2))
    bare = apart(fit)

    def shown(one: FittedTerm) -> tuple[float, float, tuple[float, float]]:
        # From where all rows led: beside the bent model the same term may end elsewhere.
        seen = fitted_inside(kept, straightened(kept, without, one.fit), one.term, PATIENT)
        held_out = gap, mean_square(replace(seen.problem, used=None), seen.fit, split)
        scale = max(one.fit.chi2 / max(int(fit.used.sum()), 1), 1.0)
        one_by_one = bare, apart(with_coefficients(one))
        return *judged(held_out, int(split.held.sum()), one_by_one, len(fit.residual), scale), held_out

    return each(shown, fitted)


def told_apart(ended: Sequence[tuple[int, float]], noise: float) -> list[int]:
    """Which of some terms, (coefficients that count, chi-square) each, the best first, do not do as well as an earlier one to a hair: what
    does is one curve by another name, and stands among the alternatives."""
    kept: list[int] = []
    for i, (rank, chi2) in enumerate(ended):
        twins = (rank == ended[k][0] and abs(chi2 - ended[k][1]) < A_HAIR * noise for k in kept)
        if not any(twins):
            kept.append(i)
    return kept


def _other_laws(
    table: Table, best: tuple[Scored, FittedTerm], asked: list[Scored], ask: Ask
) -> list[tuple[Scored, FittedTerm]]:
    """The other laws of the leading pair, and the simple ones of its place, fitted too: a linear score may have preferred the wrong one.

    Where what leads differs from spot to spot, so do its rivals: no smoother one comes near it.
    """
    pair, known = best[0].entry.pair, {s.entry.key for s in asked}
    new = [s for s in table.entries if s.entry.key not in known]
    own = [s for s in new if s.entry.pair == pair or s.entry.law == best[0].entry.law == "local"]
    simple = [s for s in new if s.entry.place == pair[0] and s.rank == 1 and s.entry.pair != pair]
    simple.sort(key=lambda s: -s.gain)
    constant = [s for s in simple if s.entry.law == "constant"]
    chosen = {id(s): s for s in (*own, *constant, *simple[:SIMPLE_LAWS])}
    return ask(list(chosen.values()))


def _simpler(
    table: Table, asked: list[tuple[Scored, FittedTerm]], near: float, ask: Ask
) -> list[tuple[Scored, FittedTerm]]:
    """The best two laws of one coefficient of each pair whose smooth law is asked: beside a bent fit a curve takes up what a refit of the
    parameters gives back. Of static tests where the smooth law's chi-square is `near` the best."""
    known = {s.entry.key for s, _ in asked}
    best = min(f.fit.chi2 for _, f in asked)
    pairs = dict.fromkeys(s.entry.pair for s, f in asked if s.rank > 1 and (s.entry.moving or f.fit.chi2 < best + near))
    new = []
    for pair in pairs:
        own = sorted((s for s in table.entries if s.entry.pair == pair and s.rank == 1), key=lambda s: -s.gain)
        laws = own[:1] if any(s.entry.moving for s in own) else own[:2]
        new += [s for s in laws if s.entry.key not in known]
    return ask(new)


def _other_edges(table: Table, best: Scored, asked: list[Scored], ask: Ask) -> list[tuple[Scored, FittedTerm]]:
    """The quantity of the leading place at all edges, a pair or one of them, with the same variable: scores beside a bent fit may have
    preferred the wrong ones."""
    place, variable = best.entry.pair
    known = {s.entry.pair for s in asked}
    new = [
        s
        for s in table.ranked
        if s.entry.variable == variable and family(s.entry.place) == family(place) and s.entry.pair not in known
    ]
    return ask(new)


def _same_direction(table: Table, best: Scored) -> list[tuple[str, str]]:
    """Pairs whose column no reading tells from that of the best, beside the parameters of this table."""
    own = next((s for s in table.entries if s.entry.key == best.entry.key), best)
    return list(dict.fromkeys(s.entry.pair for s in table.entries if s.entry.pair != own.entry.pair and _alike(own, s)))


def _alike(a: Scored, b: Scored) -> bool:
    return a.rank == b.rank == 1 and abs(float(a.directions[:, 0] @ b.directions[:, 0])) > ALIKE


def judged(
    on_held: tuple[float, float], rows: int, apart: tuple[float, float], all_rows: int, scale: float
) -> tuple[float, float]:
    """(share of the gap that is closed on rows held out, 2 ln E), without and with a term in each pair.

    on_held: mean square misfit of `rows` held out. apart: chi-square of `all_rows`, every condition left out once, whose fall in units
    of the misfit left, `scale`, is the proof; where the rows held out alone show no gap, theirs is the share.
    """
    proof = (apart[0] - apart[1]) / scale
    if on_held[0] - 1.0 < BY_CHANCE * np.sqrt(2.0 / max(rows, 1)):
        return closed(apart[0] / all_rows, apart[1] / all_rows, all_rows), proof
    return closed(*on_held, rows), proof
