"""The second edge law: the film against its definition, the valve against two independent models, derivatives at every seam."""

import functools
from typing import get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_jit
from helpers.valves import STROKE, seed_oil, temperature_at
from hypothesis import example, given, settings, strategies as st
from reference import conformance_lubrication as conformance
from reference.film import film_integral
from reference.oil import walther

from thermohyd.arguments import ArgumentValueError
from thermohyd.conditions import Conditions
from thermohyd.edge import EDGE_LAWS, EdgeLaw, MeteringEdge, at_opening, mass_flow
from thermohyd.effects.library import with_effects
from thermohyd.film import film_resistance
from thermohyd.identify.bench import record
from thermohyd.oil import at_temperature, oil_from_definition
from thermohyd.oil_definition import OilDefinition
from thermohyd.static_tests import control_flow, leakage_flow, load_flow, load_pressure, port_pressures
from thermohyd.valve import Valve


TESTS = {"leakage": leakage_flow, "pressure_gain": load_pressure, "flow_gain": control_flow, "load_flow": load_flow}
RADIUS = 10e-6
# Where the arcs, in units of r, are far overlapped, meet, part, lose their middle, and end.
OPENINGS = (-30.0, -1.0, -1e-6, 0.0, 1e-6, 1e-3, 0.03, 0.2, 0.6, 0.95, 1.0, 1.05, 1.4, 1.9, 1.999, 2.0, 5.0)
RATIOS = (1e-4, 1e-3, 0.01, 0.06, 0.2, 0.7, 1.0, 4.0, 30.0)


def grid() -> tuple[np.ndarray, np.ndarray]:
    u, c = np.meshgrid(np.array(OPENINGS) * RADIUS, np.array(RATIOS) * RADIUS)
    return u.ravel(), c.ravel()


def film(u, r, c):
    return film_resistance(*(jnp.asarray(a, dtype=float) for a in (u, r, c)))


def slopes(u, r, c):
    """dI/du, dI/dr, dI/dc."""
    lengths = jnp.broadcast_arrays(*(jnp.asarray(a, dtype=float) for a in (u, r, c)))
    return map(np.asarray, jax.jit(jax.vmap(jax.grad(film_resistance, argnums=(0, 1, 2))))(*lengths))


def test_film_is_its_definition():
    u, c = grid()
    expected = film_integral(u, RADIUS, c)
    found = np.asarray(film(u, RADIUS, c))
    worst = np.max(np.abs(found - expected) / np.where(expected > 0.0, expected, 1.0))
    print(f"film: differs by {worst:.1e}, 1e-9 allowed")
    assert worst < 1e-9


def test_derivatives_of_the_film_are_integrals():
    # dI/dc = -3 int ds/g^4, and I scales by -2 in all lengths; dI/du is compared by differences of the definition.
    u, c = grid()
    keep = u != 2.0 * RADIUS  # there the slope jumps
    u, c = u[keep], c[keep]
    r = np.full_like(u, RADIUS)
    by_opening, by_radius, by_clearance = slopes(u, r, c)
    np.testing.assert_allclose(by_clearance, -3.0 * film_integral(u, r, c, power=4), rtol=1e-9)
    total = u * by_opening + r * by_radius + c * by_clearance
    whole = film_integral(u, r, c)
    size = np.abs(u * by_opening) + np.abs(c * by_clearance) + whole
    np.testing.assert_array_less(np.abs(total + 2.0 * whole), 1e-10 * size + 1e-300)
    smooth = np.abs(u / RADIUS - 1.0) > 0.04
    step = 0.003 * np.minimum(np.sqrt(RADIUS * c), RADIUS)
    smooth &= (np.abs(u) > 3.0 * step) & (
        np.abs(u - 2.0 * RADIUS) > 0.05 * RADIUS
    )  # where arcs end the film bends as a root
    u, c, step = u[smooth], c[smooth], step[smooth]
    slope = [film_integral(u + k * step, RADIUS, c) - film_integral(u - k * step, RADIUS, c) for k in (1, 2)]
    numeric = (8.0 * slope[0] - slope[1]) / (12.0 * step)
    np.testing.assert_allclose(by_opening[smooth], numeric, rtol=1e-7)


