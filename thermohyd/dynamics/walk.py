"""A run step by step, in blocks: the same steps that `diffrax.diffeqsolve` takes, kept with their dense output."""

from typing import Any

import diffrax
import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .plant import Plant
from .rosenbrock import DenseOutput, Rodas5P
from .state import Scaling
from .vector_field import vector_field


# Steps that are tried at once: enough to fill vectors with what is asked of them, and few enough for a cache.
BLOCK = 64


def field(time: Float[Array, ""], vector: Float[Array, " states"], args: tuple[Plant, Scaling]) -> Array:
    """The vector field of the scaled state, per second."""
    plant, scaling = args
    return scaling.pack_rates(vector_field(plant, time, scaling.unpack(vector)))


TERM = diffrax.ODETerm(field)  # pyright: ignore[reportArgumentType]


class Steps(eqx.Module):
    """A step, or those of a block, leading axis (BLOCK,): from `begin` to `end` [s], of no length where it was not taken."""

    begin: Float[Array, "*steps"]
    end: Float[Array, "*steps"]
    path: DenseOutput


class Walk(eqx.Module):
    """Where the solver stands: at `state` and `time`, about to try a step to `aim` [s]; how many it tried."""

    time: Float[Array, ""]
    aim: Float[Array, ""]
    state: Float[Array, " states"]
    control: Any
    jumped: Bool[Array, ""]
    tried: Int[Array, ""]


class Way(eqx.Module):
    """What does not change on the way: step-size controller (of diffrax), end of the run [s], steps tried at most."""

    controller: Any
    last: Float[Array, ""]
    most: int = eqx.field(static=True)

    def going(self, walk: Walk) -> Bool[Array, ""]:
        return (walk.time < self.last) & (walk.tried < self.most)

    def start(
        self, time: Float[Array, ""], first_step: Float[Array, ""], state: Float[Array, " states"], args: Any
    ) -> Walk:
        solver = Rodas5P()
        aim, control = self.controller.init(
            TERM, time, self.last, state, first_step, args, solver.func, solver.error_order(TERM)
        )
        control = jax.tree.map(jnp.asarray, control)
        aim = jnp.minimum(aim, self.last)
        return Walk(time, aim, state, control, jnp.asarray(False), jnp.asarray(0))

    def block(self, walk: Walk, args: tuple[Plant, Scaling]) -> tuple[Walk, Steps]:
        """The next BLOCK steps that are tried."""
        solver = Rodas5P()
        nearly = self.last
        for _ in range(100):  # a step that would leave this little goes to the end
            nearly = eqxi.prevbefore(nearly)

        def attempt(walk: Walk, _: None) -> tuple[Walk, Steps]:
            going = self.going(walk)
            # Behind the end steps are tried and not taken: of a length that does no harm.
            aim = jnp.where(going, walk.aim, walk.time + 1e-6)
            new, error, path, _, _ = solver.step(TERM, walk.time, aim, walk.state, args, None, walk.jumped)
            error = jnp.where(jnp.isnan(error), jnp.inf, error)
            good, time, further, jumped, control, _ = self.controller.adapt_step_size(
                walk.time, aim, walk.state, new, args, error, solver.error_order(TERM), walk.control
            )
            taken = going & good
            time = jnp.minimum(time, self.last)
            nearest = jnp.where(good, self.last, time + 0.5 * (self.last - time))
            further = jnp.where(further > nearly, nearest, further)
            state = jnp.where(taken, new, walk.state)
            onward = Walk(time, further, state, control, jnp.where(good, jumped, walk.jumped), walk.tried + 1)
            onward = jax.tree.map(lambda a, b: jnp.where(going, a, b), onward, walk)
            here = walk.state
            still = DenseOutput(t0=walk.time, t1=walk.time, y0=here, y1=here, bends=jnp.zeros((3, *here.shape)))
            kept = DenseOutput(t0=walk.time, t1=aim, **path)
            kept = jax.tree.map(lambda a, b: jnp.where(taken, a, b), kept, still)
            return onward, Steps(walk.time, kept.t1, kept)

        return jax.lax.scan(attempt, walk, None, length=BLOCK)
