"""The one place that integrates: diffrax on the scaled state, states at given times, failures as codes."""

from typing import Any, Literal

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .plant import Plant
from .rosenbrock import Rodas5P
from .state import Scaling, State
from .vector_field import vector_field


# forward: tangents are carried along, for few parameters; reverse: the run is stored at checkpoints, for many.
Gradient = Literal["forward", "reverse"]
FAILURES = (
    "",
    "no equilibrium under the first row: the external force exceeds what the supply pressure can hold, or the spool that it"
    " needs lies beyond the stroke",
    "the integration took more than max_steps steps: the motion is faster than any actuator's, or a column jumps",
    "the integration failed: the states are no longer finite",
)
NO_EQUILIBRIUM, TOO_MANY_STEPS, NOT_FINITE = 1, 2, 3


class Trajectory(eqx.Module):
    """States at the wanted times, leading axis (rows,); steps taken; failure: an index into `FAILURES`, 0 for none."""

    states: State
    steps: Int[Array, ""]
    failure: Int[Array, ""]


def _field(time: Float[Array, ""], vector: Float[Array, " states"], args: tuple[Plant, Scaling]) -> Array:
    plant, scaling = args
    return scaling.pack_rates(vector_field(plant, time, scaling.unpack(vector)))


def integrate(
    plant: Plant,
    scaling: Scaling,
    start: State,
    *,
    gradient: Gradient,
    rtol: float | Array,
    atol: float | Array,
    max_steps: int,
    solver: Any = None,
) -> Trajectory:
    """The run from `start` at the first time to the last; states at all times. Tolerances are of the scaled state."""
    times = plant.inputs.time
    breaks = jnp.concatenate([plant.inputs.command.knots, plant.inputs.surroundings.knots])
    controller = diffrax.PIDController(rtol=rtol, atol=atol, pcoeff=0.2, icoeff=0.6)
    if breaks.shape[0]:
        controller = diffrax.ClipStepSizeController(controller, jump_ts=breaks)
    # A tenth of the spool's own time; the controller finds its pace from there without evaluating the field beforehand.
    first_step = jax.lax.stop_gradient(0.1 / (2.0 * jnp.pi * plant.actuator.spool_frequency))
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(_field),  # pyright: ignore[reportArgumentType]
        Rodas5P() if solver is None else solver,
        t0=times[0],
        t1=times[-1],
        dt0=first_step,
        y0=scaling.pack(start),
        args=(plant, scaling),
        saveat=diffrax.SaveAt(ts=times),
        stepsize_controller=controller,
        adjoint=diffrax.ForwardMode() if gradient == "forward" else diffrax.RecursiveCheckpointAdjoint(),
        max_steps=max_steps,
        throw=False,
    )
    vectors = solution.ys
    assert vectors is not None
    okay = diffrax.is_successful(solution.result)
    late = solution.result == diffrax.RESULTS.max_steps_reached
    failure = jnp.where(okay, jnp.where(jnp.all(jnp.isfinite(vectors)), 0, NOT_FINITE), NOT_FINITE)
    failure = jnp.where(late, TOO_MANY_STEPS, failure)
    return Trajectory(scaling.unpack(vectors), solution.stats["num_steps"], failure)
