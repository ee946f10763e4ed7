"""Every effect, alone and together, against the rows of a third model and against the independent NumPy simulator.

Few programs, each of them compiled once: all effects through the coupled balances, for the third model's rows and for
random valves alike; then each kind of balance with its own effects only.
"""

import functools
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.valves import NAMES, STROKE
from reference import conformance, static_tests as reference
from reference.oil import Oil as ReferenceOil, walther
from reference.valve import Effects, Rows, Valve as ReferenceValve

from thermohyd.conditions import Conditions
from thermohyd.edge import EDGE_LAWS, EdgeLaw
from thermohyd.effects.library import EFFECTS, with_effects
from thermohyd.oil import oil_from_definition
from thermohyd.oil_definition import OilDefinition
from thermohyd.static_tests import blocked_port_readings, control_flow, load_flow
from thermohyd.valve import Valve


# What ports store has programs of its own (test_port_storage.py).
ALL = tuple(name for name in EFFECTS if not EFFECTS[name].stores)
# Effects of docs/physics.md section 8.2 that are younger than the third model; a fourth one knows them.
YOUNGER = tuple(name for name in ALL if name in conformance.more_truth()["files"])
LINES = ("flow_saturation", "supply_droop", "return_back_pressure")
CROSSING = ("cross_port_leakage",)
PLAIN = tuple(name for name in ALL if name not in (*LINES, *CROSSING))
KNOWN = tuple(name for name in ALL if name not in YOUNGER)
BALANCES = {"leakage": "blocked", "pressure_gain": "blocked", "flow_gain": "connected", "load_flow": "loaded"}
# Cases and rows of every run through a program, so that all share it: the effects over two tests with blocked ports.
CASES, ROWS = 2 * (len(KNOWN) + 2), 66


@functools.cache
def program(balance: str, effects: tuple[str, ...], law: EdgeLaw):
    """(parameters and the pressure at which null bias holds, oil, width, amounts, operating points), each with a leading axis
    of cases -> {channel: (cases, rows)}."""

    def simulate(parameters, oil_values, width, amounts, points):
        oil = eqx.tree_at(
            lambda o: (o.viscosity_a, o.viscosity_b, o.density_15degC),
            oil_from_definition(OilDefinition(9.0, 3.6)),
            tuple(oil_values),
        )
        known = {n: parameters[i] for i, n in enumerate((*NAMES, "null_pressure"))}
        valve = Valve(oil=oil, stroke=STROKE, slot_width=width, edge_law=law, **known)
        valve = with_effects(valve, {name: amounts[i] for i, name in enumerate(effects)})
        at = Conditions(**points)
        if balance == "blocked":
            return blocked_port_readings(valve, at)
        return {"flow": (control_flow if balance == "connected" else load_flow)(valve, at)}

    return jax.jit(jax.vmap(simulate))


def run(balance: str, effects: tuple[str, ...], *cases, law: EdgeLaw = "orifice") -> dict[str, np.ndarray]:
    count = len(cases[0])
    filled = jax.tree.map(lambda a: jnp.asarray(np.resize(a, (CASES, *np.shape(a)[1:]))), cases)
    with quick_compile():
        found = program(balance, effects, law)(*filled)
    return {channel: np.asarray(value)[:count] for channel, value in found.items()}


@functools.cache
def third_model_rows(test: str) -> dict:
    rows = conformance.rows_of(test)
    assert rows.run is not None
    columns = (rows.spool_position, rows.supply_pressure, rows.return_pressure, rows.temperature)
    return points_of(columns, rows.time, rows.run, np.zeros(rows.run.size))


def points_of(columns, time, run, rate) -> dict:
    """Operating points for a program; the last one stands in for rows that a test does not have."""
    names = ("position", "supply_pressure", "return_pressure", "temperature")
    points = {**dict(zip(names, columns, strict=True)), "load_pressure": np.zeros(run.size)}
    points |= {"time": time, "run": run.astype(float), "rate": rate}
    return {name: np.pad(column, (0, ROWS - column.size), mode="edge") for name, column in points.items()}


