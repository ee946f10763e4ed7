"""Blocked ports that store oil: rows of a fourth model, exact checks, derivatives, and beside everything else that ties ports."""

import functools
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.valves import NAMES, STROKE, seed_valve
from reference import conformance
from reference.oil import seed_oil as reference_oil, walther
from reference.port_storage import swept as reference_sweep
from reference.valve import Effects, Rows, Valve as ReferenceValve

from thermohyd.chain_in_time import along_rows
from thermohyd.conditions import Conditions
from thermohyd.effects.edges import PortComplianceA, PortComplianceB
from thermohyd.effects.library import with_effects
from thermohyd.oil import oil_from_definition
from thermohyd.oil_definition import OilDefinition
from thermohyd.static_tests import blocked_port_readings, stored_port_rows
from thermohyd.valve import Valve


FILES = [name for name, file in conformance.more_truth()["files"].items() if file["kind"] == "time"]
COMPLIANCE = ("port_compliance_a", "port_compliance_b")
OTHERS = ("hysteresis", "bushing_leakage")
SUBSTEPS = 32


@functools.cache
def sweep():
    """(parameters, amounts of COMPLIANCE, amounts of OTHERS, times) -> readings of the fourth model's rows, one program for all."""
    rows, _, truth = conformance.rows_in_time(FILES[0])
    assert rows.time is not None
    assert rows.run is not None
    oil = oil_from_definition(OilDefinition(*walther(conformance.more_truth()["oils"][truth["oil"]])))
    width = conformance.more_truth()["geometry"]["width"]
    place = [rows.spool_position, rows.supply_pressure, rows.return_pressure, rows.temperature]
    columns, run = list(map(jnp.asarray, place)), jnp.asarray(rows.run.astype(float))

    def readings(values, compliance, others, time):
        valve = Valve(oil=oil, stroke=STROKE, slot_width=width, **{n: values[i] for i, n in enumerate(NAMES)})
        valve = with_effects(valve, dict(zip(OTHERS, others, strict=True)))
        ports = (PortComplianceA(compliance[0], SUBSTEPS), PortComplianceB(compliance[1], SUBSTEPS))
        valve = eqx.tree_at(lambda v: v.effects, valve, (*valve.effects, *ports), is_leaf=lambda x: x is valve.effects)
        return blocked_port_readings(valve, Conditions(*columns, time=time, run=run))

    return jax.jit(readings)


def swept(truth: dict, time: np.ndarray, compliance=None) -> dict[str, np.ndarray]:
    effects = truth["effects"]
    own = [effects.get(name, 0.0) for name in COMPLIANCE] if compliance is None else compliance
    with quick_compile():
        found = sweep()(
            jnp.asarray([truth["parameters"][name] for name in NAMES]),
            jnp.asarray(own),
            jnp.asarray([effects.get(name, 0.0) for name in OTHERS]),
            jnp.asarray(time),
        )
    return {name: np.asarray(value) for name, value in found.items()}


@pytest.mark.parametrize("name", FILES)
def test_rows_of_the_fourth_model(name):
    rows, expected, truth = conformance.rows_in_time(name)
    assert rows.time is not None
    found = swept(truth, rows.time)
    for channel, values in expected.items():
        worst = float(np.max(np.abs(found[channel] - values)) / np.max(np.abs(values)))
        print(f"{name}, {channel}: {worst:.1e} of the largest reading, 2e-6 allowed")
        assert worst < 2e-6  # steps across the kink of an edge that opens; the reference reaches 2e-9


