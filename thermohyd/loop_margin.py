"""The loop gain at which a position loop starts to oscillate, spool dynamics included, in closed form."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def phase_crossover(
    omega_h: Float[Array, "..."], xi_h: Float[Array, "..."], omega_sv: Float[Array, "..."], xi_sv: Float[Array, "..."]
) -> Float[Array, "..."]:
    """The pulsation [rad/s] at which the open loop lags by 180 degrees.

    L(s) = K_l/(s D(s)), D = (1 + 2 xi_h s/omega_h + s^2/omega_h^2)(1 + 2 xi_sv s/omega_sv + s^2/omega_sv^2): the lower
    root W = omega^2 of Re D = W^2/(omega_h omega_sv)^2 - b W + 1 = 0.
    """
    b = 1.0 / jnp.square(omega_h) + 1.0 / jnp.square(omega_sv) + 4.0 * xi_h * xi_sv / (omega_h * omega_sv)
    a = 1.0 / jnp.square(omega_h * omega_sv)
    # Written without the difference of two close numbers; b^2 >= 4 a as (1/omega_h^2 - 1/omega_sv^2)^2 >= 0.
    return jnp.sqrt(2.0 / (b + jnp.sqrt(jnp.square(b) - 4.0 * a)))


def critical_loop_gain(
    omega_h: Float[Array, "..."], xi_h: Float[Array, "..."], omega_sv: Float[Array, "..."], xi_sv: Float[Array, "..."]
) -> Float[Array, "..."]:
    """K_l [1/s] at the limit of stability: omega Im D at the phase crossover; 2 xi_h omega_h where the spool is fast."""
    w = phase_crossover(omega_h, xi_h, omega_sv, xi_sv)
    hydraulic, spool = w / omega_h, w / omega_sv
    return w * (
        2.0 * xi_h * hydraulic * (1.0 - jnp.square(spool)) + 2.0 * xi_sv * spool * (1.0 - jnp.square(hydraulic))
    )