@pytest.mark.parametrize(
    ("balance", "effects"),
    [
        ("blocked", ALL),
        ("connected", ALL),
        ("blocked", PLAIN),
        ("connected", PLAIN),
        ("blocked", LINES),
        ("blocked", CROSSING),
    ],
    ids=["all-blocked", "all-connected", "plain-blocked", "plain-connected", "lines", "crossing"],
)
def test_conformance_rows(balance, effects):
    truth = conformance.truth()
    tests = [test for test in conformance.TESTS if BALANCES[test] == balance]
    # Every effect on its own through the program of `effects`, the others at their neutral value; all of them at once.
    wanted = ["none", *(name for name in effects if name in KNOWN), *(["all"] if effects == ALL else [])]
    cases = [(test, effect) for test in tests for effect in wanted]
    oil = [*walther(truth["oil"]["viscosity_points_degC_cSt"]), truth["oil"]["density_15degC"]]
    found = run(
        balance,
        effects,
        np.array([[*(truth["parameters"].get(n, 0.0) for n in NAMES), 0.0]] * len(cases)),
        np.array([oil] * len(cases)),
        np.array([truth["geometry"]["width"]] * len(cases)),
        np.array([[truth["effects"][effect].get(name, 0.0) for name in effects] for _, effect in cases]),
        jax.tree.map(lambda *columns: np.stack(columns), *(third_model_rows(test) for test, _ in cases)),
    )
    for i, (test, effect) in enumerate(cases):
        expected = conformance.readings_of(test, effect)
        readings = found[reference.READING[test]][i][: expected.size]
        worst = float(np.max(np.abs(readings - expected)) / np.max(np.abs(expected)))
        print(f"{test} with {effect}: {worst:.1e} of the largest reading, 1e-8 allowed")
        assert worst < 1e-8, (test, effect)


@pytest.mark.parametrize("balance", ["blocked", "connected"])
def test_rows_of_the_fourth_model(balance):
    """The effects that only it knows, through the program of all of them."""
    truth = conformance.more_truth()
    more = {name: conformance.more_rows(name) for name in YOUNGER}
    cases = [(name, test) for name in more for test in conformance.TESTS if BALANCES[test] == balance]
    parameters = [
        [*(more[name].truth["parameters"][n] for n in NAMES), more[name].rows["leakage"].supply_pressure[0]]
        for name, _ in cases
    ]
    points = []
    for name, test in cases:
        rows = more[name].rows[test]
        columns = (rows.spool_position, rows.supply_pressure, rows.return_pressure, rows.temperature)
        points.append(points_of(columns, rows.time, rows.run, rows.rate))
    found = run(
        balance,
        ALL,
        np.array(parameters),
        np.array([[*walther(truth["oils"][more[name].truth["oil"]]), 870.0] for name, _ in cases]),
        np.full(len(cases), truth["geometry"]["width"]),
        np.array([[more[name].truth["effects"].get(effect, 0.0) for effect in ALL] for name, _ in cases]),
        jax.tree.map(lambda *columns: np.stack(columns), *points),
    )
    for i, (name, test) in enumerate(cases):
        for channel, expected in more[name].readings[test].items():
            own = found[reference.READING[test] if channel == "reading" else channel][i][: expected.size]
            worst = float(np.max(np.abs(own - expected)) / np.max(np.abs(expected)))
            print(f"{name}, {test}, {channel}: {worst:.1e} of the largest reading, 1e-8 allowed")
            assert worst < 1e-8, (name, test, channel)


# Smallest and largest random amount of each effect: up to several times what a bench shows.
RANGES = {
    "supply_edge_wear": (0.0, 15e-6),
    "return_edge_wear": (0.0, 15e-6),
    "edge_wear_pa": (0.0, 15e-6),
    "edge_wear_pb": (0.0, 15e-6),
    "edge_wear_at": (0.0, 15e-6),
    "edge_wear_bt": (0.0, 15e-6),
    "unequal_underlap": (-8e-6, 8e-6),
    "eccentricity": (0.0, 1.0),
    "land_leakage": (0.0, 40.0),
    "null_shift_temperature": (-50e-9, 50e-9),
    "null_shift_pressure": (-2e-13, 2e-13),
    "thermal_clearance": (-4e-9, 20e-9),
    "pressure_clearance": (0.0, 5e-14),
    "flow_saturation": (0.0, 1e14),
    "supply_droop": (0.0, 1e10),
    "return_back_pressure": (0.0, 1e14),
    "throttle_heating": (0.0, 0.7),
    "pressure_viscosity": (0.0, 2.5e-8),
    "viscosity_shift": (-0.3, 0.5),
    "temperature_offset": (-6.0, 6.0),
    "pilot_leakage": (0.0, 5e-9),
    "bushing_leakage": (0.0, 1e-12),
    "cross_port_leakage": (0.0, 1e-12),
    "flowmeter_offset": (-1e-6, 1e-6),
    "flowmeter_scale": (-0.1, 0.1),
    "flowmeter_lag": (0.0, 1.5),
    "position_scale": (-0.1, 0.1),
    "hysteresis": (0.0, 5e-6),
    "position_lag": (0.0, 1.0),
    "pressure_offset": (-3e5, 3e5),
    "load_pressure_scale": (-0.05, 0.05),
}