def test_exact_checks():
    """Nothing stored changes nothing; slow sweeps tend to the steady curve with their rate; a closed cycle keeps no oil."""
    rows, _, truth = conformance.rows_in_time("port_compliance_hysteresis_bushing")
    assert rows.time is not None
    assert rows.run is not None
    steady = swept(truth, rows.time, [0.0, 0.0])
    late = {k: swept(truth, k * rows.time) for k in (400.0, 800.0)}
    with quick_compile():
        valve = Valve(
            oil=oil_from_definition(OilDefinition(*walther(conformance.more_truth()["oils"][truth["oil"]]))),
            stroke=STROKE,
            slot_width=12e-3,
            **truth["parameters"],
        )
        valve = with_effects(valve, {name: truth["effects"][name] for name in OTHERS})
        place = (rows.spool_position, rows.supply_pressure, rows.return_pressure, rows.temperature)
        ideal = blocked_port_readings(
            valve, Conditions(*map(jnp.asarray, place), run=jnp.asarray(rows.run.astype(float)))
        )
    for channel, values in ideal.items():
        size = np.max(np.abs(values))
        np.testing.assert_allclose(steady[channel], values, atol=1e-12 * size)
        lag = {k: np.max(np.abs(found[channel] - values)) / size for k, found in late.items()}
        print(channel, lag)
        assert lag[400.0] < 0.05
        assert lag[800.0] / lag[400.0] == pytest.approx(0.5, abs=0.03)

    found = swept(truth, rows.time)
    for run in np.unique(rows.run):
        own = rows.run == run
        first, last = np.flatnonzero(own)[[0, -1]]
        # The port stands where it began: what the meters saw pass is the same, but for what the density takes.
        assert found["pressure_a"][last] == pytest.approx(found["pressure_a"][first], rel=1e-2)
        change = np.gradient(found["pressure_a"][own], rows.time[own])
        kept = np.trapezoid(change, rows.time[own]) / np.trapezoid(np.abs(change), rows.time[own])
        assert abs(kept) < 0.02


SHORT = 20
TIED = {"supply_droop": 3e9, "return_back_pressure": 5e13, "cross_port_leakage": 3e-13}


def short_sweep() -> Conditions:
    x = 40e-6 * np.interp(np.arange(SHORT), [0, 9, 10, 19], [-1.0, 1.0, 0.8, -0.7])
    full = lambda value: jnp.full(SHORT, value)
    return Conditions(
        jnp.asarray(x), full(150e5), full(2e5), full(313.15),
        time=jnp.asarray(np.arange(SHORT) * 0.4), run=jnp.asarray((np.arange(SHORT) >= 13).astype(float)),
    )  # fmt: skip


def test_the_search_ends_at_the_solution_on_random_valves():
    """A ramp of 2 s moves much oil: a search of six turns left these rows up to 4 % of the supply away."""
    rows, supply, drawn = 60, 210e5, np.random.default_rng(3)
    sweep = jnp.asarray(60e-6 * np.interp(np.arange(rows), [0, 30, rows - 1], [-1, 1, -1]))
    full = lambda value: jnp.full(rows, value)

    def left(values, temperature, compliance):
        valve = seed_valve(edge_radius=values[0], clearance=values[1], underlap=values[2])
        valve = with_effects(valve, dict(zip(COMPLIANCE, (compliance, 0.4 * compliance), strict=True)))
        time = jnp.linspace(0.0, 2.0, rows)
        read = Conditions(sweep, full(supply), full(2e5), full(temperature), time=time, run=full(0.0))
        _, stored = stored_port_rows(valve, read, jnp.zeros((2, rows)))
        return jnp.max(jnp.abs(along_rows(stored.carried, stored.source))) / supply

    valves = jnp.asarray(drawn.uniform([0.0, 1e-6, -12e-6], [30e-6, 8e-6, 25e-6], (40, 3)))
    warm, compliance = jnp.asarray(drawn.uniform(263.0, 353.0, 40)), jnp.asarray(10 ** drawn.uniform(-13.0, -11.0, 40))
    with quick_compile():
        worst = np.asarray(jax.jit(jax.vmap(left))(valves, warm, compliance))
    print(f"what one turn more would move: {worst.max():.1e} of the supply pressure at most, 1e-9 allowed")
    assert worst.max() < 1e-9


