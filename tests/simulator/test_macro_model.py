"""Eq. 6 and its inverse: round trip, derivatives, and the law by which its parameters follow the supply pressure."""

import doctest

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd import flow_curve as macro_model
from thermohyd.flow_curve import MacroModel, eq6_flow, eq6_position


def draws(count: int = 20_000):
    """(flow, x0, q0, k) over four decades of each and X0/(k Q0) from -0.95 to 1000; half of the flows negative."""
    rng = np.random.default_rng(4)
    k, q0 = 10 ** rng.uniform(-1, 1, count), 10 ** rng.uniform(-7, -4, count)
    bend = np.where(rng.random(count) < 0.5, rng.uniform(-0.95, 1.0, count), 10 ** rng.uniform(0, 3, count))
    flow = rng.choice([-1.0, 1.0], count) * q0 * 10 ** rng.uniform(-6, 3, count)
    return flow, bend * k * q0, q0, k


def test_inverse_gives_the_flow_back():
    flow, x0, q0, k = draws()
    back = np.asarray(eq6_flow(eq6_position(flow, x0, q0, k), x0, q0, k))
    error = float(np.abs(back / flow - 1.0).max())
    print(f"Q(X(Q)) over {len(flow):,} draws, largest relative error {error:.1e}")
    assert error < 1e-12


def test_inverse_at_null_is_null():
    assert float(eq6_flow(0.0, 2e-5, 4e-6, 1.3)) == 0.0
    assert float(eq6_flow(0.0, -4e-6, 4e-6, 1.3)) == 0.0


def test_no_inverse_where_eq6_is_not_monotone():
    assert np.isnan(float(eq6_flow(1e-6, -6e-6, 4e-6, 1.3)))  # X0/Q0 + k < 0
    assert np.isnan(float(eq6_flow(1e-6, 1e-6, 4e-6, -1.0)))


@pytest.mark.parametrize("x0", [2e-5, -4e-6])
@pytest.mark.parametrize("position", [0.0, 3e-6, -1e-4])
def test_gradient_through_the_inverse(position, x0):
    at = (position, x0, 4e-6, 1.3)
    reverse = jax.grad(eq6_flow, argnums=(0, 1, 2, 3))(*at)
    forward = jax.jacfwd(eq6_flow, argnums=(0, 1, 2, 3))(*at)
    steps = (1e-9, 1e-9, 1e-10, 1e-5)
    for i, step in enumerate(steps):
        up, down = ([value + sign * step * (j == i) for j, value in enumerate(at)] for sign in (1.0, -1.0))
        differences = (float(eq6_flow(*up)) - float(eq6_flow(*down))) / (2.0 * step)
        assert float(reverse[i]) == pytest.approx(differences, rel=2e-5, abs=1e-10 if i < 3 else 1e-13)
        assert float(forward[i]) == pytest.approx(float(reverse[i]), rel=1e-9, abs=1e-12 if i < 3 else 1e-18)


def test_second_derivative_of_the_inverse_is_minus_that_of_the_curve():
    # Q'' = -X''/X'^3
    at = (2e-5, 4e-6, 1.3)
    flow = eq6_flow(1e-5, *at)
    slope = jax.grad(eq6_position)(flow, *at)
    bend = jax.grad(jax.grad(eq6_position))(flow, *at)
    assert float(jax.grad(jax.grad(eq6_flow))(1e-5, *at)) == pytest.approx(float(-bend / slope**3), rel=1e-10)


def some_model() -> MacroModel:
    return MacroModel(
        x0=jnp.array([3e-5, 2e-5]),
        log_q0=jnp.array([-12.0, -0.5]),
        log_k=jnp.array([0.2, 0.5]),
        viscosity_low=jnp.asarray(30e-6),
        viscosity_high=jnp.asarray(4000e-6),
        reference_drop=jnp.asarray(70e5),
    )


def test_parameters_at_the_ends_of_the_range():
    x0, q0, k = some_model().parameters(jnp.array([30e-6, 4000e-6]))
    assert np.allclose(x0, [1e-5, 5e-5])
    assert np.allclose(np.log(q0), [-11.5, -12.5])
    assert np.allclose(np.log(k), [-0.3, 0.7])


def test_three_times_the_pressure_is_the_flow_of_thinner_oil():
    model, x = some_model(), jnp.linspace(-2e-4, 2e-4, 9)
    high = model.flow(x, 300e-6, 210e5)
    assert np.allclose(high, np.sqrt(3.0) * model.flow(x, 300e-6 / np.sqrt(3.0)))
    assert np.allclose(model.position(high, 300e-6, 210e5), x)


def test_jit_vmap_and_gradient_of_the_model():
    model = some_model()
    slope = jax.jit(jax.vmap(jax.grad(lambda x, nu: model.flow(x, nu)), in_axes=(0, None)))(
        jnp.array([0.0, 1e-5]), 1e-4
    )
    assert np.all(np.isfinite(slope))
    by_coefficient = jax.grad(lambda m: m.flow(1e-5, 1e-4))(model)
    assert np.all(np.isfinite(by_coefficient.x0))
    assert np.all(np.asarray(by_coefficient.log_k) != 0.0)


def test_examples():
    assert doctest.testmod(macro_model).failed == 0