def random_case(seed):
    """Parameters (CASES, 7), oils (CASES, 3), amounts (CASES, effects) and operating points, each (CASES, ROWS).

    A third of the valves has every effect, the others a random half of them: the absent ones have the amount 0.
    """
    rng = np.random.default_rng(seed)
    parameters = rng.uniform([0.0, 1e-6, -12e-6, 0.5, 20.0, -5e-6], [30e-6, 8e-6, 25e-6, 0.85, 300.0, 5e-6], (CASES, 6))
    parameters = np.concatenate([parameters, np.full((CASES, 1), 100e5)], axis=1)
    thickness = np.stack([10 ** rng.uniform(2, 3.6, CASES), 10 ** rng.uniform(0.6, 1.5, CASES)], axis=1)  # cSt
    oils = np.array([[*walther([[-40.0, cold], [90.0, hot]]), rng.uniform(820, 1050)] for cold, hot in thickness])
    low, high = np.array([RANGES[name] for name in ALL]).T
    amounts = rng.uniform(low, high, (CASES, low.size))
    amounts[CASES // 3 :] *= rng.integers(0, 2, amounts[CASES // 3 :].shape)
    supply = rng.uniform(40e5, 280e5, (CASES, ROWS))
    back = rng.uniform(0.0, 10e5, (CASES, ROWS))
    x = STROKE * rng.uniform(-1.0, 1.0, (CASES, ROWS)) * rng.uniform(0.0, 1.0, (CASES, ROWS)) ** 2
    x[:, 7] = x[:, 6]  # a repeated position
    temperature = rng.uniform(253.15, 363.15, (CASES, ROWS))
    load = (supply - back) * rng.uniform(-0.7, 0.7, (CASES, ROWS))
    rate = rng.uniform(-10e-6, 10e-6, (CASES, ROWS))
    time = np.cumsum(np.resize([0.3, 1.1, 0.0, 0.7], ROWS))  # two rows at one time, once in four
    sweeps = (np.arange(ROWS) > ROWS // 2).astype(float)
    every = lambda column: np.tile(column, (CASES, 1))
    points = {"position": x, "supply_pressure": supply, "return_pressure": back, "temperature": temperature}
    points |= {"load_pressure": load, "time": every(time), "run": every(sweeps), "rate": rate}
    return parameters, oils, amounts, points


LAWS = [(balance, law) for law in EDGE_LAWS for balance in ("blocked", "connected", "loaded")]


@pytest.mark.parametrize(("balance", "law"), LAWS)
def test_random_subsets_of_effects(balance, law):
    parameters, oils, amounts, points = random_case(23)
    found = run(balance, ALL, parameters, oils, np.full(CASES, 12e-3), amounts, points, law=law)
    # Where the clearance follows the pressure the reference integrates a film for every one that it tries: a few valves and rows.
    each, rows_seen = (1, ROWS) if law == "orifice" else (CASES // 4, 16)
    for i in range(0, CASES, each):
        at = {name: column[i, :rows_seen] for name, column in points.items()}
        rows = Rows(at.pop("position"), **(at | {"run": at["run"].astype(int)}))
        oil = ReferenceOil(*oils[i][:2], density=oils[i][2])
        effects, valve = Effects(**dict(zip(ALL, amounts[i], strict=True))), ReferenceValve(12e-3, *parameters[i])
        for test in (test for test in reference.TESTS if BALANCES[test] == balance):
            channel = reference.READING[test]
            expected = reference.TESTS[test](replace(valve, edge_law=law), oil, rows, effects)[channel]
            worst = float(np.max(np.abs(found[channel][i, :rows_seen] - expected)) / np.max(np.abs(expected)))
            assert worst < 1e-7, f"{test}, valve {i}: {worst:.1e} of the largest reading, 1e-7 allowed"
