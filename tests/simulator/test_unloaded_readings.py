"""Closed and connected use ports in one balance, row by row: what each test gives by itself, with its derivatives."""

from dataclasses import replace
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.shifted_valve import X, shifted_valve
from jaxtyping import Array, Float

from thermohyd.effects.effect import AbstractReadingEffect, as_amount
from thermohyd.effects.library import with_effects
from thermohyd.static_tests import blocked_port_readings, control_flow, unloaded_readings


JOINED = np.arange(len(X)) % 2 == 0
COUPLED = {"supply_droop": 8e9, "return_back_pressure": 1e13, "cross_port_leakage": 3e-13}
VALVES = {
    "plain": ({}, None, "orifice"),
    "lubrication": ({}, None, "lubrication"),
    "lines, a path and heat": (COUPLED, 0.7, "orifice"),
}


def valve_of(name):
    amounts, heat, law = VALVES[name]
    valve, at = shifted_valve(law)
    valve = replace(valve, effects=(), heat_retention=None if heat is None else jnp.asarray(heat))
    return with_effects(valve, amounts), at


def apart(valve, at):
    """Every row of the test that it is of: leakage_flow where the ports are closed, the flow between them where not."""
    return jnp.where(JOINED, control_flow(valve, at), blocked_port_readings(valve, at)["leakage_flow"])


def together(valve, at):
    found = unloaded_readings(valve, at, jnp.asarray(JOINED))
    return jnp.where(JOINED, found["flow"], found["leakage_flow"])


def as_matrix(of_fields):
    return np.stack([np.asarray(leaf) for leaf in jax.tree.leaves(eqx.filter(of_fields, eqx.is_array))])


BY_DAY = ("plain", "lines, a path and heat")  # the others compile for a minute


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in BY_DAY else pytest.mark.nightly) for name in VALVES]
)
def test_rows_of_both_kinds_are_those_of_each_test(name):
    valve, at = valve_of(name)
    numbers = range(len(valve.effects))
    fields = lambda v: [v.edge_radius, v.clearance, v.underlap, v.null_bias, *(v.effects[i].amount for i in numbers)]
    begin = fields(valve)

    def of(test):
        moved = lambda values: test(eqx.tree_at(fields, valve, values), at)
        return moved(begin), jax.jacfwd(moved)(begin), jax.vjp(moved, begin)[1](jnp.ones(len(X)))[0]

    with quick_compile():
        one, both = (jax.jit(lambda test=test: of(test))() for test in (apart, together))
        pressures = [np.asarray(found["load_pressure"]) for found in (
            blocked_port_readings(valve, at), unloaded_readings(valve, at, jnp.asarray(JOINED))
        )]  # fmt: skip
    np.testing.assert_allclose(both[0], one[0], rtol=1e-11)
    np.testing.assert_allclose(pressures[1][~JOINED], pressures[0][~JOINED], rtol=1e-10, atol=1e-3)
    for mine, other in zip(both[1:], one[1:], strict=True):
        mine, other = as_matrix(mine), as_matrix(other)
        size = np.abs(other).max(axis=-1, keepdims=True) if other.ndim > 1 else np.abs(other)
        np.testing.assert_allclose(mine / size, other / size, atol=1e-8)


@final
class RootOfWhatIsRead(AbstractReadingEffect):
    """An instrument without a derivative where it reads nothing."""

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def reading(self, channel, value, read, true, oil):
        return value + self.amount * jnp.sqrt(jnp.abs(value))


def test_what_cannot_be_differentiated_where_nothing_is_read_spoils_no_other_reading():
    valve, at = valve_of("plain")
    valve = replace(valve, effects=(RootOfWhatIsRead(1e-6),))

    def all_read(radius):
        found = unloaded_readings(replace(valve, edge_radius=radius), at, jnp.asarray(JOINED))
        return found["flow"][JOINED] + 0.0 * sum(jnp.sum(reading) for reading in found.values())

    # Row by row: their sum cancels to a ten-thousandth of them.
    expected = jax.jacrev(lambda r: control_flow(replace(valve, edge_radius=r), at)[JOINED])(valve.edge_radius)
    np.testing.assert_allclose(
        jax.jacrev(all_read)(valve.edge_radius), expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max()
    )


def test_stored_oil_is_refused():
    valve, at = valve_of("plain")
    with pytest.raises(ValueError, match="store oil"):
        unloaded_readings(with_effects(valve, {"port_compliance_a": 1e-12}), at, jnp.asarray(JOINED))
