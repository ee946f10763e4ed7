"""The actuator on the valve: a symmetric jack on a rigid anchorage, its load, and its position loop (docs/physics.md section 9)."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from .arguments import ArgumentValueError, as_array, check_sign, check_size, known
from .numerics import require_float64


POSITIVE = (
    "piston_area", "chamber_volume", "moving_mass", "rated_current", "spool_frequency", "spool_damping", "bulk_modulus_factor",
    "piston_stroke",
)  # fmt: skip
NOT_NEGATIVE = ("viscous_friction", "coulomb_friction", "jack_leakage")
# (field, greatest, what is meant): far beyond any jack, and where numbers in bench units lie.
SIZES = (
    ("piston_area", 1.0, "areas are in m2: 12 cm2 is 12e-4"),
    ("chamber_volume", 5.0, "volumes are in m3: 60 cm3 is 60e-6"),
    ("rated_current", 5.0, "currents are in A: 25 mA is 25e-3"),
)


class Actuator(eqx.Module):
    """A jack, its load and its loop; names and defaults of a bench record's `[actuator]` table. SI units, all differentiable.

    piston_area: S [m2], both sides. chamber_volume: V_t [m3], one chamber at mid stroke, lines included. moving_mass: m [kg].
    viscous_friction: f [N s/m]. coulomb_friction: F_b [N]. jack_leakage: a [m3/(s Pa)]. external_force: F_e [N], constant.
    rated_current [A]: x = X_n I/I_rated. The loop: I = K_A K_p (z* - z), amplifier_gain K_A [A/V], sensor_gain K_p [V/m].
    spool_frequency [Hz] and spool_damping [-]: the spool behind the current, second order.
    bulk_modulus_factor [-]: of the oil in the chambers only (air, hoses), 1 where they add nothing.
    piston_stroke [m]: from one end stop to the other, z = 0 half way.
    Raises ArgumentValueError for a known value in another unit or of the wrong sign, RuntimeError in single precision.
    """

    piston_area: Float[Array, ""] = eqx.field(converter=as_array, default=12e-4)
    chamber_volume: Float[Array, ""] = eqx.field(converter=as_array, default=60e-6)
    moving_mass: Float[Array, ""] = eqx.field(converter=as_array, default=50.0)
    viscous_friction: Float[Array, ""] = eqx.field(converter=as_array, default=2000.0)
    coulomb_friction: Float[Array, ""] = eqx.field(converter=as_array, default=0.0)
    jack_leakage: Float[Array, ""] = eqx.field(converter=as_array, default=0.0)
    external_force: Float[Array, ""] = eqx.field(converter=as_array, default=0.0)
    rated_current: Float[Array, ""] = eqx.field(converter=as_array, default=25e-3)
    amplifier_gain: Float[Array, ""] = eqx.field(converter=as_array, default=0.01)
    sensor_gain: Float[Array, ""] = eqx.field(converter=as_array, default=100.0)
    spool_frequency: Float[Array, ""] = eqx.field(converter=as_array, default=100.0)
    spool_damping: Float[Array, ""] = eqx.field(converter=as_array, default=0.7)
    bulk_modulus_factor: Float[Array, ""] = eqx.field(converter=as_array, default=1.0)
    piston_stroke: Float[Array, ""] = eqx.field(converter=as_array, default=50e-3)

    def __check_init__(self) -> None:
        require_float64("an Actuator")
        for name in POSITIVE:
            check_sign(name, getattr(self, name))
        for name in NOT_NEGATIVE:
            check_sign(name, getattr(self, name), "not negative")
        for name in ("external_force", "amplifier_gain", "sensor_gain"):
            known(name, getattr(self, name))
        for name, most, hint in SIZES:
            check_size(name, getattr(self, name), 0.0, most, hint)
        area, stroke, volume = (known(n, getattr(self, n)) for n in ("piston_area", "piston_stroke", "chamber_volume"))
        # Long jacks exist, and longer ones in thought; none sweeps a hundred times the oil in it.
        if area is not None and stroke is not None and volume is not None and (area * stroke > 200.0 * volume).any():
            raise ArgumentValueError(
                f"piston_stroke {np.max(stroke):g} sweeps far more than the chamber_volume {np.min(volume):g} m3 holds: "
                "lengths are in m, 50 mm is 50e-3"
            )


def seed_actuator() -> Actuator:
    """An example jack for the seed paper's valve, which the paper leaves open: 12 cm2, 50 kg, 100 N of dry friction, 1 kN."""
    return Actuator(coulomb_friction=100.0, external_force=1000.0)
