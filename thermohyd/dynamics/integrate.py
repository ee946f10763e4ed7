"""Integrate a run with diffrax on the scaled state: states at given times, failures as codes. Nothing else integrates."""

from typing import Any, Literal

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from thermohyd.arguments import LOWEST_PRESSURE

from .machine import Plant, Scaling, State
from .rosenbrock import Rodas5P
from .variational import TERM, Way, run_along


# forward: the variational equations along the run, for few parameters; reverse: the run is stored at checkpoints, for many.
Gradient = Literal["forward", "reverse"]
FAILURES = (
    "",
    "no equilibrium under the first row: the external force exceeds what the supply pressure can hold, or the spool that it"
    " needs lies beyond the stroke",
    "the integration took more than max_steps steps: the motion is faster than any actuator's, or a column jumps",
    "the integration failed: the states are no longer finite",
    "the pressure in a chamber falls below absolute vacuum: the oil would cavitate there, which the model does not have",
)
NO_EQUILIBRIUM, TOO_MANY_STEPS, NOT_FINITE, CAVITATES = 1, 2, 3, 4


class Trajectory(eqx.Module):
    """States at the wanted times, leading axis (rows,); steps taken; failure: an index into `FAILURES`, 0 for none."""

    states: State
    steps: Int[Array, ""]
    failure: Int[Array, ""]


class _Pace(eqx.Module):
    """Tolerances of the scaled state, and steps at most."""

    rtol: float | Array
    atol: float | Array
    most: int = eqx.field(static=True)

    def controller(self, plant: Plant) -> Any:
        """Steps end where a column bends."""
        breaks = jnp.concatenate([plant.inputs.command.knots, plant.inputs.surroundings.knots])
        controller = diffrax.PIDController(rtol=self.rtol, atol=self.atol, pcoeff=0.2, icoeff=0.6)
        return diffrax.ClipStepSizeController(controller, jump_ts=jnp.sort(breaks)) if breaks.shape[0] else controller


def _first_step(plant: Plant) -> Float[Array, ""]:
    """A tenth of the spool's own time; the controller finds its pace from there without evaluating the field beforehand."""
    return jax.lax.stop_gradient(0.1 / (2.0 * jnp.pi * plant.actuator.spool_frequency))


def _solve(plant: Plant, scaling: Scaling, start: Array, pace: _Pace, solver: Any, adjoint: Any) -> tuple[Array, ...]:
    """(states (rows, states), steps, whether the end was reached)."""
    times = plant.inputs.time
    solution = diffrax.diffeqsolve(
        TERM,
        solver,
        t0=times[0],
        t1=times[-1],
        dt0=_first_step(plant),
        y0=start,
        args=(plant, scaling),
        saveat=diffrax.SaveAt(ts=times),
        stepsize_controller=pace.controller(plant),
        adjoint=adjoint,
        max_steps=pace.most,
        throw=False,
    )
    assert solution.ys is not None
    return solution.ys, solution.stats["num_steps"], solution.result != diffrax.RESULTS.max_steps_reached


@eqx.filter_custom_jvp
def _forward(plant: Plant, scaling: Scaling, start: Array, pace: _Pace) -> tuple[Array, ...]:
    return _solve(plant, scaling, start, pace, Rodas5P(), diffrax.ForwardMode())


@_forward.def_jvp
def _forward_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    plant, scaling, start, pace = primals
    way = Way(pace.controller(plant), plant.inputs.time[-1], pace.most)
    run = run_along((plant, scaling), start, tangents[0], tangents[2], way, _first_step(plant))
    return (run.states, run.tried, run.finished), (run.tangents, None, None)


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
    pace, first = _Pace(rtol, atol, max_steps), scaling.pack(start)
    if gradient == "forward" and solver is None:
        vectors, steps, finished = _forward(plant, scaling, first, pace)
    else:
        adjoint = diffrax.ForwardMode() if gradient == "forward" else diffrax.RecursiveCheckpointAdjoint()
        vectors, steps, finished = _solve(plant, scaling, first, pace, Rodas5P() if solver is None else solver, adjoint)
    states = scaling.unpack(vectors)
    failure = jnp.where(jnp.any(states.pressure < LOWEST_PRESSURE), CAVITATES, 0)
    failure = jnp.where(jnp.all(jnp.isfinite(vectors)), failure, NOT_FINITE)
    return Trajectory(states, steps, jnp.where(finished, failure, TOO_MANY_STEPS))
