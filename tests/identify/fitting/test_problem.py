"""The residuals' row-wise derivatives are those of forward mode, for every test, with several gauges and with priors; and where a refit
begins."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.records import synthetic_record
from helpers.small_diagnosis import small_case
from reference import static_tests as reference
from reference.oil import Oil, walther
from reference.valve import Rows, Valve

from thermohyd.identify.bench.record import BenchRecord, StartValue
from thermohyd.identify.bench.test_record import Channel
from thermohyd.identify.fitting import problem
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.fitting.parameters import plan_parameters
from thermohyd.identify.fitting.row_blocks import plain_by_rows
from thermohyd.identify.fitting.row_sizes import padded_size
from thermohyd.identify.fitting.static_readings import base_valve, static_data
from thermohyd.identify.fitting.static_residuals import (
    FitArgs,
    plain_residual,
    prior_rows,
    residual_and_columns,
    residual_of,
)
from thermohyd.side_by_side import each


VALVE = Valve(12e-3, 8e-6, 2.5e-6, 6e-6, 0.68, 90.0, 1.2e-6)


def full_record(seed: int = 2) -> BenchRecord:
    """Leakage, both port pressures beside the load pressure, flow gain, and load flow at three load pressures."""
    rng = np.random.default_rng(seed)
    record = synthetic_record(VALVE, rng, points=21, edge_radius=StartValue(9e-6, prior_std=3e-6))
    pressure, flow = record.tests["pressure_gain"], record.tests["flow_gain"]
    rows = Rows(pressure.spool_position, pressure.supply_pressure, pressure.return_pressure, pressure.temperature)
    oil = Oil(*walther([[-40.0, 368.28], [100.0, 5.2244]]))
    read = reference.pressure_gain(VALVE, oil, rows)
    std = np.full(pressure.rows, 0.3e5)
    gauges = tuple(
        Channel(name, read[name] + std * rng.standard_normal(pressure.rows), std, "declared in bench.toml")
        for name in ("load_pressure", "pressure_a", "pressure_b")
    )
    load = flow.supply_pressure * np.resize([-0.5, 0.0, 0.5], flow.rows)
    loaded = reference.load_flow(VALVE, oil, dataclasses.replace(rows, load_pressure=load))["flow"]
    spread = np.full(flow.rows, 0.03 / 6e4)
    reading = Channel("flow", loaded + spread * rng.standard_normal(flow.rows), spread, "declared in bench.toml")
    tests = record.tests | {
        "pressure_gain": dataclasses.replace(pressure, channels=gauges),
        "load_flow": dataclasses.replace(flow, name="load_flow", load_pressure=load, channels=(reading,)),
    }
    return dataclasses.replace(record, tests=tests)


def test_columns_are_those_of_forward_mode():
    record = full_record()
    plans = plan_parameters(record.valve, record.start)
    free = tuple(name for name, plan in plans.items() if not plan.fixed)
    std = {(t.name, c.name): c.std for t in record.tests.values() for c in t.channels if c.std is not None}
    valve = base_valve(record, {name: plan.start for name, plan in plans.items()})
    args = FitArgs(valve, static_data(record.tests, std), *prior_rows([plans[name] for name in free]))
    p = jnp.asarray([plans[name].start for name in free])
    out, columns = jax.jit(lambda p: residual_and_columns(free, p, args))(p)
    forward = jax.jit(jax.jacfwd(lambda p: plain_residual(free, p, args)))(p)
    through = jax.jit(jax.jacfwd(lambda p: residual_of(free)(p, args)))(p)
    size = np.max(np.abs(np.asarray(forward)), axis=0)
    np.testing.assert_allclose(np.asarray(out), np.asarray(plain_residual(free, p, args)), atol=1e-9)
    np.testing.assert_allclose(np.asarray(columns.T) / size, np.asarray(forward) / size, atol=1e-11)
    np.testing.assert_allclose(np.asarray(through) / size, np.asarray(forward) / size, atol=1e-11)
    by_rows = plain_by_rows(free, args)(np.asarray(p), None)
    np.testing.assert_allclose(by_rows[0], np.asarray(out), atol=1e-9)
    np.testing.assert_allclose(by_rows[1].T / size, np.asarray(forward) / size, atol=1e-11)


def test_all_tests_and_gauges_together_give_the_valve_back():
    result = fit(full_record(), starts=1)
    assert {(c.test, c.channel) for c in result.channels} == {
        ("leakage", "leakage_flow"),
        ("pressure_gain", "load_pressure"),
        ("pressure_gain", "pressure_a"),
        ("pressure_gain", "pressure_b"),
        ("flow_gain", "flow"),
        ("load_flow", "flow"),
    }
    for name in result.free:
        estimate = result.parameters[name]
        assert estimate.std is not None
        assert abs(estimate.value - getattr(VALVE, name)) < 4.5 * estimate.std
    assert result.reduced_chi2 == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("rows", [1, 64, 65, 100, 1000, 1008, 1024, 4097])
def test_padding_is_little(rows):
    assert rows <= padded_size(rows) <= max(64, rows * 1.125)


def test_a_search_that_is_stuck_on_a_slope_begins_elsewhere(monkeypatch):
    """Begun where another fit had left off, on a kink, refits of a real valve ended ten standard errors up a slope."""
    problem_of, solve, starts = small_case("pilot").problem, problem.solve, []
    begin = {"edge_radius": 2e-6, "clearance": 3e-6, "pilot_leakage": 2e-9}

    def stuck_at_first(residual, boxes, args, start, **how):
        starts.append(start)
        result = solve(residual, boxes, args, start, **how)
        steep = {"converged": False, "exhausted": True, "relative_offset": 5.0, "cost": 2.0 * result.cost}
        return dataclasses.replace(result, **steep) if len(starts) == 1 else result

    free = problem_of.fit(("pilot_leakage",), begin)
    monkeypatch.setattr(problem, "solve", stuck_at_first)
    again = problem_of.fit(("pilot_leakage",), begin)
    assert again.converged
    assert again.chi2 == pytest.approx(free.chi2, rel=1e-6)
    first, neutral, nominal = (dict(zip(again.order, start, strict=True)) for start in starts)
    assert first["pilot_leakage"] == nominal["pilot_leakage"] == 2e-9
    assert abs(neutral["pilot_leakage"]) < 1e-10
    assert neutral["clearance"] == pytest.approx(free.values["clearance"], rel=1e-6)
    assert nominal["clearance"] == problem_of.plans["clearance"].start


def test_refits_give_the_same_to_the_last_bit(monkeypatch):
    """Each at a point of its own: none may see what another one was asked for."""
    monkeypatch.setenv("NPROC", "3")
    case = small_case("two")
    problem, base = case.problem, case.base
    names = problem.library.names
    ask = lambda name: problem.fit((name,), base.values, most_steps=6)
    before = problem.work.evaluations
    alone = [ask(name) for name in names]
    cost = problem.work.evaluations - before
    for _ in range(2):
        before = problem.work.evaluations
        for name, one, other in zip(names, alone, each(ask, names), strict=True):
            assert (one.chi2, one.values) == (other.chi2, other.values), name
            np.testing.assert_array_equal(one.residual, other.residual)
            np.testing.assert_array_equal(one.columns, other.columns)
        assert problem.work.evaluations - before == cost
