"""Draws of the model that a diagnosis ends with: its density is the problem's own, faults of the bench and discrepancy in it."""

from dataclasses import replace
from unittest.mock import patch

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.small_bench import small_record
from helpers.small_diagnosis import opened, small_case, small_stage
from helpers.volts import PER_VOLT, ZERO, in_volts

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.sensors import EACH_RUN, Sensor
from thermohyd.identify.diagnosis.case import Case
from thermohyd.identify.diagnosis.diagnose import Stage, diagnose_stage
from thermohyd.identify.diagnosis.result import DiagnosisResult
from thermohyd.identify.fitting.discrepancy import Discrepancy
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.uncertainty import posterior
from thermohyd.identify.uncertainty.diagnosed import diagnose_in_depth, with_posterior
from thermohyd.identify.uncertainty.log_posterior import LogPosterior, log_posterior_of
from thermohyd.identify.uncertainty.posterior import Sampling, sampled
from thermohyd.identify.uncertainty.result import Posterior
from thermohyd.identify.uncertainty.sampler import Drawn


FAULTS = ("reading_zero|leakage|leakage_flow|", "position_zero|flow_gain||", "wrong_temperature|||0 degC")
FEW = Sampling(chains=4, warmup=100, draws=200, seed=5)


def beside_curves(problem: Problem) -> Problem:
    """Its readings known to three curves beside the noise."""
    rows = sum(place.stop - place.start for place in problem.rows().values())
    columns = np.random.default_rng(0).normal(size=(rows + len(problem.parameters), 3))
    columns[rows:] = 0.0
    return problem.with_discrepancy(Discrepancy(columns))


def in_every_way(case: Case, **shared: dict[str, np.ndarray]) -> None:
    """The density of a model with an effect, faults and a discrepancy against the residuals of its problem.

    shared: of gauges of the pressure gain, what an error of each input does to them."""
    errors = {("pressure_gain", name): moved for name, moved in shared.items()}
    problem = beside_curves(case.problem.with_noise(replace(case.problem.noise, shared=errors)))
    assert (problem.decorrelation is not None) is bool(shared)
    # Of readings in volts of unknown gain the zero is a parameter, and no fault.
    faults = [name for start in FAULTS for name in problem.faults if name.startswith(start)]
    assert len(faults) > 1
    fit = problem.fit(("hysteresis", *faults), case.base.values)
    scale, rows = 1.7, len(fit.residual) - len(problem.parameters)
    names = [f"number {i}" for i in range(len(fit.free))]
    target = log_posterior_of(problem, fit, scale, names, [1.0] * len(names))
    assert target.names == tuple(names)
    density, random = jax.jit(jax.value_and_grad(target.density)), np.random.default_rng(1)
    told, expected = [], []
    for _ in range(4):
        u = target.start + random.normal(size=len(names))
        p = np.asarray(target.clamp.physical(jnp.asarray(u)))
        at = problem.evaluate({**fit.values, **dict(zip(fit.free, p.tolist(), strict=True))}, fit.effects)
        priors = float(np.sum(at.residual[rows:] ** 2))
        expected.append(-0.5 * (float(np.sum(at.residual[:rows] ** 2)) / scale + priors))
        value, slope = density(jnp.asarray(u), target.data)
        told.append(float(value) - float(target.clamp.log_slope(jnp.asarray(u))))
        assert np.all(np.isfinite(np.asarray(slope)))
    np.testing.assert_allclose(told, expected, rtol=1e-9)
    assert np.ptp(expected) > 10.0


def test_the_density_is_the_problem_s_own_with_faults_and_discrepancy():
    in_every_way(small_case("two"))


def test_also_where_gauges_share_errors():
    record = small_record(effects={"hysteresis": 1e-6}, seed=5, position_noise=0.3e-6)
    test = record.tests["pressure_gain"]
    load, half = test.channel("load_pressure"), 0.5 * (test.supply_pressure + test.return_pressure)
    gauges = tuple(
        replace(load, name=name, value=half + sign * 0.5 * load.value)
        for name, sign in (("pressure_a", 1.0), ("pressure_b", -1.0))
    )
    record = replace(record, tests={**record.tests, "pressure_gain": replace(test, channels=gauges)})
    case = opened(record)
    up, down = (case.problem.noise.shared["pressure_gain", f"pressure_{port}"]["spool_position"] for port in "ab")
    # An error of the position raises one as it lowers the other.
    assert np.max(np.abs(up)) > 0.3
    assert np.all(up * down <= 1e-6)
    steep = np.linspace(0.0, 0.9, test.rows)
    in_every_way(case, pressure_a={"spool_position": steep}, pressure_b={"spool_position": -0.5 * steep})


