"""Where the vector field has kinks, at which its derivatives jump; a run's steps cut there."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .command import asked_position, wanted_position
from .flows import openings
from .plant import Plant
from .rosenbrock import DenseOutput
from .state import Scaling, State
from .walk import BLOCK, Steps


CUTS = 16  # kinks that a block has room for
HALVINGS = 30  # of a step, to find a kink in it


def distances(plant: Plant, time: Float[Array, ""], state: State) -> Float[Array, " kinks"]:
    """Signed distances from the kinks, in metres: of the four edges from closing, of the spool's command from its limits, of the
    play from its ends.

    Left out is what only bends where flow turns round: there the flow is zero, and its derivatives jump by little.
    """
    around = plant.surroundings(time)
    command = plant.command(time)
    wanted = wanted_position(plant, command, state.position)
    limits = plant.valve.stroke * jnp.array([1.0, -1.0])
    found = [jnp.ravel(openings(plant, plant.at(around), state)), wanted - limits]
    if state.play is not None and plant.motion.backlash is not None:
        ahead = asked_position(plant, command, state.position) - state.play
        found.append(ahead - 0.5 * plant.motion.backlash * jnp.array([1.0, -1.0]))
    return jnp.concatenate(found)


def _cuts(steps: Steps, plant: Plant, scaling: Scaling) -> Float[Array, " cuts"]:
    """Times of the block's kinks, ascending, inf where there are fewer."""
    distance = lambda path, time: distances(plant, time, scaling.unpack(path.evaluate(time)))
    at = jax.vmap(distance)
    first, second = at(steps.path, steps.begin), at(steps.path, steps.end)
    crossed = (first > 0.0) != (second > 0.0)
    kinks = np.arange(first.shape[1])
    own = jax.vmap(jax.vmap(lambda path, time, kink: distance(path, time)[kink], (None, 0, 0)), (0, 0, None))

    def halve(_: Any, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        middle = 0.5 * (low + high)
        before = (own(steps.path, middle, kinks) > 0.0) == (first > 0.0)
        return jnp.where(before, middle, low), jnp.where(before, high, middle)

    bracket = tuple(jnp.broadcast_to(end[:, None], first.shape) for end in (steps.begin, steps.end))
    found = jax.lax.fori_loop(0, HALVINGS, halve, bracket)[1]
    return jnp.sort(jnp.ravel(jnp.where(crossed, found, jnp.inf)))[:CUTS]


class Pieces(eqx.Module):
    """Parts of a block's steps between kinks, in turn, leading axis (pieces,); `path` of the step that each lies in."""

    begin: Float[Array, " pieces"]
    length: Float[Array, " pieces"]
    path: DenseOutput


def pieces_of(steps: Steps, plant: Plant, scaling: Scaling) -> Pieces:
    """The block's steps cut at their kinks; spare pieces have no length."""
    ends = jnp.sort(jnp.concatenate([steps.end, _cuts(steps, plant, scaling)]))
    ends = jnp.minimum(ends, steps.end[-1])
    begins = jnp.concatenate([steps.begin[:1], ends[:-1]])
    # The first step that ends behind the piece's middle.
    owner = jnp.minimum(jnp.searchsorted(steps.end, 0.5 * (begins + ends)), BLOCK - 1)
    return Pieces(begins, ends - begins, jax.tree.map(lambda part: part[owner], steps.path))