def test_film_where_it_is_known():
    for c in (1e-9, 2e-6, 3e-4):
        either_side = next(slopes([-1e-30, 0.0, 1e-30], RADIUS, c))
        np.testing.assert_allclose(either_side, -1.0 / c**3, rtol=1e-14)
    for ratio in (1e-4, 1e-3):
        c = ratio * RADIUS
        narrow = 3.0 * np.pi / 8.0 * np.sqrt(2.0 * RADIUS * c) / c**3
        assert float(film(0.0, RADIUS, c)) == pytest.approx(narrow, rel=ratio)
    # A sharp edge is a land alone; from u = 2 r on there is no film.
    np.testing.assert_allclose(np.asarray(film([-5e-6, 1e-9], 0.0, 2e-6)), [5e-6 / 8e-18, 0.0], rtol=1e-14)
    assert float(film(2.0 * RADIUS, RADIUS, 2e-6)) == 0.0


def test_film_has_finite_derivatives_of_any_kind():
    points = jnp.array(
        [
            [u, r, c]
            for r in (0.0, 1e-9, 1e-5)
            for u in (-1e-4, 0.0, r, 2 * r, 1.5 * r, 5e-5)
            for c in (1e-8, 2e-6, 5e-5)
        ]
    )
    of = lambda p: film_resistance(p[0], p[1], p[2])
    forward, reverse = (np.asarray(jax.jit(jax.vmap(mode(of)))(points)) for mode in (jax.jacfwd, jax.jacrev))
    np.testing.assert_allclose(forward, reverse, rtol=1e-14)
    second = np.asarray(jax.jit(jax.vmap(jax.hessian(of)))(points))
    assert np.all(np.isfinite(forward))
    assert np.all(np.isfinite(second))


def conformance_valve(name: str) -> Valve:
    t, file = conformance.truth(), conformance.truth()["files"][name]
    valve = Valve(
        oil=oil_from_definition(OilDefinition(*walther(t["oil"]["viscosity_points_degC_cSt"]))),
        stroke=t["geometry"]["stroke"],
        slot_width=t["geometry"]["width"],
        edge_law="lubrication",
        **file["parameters"],
    )
    return with_effects(valve, file["effects"])


@pytest.mark.parametrize("test", conformance.TESTS)
@pytest.mark.parametrize("name", conformance.NAMES)
def test_conformance_rows(name, test):
    valve = conformance_valve(name)
    rows, expected = conformance.rows_and_readings(name, test)
    columns = (rows.spool_position, rows.supply_pressure, rows.return_pressure, rows.temperature)
    points = Conditions(
        *map(jnp.asarray, columns), direction=jnp.asarray(rows.direction), run=jnp.asarray(rows.run, dtype=float)
    )
    found = {"reading": TESTS[test](valve, points)}
    if test == "pressure_gain":
        found["pressure_a"], found["pressure_b"] = port_pressures(valve, points)
    for channel, values in expected.items():
        worst = float(np.max(np.abs(np.asarray(found[channel]) - values)) / np.max(np.abs(values)))
        print(f"{test}, {channel}, {name}: {worst:.1e} of the largest reading, 1e-8 allowed")
        assert worst < 1e-8


NAMES = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "null_bias")
SCALE = np.array([10e-6, 3e-6, 10e-6, 0.7, 5e-6])


def valve_of(z, eta: float | None = None) -> Valve:
    """The seed body with parameters in units of SCALE."""
    fields = {name: z[i] * SCALE[i] for i, name in enumerate(NAMES)}
    heat = None if eta is None else jnp.asarray(eta)
    return Valve(oil=seed_oil(), stroke=STROKE, slot_width=12e-3, edge_law="lubrication", heat_retention=heat, **fields)


@functools.cache
def compiled(test: str, eta: float | None):
    """A test's readings, and their forward and reverse Jacobian in the scaled parameters."""

    def reading(z, conditions):
        return TESTS[test](valve_of(z, eta), conditions)

    return quick_jit(reading), quick_jit(lambda *a: (jax.jacfwd(reading)(*a), jax.jacrev(reading)(*a)))


# Thick oil, null and both ends of the stroke, and the seams u = 0, u = r and u = 2 r of the film.
SEAMS = np.array([0.0, -10e-6, 10e-6, 20e-6, -20e-6, STROKE, -STROKE, 3e-6])


def seam_conditions(centistokes: float) -> Conditions:
    full = lambda value: jnp.full(len(SEAMS), value)
    oil = full(temperature_at(centistokes))
    return Conditions(jnp.asarray(SEAMS), full(210e5), full(0.0), oil, load_pressure=full(20e5))


