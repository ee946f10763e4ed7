"""The vector field against the reference's right-hand side, state by state: every effect that acts, alone and together."""

from dataclasses import asdict, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.machines import DYNAMIC, inputs_of, plant
from helpers.quick_compile import quick_jit
from reference.actuator import STATES, Dynamic, Machine
from reference.conformance_dynamic import DYNAMIC as DYNAMIC_ROWS, UNEQUAL, jack_of, machine_of
from reference.valve import Effects

from thermohyd.dynamics.machine import Plant, State
from thermohyd.dynamics.vector_field import vector_field
from thermohyd.effects.library import DYNAMIC_EFFECTS, EFFECTS, effect, with_effects


# What acts in motion; the others belong to a flowmeter, a gauge or a sweep, or to the static heat models.
STATIC = {
    "supply_edge_wear": 5e-6, "return_edge_wear": 3e-6, "edge_wear_pa": 4e-6, "edge_wear_pb": 1e-6,
    "edge_wear_at": 2e-6, "edge_wear_bt": 6e-6, "unequal_underlap": 2e-6, "eccentricity": 0.6, "land_leakage": 8.0,
    "null_shift_temperature": 4e-8, "null_shift_pressure": 1e-13,
    "thermal_clearance": 5e-9, "pressure_clearance": 3e-14, "flow_saturation": 6e13, "supply_droop": 5e9,
    "return_back_pressure": 4e13, "pressure_viscosity": 1.5e-8, "viscosity_shift": 0.2, "temperature_offset": 4.0,
    "cross_port_leakage": 5e-13,
}  # fmt: skip
MOVING = {
    "coulomb_friction": 200.0, "stribeck_friction": 300.0, "backlash": 4e-6, "entrained_air": 0.02, "jack_leakage": 2e-12,
    "flow_force": 4e-7, "wall_heat": 30.0,
}  # fmt: skip
NO_PART = set(EFFECTS) - set(STATIC) - {"position_scale"}
PRESENT = (*STATIC, *MOVING)
TIMES = 6


def machine(adiabatic: bool, static: dict[str, float], moving: dict[str, float], jack: str = DYNAMIC_ROWS) -> Machine:
    base = machine_of("closed_adiabatic")
    base = replace(base, valve=replace(base.valve, null_pressure=150e5))
    return replace(base, adiabatic=adiabatic, static=Effects(**static), dynamic=Dynamic(**moving), jack=jack_of(jack))


def random_states(seed: int) -> list[np.ndarray]:
    """States in the order of the reference, some with flows that run backwards and a piston in its end stop."""
    rng = np.random.default_rng(seed)
    low = np.array([-2e-4, -0.1, -0.5e5, -0.5e5, 300.0, 300.0, -24e-3, -0.1, -2e-4])
    high = np.array([2e-4, 0.1, 230e5, 230e5, 330.0, 330.0, 24e-3, 0.1, 2e-4])
    found = [rng.uniform(low, high) for _ in range(TIMES)]
    found[1][6] = 25.01e-3
    found[2][6], found[2][7] = -25.01e-3, -0.05
    return found


def as_state(vector: np.ndarray, adiabatic: bool) -> State:
    x, vx, pa, pb, ta, tb, z, v, y = (jnp.asarray(value) for value in vector)
    warm = jnp.stack([ta, tb]) if adiabatic else None
    return State(x, vx, jnp.stack([pa, pb]), warm, z, v, play=y)


def as_vector(rates: State) -> np.ndarray:
    warm = np.zeros(2) if rates.temperature is None else np.asarray(rates.temperature)
    assert rates.play is not None
    parts = (
        rates.spool,
        rates.spool_speed,
        *np.asarray(rates.pressure),
        *warm,
        rates.position,
        rates.velocity,
        rates.play,
    )
    return np.array([float(part) for part in parts])


@quick_jit
def field(of: Plant, time: jax.Array, state: State) -> State:
    return vector_field(of, time, state)


def largest_difference(of: Machine, adiabatic: bool) -> float:
    built = plant(of, PRESENT)
    worst = 0.0
    for i, vector in enumerate(random_states(3)):
        time = 0.019 + 0.0003 * i
        found = as_vector(field(built, jnp.asarray(time), as_state(vector, adiabatic)))
        expected = of.rates(time, vector)
        scale = np.maximum(np.abs(expected), 1e-6 * np.array([1.0, 1e3, 1e9, 1e9, 1e2, 1e2, 1.0, 1e2, 1.0]))
        worst = max(worst, float(np.max(np.abs(found - expected) / scale)))
    return worst


