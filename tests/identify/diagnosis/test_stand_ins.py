"""Names that only stand in for one place are taken back where a typed term does better without them; nothing is asked otherwise."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.linear_fit import linear_fit, linear_library, linear_problem

from thermohyd.identify.diagnosis import stand_ins
from thermohyd.identify.diagnosis.case import Case
from thermohyd.identify.diagnosis.confirmation import Confirmation
from thermohyd.identify.diagnosis.final_model import FinalModel
from thermohyd.identify.diagnosis.held_out import Split, split_rows
from thermohyd.identify.diagnosis.left_over import LackOfFit
from thermohyd.identify.diagnosis.rivals import Rivals
from thermohyd.identify.diagnosis.term_fit import FittedTerm
from thermohyd.identify.diagnosis.typed_terms import Found
from thermohyd.identify.fitting.bench_faults import BETWEEN
from thermohyd.identify.fitting.outcome import Fitted
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.model.typed_terms import TypedTerm
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.report.diagnosis_report import suspect_sentences


PROBLEM = linear_problem(NoiseCorrelation())
ROWS = sum(len(PROBLEM.noise.std[key]) for key in PROBLEM.rows())
NAMES = ("flow_force", "coulomb_friction")
FAULT = f"reading_zero{BETWEEN}flow_gain"
LEAK = TypedTerm("flow_from_a_to_b", "load", "proportional", (6e-12,), -1e6, 1e6, moving=True)


def fit_of(chi2: float, effects: tuple[str, ...] = ()) -> Fit:
    fit = linear_fit(np.full(ROWS, np.sqrt(chi2 / ROWS)), np.zeros((ROWS, 1)))
    return replace(fit, effects=effects, values={**fit.values, **dict.fromkeys(effects, 1e-7)})


def model_of(names: tuple[str, ...], chi2: float, p: float = 0.5) -> FinalModel:
    rivals = {name: Rivals(name, fit_of(chi2 + 50.0), ()) for name in names}
    proof = Confirmation(50.0, dict.fromkeys(names, 20.0)) if names else None
    left = LackOfFit(p, 0.0, 1)
    return FinalModel(fit_of(900.0), fit_of(chi2, names), rivals, {}, left, 200.0, 1.0, False, True, proof)


def asked(
    monkeypatch,
    model: FinalModel,
    chi2: float | None,
    *,
    holds: bool = True,
    in_motion: bool = True,
    beside=None,
    seen_by_the_table: bool = False,
):
    """(the model that comes back, beside which names the table was asked) where the best term alone leaves `chi2`.

    beside {names: chi-square}: of the term beside names; as much as without them where nothing is said.
    """
    calls, leaves = [], {(): chi2} if beside is None else {(): chi2, **beside}

    def refitted(problem: Problem, now: stand_ins._Beside, names: tuple[str, ...]) -> stand_ins._Beside:
        left = leaves.get(tuple(sorted(names)), chi2)
        assert left is not None
        return stand_ins._Beside(names, FittedTerm(LEAK, problem, fit_of(left), 0.0, np.ones(1), np.eye(1)))

    def terms_of(
        problem: Problem, fit: Fit, split: Split, say, *, below: float = np.inf, level: float = 1e-3
    ) -> tuple[Found, ...]:
        if level < 1e-3 and not seen_by_the_table:  # what no curve sees
            return ()
        calls.append(fit.effects)
        left = leaves.get(tuple(sorted(fit.effects)), chi2)
        if left is None:
            return ()
        fitted = FittedTerm(LEAK, problem, fit_of(left), 0.0, np.ones(1), np.eye(1))
        return (Found(fitted, 1e-9, 0.9 if holds else 0.0, 50.0, (), (2.0, 1.1)),)

    monkeypatch.setattr(stand_ins, "terms_of", terms_of)
    monkeypatch.setattr(stand_ins, "_refitted", refitted)
    monkeypatch.setattr(stand_ins, "all_rivals", lambda problem, fit, *_: dict(model.rivals))
    monkeypatch.setattr(stand_ins, "proven", lambda case, fit, rivals, *_: (fit, rivals, model.proof, (), ()))
    monkeypatch.setattr(Case, "freedom", None)
    monkeypatch.setattr(stand_ins, "scattered", lambda case, fit: False)
    monkeypatch.setattr(Problem, "in_motion", in_motion)
    monkeypatch.setattr(Problem, "fit", lambda problem, effects, *_, **__: fit_of(880.0, tuple(effects)))
    monkeypatch.setattr(stand_ins, "misfit_left", lambda problem, fit, block: LackOfFit(1e-9, 0.0, 1))
    case = Case(Fitted.__new__(Fitted), PROBLEM, {}, {}, model.base, {})
    return stand_ins.without_stand_ins(case, model, split_rows(PROBLEM.tests), 4.0), calls


def test_one_place_that_does_better_than_two_names_takes_their_place(monkeypatch):
    model = model_of(NAMES, 830.0)
    found, calls = asked(monkeypatch, model, 800.0)
    assert calls == [()]
    assert (found.fit, found.disagrees, found.proof) == (model.base, True, None)
    assert found.terms
    assert len(found.terms) == 1
    assert [s.name for s in found.suspects] == list(NAMES)
    (said,) = suspect_sentences(found.suspects)
    assert said == (
        "Suspected, not named: flow_force (0.1000 um/N) and coulomb_friction (1.000e-07 N) lower the misfit, but beside a flow from "
        "port A to port B in proportion to p_A - p_B they are of no use: they only stand in for that."
    )
    assert not found.suspects[0].hint


def test_a_name_that_is_of_use_beside_the_term_stays(monkeypatch):
    beside = {("flow_force",): 780.0}  # 20 of chi-square; 16 are asked
    found, _ = asked(monkeypatch, model_of(NAMES, 830.0), 800.0, beside=beside)
    assert (found.fit.effects, found.disagrees) == (("flow_force",), True)
    assert [s.name for s in found.suspects] == ["coulomb_friction"]
    assert found.proof is not None


def test_names_that_leave_a_misfit_go_where_the_best_term_does_without_them(monkeypatch):
    """What a term adds to the names it does as well without them."""
    model = replace(model_of(NAMES, 830.0), disagrees=True)
    found, calls = asked(monkeypatch, model, 705.0, beside={tuple(sorted(NAMES)): 700.0})
    assert calls == [NAMES, ()]
    assert found.fit is model.base
    assert [s.name for s in found.suspects] == list(NAMES)
    assert found.terms
    assert len(found.terms) == 1


def test_a_fault_of_the_bench_stands_in_as_well(monkeypatch):
    model = replace(model_of((*NAMES, FAULT), 830.0), disagrees=True)
    found, calls = asked(monkeypatch, model, 705.0)
    assert calls == [
        (*NAMES, FAULT),
        (FAULT,),
        (),
    ]  # of the term alone it is asked at last, what is told beside the plain model
    assert found.fit is model.base


def test_names_that_leave_a_misfit_stay_where_the_term_needs_them(monkeypatch):
    model = replace(model_of(NAMES, 830.0), disagrees=True)
    needs = {names: 760.0 for names in [("coulomb_friction",), ("flow_force",)]}
    found, calls = asked(monkeypatch, model, 820.0, beside={tuple(sorted(NAMES)): 700.0, **needs})
    assert calls == [NAMES, ()]
    assert (found.fit, found.suspects) == (model.fit, ())
    assert found.terms
    assert len(found.terms) == 1  # beside the names


def test_names_that_gain_as_much_as_they_cost_beside_the_term_go(monkeypatch):
    """A tie: two names gain 39 of chi-square beside the term, none 16 alone; 32 are asked of two, and 10.6 beyond for a name."""
    model = replace(model_of(NAMES, 830.0), disagrees=True)
    apart = {names: 695.0 for names in [("coulomb_friction",), ("flow_force",)]}
    found, _ = asked(monkeypatch, model, 709.0, beside={tuple(sorted(NAMES)): 670.0, **apart})
    assert found.fit is model.base
    assert len(found.suspects) == 2
    found, _ = asked(monkeypatch, model, 715.0, beside={tuple(sorted(NAMES)): 670.0, **apart})
    assert found.fit is model.fit


def test_a_name_whose_own_place_is_the_best_term_stays(monkeypatch):
    """A term without a name, and no better, says no more than the name."""
    model = replace(model_of(NAMES[:1], 830.0), disagrees=True)
    found, _ = asked(monkeypatch, model, 830.0)
    assert (found.fit, found.suspects) == (model.fit, ())


def test_names_that_leave_as_much_as_one_term_alone_go(monkeypatch):
    """Fewer amounts decide, by BIC; names that leave nothing over are asked for chi-square, too."""
    misfit = replace(model_of((*NAMES, FAULT), 830.0), disagrees=True)
    found, _ = asked(monkeypatch, misfit, 828.0)
    assert found.fit is misfit.base
    assert len(found.suspects) == 2
    clean = model_of((*NAMES, FAULT), 830.0)
    assert asked(monkeypatch, clean, 828.0)[0] is clean


@pytest.mark.parametrize(
    ("names", "chi2", "p", "best", "holds", "in_motion", "times"),
    [
        (NAMES, 830.0, 0.5, 822.0, True, True, 1),  # not by enough
        (NAMES, 830.0, 0.5, 800.0, False, True, 1),  # it does not hold
        (NAMES, 830.0, 0.5, None, True, True, 1),  # no term beyond chance
        (NAMES[:1], 830.0, 0.5, 800.0, True, True, 0),  # one name, nothing left over
        (NAMES[:1], 830.0, 0.04, 825.0, True, True, 1),  # one name, something left over
        (NAMES, 830.0, 0.5, 822.0, True, False, 1),  # static tests are asked too
        ((), 830.0, 1e-3, 800.0, True, True, 0),  # nothing named
        (
            ("port_compliance_a", "port_compliance_b"),
            830.0,
            0.5,
            800.0,
            True,
            False,
            0,
        ),  # ports that store oil have no terms
        ((FAULT,), 830.0, 0.5, 800.0, True, False, 0),  # a fault of the bench, nothing left over
        ((FAULT,), 830.0, 0.04, 822.0, True, False, 1),  # something left over, no term does better by enough
    ],
)
def test_names_stay_otherwise(monkeypatch, names, chi2, p, best, holds, in_motion, times):
    model = model_of(names, chi2, p)
    found, calls = asked(monkeypatch, model, best, holds=holds, in_motion=in_motion)
    assert found is model
    assert len(calls) == times


def test_what_no_curve_sees_the_table_does(monkeypatch):
    """Beside a model that explains all but for that, without a name and with one; in motion, where names compile anew, without."""
    model = model_of((), 830.0)
    for in_motion in (True, False):
        found, calls = asked(monkeypatch, model, 800.0, in_motion=in_motion, seen_by_the_table=True)
        assert calls == [()]
        assert (found.fit, found.disagrees) == (model.fit, True)
        assert found.terms
        assert found.terms[0].p_value == 1e-9
    moving = model_of(NAMES[:1], 830.0)
    assert asked(monkeypatch, moving, 800.0, seen_by_the_table=True) == (moving, [])
    assert asked(monkeypatch, model, 800.0, in_motion=False, seen_by_the_table=True, holds=False)[0] is model
    named = model_of(NAMES[:1], 830.0)
    needed = {NAMES[:1]: 800.0}
    found, calls = asked(monkeypatch, named, 850.0, in_motion=False, seen_by_the_table=True, beside=needed)
    assert (found.fit, found.disagrees) == (named.fit, True)
    assert calls == [NAMES[:1], ()]


def test_what_leaves_a_misfit_without_a_name_is_asked_later(monkeypatch):
    model = replace(model_of((), 830.0), disagrees=True)
    assert asked(monkeypatch, model, 800.0) == (model, [])
    assert model.terms is None


@pytest.mark.parametrize("hidden", [("flowmeter_offset",), ("flowmeter_offset", "hysteresis"), ()])
def test_names_of_the_library_that_do_what_the_term_does(monkeypatch, hidden):
    """A term that outdoes a name may be others of the library: volumes at both ports are a flow from A to B."""
    rng, rows = np.random.default_rng(3), 600
    signatures = {
        name: rng.normal(size=rows) / np.sqrt(rows) for name in ("land_leakage", "flowmeter_offset", "hysteresis")
    }
    beyond = rng.normal(size=rows) / np.sqrt(rows)  # what the library has no name for
    noise, nuisance = rng.normal(size=rows), rng.normal(size=(rows, 2))
    missing = sum(9.0 * signatures[name] for name in hidden) if hidden else 14.0 * beyond
    problem = linear_library(noise - missing, nuisance, signatures)
    base, left = problem.fit(), linear_library(noise, nuisance, signatures).fit().residual
    monkeypatch.setattr(Case, "freedom", None)
    case = Case(Fitted.__new__(Fitted), problem, {}, {}, base, {})
    model = replace(model_of((), 0.0), base=base, fit=problem.fit(["land_leakage"]))
    term = FittedTerm(LEAK, problem, replace(base, residual=left, chi2=float(left @ left)), 0.0, np.ones(1), np.eye(1))
    found = stand_ins._in_names(case, model, stand_ins._Beside((), term), 4.0)
    assert (() if found is None else found.effects) == hidden
