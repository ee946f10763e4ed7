"""Frequency tests with derivatives: the small-signal response at each operating point, by forward mode."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from thermohyd.compiling import quickly
from thermohyd.dynamics.inputs import StepInputs
from thermohyd.dynamics.small_signal import Output, frequency_response

from .machine import machine
from .trajectories import Given, Plan


READINGS = ("amplitude_ratio", "phase")
NO_RESPONSE = ("backlash",)  # effects without a small-signal response


@quickly
def responses_all(
    plan: Plan,
    p: Float[Array, " all"],
    given: Given,
    inputs: StepInputs,
    frequency: Float[Array, "runs frequencies"],
    output: Output,
    absolute: bool,
    polarity: int,
) -> tuple[Float[Array, "runs frequencies 2"], Float[Array, "runs frequencies 2 all"], Bool[Array, " runs"]]:
    """(amplitude ratio and phase [rad], their derivatives to the vector, whether there is an equilibrium)."""
    seen = tuple(name for name in plan.effects if name not in NO_RESPONSE)
    entries = [i for i, name in enumerate((*plan.names, *plan.effects)) if name not in NO_RESPONSE]

    def all_of(p: Array) -> tuple[Array, Array]:
        valve, actuator = machine(given.valve, given.actuator, plan.names, seen, jnp.stack([p[i] for i in entries]))

        def one(inputs: StepInputs, frequency: Array) -> tuple[Array, Array]:
            found = frequency_response(
                valve, actuator, inputs, frequency, output=output, absolute=absolute, heat=plan.heat, polarity=polarity,
                throw=False,
            )  # fmt: skip
            return jnp.stack([found.amplitude_ratio, jnp.deg2rad(found.phase)], axis=-1), found.found

        return jax.vmap(one)(inputs, frequency)

    values, found = all_of(p)
    slopes = jax.jacfwd(lambda q: all_of(q)[0])(p)
    return values, slopes, found
