"""A jack of unequal areas and chambers: a third model's rows, its mirror, its start inside an overlap, derivatives, what is refused.

The field itself is compared with the reference in test_dynamics_field. Runs in closed loop share a program per heat, those in
open loop another.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.machines import actuator_of, apart, as_table, inputs_of, plant, simulated, valve_of
from helpers.quick_compile import quick_jit
from reference.actuator import Machine, Run
from reference.conformance_dynamic import UNEQUAL, jack_of, machine_of, readings_of, truth
from reference.step_test import readings

from thermohyd.actuator import Actuator
from thermohyd.actuator_performance import performance
from thermohyd.arguments import ArgumentValueError
from thermohyd.dynamics.equilibrium import equilibrium, scaling_of
from thermohyd.dynamics.integrate import Gradient
from thermohyd.dynamics.linear import frequency_response
from thermohyd.dynamics.machine import Plant, State
from thermohyd.dynamics.simulate import simulate_step


KNOTS = 8
RECORDS = tuple(truth(UNEQUAL)["records"])
PAIRS = ("piston_area_a", "piston_area_b", "chamber_volume_a", "chamber_volume_b")


def run(machine: Machine, tolerance: float = 1e-11) -> np.ndarray:
    """Finer than the default: a step across the moment in which an edge opens may err by a hundred times its tolerance."""
    return as_table(simulated(machine, (), KNOTS, tolerance=tolerance))


def of_largest(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Largest difference of each reading, as a share of its largest value."""
    return np.max(np.abs(found - expected), axis=0) / np.max(np.abs(expected), axis=0)


@pytest.mark.parametrize("name", RECORDS)
def test_records_of_a_third_model(name):
    share = of_largest(run(machine_of(name, UNEQUAL)), readings_of(name, UNEQUAL))
    print(f"{name}: {share} of the largest value")
    assert np.max(share) < 1e-8


def test_the_reference_meets_them_too():
    name = "closed_isothermal"
    assert np.max(of_largest(readings(machine_of(name, UNEQUAL), 1e-8), readings_of(name, UNEQUAL))) < 1e-6


def test_equal_sides_are_the_symmetric_jack():
    """A symmetric jack's rows by the program of an unequal one."""
    machine = machine_of("closed_isothermal")
    j = machine.jack
    pairs = {f"{name}_{side}": getattr(j, name) for name in ("piston_area", "chamber_volume") for side in "ab"}
    each = replace(machine, jack=replace(j, piston_area=None, chamber_volume=None, **pairs))
    assert np.max(apart(run(each), readings_of("closed_isothermal"))) < 1e-7


def mirrored(machine: Machine) -> Machine:
    """Ports exchanged and all signs turned."""
    j, v, r = machine.jack, machine.valve, machine.run
    sides = {"piston_area_a": j.piston_area_b, "piston_area_b": j.piston_area_a}
    sides |= {"chamber_volume_a": j.chamber_volume_b, "chamber_volume_b": j.chamber_volume_a}
    return replace(
        machine,
        jack=replace(j, **sides),
        valve=replace(v, null_bias=-v.null_bias),
        run=replace(r, command=-r.command, external_force=-r.external_force),
    )


@pytest.mark.parametrize("name", ["closed_adiabatic", "open_adiabatic"])
def test_mirror(name):
    machine = machine_of(name, UNEQUAL)
    x, pa, pb, z, v = run(mirrored(machine)).T
    share = of_largest(np.stack([-x, pb, pa, -z, -v], axis=1), run(machine))
    print(f"mirrored: {np.max(share):.1e} of the largest value")
    assert np.max(share) < 1e-9


@quick_jit
def start(of: Plant) -> tuple[State, jax.Array]:
    time = of.inputs.time[0]
    return equilibrium(of, scaling_of(of, of.surroundings(time)), time)


