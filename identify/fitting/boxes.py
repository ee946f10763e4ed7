"""How a fit sees its parameters: free variables z of order one inside a box, and physical values p in SI."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, isfinite, log
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float


@dataclass(frozen=True)
class Box:
    """One free parameter: where it starts, what counts as a step of order one, and the limits it must keep.

    A limit may be infinite. `logarithmic` fits ln p instead of p, for a positive quantity whose box spans decades and
    whose readings feel ratios rather than differences; it needs lower > 0.
    """

    name: str
    start: float
    scale: float
    lower: float = -np.inf
    upper: float = np.inf
    logarithmic: bool = False
    held: bool = False  # the box is its start, so that a compiled fit of more parameters serves one of fewer

    def __post_init__(self) -> None:
        if not (isfinite(self.start) and self.lower <= self.start <= self.upper):
            raise ValueError(f"{self.name} starts at {self.start:g}, outside its box [{self.lower:g}, {self.upper:g}]")
        if not (self.lower < self.upper or (self.held and self.lower == self.upper)):
            raise ValueError(f"the box of {self.name} is empty: lower {self.lower:g}, upper {self.upper:g}")
        if not (isfinite(self.scale) and self.scale > 0.0):
            raise ValueError(f"the scale of {self.name} must be positive, not {self.scale:g}")
        if self.logarithmic and self.lower <= 0.0:
            raise ValueError(
                f"{self.name} cannot be fitted by its logarithm: its lower limit {self.lower:g} is not positive"
            )

    def held_at(self, value: float) -> "Box":
        """The same parameter, held at a physical value."""
        return Box(self.name, value, self.scale, value, value, held=True)

    def free(self, value: float) -> float:
        """z of a physical value."""
        if not self.logarithmic:
            return value / self.scale
        return log(value / self.scale) if isfinite(value) else value

    def value(self, z: float) -> float:
        """Physical value of z."""
        return self.scale * (exp(z) if self.logarithmic else z)


class Boxes(eqx.Module):
    """The boxes of a fit as arrays, so that other starts, scales and limits reuse a compiled solve.

    z = p/scale, or ln(p/scale) where `logarithmic`. The limits stay hard limits in z: an optimum on a limit is reached
    exactly, whereas a logistic or arcsine map would run after it for ever (its derivative vanishes there).
    """

    # NumPy until they enter a compiled solve: making JAX arrays one by one costs more than a step of the solve.
    scale: Float[Array | np.ndarray, " n"]
    lower: Float[Array | np.ndarray, " n"]  # in z
    upper: Float[Array | np.ndarray, " n"]  # in z
    logarithmic: Bool[Array | np.ndarray, " n"]

    @classmethod
    def of(cls, boxes: Sequence[Box]) -> "Boxes":
        """Gather the boxes, in order."""
        return cls(
            scale=np.array([box.scale for box in boxes], dtype=float),
            lower=np.array([box.free(box.lower) for box in boxes], dtype=float),
            upper=np.array([box.free(box.upper) for box in boxes], dtype=float),
            logarithmic=np.array([box.logarithmic for box in boxes], dtype=bool),
        )

    def physical(self, z: Any) -> Any:
        """Physical values p (n,) [SI] of the free variables (n,); NumPy of NumPy's, JAX of JAX's."""
        # exp sees zeros where it is not wanted, lest its overflow poison the derivative of the other branch.
        numpy = np if isinstance(z, np.ndarray) else jnp
        grown = numpy.exp(numpy.where(self.logarithmic, z, 0.0))
        return numpy.where(self.logarithmic, grown, z) * self.scale

    def slope(self, z: Any) -> Any:
        """dp/dz (n,)."""
        numpy = np if isinstance(z, np.ndarray) else jnp
        return numpy.exp(numpy.where(self.logarithmic, z, 0.0)) * self.scale


def free_values(boxes: Sequence[Box], values: Sequence[float] | np.ndarray) -> np.ndarray:
    """z (n,) of physical values (n,), clipped into the box."""
    inside = [min(max(float(value), box.lower), box.upper) for box, value in zip(boxes, values, strict=True)]
    return np.array([box.free(value) for box, value in zip(boxes, inside, strict=True)])
