"""Eq. 6 for other programs: JSON in SI units, and plain formulas that any system-level tool can evaluate."""

from typing import Any

import numpy as np

from thermohyd.oil import Oil

from .macro_fit import NAMES, MacroFit


def macro_formulas(fit: MacroFit, oil: Oil) -> dict[str, str]:
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


def macro_json(fit: MacroFit, oil: Oil) -> dict[str, Any]:
    """The model, its coefficients' standard errors, every temperature's own fit and all errors; SI units."""
    model = fit.model
    coefficients = dict(zip(NAMES, (model.x0, model.log_q0, model.log_k), strict=True))
    return {
        "equation": "X = X0 tanh(Q/Q0) + k Q",
        "units": "SI: X, X0 [m], Q, Q0 [m3/s], k [s/m2], T [K], dp = P_s - P_t [Pa], nu [m2/s]",
        "formulas": macro_formulas(fit, oil),
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
