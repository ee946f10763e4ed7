"""Heat between the oil of the chambers, the metal around it, and the surroundings (MODEL section 7)."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


def _optional(value: float | Array | None) -> Array | None:
    return None if value is None else jnp.asarray(value, dtype=jnp.result_type(float))


class Walls(eqx.Module):
    """The metal around each of the two chambers; both are alike. Everything None: the oil keeps its heat (THM).

    conductance h_w A_w [W/K] between oil and wall. capacity C_w [J/K] of one wall: None, it is held at the supply's
    temperature T_s. ambient_conductance G_amb [W/K] and ambient_temperature T_amb [K]: what a wall with a capacity loses;
    None: nothing.
    """

    conductance: Float[Array, ""] | None = eqx.field(converter=_optional, default=None)
    capacity: Float[Array, ""] | None = eqx.field(converter=_optional, default=None)
    ambient_conductance: Float[Array, ""] | None = eqx.field(converter=_optional, default=None)
    ambient_temperature: Float[Array, ""] | None = eqx.field(converter=_optional, default=None)

    def plus(self, conductance: Float[Array, "..."]) -> "Walls":
        """With more conductance between oil and wall (the effect `wall_heat`)."""
        own = self.conductance
        total = conductance if own is None else own + conductance
        return Walls(total, self.capacity, self.ambient_conductance, self.ambient_temperature)

    def into_oil(
        self, oil: Float[Array, "2"], wall: Float[Array, "2"] | None, supply: Float[Array, ""]
    ) -> Float[Array, "2"] | None:
        """Heat [W] into each chamber's oil; None where nothing passes."""
        if self.conductance is None:
            return None
        return self.conductance * ((supply if wall is None else wall) - oil)

    def rate(self, oil: Float[Array, "2"], wall: Float[Array, "2"]) -> Float[Array, "2"]:
        """dT_w/dt [K/s]: C_w dT_w/dt = h_w A_w (T - T_w) + G_amb (T_amb - T_w)."""
        assert self.capacity is not None
        heat = jnp.zeros_like(wall) if self.conductance is None else self.conductance * (oil - wall)
        if self.ambient_conductance is not None and self.ambient_temperature is not None:
            heat = heat + self.ambient_conductance * (self.ambient_temperature - wall)
        return heat / self.capacity

    @property
    def settling(self) -> Float[Array, ""]:
        """C_w/(h_w A_w + G_amb) [s]: the wall's own time constant."""
        assert self.capacity is not None
        parts = [g for g in (self.conductance, self.ambient_conductance) if g is not None]
        return self.capacity / sum(parts, start=jnp.zeros(()))