def overlapped(seed: int, kind: str) -> Machine:
    """A valve overlapped by up to 30 um, far from matched to its jack, under any force that the supply holds."""
    rng = np.random.default_rng(seed)
    base = machine_of("closed_adiabatic" if kind == "setpoint" else "open_adiabatic", UNEQUAL)
    s_a, v_a, v_b = rng.uniform(5e-4, 30e-4), *rng.uniform(20e-6, 300e-6, 2)
    s_b = s_a * float(np.exp(rng.uniform(-1.2, 1.2)))
    ps, pt, ts = rng.uniform(70e5, 350e5), rng.uniform(0.0, 20e5), rng.uniform(253.0, 353.0)
    force = s_a * pt - s_b * ps + rng.uniform(0.03, 0.97) * (s_a + s_b) * (ps - pt)
    command = rng.uniform(-5e-3, 5e-3) if kind == "setpoint" else rng.uniform(-20e-6, 20e-6)
    time = base.run.time
    full = lambda value: np.full(len(time), float(value))
    valve = replace(
        base.valve, underlap=rng.uniform(-30e-6, 0.0), clearance=rng.uniform(0.5e-6, 6e-6),
        edge_radius=rng.uniform(0.0, 20e-6), null_bias=rng.uniform(-5e-6, 5e-6),
    )  # fmt: skip
    jack = replace(
        base.jack, piston_area_a=s_a, piston_area_b=s_b, chamber_volume_a=v_a, chamber_volume_b=v_b,
        viscous_friction=float(np.exp(rng.uniform(np.log(10.0), np.log(1e4)))),
    )  # fmt: skip
    return replace(
        base, valve=valve, jack=jack, run=Run(base.run.kind, time, full(command), *map(full, (ps, pt, ts, force)))
    )


@pytest.mark.parametrize("kind", ["setpoint", "spool_position"])
def test_a_start_inside_the_overlap(kind):
    """Always found, and at rest by the reference's equations: rates in turnovers of the chambers and in m/s2."""
    worst = np.zeros(3)
    for seed in range(200):
        machine = overlapped(seed, kind)
        state, found = start(plant(machine))
        assert bool(found), seed
        assert state.temperature is not None
        vector = np.array([state.spool, 0.0, *state.pressure, *state.temperature, state.position, state.velocity, 0.0])
        rates = machine.rates(0.0, vector.astype(float), machine.run.command[0])
        ax, dp, dt, az = rates[1], rates[2:4], rates[4:6], rates[7]
        assert abs(ax) < 1e-6 * (2.0 * np.pi * 100.0) ** 2 * machine.jack.stroke
        worst = np.maximum(worst, [np.max(np.abs(dp)) / 1e9, np.max(np.abs(dt)), abs(az)])
    print(f"{kind}: dp/dt {worst[0]:.1e} GPa/s, dT/dt {worst[1]:.1e} K/s, v' {worst[2]:.1e} m/s2")
    assert np.all(worst < [1e-8, 1e-8, 1e-8])


def small_step() -> Machine:
    """A motion inside the overlap, where no edge opens and the flows have no kinks."""
    base = machine_of("closed_isothermal", UNEQUAL)
    time = np.linspace(0.0, 0.03, 12)
    full = lambda value: np.full(len(time), value)
    setpoint = np.interp(time, time[[0, 2, 3, 11]], [0.0, 0.0, 1e-4, 1e-4])
    return replace(base, run=Run("setpoint", time, setpoint, full(210e5), full(2e5), full(313.15), full(1000.0)))


WEIGHTS = np.random.default_rng(0).normal(size=(12, 3))


def weighted(theta: jax.Array, gradient: Gradient) -> jax.Array:
    """One number of the readings, by each area and volume as a share of its own."""
    given = small_step()
    valve, jack = valve_of(given), actuator_of(given)
    jack = replace(jack, **{name: getattr(jack, name) * theta[i] for i, name in enumerate(PAIRS)})
    found = simulate_step(
        valve, jack, inputs_of(given), heat="isothermal", gradient=gradient, rtol=1e-11, atol=1e-11, throw=False
    )
    table = jnp.stack([found.spool_position / 1e-6, found.pressure_a / 1e5, found.piston_velocity / 1e-4], axis=1)
    return jnp.sum(table * WEIGHTS)


@quick_jit
def forward(theta: jax.Array) -> tuple[jax.Array, jax.Array]:
    """(derivatives, the number itself): one program for both."""
    return jax.jacfwd(lambda theta: (weighted(theta, "forward"),) * 2, has_aux=True)(theta)


