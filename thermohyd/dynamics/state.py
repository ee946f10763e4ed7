"""The state of an actuator in SI units, and the same as a vector of numbers of order 1 for the solver."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


POSITION = 3  # of the piston, in the vector


class State(eqx.Module):
    """Spool x [m] and its speed [m/s]; p_A, p_B [Pa, gauge]; T_A, T_B [K]; piston z [m] and v [m/s].

    temperature is None where the oil stays at the supply's (HM); wall [K], the metal around each chamber, where it has a
    capacity of its own; play y [m] where the command has backlash. Rates of change are held in the same Module, per second.
    """

    spool: Float[Array, "..."]
    spool_speed: Float[Array, "..."]
    pressure: Float[Array, "... 2"]
    temperature: Float[Array, "... 2"] | None
    position: Float[Array, "..."]
    velocity: Float[Array, "..."]
    wall: Float[Array, "... 2"] | None = None
    play: Float[Array, "..."] | None = None


class Scaling(eqx.Module):
    """What a state is counted from and in: vector = (state - origin)/size, in the order of `pack`."""

    origin: State
    size: State

    def pack(self, state: State) -> Float[Array, " states"]:
        return (_flat(state) - _flat(self.origin)) / _flat(self.size)

    def pack_rates(self, rates: State) -> Float[Array, " states"]:
        return _flat(rates) / _flat(self.size)

    def unpack(self, vector: Float[Array, "*lead states"]) -> State:
        """The state, or the states of several times."""
        return _unflat(_flat(self.origin) + _flat(self.size) * vector, self.origin)


def _flat(state: State) -> Float[Array, " states"]:
    # Speeds first, pressures last: eliminated in this order, no pivot of a step's matrix is small (see `rosenbrock`).
    parts = [state.spool_speed, state.spool, state.velocity, state.position, state.play, state.wall]
    parts += [state.temperature, state.pressure]
    return jnp.concatenate([jnp.atleast_1d(part) for part in parts if part is not None])


def _unflat(vector: Float[Array, "*lead states"], like: State) -> State:
    at = 4
    play = wall = temperature = None
    if like.play is not None:
        play, at = vector[..., at], at + 1
    if like.wall is not None:
        wall, at = vector[..., at : at + 2], at + 2
    if like.temperature is not None:
        temperature, at = vector[..., at : at + 2], at + 2
    return State(
        spool_speed=vector[..., 0],
        spool=vector[..., 1],
        velocity=vector[..., 2],
        position=vector[..., 3],
        play=play,
        wall=wall,
        temperature=temperature,
        pressure=vector[..., at : at + 2],
    )
