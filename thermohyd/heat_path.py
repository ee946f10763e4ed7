"""Where the throttling heat may go: from the oil to the valve's body, and from there to the ambience."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


# Conductance that the wall always has to the oil, so that a wall without any has a temperature (that of the oil) [W/K].
LEAST = 1e-12


def _as_array(value: float | Array) -> Array:
    return jnp.asarray(value, dtype=jnp.result_type(float))


class HeatPath(eqx.Module):
    """The body as one lump of metal. Numbers, or arrays that broadcast against the operating points.

    wall_conductance: h_w A_w [W/K] between oil and body, of the whole valve; each of the four passages behind an edge has a
    quarter. ambient_conductance G_amb [W/K] between body and ambience, 0 for an insulated valve. ambient_temperature [K];
    None: that of the oil supplied. A wall_conductance of 0 is the seed paper's THM; both conductances large and the ambience
    at the oil's temperature, its HM.
    """

    wall_conductance: Float[Array, "..."] = eqx.field(converter=_as_array)
    ambient_conductance: Float[Array, "..."] = eqx.field(converter=_as_array)
    ambient_temperature: Float[Array, "..."] | None = None


class Passed(eqx.Module):
    """Oil that has passed along the wall: temperature on leaving [K], heat flow to the wall per kelvin [W/K]."""

    temperature: Float[Array, "..."]
    conductance: Float[Array, "..."]


def pass_wall(
    capacity: Float[Array, "..."],
    conductance: Float[Array, "..."],
    arriving: Float[Array, "..."],
    wall: Float[Array, "..."],
) -> Passed:
    """Oil of heat capacity flow m c_p [W/K] along a wall of one temperature: what it keeps of its excess is exp(-NTU).

    NTU = h_w A_w/(m c_p) (Incropera and DeWitt, internal flow along a wall of constant temperature).
    """
    lost = -jnp.expm1(-conductance / capacity)
    felt = -jnp.expm1(-(conductance + LEAST) / capacity)
    return Passed(temperature=arriving - lost * (arriving - wall), conductance=felt * capacity)
