"""The flow curve of a valve in one line, for system-level models: the seed paper's Eq. 6, X = X0 tanh(Q/Q0) + k Q.

X0, Q0 and k follow temperature through the kinematic viscosity alone: a slot's flow obeys Q/(w nu) = F(h sqrt(dp/rho)/nu)
(docs/physics.md section 13), so the whole curve does, with h a function of x. The same law carries them to another supply pressure:
X0 belongs to nu/sqrt(dp), Q0 and 1/k grow as sqrt(dp). `thermohyd.identify.fit_flow_curve` finds the coefficients.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float


# From the end of the bracket where the curve's bend makes Newton monotone, over 2e5 draws of (X0, Q0, k, X) with
# X0/(k Q0) between -0.95 and 1000: 6 steps leave 2e-2 of the flow, 8 leave 3e-6, 10 only rounding.
NEWTON_STEPS = 12


def eq6_position(flow: ArrayLike, x0: ArrayLike, q0: ArrayLike, k: ArrayLike) -> Array:
    """X = X0 tanh(Q/Q0) + k Q (Eq. 6): spool opening [m] at a flow [m3/s]; arrays broadcast. X0 [m], Q0 [m3/s], k [s/m2]."""
    return jnp.asarray(x0 * jnp.tanh(flow / q0) + k * jnp.asarray(flow))


def eq6_flow(position: ArrayLike, x0: ArrayLike, q0: ArrayLike, k: ArrayLike) -> Array:
    """Q(X), the inverse of `eq6_position` [m3/s]; differentiable, forward and reverse, in all four (implicit function).

    Needs k > 0, Q0 > 0 and X0/Q0 + k > 0, without which Eq. 6 is not monotone and has no inverse: NaN there.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> print(round(float(eq6_flow(eq6_position(1e-5, 2e-5, 4e-6, 1.3), 2e-5, 4e-6, 1.3)) * 1e5, 12))
    1.0
    """
    floats = [jnp.asarray(value, dtype=jnp.result_type(float)) for value in (position, x0, q0, k)]
    position, x0, q0, k = jnp.broadcast_arrays(*floats)

    def surplus(flow: Array) -> Array:
        return eq6_position(flow, x0, q0, k) - position

    def solve(fn, start: Array) -> Array:
        # |Q| k lies between |X| - X0 and |X| (X0 > 0) or |X| and |X| - X0 (X0 < 0), tanh being between 0 and 1.
        sign = jnp.where(position < 0.0, -1.0, 1.0)
        size = jnp.abs(position)
        low = jnp.maximum(jnp.minimum(size, size - x0), 0.0) / k
        high = jnp.maximum(size, size - x0) / k
        start = jnp.where(x0 > 0.0, low, high)

        def step(_: ArrayLike, state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            flow, low, high = state
            value, slope = jax.jvp(lambda q: sign * fn(sign * q), (flow,), (jnp.ones_like(flow),))
            low = jnp.where(value < 0.0, flow, low)
            high = jnp.where(value > 0.0, flow, high)
            trial = flow - value / slope
            inside = (trial >= low) & (trial <= high)
            return jnp.where(inside, trial, 0.5 * (low + high)), low, high

        return sign * jax.lax.fori_loop(0, NEWTON_STEPS, step, (start, low, high))[0]

    def tangent_solve(linear, y: Array) -> Array:
        return y / linear(jnp.ones_like(y))

    root = jax.lax.custom_root(surplus, jnp.zeros_like(position), solve, tangent_solve)
    return jnp.where((k > 0.0) & (q0 > 0.0) & (x0 / q0 + k > 0.0), root, jnp.nan)


class MacroModel(eqx.Module):
    """Eq. 6 with parameters that follow the oil's viscosity and the supply pressure; SI units, every array differentiable.

    With nu' = nu sqrt(reference_drop/drop) and u = (2 ln nu' - ln nu_high - ln nu_low)/(ln nu_high - ln nu_low):
    X0 = sum x0_i u^i [m], ln Q0 = sum log_q0_i u^i [Q0 in m3/s], ln k = sum log_k_i u^i [k in s/m2], Q0 and 1/k times
    sqrt(drop/reference_drop). The polynomials hold between nu_low and nu_high [m2/s] and mean nothing outside.
    """

    x0: Float[Array, " terms"]
    log_q0: Float[Array, " terms"]
    log_k: Float[Array, " terms"]
    viscosity_low: Float[Array, ""]
    viscosity_high: Float[Array, ""]
    reference_drop: Float[Array, ""]  # P_s - P_t of the curves it was fitted to [Pa]

    def parameters(self, viscosity: ArrayLike, drop: ArrayLike | None = None) -> tuple[Array, Array, Array]:
        """(X0 [m], Q0 [m3/s], k [s/m2]) at a kinematic viscosity [m2/s] and a pressure P_s - P_t [Pa]; arrays broadcast."""
        ratio = jnp.sqrt((self.reference_drop if drop is None else jnp.asarray(drop)) / self.reference_drop)
        low, high = jnp.log(self.viscosity_low), jnp.log(self.viscosity_high)
        u = (2.0 * jnp.log(jnp.asarray(viscosity) / ratio) - high - low) / (high - low)
        x0, log_q0, log_k = (jnp.polyval(c[::-1], u) for c in (self.x0, self.log_q0, self.log_k))
        return x0, jnp.exp(log_q0) * ratio, jnp.exp(log_k) / ratio

    def position(self, flow: ArrayLike, viscosity: ArrayLike, drop: ArrayLike | None = None) -> Array:
        """Spool opening X [m], counted from the hydraulic null, that lets a flow [m3/s] through (Eq. 6)."""
        return eq6_position(flow, *self.parameters(viscosity, drop))

    def flow(self, position: ArrayLike, viscosity: ArrayLike, drop: ArrayLike | None = None) -> Array:
        """Flow Q [m3/s] at a spool opening [m] counted from the hydraulic null: the inverse of `position`."""
        return eq6_flow(position, *self.parameters(viscosity, drop))
