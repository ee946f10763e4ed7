"""The model against the independent NumPy simulator, and against the rows of a third one, to 1e-8."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.valves import NAMES, STROKE
from reference import conformance, static_tests as reference
from reference.oil import Oil as ReferenceOil, walther
from reference.valve import Effects, Rows, Valve as ReferenceValve

from thermohyd.conditions import Conditions
from thermohyd.oil import oil_from_definition
from thermohyd.oil_definition import OilDefinition
from thermohyd.static_tests import control_flow, leakage_flow, load_flow, load_pressure, port_pressures
from thermohyd.valve import Valve


TESTS = {"leakage": leakage_flow, "pressure_gain": load_pressure, "flow_gain": control_flow, "load_flow": load_flow}
VALVES, ROWS = 60, 50


def random_case(seed):
    """Parameters (VALVES, 6), oils [(walther points, density)] and operating points (VALVES, ROWS)."""
    rng = np.random.default_rng(seed)
    parameters = rng.uniform(
        [0.0, 0.5e-6, -20e-6, 0.5, 20.0, -5e-6], [30e-6, 8e-6, 25e-6, 0.85, 300.0, 5e-6], (VALVES, 6)
    )
    parameters[:5, 0] = 0.0  # sharp edges
    points = np.stack([10 ** rng.uniform(2, 3.6, VALVES), 10 ** rng.uniform(0.6, 1.5, VALVES)], axis=1)  # cSt
    oils = [(walther([[-40.0, cold], [90.0, hot]]), rng.uniform(820, 1050)) for cold, hot in points]
    supply = rng.uniform(20e5, 280e5, (VALVES, ROWS))
    back = rng.uniform(0.0, 10e5, (VALVES, ROWS))
    x = STROKE * rng.uniform(-1.0, 1.0, (VALVES, ROWS)) * rng.uniform(0.0, 1.0, (VALVES, ROWS)) ** 2
    x[:, 0] = parameters[:, 5]  # exactly at null
    temperature = rng.uniform(233.15, 373.15, (VALVES, ROWS))
    load = (supply - back) * rng.uniform(-0.9, 0.9, (VALVES, ROWS))
    return parameters, oils, (x, supply, back, temperature, load)


@pytest.mark.parametrize("test", TESTS)
@pytest.mark.parametrize("eta", [None, 0.35, 1.0])
def test_random_valves_oils_and_conditions(test, eta):
    parameters, oils, (x, supply, back, temperature, load) = random_case(11)

    def simulate(values, walther_a, walther_b, density, *points):
        oil = oil_from_definition(OilDefinition(9.0, 3.6))
        oil = eqx.tree_at(
            lambda o: (o.viscosity_a, o.viscosity_b, o.density_15degC), oil, (walther_a, walther_b, density)
        )
        valve = Valve(
            oil=oil,
            stroke=STROKE,
            slot_width=12e-3,
            heat_retention=None if eta is None else jnp.asarray(eta),
            **{name: values[i] for i, name in enumerate(NAMES)},
        )
        return TESTS[test](valve, Conditions(*points[:4], load_pressure=points[4]))

    coefficients = np.array([[*pair, density] for pair, density in oils]).T
    found = jax.jit(jax.vmap(simulate))(
        *map(jnp.asarray, (parameters, *coefficients, x, supply, back, temperature, load))
    )
    spread = lambda a: np.repeat(a, ROWS)
    valve = ReferenceValve(12e-3, *(spread(column) for column in parameters.T))  # pyright: ignore[reportArgumentType]
    oil = ReferenceOil(spread(coefficients[0]), spread(coefficients[1]), density=spread(coefficients[2]))
    rows = Rows(*(a.ravel() for a in (x, supply, back, temperature)), load_pressure=load.ravel())
    effects = Effects(throttle_heating=0.0 if eta is None else eta)
    expected = reference.TESTS[test](valve, oil, rows, effects)[reference.READING[test]].reshape(VALVES, ROWS)
    error = np.abs(np.asarray(found) - expected)
    # signed readings cross zero: relative to each valve's largest
    size = expected if test == "leakage" else np.max(np.abs(expected), axis=1, keepdims=True)
    worst = float(np.max(error / size))
    print(f"{test}, eta {eta}: differs by {worst:.1e}, 1e-8 allowed")
    assert worst < 1e-8


@pytest.mark.parametrize(("effect", "eta"), [("none", None), ("none", 0.0), ("throttle_heating", 0.6)])
@pytest.mark.parametrize("test", conformance.TESTS)
def test_conformance_rows(test, effect, eta):
    truth = conformance.truth()
    a, b = walther(truth["oil"]["viscosity_points_degC_cSt"])
    valve = Valve(
        oil=oil_from_definition(OilDefinition(a, b, density=truth["oil"]["density_15degC"])),
        stroke=truth["geometry"]["stroke"],
        slot_width=truth["geometry"]["width"],
        heat_retention=None if eta is None else jnp.asarray(eta),
        **truth["parameters"],
    )
    rows = conformance.rows_of(test)
    points = Conditions(
        *map(jnp.asarray, (rows.spool_position, rows.supply_pressure, rows.return_pressure, rows.temperature))
    )
    expected = conformance.readings_of(test, effect)
    worst = float(np.max(np.abs(np.asarray(TESTS[test](valve, points)) - expected)) / np.max(np.abs(expected)))
    print(f"{test} with {effect}: {worst:.1e} of the largest reading, 1e-8 allowed")
    assert worst < 1e-8
    if test == "pressure_gain":
        pressure_a, pressure_b = port_pressures(valve, points)
        np.testing.assert_allclose(np.asarray(pressure_a - pressure_b), expected, atol=1e-8 * np.max(np.abs(expected)))
