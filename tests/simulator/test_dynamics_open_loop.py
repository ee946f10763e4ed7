"""Open loop: a third model's rows, the sign of the current, and slow sweeps that meet the static tests. One program."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from helpers.machines import apart, as_table, simulated, valve_of
from helpers.quick_compile import quick_jit
from reference.actuator import Machine, Run
from reference.conformance_dynamic import machine_of, readings_of

from thermohyd.conditions import Conditions
from thermohyd.static_tests import control_flow


KNOTS = 8


def run(machine: Machine):
    return simulated(machine, (), KNOTS)


def short(seed: int) -> Machine:
    """The conformance valve for 40 ms: current steps both ways, supply, return, temperature and force vary."""
    rng = np.random.default_rng(seed)
    base = machine_of("current_adiabatic")
    time = np.linspace(0.0, 0.04, len(base.run.time))
    bend = time[[0, 5, 8, 30, 33, len(time) - 1]]
    column = lambda *values: np.interp(time, bend, values)
    current = rng.uniform(-8e-3, 8e-3, 3)
    columns = Run(
        "current",
        time,
        column(*np.repeat(current, 2)),
        column(200e5, 200e5, 210e5, 210e5, 190e5, 190e5),
        column(2e5, 2e5, 3e5, 3e5, 4e5, 4e5),
        column(313.15, 313.15, 314.0, 314.0, 314.5, 314.5),
        column(500.0, 500.0, -1500.0, -1500.0, 1500.0, 1500.0),
    )
    return replace(base, run=columns)


def test_current_record():
    share = apart(as_table(run(machine_of("current_adiabatic"))), readings_of("current_adiabatic"))
    print(f"{np.max(share):.1e} of the range")
    assert np.max(share) < 1e-5


def test_polarity():
    machine = short(2)
    turned = replace(
        machine, run=replace(machine.run, command=-machine.run.command), jack=replace(machine.jack, polarity=-1)
    )
    np.testing.assert_allclose(as_table(run(turned)), as_table(run(machine)), rtol=1e-9, atol=1e-12)


def test_slow_sweep_is_the_flow_gain_test():
    """Without load and friction, S v is the flow of connected ports, as the spool creeps through its range."""
    base = machine_of("current_adiabatic")
    time = np.linspace(0.0, 400.0, len(base.run.time))
    full = lambda value: np.full(len(time), float(value))
    current = np.interp(time, [0.0, 200.0, 400.0], [-4e-3, 4e-3, -4e-3])
    columns = Run("current", time, current, full(210e5), full(2e5), full(313.15), full(0.0))
    # A jack so large that the sweep stays within its stroke and the flow makes no pressure.
    jack = replace(base.jack, piston_area=0.1, chamber_volume=3.0, piston_stroke=50.0, viscous_friction=0.0)
    found = run(replace(base, run=columns, jack=jack))
    x = np.asarray(found.spool_position)
    at = Conditions(*(jnp.asarray(v) for v in (x, full(210e5), full(2e5), full(313.15))))
    static = np.asarray(quick_jit(control_flow)(replace(valve_of(base), heat_retention=jnp.asarray(1.0)), at))
    share = np.max(np.abs(0.1 * np.asarray(found.piston_velocity) - static)) / np.ptp(static)
    print(f"S v apart from the flow-gain test by {share:.1e} of its range")
    assert share < 2e-3