ALONE = [*((name, {name: amount}, {}) for name, amount in STATIC.items()),
         *((name, {}, {name: amount}) for name, amount in MOVING.items())]  # fmt: skip


@pytest.mark.parametrize(("adiabatic", "jack"), [(True, DYNAMIC_ROWS), (False, DYNAMIC_ROWS), (True, UNEQUAL)])
def test_every_effect_alone_and_together(adiabatic, jack):
    cases = [("none", {}, {}), *ALONE, ("all", STATIC, MOVING)]
    found = {name: largest_difference(machine(adiabatic, s, m, jack), adiabatic) for name, s, m in cases}
    print(f"{max(found, key=lambda name: found[name])}: {max(found.values()):.1e} of the rate")
    assert max(found.values()) < 1e-11


def test_the_other_edge_law():
    of = machine(True, {}, {})
    of = replace(of, valve=replace(of.valve, edge_law="lubrication"))
    worst = largest_difference(of, True)
    print(f"lubrication: {worst:.1e} of the rate")
    assert worst < 1e-9  # the film's eleven nodes leave 4e-12 of it


@pytest.mark.parametrize("adiabatic", [True, False])
def test_neutral_changes_nothing(adiabatic):
    bare = machine(adiabatic, {}, {})
    vector = random_states(5)[0]
    # Without backlash there is no play to carry.
    state = eqx.tree_at(lambda s: s.play, as_state(vector, adiabatic), None)
    time = jnp.asarray(0.0195)
    plain = field(plant(bare), time, state)
    neutral = field(plant(bare, PRESENT), time, as_state(vector, adiabatic))
    for name in ("spool", "spool_speed", "pressure", "temperature", "position", "velocity"):
        if getattr(plain, name) is not None:
            np.testing.assert_allclose(getattr(neutral, name), getattr(plain, name), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("adiabatic", [True, False])
def test_equal_sides_given_one_by_one(adiabatic):
    """The pairs with equal entries are the symmetric jack, which has no second area to compute with."""
    shared = machine(adiabatic, {}, {})
    j = shared.jack
    pairs = {f"{name}_{side}": getattr(j, name) for name in ("piston_area", "chamber_volume") for side in "ab"}
    each = replace(shared, jack=replace(j, piston_area=None, chamber_volume=None, **pairs))
    for vector in random_states(7):
        state = eqx.tree_at(lambda s: s.play, as_state(vector, adiabatic), None)
        one, other = (jax.tree.leaves(field(plant(of), jnp.asarray(0.0195), state)) for of in (shared, each))
        for a, b in zip(one, other, strict=True):
            np.testing.assert_allclose(b, a, rtol=1e-13, atol=1e-13 * float(np.max(np.abs(a))))


def test_others_take_no_part():
    bare = machine(True, {}, {})
    valve = plant(bare).valve
    state = eqx.tree_at(lambda s: s.play, as_state(random_states(6)[0], True), None)
    loaded = with_effects(valve, {name: EFFECTS[name].scale for name in NO_PART})
    both = [
        field(eqx.tree_at(lambda p: p.valve.effects, plant(bare), v.effects), jnp.asarray(0.0), state)
        for v in (valve, loaded)
    ]
    assert all(np.array_equal(one, other) for one, other in zip(*map(jax.tree.leaves, both), strict=True))


def test_the_library_is_the_reference_s():
    assert set(DYNAMIC_EFFECTS) == set(DYNAMIC) == set(asdict(Dynamic()))
    assert len(STATES) == 9
    # Rows of a CSV rounded to 12 digits have no bends of their own: four where the setpoint ramps begin and end.
    assert np.count_nonzero(np.abs(np.asarray(inputs_of(machine(True, {}, {})).command.bends)) > 1e-9) == 4


@pytest.mark.parametrize("name", DYNAMIC_EFFECTS)
def test_registry_line(name):
    info = DYNAMIC_EFFECTS[name]
    assert info.dynamic
    assert info.stages == ("motion",)
    assert info.lower == 0.0 < info.typical[0] <= info.scale <= info.typical[1] <= info.upper
    assert set(info.shows) <= {"step", "frequency"}
    assert info.sentence[0].islower()
    assert all(word in str(info.effect_class.__doc__) for word in ("Source:", "Amount", "Shows"))
    assert float(effect(name).amount) == 0.0
    assert not any(known.dynamic for known in EFFECTS.values())
