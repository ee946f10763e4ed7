"""Which of the terms that were fitted are told, and which of two that do alike comes first: no model is run."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.linear_fit import linear_fit, linear_problem
from helpers.small_diagnosis import small_case

from thermohyd.identify.diagnosis import typed_terms
from thermohyd.identify.diagnosis.held_out import split_rows
from thermohyd.identify.diagnosis.max_t import MaxT
from thermohyd.identify.diagnosis.term_fit import FittedTerm, as_wear, columns_of, fitted_inside, mirrored
from thermohyd.identify.diagnosis.term_table import (
    UNHEARD_OF,
    UNUSUAL,
    Entry,
    Scored,
    Table,
    blank,
    opened,
    prior_of,
    table_of,
)
from thermohyd.identify.diagnosis.typed_terms import judged, leading, told_apart
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.model.places import place_of
from thermohyd.identify.model.typed_terms import TypedTerm
from thermohyd.identify.noise.correlation import NoiseCorrelation


def entry(place, variable):
    return Entry(place, variable, "proportional", np.zeros((1, 1)), np.ones(1), 0.0, 1.0)


def test_an_instrument_stands_for_what_no_reading_tells_apart():
    own, other = np.eye(5)[:, :1], np.eye(5)[:, 1:2]
    scored = [
        Scored(entry(place, variable), gain, 1, direction)
        for place, variable, gain, direction in (
            ("edge_flow", "opening", 90.0, own),
            ("reading:flows", "flow", 89.9, own),
            ("position", "position", 89.8, own),
            ("viscosity", "temperature", 60.0, other),
        )
    ]
    law = MaxT.of(np.concatenate([own, other], axis=1), np.zeros(2, dtype=bool), 200)
    found = leading(Table(tuple(scored), law, 200.0, 1.0, 100))
    assert [s.entry.pair for s in found] == [("reading:flows", "flow"), ("viscosity", "temperature")]


@pytest.mark.parametrize(("moving", "first"), [(False, "position"), (True, "flow_from_a_to_b")])
def test_in_motion_nothing_reads_the_position_that_edges_are_given(moving, first):
    direction = np.eye(5)[:, :1]
    alike = [
        Scored(replace(entry(place, "load"), moving=moving), gain, 1, direction)
        for place, gain in (("flow_from_a_to_b", 90.0), ("position", 89.9))
    ]
    law = MaxT.of(direction, np.zeros(1, dtype=bool), 200)
    assert [s.entry.place for s in leading(Table(tuple(alike), law, 200.0, 1.0, 100))] == [first]


@pytest.mark.parametrize("moving", [True, False])
def test_what_physics_is_known_to_do_is_asked_at_a_lower_level_in_motion(moving):
    """Beside what chance does not explain: of laws that are usual there, and by one coefficient."""
    pairs = (
        (("force_on_piston", "direction"), "proportional", 90.0),
        (("flow_into_chambers", "pressure_rate"), "gaseous", 14.0),
        (("flow_into_chamber_a", "time"), "proportional", 14.0),  # nothing is known to do that
        (("force_on_piston", "velocity"), "proportional", 2.0),  # chance does
    )
    scored = [
        Scored(replace(entry(*pair), law=law, moving=moving), gain, 1, np.eye(9)[:, i : i + 1])
        for i, (pair, law, gain) in enumerate(pairs)
    ]
    law = MaxT.of(np.eye(9)[:, : len(pairs)], np.zeros(len(pairs), dtype=bool), 4000)
    table = Table(tuple(scored), law, 1000.0, 1.0, 1000)
    assert 1e-3 < table.p_value(scored[1]) < 0.05
    assert [s.entry.pair for s in leading(table)] == [pair for pair, *_ in pairs[: 2 if moving else 1]]
    assert leading(Table(tuple(scored[1:]), law, 1000.0, 1.0, 1000)) == []  # chance explains the table


@pytest.mark.parametrize(
    ("left", "in_motion", "followed"),
    [
        (150.0, True, True),  # of 800 that a term must close it closes 750
        (190.0, True, False),
        (190.0, False, True),  # static tests: a round takes a second
    ],
)
def test_what_stays_far_from_what_it_must_do_is_followed_no_further_in_motion(monkeypatch, left, in_motion, followed):
    """A first round of refits says it, where a round takes ten seconds."""
    problem = linear_problem(NoiseCorrelation())
    rows = sum(len(problem.noise.std[key]) for key in problem.rows())
    fit = linear_fit(np.full(rows, np.sqrt(900.0 / rows)), np.zeros((rows, 1)))
    direction = np.eye(rows)[:, :1]
    lead = Scored(replace(entry("flow_into_a", "pressure"), moving=in_motion), 700.0, 1, direction)
    table = Table((lead,), MaxT.of(direction, np.zeros(1, dtype=bool), 200), 900.0, 1.0, rows)

    class FollowedError(Exception):
        """What comes after the first round was asked for."""

    def other_laws(*_):
        raise FollowedError

    def refit(problem, fit, term, rounds=1, goal=np.inf):
        return FittedTerm(term, problem, replace(fit, chi2=left), 0.0, np.ones(1), np.eye(1))

    monkeypatch.setattr(Problem, "in_motion", in_motion)
    monkeypatch.setattr(typed_terms, "table_of", lambda problem, fit: (table, problem))
    monkeypatch.setattr(typed_terms, "fitted_inside", refit)
    monkeypatch.setattr(typed_terms, "_other_laws", other_laws)
    monkeypatch.setattr(typed_terms, "BENT", 1e9)
    if followed:
        with pytest.raises(FollowedError):
            typed_terms.terms_of(problem, fit, split_rows(problem.tests), below=100.0)
    else:
        assert typed_terms.terms_of(problem, fit, split_rows(problem.tests), below=100.0) == ()


def test_one_curve_by_another_name_is_told_once():
    ended = [(1, 500.0), (1, 500.05), (1, 503.0), (3, 500.0)]
    assert told_apart(ended, 1.0) == [0, 2, 3]
    assert told_apart(ended, 50.0) == [0, 3]  # where much is left, little counts for less


@pytest.mark.parametrize(
    ("on_held", "share"),
    [
        ((2.0, 1.0), 1.0),  # a gap that the rows held out show
        ((2.0, 1.5), 0.5),
        ((1.02, 1.01), 1.0),  # none there: of the proof's rows, whose misfit falls below the noise
        ((0.99, 0.98), 1.0),
    ],
)
def test_a_gap_that_the_rows_held_out_do_not_show_is_that_of_the_proofs_rows(on_held, share):
    found = judged(on_held, 800, (2900.0, 2800.0), 2850, 1.0)
    assert found == (pytest.approx(share), pytest.approx(100.0))


def test_what_known_physics_does_comes_first_among_equals():
    known, unheard = entry("viscosity", "constant"), entry("viscosity", "rate")
    assert prior_of(known) == 0.0
    assert prior_of(unheard) == UNHEARD_OF
    # By another law than it usually goes.
    loss = entry("return_pressure", "flow")
    assert (prior_of(replace(loss, law="square")), prior_of(loss)) == (0.0, UNUSUAL)
    # Of one edge beside that: what all edges do is simpler.
    assert prior_of(entry("edge_radius:pa", "rate")) == UNHEARD_OF + place_of("edge_radius:pa").prior


@pytest.mark.parametrize(
    ("place", "variable", "law", "coefficients"),
    [
        ("oil_temperature:return", "pressure_drop", "proportional", (4e-7,)),
        ("oil_temperature:pa", "pressure_drop", "smooth", (1.0, 0.5, -0.3, 0.2)),
        ("oil_temperature", "constant", "constant", (2.0,)),
    ],
)
def test_columns_of_a_warming_are_the_derivatives_of_the_residual(place, variable, law, coefficients):
    case = small_case("pilot")
    problem = opened(case.problem, case.base)
    term = TypedTerm(place, variable, law, coefficients, *((1.0, 1.0) if law == "constant" else (0.0, 210e5)))
    at = lambda own: problem.with_terms(replace(term, coefficients=own)).evaluate(case.base.values, ())
    columns = np.zeros(0)
    for _ in range(6):  # a variable made of the model's own pressures is that of the last round
        columns, states = columns_of(problem.with_terms(term), at(coefficients), term)
        assert states is not None
        problem = problem.with_states(states)
    for i, own in enumerate(coefficients):
        step = 1e-3 * abs(own)
        moved = [tuple(c + sign * step * (k == i) for k, c in enumerate(coefficients)) for sign in (1.0, -1.0)]
        wanted = (at(moved[0]).residual - at(moved[1]).residual) / (2.0 * step)
        assert np.abs(wanted).max() > 0.0
        np.testing.assert_allclose(columns[:, i], wanted, atol=2e-3 * np.abs(wanted).max())


def test_a_refit_that_cannot_reach_its_goal_is_left():
    case = small_case("pilot")
    problem = opened(case.problem, case.base)
    term = TypedTerm("clearance", "opening", "smooth", (0.0,) * 4, 0.0, 100e-6)
    whole, left = (fitted_inside(problem, case.base, term, goal=goal) for goal in (np.inf, 0.0))
    assert whole.fit.chi2 < left.fit.chi2 < case.base.chi2
    # One that can is followed as far as ever.
    again = fitted_inside(problem, case.base, term, goal=whole.fit.chi2 + 1.0)
    assert again.fit.chi2 == whole.fit.chi2


def test_an_edge_that_seems_sharper_is_told_as_the_others_wear():
    """A return edge worn by 15 um, with no wear in the library, was told as supply edges 15 um sharper than the rest: the same valve."""
    case = small_case("pilot")
    base = replace(case.base, values=case.base.values | {"edge_radius": 8e-6})
    table, problem = table_of(case.problem, case.base)
    others = {s.entry.place: s for s in table.entries if mirrored(s)}
    supply, amount = others["edge_radius:supply"], 3e-6
    as_told = lambda side: fitted_inside(
        problem, base, replace(blank(supply.entry, base, 1), coefficients=(side * amount,)), rounds=0
    )
    sharper = as_told(-1.0)
    radius = base.values["edge_radius"] - amount
    worn = replace(blank(others["edge_radius:return"].entry, base, 1), coefficients=(amount,))
    same = problem.with_terms(worn).evaluate(base.values | {"edge_radius": radius}, ())
    np.testing.assert_allclose(same.residual, sharper.fit.residual, rtol=0, atol=1e-6)
    twin, found = as_wear(problem, base, supply, sharper, tuple(others.values()), np.inf)
    assert twin.entry.place == found.term.place == "edge_radius:return"
    assert found.fit.chi2 <= sharper.fit.chi2
    too_sharp = replace(sharper, term=replace(sharper.term, coefficients=(-1.0,)))
    for kept in (as_told(1.0), too_sharp):
        assert as_wear(problem, base, supply, kept, tuple(others.values()), np.inf) == (supply, kept)