@pytest.mark.parametrize(("test", "eta"), [("flow_gain", None), *((test, 0.6) for test in TESTS)])
def test_derivatives_at_the_seams(test, eta):
    # Null bias 0 and underlap 0 put the rows of SEAMS exactly on them; r = 0 makes them one.
    reading, jacobians = compiled(test, eta)
    for centistokes in (30.0, 4000.0):
        c = seam_conditions(centistokes)
        for z in (
            [1.0, 0.7, 0.0, 1.0, 0.0],
            [1.5, 0.7, 1.5, 1.0, 0.06],
            [0.0, 0.7, 0.3, 1.0, 0.0],
            [1.0, 0.7, -1.0, 1.0, 0.0],
        ):
            z = jnp.asarray(z)
            unit = float(jnp.max(jnp.abs(reading(z, c))))
            forward, reverse = (np.asarray(a) / unit for a in jacobians(z, c))
            columns = []
            for i, e in enumerate(np.eye(z.size)):
                # without a radius the slit's second derivative jumps at u = 0: differences along u are right to the step only
                step = 1e-4 if z[0] > 0.0 or NAMES[i] not in ("underlap", "null_bias") else 1e-6
                # one-sided where a radius of zero has no other side
                below = 0.0 if z[i] == 0.0 and NAMES[i] == "edge_radius" else 1.0
                low, high = (
                    (reading(z + k * step * e, c) - reading(z - below * k * step * e, c)) / ((1.0 + below) * k * step)
                    for k in (1, 2)
                )
                columns.append(np.asarray((4 * low - high) / 3 if below else 2 * low - high) / unit)
            numeric = np.stack(columns, axis=-1)
            assert np.all(np.isfinite(forward))
            size = np.maximum(np.max(np.abs(numeric), axis=0, keepdims=True), 1e-4)
            np.testing.assert_array_less(np.abs(forward - reverse) / size, 1e-10)
            worst = np.max(np.abs(forward - numeric) / size, axis=0)
            print(f"{test}, {centistokes:g} cSt, {z}: {worst}")
            assert np.all(worst < 3e-5)


lengths = st.floats(0.0, 40e-6)


@settings(max_examples=200, deadline=None)
@given(
    opening=st.floats(-300e-6, 300e-6),
    radius=lengths,
    clearance=st.floats(0.05e-6, 50e-6),
    drop=st.floats(-350e5, 350e5),
    kelvin=st.floats(233.0, 393.0),
)
@example(opening=4.905695172829685e-191, radius=4.905695172829685e-191, clearance=4.7e-5, drop=0.0, kelvin=233.0)
def test_an_edge_is_finite_and_odd_everywhere(opening, radius, clearance, drop, kelvin):
    at = jnp.array([opening * 1e5, radius * 1e5, clearance * 1e5, drop * 1e-5])
    flow, forward, reverse, second = edge_flow_and_slopes(at, jnp.asarray(kelvin))
    assert np.all(np.isfinite(np.concatenate([np.ravel(a) for a in (flow, forward, reverse, second)])))
    np.testing.assert_allclose(forward, reverse, rtol=1e-9, atol=1e-12 * float(np.max(np.abs(forward))))
    back = edge_flow_and_slopes(at.at[3].mul(-1.0), jnp.asarray(kelvin))[0]
    assert float(back) == -float(flow)
    assert forward[3] > 0.0


@quick_jit
def edge_flow_and_slopes(z, kelvin):
    """Mass flow [kg/s] of an edge, lengths in 10 um and drop in bar; first derivatives either way, and second ones."""

    def flow(z):
        a = jnp.asarray
        edge = MeteringEdge(a(12e-3), z[1] * 1e-5, z[2] * 1e-5, a(0.0), a(0.7), a(100.0), law="lubrication")
        return mass_flow(at_opening(edge, z[0] * 1e-5), at_temperature(seed_oil(), kelvin), z[3] * 1e5, a(1e7))

    return flow(z), jax.jacfwd(flow)(z), jax.jacrev(flow)(z), jax.jacfwd(jax.jacrev(flow))(z)


def test_transition_number_is_unused():
    c = seam_conditions(100.0)
    valve = valve_of(np.ones(5))
    other = eqx.tree_at(lambda v: v.transition_number, valve, jnp.asarray(7.0))
    np.testing.assert_array_equal(leakage_flow(valve, c), leakage_flow(other, c))


def test_unknown_law_is_refused():
    with pytest.raises(
        ArgumentValueError, match=r'edge_law must be "orifice" or "lubrication", not the text "turbulent"'
    ):
        Valve(
            oil=seed_oil(),
            stroke=STROKE,
            slot_width=12e-3,
            edge_radius=0.0,
            clearance=1e-6,
            underlap=0.0,
            edge_law="turbulent",
        )


def test_words_for_the_laws_are_the_same_everywhere():
    assert get_args(EdgeLaw) == EDGE_LAWS == record.EDGE_LAWS
