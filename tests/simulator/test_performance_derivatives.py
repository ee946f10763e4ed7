"""Derivatives of the performance figures against finite differences and reverse mode; one call with everything."""

import doctest
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.valves import seed_valve

from thermohyd import actuator_performance, performance_derivatives
from thermohyd.actuator import Actuator, seed_actuator
from thermohyd.actuator_performance import performance
from thermohyd.effects.library import with_effects
from thermohyd.performance_derivatives import performance_with_derivatives


TEMPERATURE = jnp.array([253.15, 313.15, 353.15])
AT: dict[str, Any] = {"temperature": TEMPERATURE, "supply_pressure": 70e5, "return_pressure": 3e5}
JACK = replace(seed_actuator(), jack_leakage=jnp.asarray(2e-13))


@pytest.fixture(autouse=True, scope="module")
def quickly():
    with quick_compile():
        yield


def moved(valve, actuator, conditions, name, value):
    """Valve, actuator and conditions with one named parameter at another value."""
    owner, _, field = name.rpartition(".")
    if not owner:
        return valve, actuator, conditions | {name: value}
    if owner == "actuator":
        return valve, replace(actuator, **{field: value}), conditions
    if owner == "oil":
        return replace(valve, oil=replace(valve.oil, **{field: value})), actuator, conditions
    if owner == "valve.effects":
        return with_effects(replace(valve, effects=()), {field: value}), actuator, conditions
    return replace(valve, **{field: value}), actuator, conditions


@pytest.mark.parametrize("heat", [None, 0.4])
def test_every_derivative_is_that_of_finite_differences(heat):
    valve = with_effects(seed_valve(), {"eccentricity": 0.5})
    found = performance_with_derivatives(valve, JACK, heat=heat, **AT)
    assert ("valve.heat_retention" in found.names) == (heat is not None)
    for name in found.names:
        base = np.asarray(found.parameter[name])
        step = 1e-4 * (np.abs(base) if np.all(base) else 1.0)
        # The fields' own names and heat share one compiled program with the first call of `performance`.
        sides = []
        for by in (step, -step, 2 * step, -2 * step):
            v, a, at = moved(valve, JACK, AT, name, jnp.asarray(base + by))
            eta = (v.heat_retention if name == "valve.heat_retention" else heat) if heat is not None else None
            arguments: dict[str, Any] = {**at, "heat": eta}
            sides.append(performance(v, a, **arguments))
        numeric = jax.tree.map(lambda p, m, pp, mm, step=step: (8 * (p - m) - (pp - mm)) / (12 * step), *sides)
        for figure in type(found.value).__dataclass_fields__:
            value = np.asarray(getattr(found.value, figure))
            exact, differences = (np.asarray(getattr(p, figure)) for p in (found.derivative(name), numeric))
            # Relative to a change of the figure by itself; differences carry rounding of 1e-15/1e-4 of it.
            scale = np.maximum(np.abs(differences) * step / 1e-4, np.abs(value))
            np.testing.assert_allclose(exact * step / 1e-4 / scale, differences * step / 1e-4 / scale, atol=2e-8)


def test_reverse_mode_agrees_with_forward():
    def errors(valve, actuator):
        return jnp.sum(performance(valve, actuator, **AT).load_error * jnp.array([1.0, 2.0, 3.0]))

    of_valve, of_actuator = eqx.filter_grad(lambda both: errors(*both))((seed_valve(), JACK))
    found = performance_with_derivatives(seed_valve(), JACK, **AT)
    for name, reverse in (
        ("valve.edge_radius", of_valve.edge_radius),
        ("oil.viscosity_b", of_valve.oil.viscosity_b),
        ("actuator.piston_area", of_actuator.piston_area),
    ):
        forward = np.sum(np.asarray(found.derivative(name).load_error) * [1.0, 2.0, 3.0])
        assert float(reverse) == pytest.approx(forward, rel=1e-9)


def test_vmapped_over_temperature_is_the_batch():
    one = lambda t: performance_with_derivatives(
        seed_valve(), JACK, temperature=t, supply_pressure=70e5, return_pressure=3e5
    )
    batch = performance_with_derivatives(seed_valve(), JACK, **AT)
    mapped = jax.vmap(one)(TEMPERATURE)
    assert mapped.names == batch.names
    for name in ("temperature", "actuator.moving_mass"):
        forward, spread = (
            batch.derivative(name),
            jax.tree.map(lambda s, n=name: s[:, mapped.names.index(n)], mapped.slopes),
        )
        for a, b in zip(jax.tree.leaves(forward), jax.tree.leaves(spread), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9)


def test_elasticities_of_the_formulas():
    # omega_h^2 goes as 1/m where friction and leakage do not stiffen the jack; a voltage error goes as 1/K_A.
    found = performance_with_derivatives(seed_valve(), Actuator(coulomb_friction=50.0), **AT)
    np.testing.assert_allclose(found.elasticity("actuator.moving_mass").natural_frequency, -0.5, rtol=1e-12)
    np.testing.assert_allclose(found.elasticity("actuator.amplifier_gain").static_error, -1.0, rtol=1e-12)
    assert np.all(found.elasticity("temperature").null_consumption > 0.0)


@pytest.mark.parametrize("module", [actuator_performance, performance_derivatives])
def test_examples(module):
    result = doctest.testmod(module)
    assert result.attempted
    assert not result.failed
