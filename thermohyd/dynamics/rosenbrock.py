"""Rodas5P: a stiff solver for small systems, one matrix and no iteration per step, as a solver of diffrax.

G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within the Julia Differential
Equations package, BIT Numerical Mathematics 63, 27 (2023): order 5(4), 8 stages, A-stable and stiffly accurate, dense
output of order 4. In the form of Hairer and Wanner (Solving ODEs II, section IV.7) that needs no product with the matrix:

    (I/(gamma h) - J) k_i = f(t + c_i h, y + sum_j a_ij k_j) + sum_j C_ij/h k_j + h d_i df/dt,   y_1 = y + sum_i m_i k_i.

J is exact here (forward mode). The matrix is inverted by Gauss-Jordan elimination without pivoting: I/(gamma h) holds up
the diagonal, and states are ordered so that what is eliminated first is damped: as exact as LAPACK, 1e-14, for steps up to 0.1 s;
a poor inverse would show as a large error and the step be repeated with a smaller h.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.small_systems import inverse

from .rodas5p import DENSE, GAMMA, TABLEAU


class DenseOutput(diffrax.AbstractLocalInterpolation):
    """Between the ends of a step: y_0 (1 - s) + s (y_1 + (1 - s)(K_1 + s (K_2 + s K_3))), of order 4."""

    t0: Any
    t1: Any
    y0: Float[Array, " states"]
    y1: Float[Array, " states"]
    bends: Float[Array, "3 states"]

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> Float[Array, " states"]:
        del left
        if t1 is not None:
            return self.evaluate(t1) - self.evaluate(t0)
        span = self.t1 - self.t0
        s = jnp.where(span > 0.0, (t0 - self.t0) / jnp.where(span > 0.0, span, 1.0), 0.0)
        inner = self.bends[0] + s * (self.bends[1] + s * self.bends[2])
        return (1.0 - s) * self.y0 + s * (self.y1 + (1.0 - s) * inner)


class Rodas5P(diffrax.AbstractAdaptiveSolver):
    """The method above for one flat vector of states; `terms` is one `diffrax.ODETerm`."""

    term_structure: ClassVar = diffrax.AbstractTerm
    interpolation_cls: ClassVar[Callable[..., DenseOutput]] = DenseOutput

    def order(self, terms: Any) -> int:
        return 5

    def init(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any) -> None:
        return None

    def func(self, terms: Any, t0: Any, y0: Any, args: Any) -> Any:
        return terms.vf(t0, y0, args)

    def step(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any, solver_state: None, made_jump: Any) -> Any:
        del solver_state, made_jump
        h = t1 - t0
        field = lambda t, y: terms.vf(t, y, args)
        # f, its slope in time and its Jacobian in one batch of tangents.
        n = y0.shape[0]
        _, push = jax.linearize(field, t0, y0)
        slope = push(jnp.ones_like(t0), jnp.zeros_like(y0))
        columns = jax.vmap(lambda tangent: push(jnp.zeros_like(t0), tangent), out_axes=1)(jnp.eye(n))
        solve = inverse(jnp.eye(n) / (GAMMA * h) - columns)

        # One evaluation of the field in the program, not eight: a loop compiles in a third of the time and runs as fast.
        def stage(ks: Array, coefficients: tuple[Array, Array, Array, Array]) -> tuple[Array, Array]:
            a, c, d, (i, node) = coefficients
            y = y0 + jnp.sum(a[:, None] * ks, axis=0)
            right = field(t0 + node * h, y) + h * d * slope + jnp.sum(c[:, None] * ks, axis=0) / h
            k = jnp.sum(solve * right, axis=1)
            return jax.lax.dynamic_update_slice(ks, k[None], (i.astype(int), 0)), y

        a, c, d, nodes = (jnp.asarray(part) for part in TABLEAU)
        ks, states = jax.lax.scan(stage, jnp.zeros((8, n)), (a, c, d, nodes))
        y1 = states[-1] + ks[-1]
        bends = jnp.tensordot(DENSE, ks, 1)
        return y1, ks[-1], {"y0": y0, "y1": y1, "bends": bends}, None, diffrax.RESULTS.successful
