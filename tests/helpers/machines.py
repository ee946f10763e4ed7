"""The reference's machines run by the simulator: one description for both sides of a comparison."""

from dataclasses import asdict, fields
from functools import partial

import jax.numpy as jnp
import numpy as np
from reference.actuator import Dynamic, Machine
from reference.step_test import READINGS

from helpers.quick_compile import quick_jit
from thermohyd.actuator import Actuator
from thermohyd.dynamics.inputs import StepInputs, step_inputs
from thermohyd.dynamics.integrate import FAILURES
from thermohyd.dynamics.machine import Plant, Walls, plant_of
from thermohyd.dynamics.simulate import RTOL, StepReadings, simulate_step
from thermohyd.effects.library import with_effects
from thermohyd.oil import Oil
from thermohyd.valve import Valve


DYNAMIC = tuple(field.name for field in fields(Dynamic))


def valve_of(machine: Machine, effects: tuple[str, ...] = ()) -> Valve:
    """The valve, with the named effects at the machine's amounts (those of 0 included, to share compiled programs)."""
    v, o = machine.valve, machine.oil
    a, b, rho = (float(value) for value in (o.walther_a, o.walther_b, o.density))
    oil = Oil(viscosity_a=a, viscosity_b=b, density_15degC=rho)
    bare = Valve(oil=oil, stroke=machine.jack.stroke, **asdict(v))
    given = asdict(machine.static) | asdict(machine.dynamic)
    used = {name for name, amount in given.items() if amount} | set(effects)
    return with_effects(bare, {name: given[name] for name in sorted(used)})


def actuator_of(machine: Machine) -> Actuator:
    given = asdict(machine.jack)
    return Actuator(**{name: value for name, value in given.items() if name not in ("stroke", "polarity")})


def inputs_of(machine: Machine, knots: int = 0) -> StepInputs:
    r = machine.run
    return step_inputs(
        r.time, r.command, r.kind, supply_pressure=r.supply_pressure, return_pressure=r.return_pressure,
        temperature=r.temperature, external_force=r.external_force, knots=knots,
    )  # fmt: skip


def heat_of(machine: Machine):
    return "adiabatic" if machine.adiabatic else "isothermal"


@partial(quick_jit, static_argnames=("heat",))
def _quickly(valve, actuator, inputs, walls, polarity, tolerance, heat) -> StepReadings:
    return simulate_step(
        valve, actuator, inputs, walls=walls, polarity=polarity, heat=heat, rtol=tolerance, atol=tolerance, throw=False
    )


def simulated(
    machine: Machine,
    effects: tuple[str, ...] = (),
    knots: int = 0,
    walls: Walls | None = None,
    tolerance: float = RTOL,
) -> StepReadings:
    """A run by a program that is compiled quickly, one per kind of command, heat, effects, rows and (powers of two) knots."""
    found = _quickly(
        valve_of(machine, effects),
        actuator_of(machine),
        inputs_of(machine, knots),
        walls,
        machine.jack.polarity,
        tolerance,
        heat_of(machine),
    )
    if int(found.failure):
        raise RuntimeError(FAILURES[int(found.failure)])
    return found


def plant(machine: Machine, effects: tuple[str, ...] = ()) -> Plant:
    return plant_of(
        valve_of(machine, effects),
        actuator_of(machine),
        inputs_of(machine),
        heat=heat_of(machine),
        walls=Walls(),
        polarity=machine.jack.polarity,
    )


def as_table(readings: StepReadings) -> np.ndarray:
    """(rows, 5) in the order of the reference's READINGS."""
    return np.asarray(jnp.stack([getattr(readings, name) for name in READINGS], axis=1))


def apart(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Largest difference of each reading, as a share of its range."""
    return np.max(np.abs(found - expected), axis=0) / np.ptp(expected, axis=0)
