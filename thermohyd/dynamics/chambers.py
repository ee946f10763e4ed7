"""Mass and energy of the two chambers: how fast their pressures and temperatures change (MODEL section 7)."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..oil import bulk_modulus, density, expansion, specific_heat
from .flows import Flows
from .plant import Plant, Surroundings
from .state import State


ATMOSPHERE = 1.013e5  # Pa absolute, at gauge zero
POLYTROPIC = 1.4
# Air is an ideal gas and has no pressure below zero; no state that the model is for comes near [Pa, absolute].
THINNEST_AIR = 1e3
SIDES = np.array([1.0, -1.0])  # a piston moving with +z makes room in A


def mixture_modulus(
    beta: Float[Array, "..."], share: Float[Array, "..."], pressure: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Bulk modulus [Pa] of oil with a share phi of its volume, at atmospheric pressure, as air bubbles; pressure gauge.

    1/beta_eff = [(1 - phi)/beta + g/(n P)]/(1 - phi + g), g = phi (p_a/P)^(1/n), polytropic, n = 1.4 (MODEL section 7;
    the mixture model of Merritt, section 2-4, with the air's compression followed).
    """
    absolute = jnp.maximum(pressure + ATMOSPHERE, THINNEST_AIR)
    air = share * jnp.power(ATMOSPHERE / absolute, 1.0 / POLYTROPIC)
    return (1.0 - share + air) / ((1.0 - share) / beta + air / (POLYTROPIC * absolute))


def chamber_volumes(plant: Plant, position: Float[Array, "..."]) -> Float[Array, "... 2"]:
    """V_t + S z and V_t - S z [m3]."""
    j = plant.actuator
    return j.chamber_volume + j.piston_area * SIDES * position[..., None]


class Sources(eqx.Module):
    """What changes the chambers' state; all of it is zero in a steady state, where the pressures and temperatures rest.

    squeeze: relative surplus of oil over room [1/s]; heating: of the oil at constant pressure [K/s], renewal: how fast inflow
    and walls bring that about [1/s], both None where the oil stays at T_s. density [kg/m3], temperature [K].
    """

    squeeze: Float[Array, "2"]
    heating: Float[Array, "2"] | None
    renewal: Float[Array, "2"] | None
    density: Float[Array, "2"]
    temperature: Float[Array, "2"]


def chamber_sources(plant: Plant, around: Surroundings, state: State, flows: Flows) -> Sources:
    """Oil and heat that flows, walls and the piston's motion bring."""
    oil, p = plant.oil, state.pressure
    t = jnp.broadcast_to(around.temperature, (2,)) if state.temperature is None else state.temperature
    volume = chamber_volumes(plant, state.position)
    rho = density(oil, p, t)
    growth = plant.actuator.piston_area * SIDES * state.velocity
    squeeze = (flows.net / rho - growth) / volume
    if state.temperature is None:
        return Sources(squeeze, None, None, rho, t)
    assert flows.warming is not None
    mass = rho * volume
    heating, renewal = flows.warming / mass, flows.inflow / mass
    passed = plant.walls.into_oil(t, state.wall, around.temperature)
    if passed is not None:
        assert plant.walls.conductance is not None
        capacity = mass * specific_heat(oil, t)
        heating, renewal = heating + passed / capacity, renewal + plant.walls.conductance / capacity
    return Sources(squeeze, heating, renewal, rho, t)


def chamber_rates(plant: Plant, state: State, sources: Sources) -> tuple[Float[Array, "2"], Float[Array, "2"] | None]:
    """(dp/dt [Pa/s], dT/dt [K/s] or None where the oil stays at T_s)."""
    oil, p, t = plant.oil, state.pressure, sources.temperature
    beta = bulk_modulus(oil, p, t) * plant.actuator.bulk_modulus_factor
    if plant.motion.entrained_air is not None:
        beta = mixture_modulus(beta, plant.motion.entrained_air, p)
    if sources.heating is None:
        return beta * sources.squeeze, None
    # dp = beta (squeeze + alpha dT) and dT = heating + k dp are two linear equations.
    alpha = expansion(oil, p, t)
    k = alpha * t / (sources.density * specific_heat(oil, t))
    dp = beta * (sources.squeeze + alpha * sources.heating) / (1.0 - beta * alpha * k)
    return dp, sources.heating + k * dp
