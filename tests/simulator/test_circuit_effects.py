"""What effects and typed terms add to the circuit in motion, beside physics that the machine has already (held by the reference)."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.machines import plant
from reference.conformance_dynamic import machine_of

from thermohyd.dynamics.circuit import Added, turned
from thermohyd.dynamics.flows import ATMOSPHERE, POLYTROPIC, chamber_rates, chamber_sources, chamber_volumes, flows_at
from thermohyd.dynamics.linear import frequency_response
from thermohyd.dynamics.machine import MEMORY, Plant, State, Walls, asked_position, plant_of
from thermohyd.dynamics.vector_field import rates_at
from thermohyd.effects.library import effect
from thermohyd.identify.fitting.motion_terms import AbstractFew, terms_in
from thermohyd.identify.model.places import PLACES
from thermohyd.identify.model.term_variables import MOVED, SIGNALS, VARIABLES, asked_with, signal_of
from thermohyd.identify.model.typed_terms import TypedTerm, unit_of


STATE = State(
    spool=jnp.asarray(4e-5), spool_speed=jnp.asarray(3e-3), pressure=jnp.asarray([9e6, 12e6]),
    temperature=jnp.asarray([318.0, 321.0]), position=jnp.asarray(2e-3), velocity=jnp.asarray(0.04),
)  # fmt: skip
BARE = plant(machine_of("closed_adiabatic"))


@jax.jit
def _rates(machine, state):
    return rates_at(machine, state, machine.surroundings(machine.inputs.time[0]), jnp.asarray(1e-3))


def machine_with(*effects) -> Plant:
    valve = replace(BARE.valve, effects=effects)
    return plant_of(valve, BARE.actuator, BARE.inputs, heat="adiabatic", walls=Walls(), polarity=1)


def rates(*effects) -> State:
    """Rates of change of one state, with effects on the valve."""
    return _rates(machine_with(*effects), STATE)


def term_of(
    place: str, variable: str, law: str, *coefficients: float, low: float = -1e9, high: float = 1e9
) -> AbstractFew:
    terms = terms_in((TypedTerm(place, variable, law, coefficients, low, high, moving=True),))
    return terms.effect(terms.coefficients)


def leaves(state: State) -> np.ndarray:
    return np.concatenate([np.atleast_1d(leaf) for leaf in jax.tree.leaves(state)])


def test_a_term_of_nothing_changes_nothing():
    np.testing.assert_array_equal(
        leaves(rates(term_of("flow_from_a_to_b", "load", "proportional", 0.0))), leaves(rates())
    )


@pytest.mark.parametrize(
    ("term", "name", "amount", "within"),
    [
        (("force_on_piston", "direction", "proportional", -150.0), "coulomb_friction", 150.0, 1e-12),
        (("heat_of_chamber", "temperature", "proportional", -40.0), "wall_heat", 40.0, 1e-12),
        (("viscosity", "constant", "constant", 0.2), "viscosity_shift", 0.2, 1e-12),
        # A leak's oil is weighed at the mean pressure, and warms.
        (("flow_from_a_to_b", "load", "proportional", 5e-12), "jack_leakage", 5e-12, 0.05),
    ],
)
def test_a_term_is_the_physics_that_it_stands_for(term, name, amount, within):
    plain = leaves(rates())
    moved, expected = leaves(rates(term_of(*term))) - plain, leaves(rates(effect(name, amount))) - plain
    assert np.max(np.abs(expected)) > 0.0
    pressures = slice(-4, None) if within > 1e-6 else slice(None)
    np.testing.assert_allclose(
        moved[pressures], expected[pressures], rtol=within, atol=within * np.max(np.abs(expected[pressures]))
    )


def test_a_lag_of_the_command_with_its_rate_is_a_delay():
    term = TypedTerm("command_lag", "command_rate", "proportional", (1.5e-3,), -1.0, 1.0, moving=True)
    assert term.unit == "s"
    terms = terms_in((term,))
    found, expected = machine_with(terms.delay(terms.coefficients)), machine_with(effect("spool_delay", 1.5e-3))
    np.testing.assert_array_equal(found.inputs.command.knots, expected.inputs.command.knots)
    assert len(found.inputs.command.knots) > 0
    assert np.all(found.inputs.command.knots > BARE.inputs.command.knots)
    np.testing.assert_array_equal(leaves(rates(terms.effect(terms.coefficients))), leaves(rates()))


def test_what_goes_with_the_rate_of_the_pressure_is_solved_for():
    around = BARE.surroundings(BARE.inputs.time[0])
    flows = flows_at(BARE, BARE.at(around), around, STATE)
    found = lambda added: chamber_rates(BARE, STATE, chamber_sources(BARE, around, STATE, flows, added))[0]
    stores = jnp.asarray([-3e-14, 0.0])
    dp = found(Added(inflow_per_rate=stores))
    np.testing.assert_allclose(dp, found(Added(inflow=stores * dp)), rtol=1e-12)
    assert abs(float(dp[0])) < 0.9 * abs(float(found(Added())[0]))


def test_a_gas_in_the_chambers_is_entrained_air():
    """phi V/(n p_a) at gauge zero: to first order in the share, but for the oil that the bubbles take the room of."""
    share = 1e-4
    volumes = chamber_volumes(BARE, STATE.position)
    for i, chamber in enumerate("ab"):
        amount = -share * float(volumes[i]) / (POLYTROPIC * ATMOSPHERE)
        found = rates(term_of(f"flow_into_chamber_{chamber}", "pressure_rate", "gaseous", amount))
        expected = rates(effect("entrained_air", share))
        moved, wanted = (float((of.pressure - rates().pressure)[i]) for of in (found, expected))
        assert wanted != 0.0
        assert moved == pytest.approx(wanted, rel=0.05)
        assert float((found.pressure - rates().pressure)[1 - i]) == 0.0


def test_a_force_on_the_spool_and_a_shift_of_its_position():
    plain = rates()
    pushed = rates(term_of("force_on_spool", "constant", "constant", 1e-6))
    square = (2.0 * np.pi * float(BARE.actuator.spool_frequency)) ** 2
    assert float(pushed.spool_speed - plain.spool_speed) == pytest.approx(1e-6 * square, rel=1e-6)
    valve = replace(BARE.valve, null_bias=BARE.valve.null_bias - 2e-6)
    assert BARE.supplied is not None
    other = _rates(
        replace(BARE, valve=valve, supplied=replace(BARE.supplied, null_bias=BARE.supplied.null_bias - 2e-6)), STATE
    )
    shifted = rates(term_of("position", "constant", "constant", 2e-6))
    np.testing.assert_allclose(leaves(shifted), leaves(other), rtol=1e-9)


def with_memory(ahead: float, *effects):
    """(machine, state) with the command `ahead` [m] of the state that remembers its last turn."""
    machine = machine_with(*effects)
    asked = asked_position(machine, machine.command(machine.inputs.time[0]), STATE.position)
    return machine, replace(STATE, play=asked - ahead)


PLAY = 2e-6
TURNED = ("force_on_spool", "direction", "proportional")


@pytest.mark.parametrize(
    ("ahead", "expected"), [(3e-6, 1.0), (-3e-6, -1.0), (0.0, 0.0), (MEMORY * 0.125, 0.25), (-MEMORY * 0.125, -0.25)]
)
def test_which_way_the_command_went_last_is_remembered(ahead, expected):
    ahead *= 1.0 if abs(ahead) == 3e-6 else float(BARE.valve.stroke)
    machine, state = with_memory(ahead, term_of(*TURNED, 0.0))
    around = machine.surroundings(machine.inputs.time[0])
    assert float(turned(machine, around, state)) == pytest.approx(expected, abs=1e-12)
    # Only where somebody asks.
    assert BARE.play_width is None
    assert float(turned(BARE, around, STATE)) == 0.0


def test_a_term_that_goes_with_the_last_turn_is_a_play_on_its_way():
    """At either end of a play, half its width against the motion; and the play's own state moves alike."""
    for end in (1.0, -1.0):
        found = []
        for effects in ((effect("backlash", PLAY),), (term_of(*TURNED, -0.5 * PLAY),)):
            machine, state = with_memory(end * 0.5 * PLAY, *effects)
            begin = machine.inputs.time[0]
            found.append(rates_at(machine, state, machine.surroundings(begin), machine.command(begin)))
        assert float(found[0].spool_speed) == pytest.approx(float(found[1].spool_speed), rel=1e-12)
        # A term beside a play sees where that one stands.
        machine, state = with_memory(end * 0.25 * PLAY, effect("backlash", PLAY), term_of(*TURNED, 0.0))
        assert float(turned(machine, machine.surroundings(machine.inputs.time[0]), state)) == pytest.approx(0.5 * end)


