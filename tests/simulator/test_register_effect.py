"""Effects registered and taken out again: what is refused, in which words, and that nothing stale is left behind."""

from dataclasses import replace
from typing import final

import equinox as eqx
import jax.numpy as jnp
import pytest
from helpers.machines import plant
from helpers.users_effects import LOAD_DRAG, METER_TARE, LoadDrag, registered
from helpers.valves import seed_valve
from jaxtyping import Array, Float
from reference.conformance_dynamic import machine_of

import thermohyd
from thermohyd.dynamics.machine import State
from thermohyd.dynamics.vector_field import thrust
from thermohyd.effects.effect import AbstractEdgeEffect, AbstractReadingEffect, as_amount
from thermohyd.effects.effect_info import EffectInfo
from thermohyd.effects.library import (
    DYNAMIC_EFFECTS,
    EFFECTS,
    effect_info,
    register_effect,
    unregister_effect,
    whole_library,
    with_effects,
)
from thermohyd.identify.fitting.motion_readings import Plan
from thermohyd.identify.fitting.stored_programs import stored_program


@final
class OtherTare(AbstractReadingEffect):
    """Another effect for a name that was used before."""

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def reading(self, channel, value, read, true, oil):
        return value + self.amount


class HalfAnEffect(AbstractEdgeEffect):
    """What its stage asks for is not there."""

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)


class NoEffect:
    pass


def test_in_by_its_class_and_out_again():
    before = whole_library()
    with registered(METER_TARE, LOAD_DRAG):
        assert list(EFFECTS)[-1] == "meter_tare"
        assert list(DYNAMIC_EFFECTS)[-1] == "load_drag"
        assert effect_info("meter_tare") is METER_TARE
        assert LOAD_DRAG.stages == ("force",)
        assert float(with_effects(seed_valve(), {"meter_tare": 2.0}).effects[0].amount) == 2.0
    assert whole_library() == before


def test_public_names():
    assert thermohyd.register_effect is register_effect
    assert thermohyd.unregister_effect is unregister_effect
    assert thermohyd.EffectInfo is EffectInfo


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"name": "hysteresis"}, ValueError, "there is an effect hysteresis already; take another name"),
        ({"name": "null_bias"}, ValueError, "null_bias is a quantity of the valve or of the actuator"),
        (
            {"effect": "thermohyd.effects.edges:LandLeakage"},
            ValueError,
            "LandLeakage is the class of land_leakage already",
        ),
        ({"effect": NoEffect}, TypeError, "NoEffect must inherit from the abstract class of a stage"),
        ({"effect": HalfAnEffect}, TypeError, "HalfAnEffect lacks edges, which its stage asks for"),
        ({"effect": LoadDrag}, ValueError, "shows has 'leakage', but LoadDrag is an effect of dynamic tests"),
        ({"shows": ("leakage", "step")}, ValueError, "shows has 'step', but MeterTare is an effect of static tests"),
        ({"factor_on": "viscosity"}, ValueError, "viscosity_shift is the factor on the viscosity already"),
    ],
)
def test_what_cannot_be_registered(change, error, message):
    before = whole_library()
    with pytest.raises(error, match=message):
        register_effect(replace(METER_TARE, **change))
    assert whole_library() == before


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"name": "meter tare"}, ValueError, "must be a Python identifier, such as slot_wear, not 'meter tare'"),
        ({"name": "lambda"}, ValueError, "must be a Python identifier"),
        ({"effect": "MeterTare"}, TypeError, "effect must be a class or \"module:Class\", not 'MeterTare'"),
        ({"upper": float("inf")}, ValueError, "lower, upper, typical and scale must be finite numbers"),
        ({"lower": 1e-14}, ValueError, "must have the neutral amount, 0, between them"),
        ({"scale": 1e-11}, ValueError, r"must have 0 < typical\[0\] <= scale <= typical\[1\] <= upper"),
        ({"shows": ("leak",)}, ValueError, "shows has the unknown 'leak'; known: leakage, pressure_gain"),
        ({"shows": ()}, ValueError, "shows, unit and sentence must not be empty"),
        ({"needs": ("patience",)}, ValueError, "needs has the unknown 'patience'; known: time, rate, several_rates"),
        ({"adds_to": "clearance"}, ValueError, "adds_to has the unknown 'clearance'; known: heat_retention"),
    ],
)
def test_what_is_no_entry(change, error, message):
    with pytest.raises(error, match=message):
        replace(METER_TARE, **change)


def test_a_field_that_is_missing_is_named():
    with pytest.raises(TypeError, match="unit"):
        EffectInfo(name="bare", effect=OtherTare, lower=0.0, upper=1.0)  # pyright: ignore[reportCallIssue]
    with pytest.raises(TypeError, match="EffectInfo"):
        register_effect(OtherTare)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("name", ["hysteresis", "meter_tare"])
def test_only_what_was_registered_can_be_taken_out(name):
    with pytest.raises(ValueError, match=f"'{name}' is no effect that register_effect added"):
        unregister_effect(name)


def test_programs_are_kept_by_the_class_behind_a_name():
    names, reads = ("viscosity_shift", "meter_tare"), ("leakage_flow",)
    with registered(METER_TARE):
        first, plan = stored_program(names, reads), Plan((), names, "adiabatic")
        assert stored_program(names, reads) is first
        assert Plan((), names, "adiabatic") == plan
    with registered(replace(METER_TARE, effect=OtherTare)):
        assert stored_program(names, reads) is not first
        assert Plan((), names, "adiabatic") != plan
    with registered(METER_TARE):
        assert stored_program(names, reads) is first


def test_a_force_acts_on_the_moving_mass_and_its_absence_costs_nothing():
    bare = plant(machine_of("closed_adiabatic"))
    around, zero = bare.surroundings(jnp.zeros(())), jnp.zeros(())
    pressure, temperature = jnp.array([90e5, 70e5]), jnp.array([310.0, 311.0])
    state = State(zero, zero, pressure, temperature, position=jnp.asarray(1e-3), velocity=jnp.asarray(-0.05))
    dragged = lambda amount: replace(bare, valve=replace(bare.valve, effects=(LoadDrag(amount),)))
    free = float(thrust(bare, around, state))
    assert bare.forces == ()
    assert float(thrust(dragged(0.0), around, state)) == free
    assert float(thrust(dragged(3e4), around, state)) == pytest.approx(free + 3e4 * 0.05**2, rel=1e-12)
