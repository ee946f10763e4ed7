"""Fit the seed paper's Eq. 6, X = X0 tanh(Q/Q0) + k Q, to flow curves: each temperature alone, then all with smooth laws.

Where the literal Eq. 6 is too coarse, a second term is fitted to one flow curve: X = X0 tanh(Q/Q0) + X1 tanh(Q/Q1) + k Q. Cold oil
is laminar over the whole stroke: Q grows as the square of the gap, so X as sqrt(Q), without an asymptote. A second bend at a
larger flow follows that; the curve stays explicit in Q and becomes Eq. 6 where X1 = 0.

For other programs the model is written as JSON in SI units, and as plain formulas that any system-level tool can evaluate.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from thermohyd.conditions import operating_points
from thermohyd.flow_curve import MacroModel, eq6_position
from thermohyd.identify.bench.shown_units import L_MIN, UM
from thermohyd.identify.fitting.boxes import Box
from thermohyd.identify.fitting.least_squares import LeastSquaresResult, solve
from thermohyd.identify.fitting.uncertainty import Block, covariance_of
from thermohyd.identify.noise.correlation import noise_correlation
from thermohyd.oil import Oil, walther_viscosity
from thermohyd.static_tests import control_flow
from thermohyd.valve import Valve, true_oil


NAMES = ("X0", "Q0", "k")
# The fits work in bench units, where their parameters are of order one to a hundred.
TO_SI = np.array([1.0 / UM, 1.0 / L_MIN, L_MIN / UM])
# Degree of the laws in ln(nu). For the seed valve at 70 bar degree 2 misses the curves by up to 21 um, 3 by 20, 4 by 15
# and 5 by 12; 6 and 7 by 11.5 and 11.1, which is what fits of each temperature alone leave (11.1, at 4000 cSt).
DEGREE = 5


@dataclass(frozen=True)
class Eq6Fit:
    """Eq. 6 at one temperature [K] and kinematic viscosity [m2/s]; SI units.

    values, std: (X0 [m], Q0 [m3/s], k [s/m2]) and their standard errors, with the misfit taken as noise that is correlated
    along the sweep; 0 where there is none. rms, worst: of the opening [m]. smooth_*: of the law in temperature.
    """

    temperature: float
    viscosity: float
    values: np.ndarray
    std: np.ndarray
    rms: float
    worst: float
    smooth_rms: float
    smooth_worst: float
    converged: bool


@dataclass(frozen=True)
class FlowCurveFit:
    """The fits temperature by temperature and the model with smooth laws; std: (3, degree + 1) of the model's coefficients.

    position: (n,) [m] counted from null; flow: (temperatures, n) [m3/s], the curves that were fitted.
    """

    model: MacroModel
    std: np.ndarray
    fits: tuple[Eq6Fit, ...]
    stroke: float
    position: np.ndarray
    flow: np.ndarray
    converged: bool

    @property
    def worst(self) -> float:
        """Largest error of the smooth model over all temperatures and openings [m]."""
        return max(fit.smooth_worst for fit in self.fits)


def fit_flow_curve(
    valve: Valve,
    temperatures: Sequence[float] | np.ndarray,
    *,
    supply_pressure: float,
    return_pressure: float = 0.0,
    points: int = 201,
    degree: int = DEGREE,
) -> FlowCurveFit:
    """Eq. 6 of a valve: its flow curve with connected ports over the whole stroke, at several temperatures [K], fitted.

    Least squares in the opening X over `points` equidistant openings. Needs at least degree + 1 temperatures (ValueError).

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> from thermohyd import seed_valve
    >>> found = fit_flow_curve(seed_valve(), [300.0, 310.0, 320.0, 330.0], supply_pressure=70e5, degree=3)
    >>> print(f"{1e6 * found.worst:.1f} um")
    1.2 um
    """
    warm = np.asarray(temperatures, dtype=float)
    share = np.linspace(-1.0, 1.0, points)
    position = share * float(valve.stroke) + float(valve.null_bias)
    rows = operating_points(
        jnp.asarray(np.tile(position, len(warm))),
        supply_pressure=supply_pressure,
        return_pressure=return_pressure,
        temperature=jnp.asarray(np.repeat(warm, points)),
    )
    flow = np.asarray(control_flow(valve, rows)).reshape(len(warm), points)
    viscosity = np.asarray(walther_viscosity(true_oil(valve), jnp.asarray(warm)))
    return fit_eq6(
        share * float(valve.stroke), flow, warm, viscosity, drop=supply_pressure - return_pressure, degree=degree
    )


def fit_eq6(
    position: np.ndarray,
    flow: np.ndarray,
    temperature: np.ndarray,
    viscosity: np.ndarray,
    *,
    drop: float,
    degree: int = DEGREE,
) -> FlowCurveFit:
    """Eq. 6 through flow curves: position (n,) [m] from null, flow (t, n) [m3/s], temperature [K] and viscosity [m2/s] (t,).

    drop: P_s - P_t of the curves [Pa]. Raises ValueError where there are fewer temperatures than coefficients per law.
    """
    if len(temperature) <= degree:
        raise ValueError(f"laws of degree {degree} in ln(viscosity) need at least {degree + 1} temperatures")
    x, q = UM * np.asarray(position, dtype=float), L_MIN * np.asarray(flow, dtype=float)
    alone = [_fit_alone(x, curve) for curve in q]
    low, high = np.log(viscosity.min()), np.log(viscosity.max())
    u = (2.0 * np.log(viscosity) - high - low) / (high - low)
    smooth = _fit_smooth(x, q, u, np.array([fit.p for fit in alone]), degree)
    coefficients = smooth.p.reshape(3, degree + 1)
    std = _standard_errors(smooth, np.repeat(np.arange(len(q)), len(x))).reshape(3, degree + 1)
    constant = np.eye(1, degree + 1)[0]
    model = MacroModel(
        x0=jnp.asarray(coefficients[0] * TO_SI[0]),
        log_q0=jnp.asarray(coefficients[1] + np.log(TO_SI[1]) * constant),
        log_k=jnp.asarray(coefficients[2] + np.log(TO_SI[2]) * constant),
        viscosity_low=jnp.asarray(float(viscosity.min())),
        viscosity_high=jnp.asarray(float(viscosity.max())),
        reference_drop=jnp.asarray(float(drop)),
    )
    missed = smooth.residual.reshape(q.shape) / UM
    fits = tuple(
        Eq6Fit(
            temperature=float(t),
            viscosity=float(nu),
            values=fit.p * TO_SI,
            std=_standard_errors(fit, np.zeros(len(x))) * TO_SI,
            rms=float(np.sqrt(np.mean(fit.residual**2))) / UM,
            worst=float(np.abs(fit.residual).max()) / UM,
            smooth_rms=float(np.sqrt(np.mean(miss**2))),
            smooth_worst=float(np.abs(miss).max()),
            converged=fit.converged,
        )
        for t, nu, fit, miss in zip(temperature, viscosity, alone, missed, strict=True)
    )
    return FlowCurveFit(
        model, std * np.array([[TO_SI[0]], [1.0], [1.0]]), fits, float(position.max()), position, flow, smooth.converged
    )


def _alone(p: Array, args: tuple[Array, Array]) -> Array:
    x, q = args
    return eq6_position(q, p[0], p[1], p[2]) - x


def _together(p: Array, args: tuple[Array, Array, Array]) -> Array:
    x, q, powers = args  # (n,), (t, n), (t, terms)
    x0, log_q0, log_k = p.reshape(3, -1) @ powers.T
    return (eq6_position(q, x0[:, None], jnp.exp(log_q0)[:, None], jnp.exp(log_k)[:, None]) - x).reshape(-1)


def _fit_alone(x: np.ndarray, q: np.ndarray) -> LeastSquaresResult:
    x0, q0, k = _best_of_scan(x, q)
    most = float(np.abs(q).max())
    boxes = (
        Box("X0", x0, 10.0),
        Box("Q0", q0, q0, 1e-4 * most, 10.0 * most, logarithmic=True),
        Box("k", k, k, 1e-3 * k, 1e3 * k, logarithmic=True),
    )
    return solve(_alone, boxes, (x, q))


def _best_of_scan(x: np.ndarray, q: np.ndarray) -> tuple[float, float, float]:
    """The best (X0, Q0, k) on a grid of Q0, for each of which X0 and k are linear: Eq. 6 often has two minima."""
    scan = np.geomspace(2e-3, 1.5, 80) * np.abs(q).max()
    bend = np.tanh(q / scan[:, None])
    bb, bq, qq = np.sum(bend**2, axis=1), bend @ q, float(q @ q)
    bx, qx = bend @ x, float(q @ x)
    x0, k = (bx * qq - qx * bq) / (bb * qq - bq**2), (qx * bb - bx * bq) / (bb * qq - bq**2)
    cost = np.sum((x0[:, None] * bend + k[:, None] * q - x) ** 2, axis=1)
    best = int(np.argmin(np.where((k > 0.0) & (x0 / scan + k > 0.0), cost, np.inf)))
    return float(x0[best]), float(scan[best]), float(k[best])


def _fit_smooth(x: np.ndarray, q: np.ndarray, u: np.ndarray, alone: np.ndarray, degree: int) -> LeastSquaresResult:
    powers = np.vander(u, degree + 1, increasing=True)
    targets = np.column_stack([alone[:, 0], np.log(alone[:, 1]), np.log(alone[:, 2])])
    start = np.linalg.lstsq(powers, targets, rcond=None)[0].T
    boxes = [
        Box(f"{name}_{i}", float(start[row, i]), 10.0 if name == "X0" else 1.0)
        for row, name in enumerate(NAMES)
        for i in range(degree + 1)
    ]
    return solve(_together, boxes, (x, q, powers))


def _standard_errors(fit: LeastSquaresResult, sweeps: np.ndarray) -> np.ndarray:
    n, p = fit.jacobian.shape
    block = Block(slice(0, n), sweeps, noise_correlation(fit.residual, sweeps, p), fit.cost / max(n - p, 1))
    names = tuple(str(i) for i in range(p))
    return np.sqrt(np.diag(covariance_of(fit.jacobian, names, fit.active, [block], slice(0, 0)).matrix))


@dataclass(frozen=True)
class TwoTermFit:
    """values: (X0 [m], Q0 [m3/s], X1 [m], Q1 [m3/s], k [s/m2]); rms and worst error of the opening [m]."""

    values: np.ndarray
    rms: float
    worst: float


def two_term_position(values: np.ndarray | Array, flow: np.ndarray | Array) -> Array:
    """X0 tanh(Q/Q0) + X1 tanh(Q/Q1) + k Q, with values in the order of `TwoTermFit.values`."""
    x0, q0, x1, q1, k = values
    return x0 * jnp.tanh(flow / q0) + x1 * jnp.tanh(flow / q1) + k * jnp.asarray(flow)


def fit_two_terms(position: np.ndarray, flow: np.ndarray) -> TwoTermFit:
    """Least squares in the opening; position [m] counted from null and flow [m3/s] have the same shape (n,)."""
    x, q = UM * np.asarray(position, dtype=float), L_MIN * np.asarray(flow, dtype=float)
    most = float(np.abs(q).max())
    x0, q0, x1, q1, k = _best_of_two_knees(x, q, np.geomspace(2e-3, 1.0, 28) * most)
    boxes = (
        Box("X0", x0, 10.0),
        Box("Q0", q0, q0, 1e-4 * most, 2.0 * most, logarithmic=True),
        Box("X1", x1, 10.0),
        Box("Q1", q1, q1, 1e-4 * most, 2.0 * most, logarithmic=True),
        Box("k", k, abs(k)),
    )
    found = solve(_residual, boxes, (x, q), max_steps=60)
    to_si = np.array([1.0 / UM, 1.0 / L_MIN, 1.0 / UM, 1.0 / L_MIN, L_MIN / UM])
    worst, rms = float(np.abs(found.residual).max()), float(np.sqrt(np.mean(found.residual**2)))
    return TwoTermFit(found.p * to_si, rms / UM, worst / UM)


def _residual(p: Array, args: tuple[Array, Array]) -> Array:
    x, q = args
    return two_term_position(p, q) - x


def _best_of_two_knees(x: np.ndarray, q: np.ndarray, scan: np.ndarray) -> tuple[float, float, float, float, float]:
    """The best pair (Q0, Q1) on a grid; the other three are linear."""
    bends = np.tanh(q / scan[:, None])
    first, second = np.triu_indices(len(scan), 1)
    overlap, along, onto = bends @ bends.T, bends @ q, bends @ x
    normal = np.empty((len(first), 3, 3))
    normal[:, 0, 0], normal[:, 1, 1], normal[:, 2, 2] = overlap[first, first], overlap[second, second], q @ q
    normal[:, 0, 1] = normal[:, 1, 0] = overlap[first, second]
    normal[:, 0, 2] = normal[:, 2, 0] = along[first]
    normal[:, 1, 2] = normal[:, 2, 1] = along[second]
    right = np.stack([onto[first], onto[second], np.full(len(first), q @ x)], axis=1)
    linear = np.linalg.solve(normal, right[..., None])[..., 0]
    best = int(np.argmax(np.sum(linear * right, axis=1)))
    x0, x1, k = (float(value) for value in linear[best])
    return x0, float(scan[first[best]]), x1, float(scan[second[best]]), k


def flow_curve_formulas(fit: FlowCurveFit, oil: Oil) -> dict[str, str]:
    """{name: right-hand side}, in the order in which to evaluate them; SI units, T the oil's temperature [K], Q the flow
    [m3/s], dp = P_s - P_t [Pa], X the opening from null [m]. Only + - * / ^, log (natural), log10, exp, sqrt and tanh.
    """
    model = fit.model
    low, high = np.log(float(model.viscosity_low)), np.log(float(model.viscosity_high))
    factor = 1.0 if oil.viscosity_factor is None else float(oil.viscosity_factor)
    return {
        "nu": f"{1e-6 * factor!r}*(10^(10^({float(oil.viscosity_a)!r} - {float(oil.viscosity_b)!r}*log10(T))) - 0.7)",
        "s": f"sqrt(dp/{float(model.reference_drop)!r})",
        "u": f"(2*log(nu/s) - ({float(low + high)!r}))/{float(high - low)!r}",
        "X0": _horner(np.asarray(model.x0)),
        "Q0": f"s*exp({_horner(np.asarray(model.log_q0))})",
        "k": f"exp({_horner(np.asarray(model.log_k))})/s",
        "X": "X0*tanh(Q/Q0) + k*Q",
    }


def _horner(coefficients: np.ndarray) -> str:
    """c0 + u*(c1 + u*(...)), every coefficient with all its digits and in brackets, for tools that dislike + -1."""
    words = f"({float(coefficients[-1])!r})"
    for value in coefficients[-2::-1]:
        words = f"(({float(value)!r}) + u*{words})"
    return words


def flow_curve_json(fit: FlowCurveFit, oil: Oil) -> dict[str, Any]:
    """The model, its coefficients' standard errors, every temperature's own fit and all errors; SI units."""
    model = fit.model
    coefficients = dict(zip(NAMES, (model.x0, model.log_q0, model.log_k), strict=True))
    return {
        "equation": "X = X0 tanh(Q/Q0) + k Q",
        "units": "SI: X, X0 [m], Q, Q0 [m3/s], k [s/m2], T [K], dp = P_s - P_t [Pa], nu [m2/s]",
        "formulas": flow_curve_formulas(fit, oil),
        "laws": "X0 = sum c_i u^i, ln Q0 = sum c_i u^i, ln k = sum c_i u^i, with nu and dp as in the formulas",
        "coefficients": {
            name: {"value": np.asarray(values).tolist(), "std": std.tolist()}
            for (name, values), std in zip(coefficients.items(), fit.std, strict=True)
        },
        "viscosity_range": [float(model.viscosity_low), float(model.viscosity_high)],
        "reference_drop": float(model.reference_drop),
        "stroke": fit.stroke,
        "worst_error": {"m": fit.worst, "share_of_stroke": fit.worst / fit.stroke},
        "standard_errors": "of least squares with the misfit taken as noise correlated along the sweep",
        "temperatures": [
            {
                "temperature": own.temperature,
                "viscosity": own.viscosity,
                "converged": own.converged,
                **{
                    name: {"value": float(value), "std": float(std)}
                    for name, value, std in zip(NAMES, own.values, own.std, strict=True)
                },
                "error_of_own_fit": {"rms": own.rms, "worst": own.worst},
                "error_of_smooth_law": {"rms": own.smooth_rms, "worst": own.smooth_worst},
            }
            for own in fit.fits
        ],
    }
