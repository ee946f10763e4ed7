"""The actuator on the valve: a jack on a rigid anchorage, its load, and its position loop (docs/physics.md section 9)."""

from dataclasses import fields

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .arguments import ArgumentValueError, as_array, as_optional_array, check_sign, check_size, known
from .numerics import require_float64


# What the two sides share, by default; or each has its own, under the same name with _a and _b.
SHARED = {"piston_area": 12e-4, "chamber_volume": 60e-6}
SIDES = ("", "_a", "_b")
POSITIVE = (
    *(f"{name}{side}" for name in SHARED for side in SIDES),
    "moving_mass", "rated_current", "spool_frequency", "spool_damping", "bulk_modulus_factor", "piston_stroke",
)  # fmt: skip
NOT_NEGATIVE = ("viscous_friction", "coulomb_friction", "jack_leakage")
# (field, greatest, what is meant): far beyond any jack, and where numbers in bench units lie.
SIZES = (
    *((f"piston_area{side}", 1.0, "areas are in m2: 12 cm2 is 12e-4") for side in SIDES),
    *((f"chamber_volume{side}", 5.0, "volumes are in m3: 60 cm3 is 60e-6") for side in SIDES),
    ("rated_current", 5.0, "currents are in A: 25 mA is 25e-3"),
)


class Actuator(eqx.Module):
    """A jack, its load and its loop; names and defaults of a bench record's `[actuator]` table. SI units, all differentiable.

    piston_area: S [m2], both sides, 12 cm2 unless given. chamber_volume: V_t [m3], one chamber at mid stroke, lines included, 60 cm3
    unless given. An unequal jack has the pairs piston_area_a, piston_area_b (S_a, S_b) and chamber_volume_a, chamber_volume_b (at
    mid stroke) in their place, either or both; what is not used is None. moving_mass: m [kg].
    viscous_friction: f [N s/m]. coulomb_friction: F_b [N]. jack_leakage: a [m3/(s Pa)]. external_force: F_e [N], constant.
    rated_current [A]: x = X_n I/I_rated. The loop: I = K_A K_p (z* - z), amplifier_gain K_A [A/V], sensor_gain K_p [V/m].
    spool_frequency [Hz] and spool_damping [-]: the spool behind the current, second order.
    bulk_modulus_factor [-]: of the oil in the chambers only (air, hoses), 1 where they add nothing.
    piston_stroke [m]: from one end stop to the other, z = 0 half way.
    Raises ArgumentValueError for a known value in another unit or of the wrong sign, for half a pair and for a pair beside what
    both sides share; RuntimeError in single precision.
    """

    # None, and not two equal entries, where both sides are alike: then no program has a second area to multiply with.
    piston_area: Float[Array, ""] | None = eqx.field(converter=as_optional_array, default=None)
    chamber_volume: Float[Array, ""] | None = eqx.field(converter=as_optional_array, default=None)
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
    piston_area_a: Float[Array, ""] | None = eqx.field(converter=as_optional_array, default=None)
    piston_area_b: Float[Array, ""] | None = eqx.field(converter=as_optional_array, default=None)
    chamber_volume_a: Float[Array, ""] | None = eqx.field(converter=as_optional_array, default=None)
    chamber_volume_b: Float[Array, ""] | None = eqx.field(converter=as_optional_array, default=None)

    def __post_init__(self) -> None:
        for name, default in SHARED.items():
            if all(getattr(self, f"{name}{side}") is None for side in SIDES):
                setattr(self, name, default)

    def __check_init__(self) -> None:
        require_float64("an Actuator")
        for name in SHARED:
            shared, a, b = (getattr(self, f"{name}{side}") is not None for side in SIDES)
            if a != b:
                raise ArgumentValueError(
                    f"{name}_{'b' if a else 'a'} is missing: {name}_a and {name}_b are given together"
                )
            if shared and a:
                raise ArgumentValueError(f"give {name}, of both sides, or {name}_a and {name}_b, not all three")
        for name in POSITIVE:
            if getattr(self, name) is not None:
                check_sign(name, getattr(self, name))
        for name in NOT_NEGATIVE:
            check_sign(name, getattr(self, name), "not negative")
        for name in ("external_force", "amplifier_gain", "sensor_gain"):
            known(name, getattr(self, name))
        for name, most, hint in SIZES:
            if getattr(self, name) is not None:
                check_size(name, getattr(self, name), 0.0, most, hint)
        stroke = known("piston_stroke", self.piston_stroke)
        for side in ("_a", "_b"):
            of, filled = (n if getattr(self, n) is not None else f"{n}{side}" for n in SHARED)
            area, volume = known(of, getattr(self, of)), known(filled, getattr(self, filled))
            # Long jacks exist, and longer ones in thought; none sweeps a hundred times the oil in it.
            if (
                area is not None
                and stroke is not None
                and volume is not None
                and (area * stroke > 200.0 * volume).any()
            ):
                raise ArgumentValueError(
                    f"piston_stroke {np.max(stroke):g} sweeps far more than the {filled} {np.min(volume):g} m3 holds: "
                    "lengths are in m, 50 mm is 50e-3"
                )

    def to_dict(self) -> dict[str, float]:
        """{field: its number, SI}, without what is None."""
        given = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: float(value) for name, value in given.items() if value is not None}

    @property
    def areas(self) -> Float[Array, "..."]:
        """S [m2] of both sides, (); or (2,), S_a and S_b: a factor on what has the sides along its last axis."""
        return _of_sides(self.piston_area, self.piston_area_a, self.piston_area_b)

    @property
    def volumes(self) -> Float[Array, "..."]:
        """V_t [m3] of both chambers at mid stroke, (); or (2,), those of A and B."""
        return _of_sides(self.chamber_volume, self.chamber_volume_a, self.chamber_volume_b)

    @property
    def mean_area(self) -> Float[Array, ""]:
        """(S_a + S_b)/2 [m2]."""
        return self.areas if self.piston_area is not None else jnp.mean(self.areas, axis=-1)

    @property
    def symmetric(self) -> bool:
        """Whether both sides are described as one; known while tracing, unlike the equality of two areas."""
        return self.piston_area is not None and self.chamber_volume is not None

    def push(self, pressure: Float[Array, "2"]) -> Float[Array, ""]:
        """Force [N] of the pressures p_A, p_B [Pa] on the piston: S_a p_A - S_b p_B."""
        if self.piston_area is not None:
            return self.piston_area * (pressure[0] - pressure[1])
        return self.areas[0] * pressure[0] - self.areas[1] * pressure[1]


def _of_sides(shared: Array | None, a: Array | None, b: Array | None) -> Float[Array, "..."]:
    if shared is not None:
        return shared
    assert a is not None
    assert b is not None
    return jnp.stack([a, b], axis=-1)


def seed_actuator() -> Actuator:
    """An example jack for the seed paper's valve, which the paper leaves open: 12 cm2, 50 kg, 100 N of dry friction, 1 kN."""
    return Actuator(coulomb_friction=100.0, external_force=1000.0)
