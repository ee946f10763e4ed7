"""Beside a misfit that all models share, rivals are told apart by what is not missed."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.linear_fit import LinearProblem, linear_library

from thermohyd.identify.diagnosis.remaining_misfit import Beside, Remaining, curves_of
from thermohyd.identify.diagnosis.rivals import Rival, Rivals, rivals_of
from thermohyd.identify.diagnosis.rivals_beside_misfit import rivals_beside_misfit, weighed_again
from thermohyd.identify.fitting.discrepancy import Discrepancy
from thermohyd.identify.fitting.problem_fit import Fit


ROWS = 768  # of a small bench
NAMED, BENT, OTHER = "hysteresis", "position_lag", "flowmeter_offset"
STRENGTH, MISSED = 20.0, 12.0


def bench(seed: int = 0) -> tuple[LinearProblem, Discrepancy]:
    """`NAMED` is there, and a smooth curve that no model has; `BENT` does what `NAMED` does and a third of that curve the wrong way,
    `OTHER` half of what it does."""
    rng = np.random.default_rng(seed)
    u, w, *own = np.linalg.qr(rng.normal(size=(ROWS, 8)))[0].T
    plain = linear_library(np.zeros(ROWS), np.stack(own, axis=1), {})
    curves = next(curves_of(plain, 0.15, len(plain.fit().residual)))
    curve = curves[:ROWS].sum(axis=1)
    curve /= np.linalg.norm(curve)
    shapes = {NAMED: u, BENT: 0.95 * u + 0.31 * curve, OTHER: 0.5 * u + np.sqrt(0.75) * w}
    signatures = {name: 10.0 * shape for name, shape in shapes.items()}
    misfit = rng.normal(size=ROWS) - STRENGTH * u + MISSED * curve
    return linear_library(misfit, np.stack(own, axis=1), signatures), Discrepancy(MISSED * curves)


def judged(problem: LinearProblem, known: Discrepancy | None) -> tuple[Fit, dict[str, Rivals], Remaining]:
    final = problem.fit([NAMED])
    rivals = {NAMED: rivals_of(problem, final, NAMED, {})}
    beside = Beside(problem.with_discrepancy(known).fit([NAMED]), 1.0, 0.15, None, known)
    return final, rivals, Remaining(Beside(final, 1.0), beside, ())


def test_a_rival_that_bends_to_what_is_missed_is_one_beside_it():
    problem, missed = bench()
    final, rivals, remaining = judged(problem, missed)
    assert not rivals[NAMED].alike
    found = rivals_beside_misfit(problem, final, rivals, remaining)[NAMED]
    assert [r.name for r in found.alike] == [BENT]
    assert {r.name for r in found.tried} == {r.name for r in rivals[NAMED].tried}
    assert list(found.tried) == sorted(found.tried, key=lambda r: r.chi2_more)
    bent = problem.with_discrepancy(missed).fit([BENT])
    assert found.alike[0].chi2_more == pytest.approx(bent.chi2 - remaining.believed.fit.chi2, abs=1e-6)


def test_a_search_that_was_left_by_the_noise_goes_on_to_its_amount():
    problem, missed = bench()
    final, rivals, remaining = judged(problem, missed)
    left = {NAMED: replace(rivals[NAMED], tried=tuple(_left(problem, r) for r in rivals[NAMED].tried))}
    found = rivals_beside_misfit(problem, final, left, remaining)[NAMED]
    assert found.alike[0].fit.values[BENT] == pytest.approx(problem.fit([BENT]).values[BENT])


def _left(problem: LinearProblem, rival: Rival) -> Rival:
    values = {**rival.fit.values, rival.name: 0.7 * rival.fit.values[rival.name]}
    at = problem.evaluate(values, rival.fit.effects)
    return replace(rival, fit=replace(rival.fit, residual=at.residual, values=values, chi2=at.chi2, converged=False))


def test_in_motion_one_step_decides(monkeypatch: pytest.MonkeyPatch):
    problem, missed = bench()
    final, rivals, remaining = judged(problem, missed)
    refits = rivals_beside_misfit(problem, final, rivals, remaining)[NAMED]
    monkeypatch.setattr(LinearProblem, "in_motion", True)
    monkeypatch.setattr(LinearProblem, "fit", lambda *_, **__: pytest.fail("no refit in motion"))
    on_paper = rivals_beside_misfit(problem, final, rivals, remaining)[NAMED]
    assert [r.name for r in on_paper.alike] == [r.name for r in refits.alike]
    assert on_paper.alike[0].chi2_more == pytest.approx(refits.alike[0].chi2_more, abs=1e-6)


def test_a_rival_is_weighed_from_where_it_is_one(monkeypatch: pytest.MonkeyPatch):
    """A search begun elsewhere may end in another valley."""
    problem, missed = bench()
    final, rivals, remaining = judged(problem, missed)
    found = rivals_beside_misfit(problem, final, rivals, remaining)[NAMED].alike[0]
    fit, begun = LinearProblem.fit, []
    monkeypatch.setattr(LinearProblem, "fit", lambda self, effects, start: begun.append(start) or fit(self, effects))
    [again] = weighed_again(problem, [found], replace(remaining, weighed=remaining.believed))
    assert found.beside is not None
    assert begun == [found.beside.values]
    assert again.chi2_more == pytest.approx(found.chi2_more, abs=1e-6)


def test_where_nothing_smooth_is_missed_rivals_stay_as_they_are():
    problem, _ = bench()
    final, rivals, remaining = judged(problem, None)
    assert rivals_beside_misfit(problem, final, rivals, remaining) == rivals
    assert weighed_again(problem, rivals[NAMED].tried, remaining) == rivals[NAMED].tried