@pytest.mark.nightly  # a whole diagnosis
def test_also_behind_sensors_of_unknown_gain_and_zero():
    sensors = (
        Sensor("leakage_flow", gain=None, signal="V", free_zero=EACH_RUN),
        Sensor("load_pressure", gain=0.97 * PER_VOLT["load_pressure"], signal="V", tolerance=0.05, zero=ZERO),
    )
    in_every_way(opened(in_volts(small_record(effects={"hysteresis": 1e-6}, seed=5), *sensors)))


def drawn(stage: Stage) -> tuple[DiagnosisResult, DiagnosisResult]:
    """A diagnosis, and the same with draws."""
    return stage.result, with_posterior(stage.answer, FEW)


@pytest.mark.nightly  # whole diagnoses with draws
def test_draws_of_a_named_effect_and_of_a_fault_agree_with_their_error_bars():
    record = small_record(effects={"hysteresis": 1e-6}, seed=2)
    test = record.tests["pressure_gain"]
    moved = replace(test, spool_position=test.spool_position + 2e-6)
    record = replace(record, tests={**record.tests, "pressure_gain": moved})
    plain, result = drawn(diagnose_stage(opened(record)))
    assert [effect.name for effect in plain.effects] == ["hysteresis"]
    assert plain.after.knowledge is None
    known = result.after.knowledge
    assert known is not None
    assert known.posterior is not None
    assert known.posterior.trouble == ""
    for name in ("hysteresis", "clearance", "discharge_coefficient"):
        row, estimate = known.rows[name], plain.after.parameters[name]
        assert row.posterior is not None
        assert estimate.std
        assert abs(row.posterior.mean - estimate.value) < 0.4 * estimate.std
        assert row.posterior.std == pytest.approx(estimate.std, rel=0.3)
    [fault] = [fault for fault in result.after.faults if fault.name == "position_zero"]
    assert fault.std
    of = known.posterior.parameters["position_zero (pressure gain)"]
    assert abs(of.mean - fault.value) < 0.4 * fault.std
    assert of.std == pytest.approx(fault.std, rel=0.3)
    assert any("position_zero (pressure gain): posterior 95 % " in note for note in known.notes)
    content = result.to_dict()["fit"]["knowledge"]
    assert set(content["parameters"]) == set(result.after.free)
    assert list(content["faults"]) == ["position_zero (pressure gain)"]


def by_the_covariance(target: LogPosterior, sampling: Sampling, say: object) -> Posterior:
    """Draws of the normal law that the sampler would begin with: no program is compiled."""
    del say
    shape = (sampling.chains, sampling.draws)
    u = np.random.default_rng(sampling.seed).multivariate_normal(target.start, target.covariance, shape)
    found = Drawn(u, np.zeros(shape, dtype=bool), np.zeros(shape), np.ones(shape), np.ones(shape, dtype=int))
    with patch.object(posterior, "draw", lambda *_, **__: found):
        return sampled(target, sampling)


@pytest.mark.nightly  # a whole diagnosis with draws
def test_beside_a_misfit_the_posterior_is_as_wide_as_the_error_bars():
    with patch.object(posterior, "sampled", by_the_covariance):
        plain, result = drawn(small_stage("outside"))
    assert plain.verdict == "unexplained"
    assert plain.discrepancy
    known = result.after.knowledge
    assert known is not None
    assert any("what the model misses" in note for note in known.notes)
    for name in ("clearance", "discharge_coefficient", "null_bias"):
        of, estimate = known.rows[name].posterior, plain.after.parameters[name]
        assert of is not None
        assert estimate.std
        # The error bar is a sandwich about the fit that is reported, which the likelihood's own width never exceeds by much.
        assert 0.2 < of.std / estimate.std < 1.5


def test_what_cannot_be_drawn_is_said_before_anything_is_searched():
    with pytest.raises(BenchInputError, match="--learn do not go together"):
        diagnose_in_depth(small_record(), learn=True)