def test_a_memory_has_no_small_signal_response():
    frequency = jnp.array([1.0, 30.0, 200.0])
    found = [
        frequency_response(replace(BARE.valve, effects=effects), BARE.actuator, BARE.inputs, frequency)
        for effects in ((), (term_of(*TURNED, -1e-6),))
    ]
    # Two programs, which round apart.
    np.testing.assert_allclose(found[0].amplitude_ratio, found[1].amplitude_ratio, rtol=1e-14)
    np.testing.assert_allclose(found[0].phase, found[1].phase, rtol=1e-14)


def test_a_smooth_law_is_its_legendre_series():
    from numpy.polynomial import legendre

    coefficients, plain = (3.0, -20.0, 8.0, 5.0), rates()
    found = rates(term_of("force_on_piston", "velocity", "smooth", *coefficients, low=-0.1, high=0.2))
    force = float(found.velocity - plain.velocity) * float(BARE.actuator.moving_mass)
    assert force == pytest.approx(legendre.legval((0.04 - 0.05) / 0.15, coefficients), rel=1e-6)


def test_every_pair_in_motion_has_a_signal_and_a_unit():
    pairs = [(p, v) for p in PLACES.values() for v in VARIABLES.values() if asked_with(p, v, moving=True)]
    assert len(pairs) > 40
    for place, variable in pairs:
        assert set(place.moving) <= {*MOVED, "command"}
        unit_of(place.name, variable.name, "proportional")
        for moved in place.moving:
            assert (
                variable.name in ("pressure_rate", "command_rate") or signal_of(place, moved, variable.name) in SIGNALS
            )
