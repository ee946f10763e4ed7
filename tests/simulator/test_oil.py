"""The oil's laws fit together: compressibility and expansion are the derivatives of the density (docs/physics.md section 2)."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.valves import seed_oil
from hypothesis import given, strategies as st

from thermohyd.oil import TemperatureShifts, compressed, density, throttling_rise


SHIFTED = TemperatureShifts(*(jnp.asarray(shift) for shift in (3.0, -7.0, 11.0, 5.0)))


@pytest.mark.parametrize("shifts", [None, SHIFTED])
@given(pressure=st.floats(-0.9e5, 700e5), temperature=st.floats(230.0, 420.0))
def test_modulus_and_expansion_are_the_density_s_derivatives(shifts, pressure, temperature):
    oil = replace(seed_oil(), shifts=shifts)
    p, t = jnp.asarray(pressure), jnp.asarray(temperature)
    rho, (by_pressure, by_temperature) = jax.value_and_grad(lambda p, t: density(oil, p, t), argnums=(0, 1))(p, t)
    found = compressed(oil, p, t)
    np.testing.assert_allclose(found.density, rho, rtol=1e-15)
    np.testing.assert_allclose(found.bulk_modulus, rho / by_pressure, rtol=1e-12)
    np.testing.assert_allclose(found.expansion, -by_temperature / rho, rtol=1e-12)


@given(drop=st.floats(-300e5, 300e5), mean=st.floats(1e5, 300e5), temperature=st.floats(230.0, 420.0))
def test_throttled_oil_keeps_its_enthalpy(drop, mean, temperature):
    """dh = c_p dT + (1 - alpha T)/rho dp, alpha by differences of the density."""
    oil, step = seed_oil(), 1e-2
    p, t = jnp.asarray(mean), jnp.asarray(temperature)
    warmer, colder = density(oil, p, t + step), density(oil, p, t - step)
    alpha = -(warmer - colder) / (2.0 * step) / density(oil, p, t)
    heat = oil.specific_heat_15degC + oil.specific_heat_slope * (t - 288.15)
    rise = throttling_rise(oil, jnp.asarray(drop), p, t)
    np.testing.assert_allclose(heat * rise, (1.0 - alpha * t) / density(oil, p, t) * drop, rtol=1e-6, atol=1e-9)
