"""Every effect, alone and together, against the rows of a third model and against the independent NumPy simulator."""

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
from thermohyd.effects.registry import EFFECTS, with_effects
from thermohyd.oil import oil_from_definition
from thermohyd.oil_definition import OilDefinition
from thermohyd.static_tests import control_flow, leakage_flow, load_flow, load_pressure
from thermohyd.valve import Valve


TESTS = {"leakage": leakage_flow, "pressure_gain": load_pressure, "flow_gain": control_flow, "load_flow": load_flow}
VALVES, ROWS = 48, 40


# Effects that share a compiled program here, each of them alone in one run of it: the three kinds of balance.
LINES = ("flow_saturation", "supply_droop", "return_back_pressure")
CROSSING = ("cross_port_leakage",)
PLAIN = tuple(name for name in EFFECTS if name not in (*LINES, *CROSSING))


@pytest.mark.parametrize(
    "together", [PLAIN, LINES, CROSSING, tuple(EFFECTS)], ids=["plain", "lines", "crossing", "all"]
)
@pytest.mark.parametrize("test", conformance.TESTS)
def test_conformance_rows(test, together):
    truth = conformance.truth()
    a, b = walther(truth["oil"]["viscosity_points_degC_cSt"])
    ideal = Valve(
        oil=oil_from_definition(OilDefinition(a, b, density=truth["oil"]["density_15degC"])),
        stroke=truth["geometry"]["stroke"],
        slot_width=truth["geometry"]["width"],
        **truth["parameters"],
    )
    rows = conformance.rows_of(test)
    points = Conditions(
        *map(jnp.asarray, (rows.spool_position, rows.supply_pressure, rows.return_pressure, rows.temperature)),
        time=jnp.asarray(rows.time),
        run=jnp.asarray(rows.run, dtype=float),
    )

    def simulate(amounts):
        return TESTS[test](with_effects(ideal, {name: amounts[i] for i, name in enumerate(together)}), points)

    wanted = ["all"] if together == tuple(EFFECTS) else ["none", *together]
    amounts = [[truth["effects"][effect].get(name, 0.0) for name in together] for effect in wanted]
    found = np.asarray(jax.jit(jax.vmap(simulate))(jnp.asarray(amounts)))
    for effect, readings in zip(wanted, found, strict=True):
        expected = conformance.readings_of(test, effect)
        worst = float(np.max(np.abs(readings - expected)) / np.max(np.abs(expected)))
        print(f"{test} with {effect}: {worst:.1e} of the largest reading, 1e-8 allowed")
        assert worst < 1e-8


# Smallest and largest random amount of each effect: up to several times what a bench shows.
RANGES = {
    "supply_edge_wear": (0.0, 15e-6),
    "return_edge_wear": (0.0, 15e-6),
    "unequal_underlap": (-8e-6, 8e-6),
    "eccentricity": (0.0, 1.0),
    "land_leakage": (0.0, 40.0),
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
    "pressure_offset": (-3e5, 3e5),
}


def random_case(seed):
    """Parameters (VALVES, 6), oils (VALVES, 3), amounts (VALVES, effects) and operating points (VALVES, ROWS).

    A third of the valves has every effect, the others a random half of them: the absent ones have the amount 0.
    """
    rng = np.random.default_rng(seed)
    parameters = rng.uniform(
        [0.0, 1e-6, -12e-6, 0.5, 20.0, -5e-6], [30e-6, 8e-6, 25e-6, 0.85, 300.0, 5e-6], (VALVES, 6)
    )
    thickness = np.stack([10 ** rng.uniform(2, 3.6, VALVES), 10 ** rng.uniform(0.6, 1.5, VALVES)], axis=1)  # cSt
    oils = np.array([[*walther([[-40.0, cold], [90.0, hot]]), rng.uniform(820, 1050)] for cold, hot in thickness])
    low, high = np.array(list(RANGES.values())).T
    amounts = rng.uniform(low, high, (VALVES, low.size))
    amounts[VALVES // 3 :] *= rng.integers(0, 2, amounts[VALVES // 3 :].shape)
    supply = rng.uniform(40e5, 280e5, (VALVES, ROWS))
    back = rng.uniform(0.0, 10e5, (VALVES, ROWS))
    x = STROKE * rng.uniform(-1.0, 1.0, (VALVES, ROWS)) * rng.uniform(0.0, 1.0, (VALVES, ROWS)) ** 2
    x[:, 7] = x[:, 6]  # a repeated position
    temperature = rng.uniform(253.15, 363.15, (VALVES, ROWS))
    load = (supply - back) * rng.uniform(-0.7, 0.7, (VALVES, ROWS))
    return parameters, oils, amounts, (x, supply, back, temperature, load)


@pytest.mark.parametrize("test", TESTS)
def test_random_subsets_of_effects(test):
    parameters, oils, amounts, points = random_case(23)
    time = np.cumsum(np.resize([0.3, 1.1, 0.0, 0.7], ROWS))  # two rows at one time, once in four
    run = np.repeat([0.0, 1.0], ROWS // 2)

    def simulate(values, oil_values, strength, *p):
        oil = eqx.tree_at(
            lambda o: (o.viscosity_a, o.viscosity_b, o.density_15degC),
            oil_from_definition(OilDefinition(9.0, 3.6)),
            tuple(oil_values),
        )
        valve = Valve(oil=oil, stroke=STROKE, slot_width=12e-3, **{name: values[i] for i, name in enumerate(NAMES)})
        valve = with_effects(valve, {name: strength[i] for i, name in enumerate(RANGES)})
        points = Conditions(*p[:4], load_pressure=p[4], time=jnp.asarray(time), run=jnp.asarray(run))
        return TESTS[test](valve, points)

    found = np.asarray(jax.jit(jax.vmap(simulate))(*map(jnp.asarray, (parameters, oils, amounts, *points))))
    for i in range(VALVES):
        rows = Rows(*(p[i] for p in points[:4]), load_pressure=points[4][i], time=time, run=run.astype(int))
        expected = reference.TESTS[test](
            ReferenceValve(12e-3, *parameters[i]),
            ReferenceOil(*oils[i][:2], density=oils[i][2]),
            rows,
            Effects(**dict(zip(RANGES, amounts[i], strict=True))),
        )[reference.READING[test]]
        worst = float(np.max(np.abs(found[i] - expected)) / np.max(np.abs(expected)))
        assert worst < 1e-7, f"{test}, valve {i}: {worst:.1e} of the largest reading, 1e-7 allowed"
