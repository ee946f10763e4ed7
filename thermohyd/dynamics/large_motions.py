"""How much more a valve passes per opening away from null than at null: what large motions take from a loop's gain margin."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Real

from ..actuator_performance import with_heat, without_instruments
from ..conditions import Conditions
from ..precision import require_float64
from ..static_tests import control_flow
from ..valve import Valve


OPENINGS = np.geomspace(1e-3, 1.0, 48)  # of the stroke
KEPT = {"adiabatic": 1.0, "isothermal": 0.0}


def largest_gain_rise(
    valve: Valve,
    temperatures: Sequence[float] | Real[np.ndarray, " temperatures"] | Float[Array, " temperatures"],
    *,
    supply_pressure: float,
    return_pressure: float = 0.0,
    heat: str = "adiabatic",
) -> np.ndarray:
    """Largest flow per opening Q(x)/x over the stroke as a factor of that at null, at temperatures [K]; 1 where null is steepest.

    To a motion of amplitude x a symmetric flow curve that bends upwards has a gain (its describing function) between Q'(0)
    and the largest Q(x)/x. The gain margin at null divided by this factor is what is left for any amplitude: below 1 a
    loop that is stable at rest may keep swinging once moved. Without load, spool clipped at its stroke; pressures in Pa.
    """
    require_float64("largest_gain_rise")
    warm = np.asarray(temperatures, dtype=float)
    bare = with_heat(without_instruments(valve), KEPT[heat])
    opening = np.tile(OPENINGS, warm.size) * float(valve.stroke)
    full = lambda value: jnp.full(opening.size, float(value))
    at = Conditions(
        jnp.asarray(opening), full(supply_pressure), full(return_pressure), jnp.asarray(warm.repeat(OPENINGS.size))
    )
    gain = (np.asarray(_flow(bare, at)) / opening).reshape(warm.size, OPENINGS.size)
    return np.max(gain, axis=1) / gain[:, 0]


@eqx.filter_jit
def _flow(valve: Valve, at: Conditions) -> Float[Array, " rows"]:
    return control_flow(valve, at)