@quick_jit
def reverse(theta: jax.Array) -> jax.Array:
    return jax.grad(weighted)(theta, "reverse")


def test_derivatives_by_each_area_and_volume():
    at, step = jnp.ones(len(PAIRS)), 1e-4
    found = np.asarray(forward(at)[0])
    size = np.max(np.abs(found))
    number = lambda theta: float(forward(theta)[1])
    expected = np.array([(number(at + u) - number(at - u)) / (2.0 * step) for u in step * np.eye(len(at))])
    backward = np.asarray(reverse(at))
    print("forward", found, "apart", np.max(np.abs(found - backward)) / size, np.max(np.abs(found - expected)) / size)
    assert np.min(np.abs(found)) > 1e-3 * size
    np.testing.assert_allclose(backward, found, atol=2e-7 * size)
    np.testing.assert_allclose(expected, found, atol=1e-6 * size)


def test_small_signal_is_the_reference_s_linearised():
    """Piston velocity over spool command, against central differences of the reference's right-hand side."""
    machine = machine_of("open_isothermal", UNEQUAL)
    state, found = start(plant(machine))
    assert bool(found)
    at = np.array([state.spool, 0.0, *state.pressure, 313.15, 313.15, 0.0, state.velocity, 0.0], dtype=float)
    # Spool and its speed, pressures, velocity: position and heat take no part, the command drives the spool.
    keep, steps = np.array([0, 1, 2, 3, 7]), np.array([2e-9, 1e-5, 2e2, 2e2, 1e-7])
    bumps = np.zeros((5, 9))
    bumps[np.arange(5), keep] = steps
    columns = [(machine.rates(0.0, at + b, 0.0) - machine.rates(0.0, at - b, 0.0))[keep] for b in bumps]
    matrix = np.stack(columns, axis=1) / (2.0 * steps)
    drive = ((machine.rates(0.0, at, 1e-7) - machine.rates(0.0, at, -1e-7)) / 2e-7)[keep]
    frequency = np.array([0.5, 5.0, 20.0, 80.0])
    gain = np.array([np.linalg.solve(2j * np.pi * f * np.eye(5) - matrix, drive)[4] for f in frequency])
    response = quick_jit(
        lambda valve, jack, inputs: frequency_response(
            valve,
            jack,
            inputs,
            jnp.asarray(frequency),
            output="piston_velocity",
            absolute=True,
            heat="isothermal",
            throw=False,
        )
    )(valve_of(machine), actuator_of(machine), inputs_of(machine))
    np.testing.assert_allclose(response.amplitude_ratio, np.abs(gain), rtol=1e-5)
    np.testing.assert_allclose(response.phase, np.rad2deg(np.unwrap(np.angle(gain))), atol=1e-3)


def test_a_symmetric_jack_has_no_second_side():
    """Nothing is computed twice: the fields of the pairs are None, and so are those that a pair replaces."""
    shared, pair = Actuator(), actuator_of(machine_of("closed_isothermal", UNEQUAL))
    assert all(getattr(shared, name) is None for name in PAIRS)
    assert (shared.areas.shape, shared.volumes.shape, shared.symmetric) == ((), (), True)
    assert (float(shared.areas), float(shared.volumes)) == (12e-4, 60e-6)
    assert pair.piston_area is None
    assert pair.chamber_volume is None
    np.testing.assert_allclose(pair.areas, jack_of(UNEQUAL).areas)
    np.testing.assert_allclose(pair.volumes, jack_of(UNEQUAL).mid_volumes)
    assert not pair.symmetric
    lines = Actuator(chamber_volume_a=50e-6, chamber_volume_b=70e-6)
    assert (float(lines.areas), lines.volumes.shape, lines.symmetric) == (12e-4, (2,), False)


def test_formulas_of_a_symmetric_jack_refuse_another():
    jack = actuator_of(small_step())
    with pytest.raises(ArgumentValueError, match="linear performance is that of a symmetric jack"):
        performance(valve_of(small_step()), jack, temperature=313.15, supply_pressure=210e5)
