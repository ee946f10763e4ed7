"""Names that only stand in for one place are taken back where a typed term does better with fewer amounts; nothing is asked otherwise."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.linear_fit import linear_fit, linear_problem

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


def asked(monkeypatch, model: FinalModel, chi2: float | None, *, holds: bool = True, in_motion: bool = True):
    """(the model that comes back, how often the table was asked) where the best term leaves `chi2`."""
    calls = []

    def terms_of(problem: Problem, fit: Fit, split: Split, say, *, below: float) -> tuple[Found, ...]:
        calls.append(fit)
        assert below == model.fit.chi2 - 10.6 * model.scale  # else no term would be of use
        if chi2 is None:
            return ()
        fitted = FittedTerm(LEAK, problem, fit_of(chi2), 0.0, np.ones(1), np.eye(1))
        return (Found(fitted, 1e-9, 0.9 if holds else 0.0, 50.0, (), (2.0, 1.1)),)

    monkeypatch.setattr(stand_ins, "terms_of", terms_of)
    monkeypatch.setattr(Problem, "in_motion", in_motion)
    monkeypatch.setattr(stand_ins, "misfit_left", lambda problem, fit, block: LackOfFit(1e-9, 0.0, 1))
    case = Case(Fitted.__new__(Fitted), PROBLEM, {}, {}, model.base, {})
    return stand_ins.without_stand_ins(case, model, split_rows(PROBLEM.tests)), len(calls)


def test_one_place_that_does_better_than_two_names_takes_their_place(monkeypatch):
    model = model_of(NAMES, 830.0)
    found, times = asked(monkeypatch, model, 800.0)
    assert times == 1
    assert (found.fit, found.disagrees, found.proof) == (model.base, True, None)
    assert len(found.terms) == 1
    assert [s.name for s in found.suspects] == list(NAMES)
    (first, _) = suspect_sentences(found.suspects)
    assert "Suspected, not named: flow_force" in first
    assert "a flow from port A to port B in proportion to p_A - p_B does better than all names together" in first
    assert not found.suspects[0].hint


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
    found, count = asked(monkeypatch, model, best, holds=holds, in_motion=in_motion)
    assert found is model
    assert count == times


def test_what_is_unexplained_is_asked_later(monkeypatch):
    model = replace(model_of(NAMES, 830.0), disagrees=True)
    assert asked(monkeypatch, model, 800.0) == (model, 0)