@pytest.mark.parametrize("tied", [False, True], ids=["ports apart", "lines, crossing and heat"])
def test_derivatives(tied):
    """Forward = reverse = finite differences, to parameters and to what is stored; at nothing stored at port B, too.

    One step a row: where steps go by need, two points of a difference may put them into different rows, and lie apart by what
    the steps miss.
    """
    start = jnp.asarray([12e-6, 2.5e-6, 4e-6, 1e-6, 4e-13, 0.0])
    names = ("edge_radius", "clearance", "underlap", "null_bias")
    unit = jnp.asarray([1e-6, 1e-6, 1e-6, 1e-6, 1e-13, 1e-13])
    size = np.array([1e-6, 1e7, 1e7, 1e7, 1e-6])

    def readings(z):
        values = z * unit
        valve = seed_valve(0.6 if tied else None, **{name: values[i] for i, name in enumerate(names)})
        valve = with_effects(valve, TIED if tied else {})
        stored = (PortComplianceA(values[4], substeps=1), PortComplianceB(values[5], substeps=1))
        valve = eqx.tree_at(lambda v: v.effects, valve, (*valve.effects, *stored), is_leaf=lambda x: x is valve.effects)
        return jnp.stack([*blocked_port_readings(valve, short_sweep()).values()]) / size[:, None]

    at = start / unit
    weights = jnp.asarray(np.random.default_rng(4).standard_normal((5, SHORT)))

    def all_three(z):
        value, push = jax.linearize(readings, z)
        return value, jax.vmap(push)(jnp.eye(z.size)), jax.linear_transpose(push, z)(weights)[0]

    fn = jax.jit(all_three)
    with quick_compile():
        value, forward, reverse = (np.asarray(part) for part in fn(at))
        assert np.all(np.isfinite(value))
        np.testing.assert_allclose(reverse, np.einsum("pcr,cr->p", forward, weights), rtol=1e-9)
        for i in range(at.size):
            h = 2e-4
            # Less than nothing cannot be stored: at port B to one side, to second order.
            if i == 5:
                ends = [np.asarray(fn(at.at[i].add(k * h))[0]) for k in (1, 2)]
                numeric = (4 * ends[0] - ends[1] - 3 * value) / (2 * h)
            else:
                numeric = (np.asarray(fn(at.at[i].add(h))[0]) - np.asarray(fn(at.at[i].add(-h))[0])) / (2 * h)
            worst = np.max(np.abs(numeric - forward[i]), axis=1) / (1e-9 + np.max(np.abs(forward[i]), axis=1))
            print(i, worst)
            assert np.all(worst < 1e-4)


def test_edges_by_lubrication_theory_whose_clearance_follows_the_pressure():
    """A sweep of the second law beside the reference, which integrates its film at every pressure that it meets."""
    read = short_sweep()
    of_edges = {"edge_radius": 12e-6, "clearance": 2.5e-6, "underlap": 4e-6, "null_bias": 1e-6}
    amounts, compliance = {"pressure_clearance": 4e-14}, (4e-13, 1.5e-13)
    valve = with_effects(replace(seed_valve(**of_edges), edge_law="lubrication"), amounts)
    ports = (PortComplianceA(compliance[0], SUBSTEPS), PortComplianceB(compliance[1], SUBSTEPS))
    valve = eqx.tree_at(lambda v: v.effects, valve, (*valve.effects, *ports), is_leaf=lambda x: x is valve.effects)
    with quick_compile():
        found = blocked_port_readings(valve, read)
    rows = Rows(
        *(np.asarray(c) for c in (read.position, read.supply_pressure, read.return_pressure, read.temperature)),
        time=np.asarray(read.time), run=np.asarray(read.run).astype(int),
    )  # fmt: skip
    plain = ReferenceValve(12e-3, **of_edges, edge_law="lubrication")
    expected = reference_sweep(plain, reference_oil(), rows, Effects(**amounts), compliance, tolerance=1e-8)
    for channel, values in expected.items():
        worst = float(np.max(np.abs(found[channel] - values)) / np.max(np.abs(values)))
        print(f"{channel}: {worst:.1e} of the largest reading, 2e-6 allowed")
        assert worst < 2e-6


def test_lines_that_lose_more_than_an_open_edge():
    """Behind a soft supply a wide open edge has next to no drop: what the line loses turns with the flow sixty times as fast as
    with the pressure. With next to nothing stored the rows are those of ports that store nothing."""
    rows = 40
    full = lambda value: jnp.full(rows, value)
    x = jnp.asarray(100e-6 * np.interp(np.arange(rows), [0.0, 20.0, 39.0], [-1.0, 1.0, -1.0]))
    read = Conditions(x, full(210e5), full(2e5), full(313.15), time=0.6 * jnp.arange(40.0), run=full(0.0))
    lines = {"supply_droop": 1.5e10, "return_back_pressure": 1e14}
    with quick_compile():
        steady = blocked_port_readings(with_effects(seed_valve(0.5), lines), read)
        found = blocked_port_readings(with_effects(seed_valve(0.5), lines | {"port_compliance_b": 1e-19}), read)
    for channel, values in steady.items():
        np.testing.assert_allclose(found[channel], values, atol=1e-6 * float(jnp.max(jnp.abs(values))), err_msg=channel)


def test_without_time_it_is_said():
    points = eqx.tree_at(lambda c: c.time, short_sweep(), None)
    with pytest.raises(ValueError, match="what blocked ports store needs conditions with the time"):
        blocked_port_readings(with_effects(seed_valve(), {"port_compliance_a": 1e-13}), points)
