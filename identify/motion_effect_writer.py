"""The stage of a typed term of tests in motion, as text: what `thermohyd effect` writes of it, and its test. No JAX."""

from thermohyd.identify.model.places import OF_READING, place_of
from thermohyd.identify.model.term_variables import DELAYED, DIRECTION_SPEED, IMPLICIT, REFERENCE_TEMPERATURE, signal_of
from thermohyd.identify.model.typed_terms import GASEOUS, TypedTerm

from .written_term import Stage, refused


# What a signal is of what an effect of the circuit sees.
_OF_SEEN = {
    "constant": "jnp.ones_like(seen.time)",
    "position": "seen.spool",
    "opening": "jnp.abs(seen.spool)",
    "rate": "seen.spool_speed",
    "turned": "seen.turned",
    "velocity": "seen.velocity",
    "direction": f"jnp.tanh(seen.velocity / {DIRECTION_SPEED})",
    "piston_position": "seen.position",
    "pressure_a": "seen.pressure[0]",
    "pressure_b": "seen.pressure[1]",
    "load": "seen.pressure[0] - seen.pressure[1]",
    "drop_a": "seen.supply_pressure - seen.pressure[0]",
    "drop_b": "seen.supply_pressure - seen.pressure[1]",
    "drop": "seen.supply_pressure - seen.return_pressure",
    "warming_a": "seen.warming[0]",
    "warming_b": "seen.warming[1]",
    "temperature": f"seen.temperature - {REFERENCE_TEMPERATURE}",
    "time": "seen.time",
}
# {part of the machine: (field of what is added, chamber)}
_ADDED = {
    "force_on_piston": ("piston_force", None), "force_on_spool": ("spool_target", None), "position": ("opening", None),
    "viscosity": ("viscosity", None), "flow_a": ("inflow", 0), "flow_b": ("inflow", 1), "heat_a": ("heat", 0),
    "heat_b": ("heat", 1),
}  # fmt: skip


def stage_in_motion(term: TypedTerm) -> Stage:
    """The stage of a term's place in motion. Raises BenchInputError where no stage acts there."""
    if term.place.startswith(OF_READING):
        raise refused(term, "no stage of the simulator reads a test in motion")
    if term.variable == DELAYED:
        return _delay(term)
    place = place_of(term.place, moving=True)
    parts: dict[str, list[str]] = {}
    for moved, sign in place.moving.items():
        field, chamber = _ADDED[moved]
        if term.variable == IMPLICIT:
            parts.setdefault("inflow_per_rate", ["0.0", "0.0"])[chamber or 0] = f"{sign}"
            continue
        minus = "-" if sign < 0.0 else ""
        flow = f"{minus}self.amount * law({_OF_SEEN[signal_of(place, moved, term.variable)]})"
        parts.setdefault(field, [flow] if chamber is None else ["jnp.zeros(())"] * 2)[chamber or 0] = flow
    ((field, values),) = parts.items()
    imports = ("from thermohyd.dynamics.circuit import AbstractCircuitEffect, Added, Seen",)
    if field == "inflow_per_rate":
        value = f"self.amount * np.array([{', '.join(values)}])"
        if term.law == GASEOUS:
            imports = (*imports, "from thermohyd.dynamics.flows import softness_of_gas")
            value += " * softness_of_gas(seen.pressure)"
    else:
        value = values[0] if len(values) == 1 else f"jnp.stack([{', '.join(values)}])"
    body = f"""    def added(self, seen: Seen) -> Added:
        return Added({field}={value})"""
    remembers = "seen.turned" in body
    # Which way the command went last is no small motion.
    return Stage(
        "AbstractCircuitEffect",
        imports,
        body,
        (),
        ("step",) if remembers else ("step", "frequency"),
        remembers=remembers,
    )


def _delay(term: TypedTerm) -> Stage:
    """A lag of the command with its own rate is a delay, which a field of `Motion` has: exact however fast the command changes."""
    body = """    def motion(self, so_far: Motion) -> Motion:
        return so_far.later(self.amount)"""
    imports = ("from thermohyd.dynamics.machine import AbstractMotionEffect, Motion",)
    later = term.coefficients[0] > 0.0
    return Stage("AbstractMotionEffect", imports, body, (), ("step", "frequency"), lower_is_zero=later)


_ADDED_BY_A_DELAY = '''def added(amount):
    """Everything that moves an actuator, of one that has nothing else."""
    still = Motion(jnp.zeros(()), jnp.zeros(()))
    return np.stack(jax.tree.leaves(effect(NAME, amount).motion(still)))'''
_ADDED_TO_THE_CIRCUIT = '''def added(amount):
    """Everything that is added at a few states of an actuator."""
    sizes = np.array([0.1, 5e-5, 1e-2, 2e-3, 0.05, 2e6, 2e6, 2.0, 2.0])
    found = []
    for row in np.random.default_rng(0).uniform(-1.0, 1.0, (20, len(sizes))) * sizes:
        values = [jnp.asarray(value) for value in row]
        seen = Seen(
            time=abs(values[0]), spool=values[1], spool_speed=values[2], position=values[3], velocity=values[4],
            pressure=10e6 + jnp.stack(values[5:7]), warming=5.0 + jnp.stack(values[7:9]), supply_pressure=jnp.asarray(21e6),
            return_pressure=jnp.asarray(2e5), temperature=jnp.asarray(323.15), turned=jnp.sign(values[2]),
        )
        found += [jnp.ravel(leaf) for leaf in jax.tree.leaves(effect(NAME, amount).added(seen))]
    return np.concatenate(found)'''


def test_in_motion(name: str, term: TypedTerm) -> str:
    """The text of a test: the amount 0 adds nothing, an amount adds something somewhere."""
    delays = term.variable == DELAYED
    needed = "machine import Motion" if delays else "circuit import Seen"
    return f'''"""{name}: neutral at 0, and something to see at a usual amount. Run: pytest {f"test_{name}.py"}"""

from pathlib import Path

import jax
import numpy as np


jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp

from thermohyd.dynamics.{needed}
from thermohyd.effects.library import effect, effect_info
from thermohyd.identify.users_effects import load_effects


NAME = "{name}"
load_effects(Path(__file__).parent)


{_ADDED_BY_A_DELAY if delays else _ADDED_TO_THE_CIRCUIT}


def test_none_of_it_adds_nothing():
    np.testing.assert_array_equal(added(0.0), 0.0)


def test_some_of_it_adds_something():
    assert np.max(np.abs(added(effect_info(NAME).scale))) > 0.0
'''
