"""The one place that integrates: diffrax on the scaled state, readings at given times, failures as codes."""

from typing import Literal

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .plant import Plant
from .rosenbrock import Rodas5P
from .state import Scaling, State
from .vector_field import vector_field


Gradient = Literal["forward", "reverse"]
RTOL, ATOL = 1e-6, 1e-7
MOST_STEPS = 100_000


class Trajectory(eqx.Module):
    """States at the wanted times, leading axis (rows,); steps taken; failure: 0 where all went well (see `FAILURES`)."""

    states: State
    steps: Int[Array, ""]
    failure: Int[Array, ""]


def _field(time: Float[Array, ""], vector: Float[Array, " states"], args: tuple[Plant, Scaling]) -> Array:
    plant, scaling = args
    return scaling.pack_rates(vector_field(plant, time, scaling.unpack(vector)))


def integrate(
    plant: Plant, scaling: Scaling, start: State, *, gradient: Gradient, rtol: float, atol: float, max_steps: int, solver=None
) -> Trajectory:
    times = plant.inputs.time
    breaks = jnp.concatenate([plant.inputs.command.knots, plant.inputs.surroundings.knots])
    controller = diffrax.PIDController(rtol=rtol, atol=atol, pcoeff=0.2, icoeff=0.6)
    if breaks.shape[0]:
        controller = diffrax.ClipStepSizeController(controller, jump_ts=breaks)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(_field),
        Rodas5P() if solver is None else solver,
        t0=times[0],
        t1=times[-1],
        dt0=None,
        y0=scaling.pack(start),
        args=(plant, scaling),
        saveat=diffrax.SaveAt(ts=times),
        stepsize_controller=controller,
        adjoint=diffrax.ForwardMode() if gradient == "forward" else diffrax.RecursiveCheckpointAdjoint(),
        max_steps=max_steps,
        throw=False,
    )
    okay = diffrax.is_successful(solution.result)
    return Trajectory(scaling.unpack(solution.ys), solution.stats["num_steps"], jnp.where(okay, 0, 1))
