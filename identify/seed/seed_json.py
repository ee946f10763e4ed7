"""`seed.json` and the CSVs: every claim, value and curve of the reproduction, for programs and spreadsheets."""

import io
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from ..macro_output import macro_json
from . import seed_valve as paper
from .curves import MODELS, SeedCurves
from .seed_study import SeedStudy


BAR, L_MIN, CST, CELSIUS = 1e-5, 6e4, 1e6, 273.15
OPENINGS = (0.0, 0.01, 0.025, 0.03, 0.05, 0.1, 1.0)  # whose gains go into gains.csv


def seed_json(study: SeedStudy) -> dict[str, Any]:
    """Claims and Eq. 6 as dictionaries, curves as nested lists in SI units, axes named."""
    curves, oil = study.curves, paper.seed_valve().oil
    drawn = study.drawn
    names = ("leakage", "load_pressure", "pressure_gain", "flow", "flow_gain")
    return {
        "units": "SI: m, Pa (gauge), K, m3/s; viscosity m2/s; opening as a share of the stroke",
        "claims": [asdict(claim) for claim in study.claims],
        "claims_that": {word: study.count(word) for word in ("holds", "partly", "no")},
        "eq6": {model: macro_json(fit, oil) for model, fit in study.macro.items()},
        "eq6_with_second_tanh": {
            "equation": "X = X0 tanh(Q/Q0) + X1 tanh(Q/Q1) + k Q, values in the order X0, Q0, X1, Q1, k",
            "temperature": curves.temperature.tolist(),
            "values": [fit.values.tolist() for fit in study.two_terms],
            "worst": [fit.worst for fit in study.two_terms],
        },
        "curves": {
            "axes": ["model", "supply_pressure", "temperature", "opening"],
            "model": list(MODELS),
            "supply_pressure": curves.supply.tolist(),
            "temperature": curves.temperature[drawn].tolist(),
            "viscosity": curves.viscosity[drawn].tolist(),
            "opening": curves.opening.tolist(),
            **{name: getattr(curves, name)[:, :, drawn].tolist() for name in names},
        },
        "actuator_at_null": {
            "axes": ["model", "supply_pressure", "temperature"],
            "temperature": curves.temperature.tolist(),
            **{name: values.tolist() for name, values in study.performance.items()},
        },
        "seconds": study.seconds,
    }


def seed_tables(study: SeedStudy) -> dict[str, str]:
    """{"curves.csv": against opening, "gains.csv": against temperature, "eq6.csv", "claims.csv"}, bench units in the headers."""
    claims = pd.DataFrame(
        [{key: value for key, value in asdict(claim).items() if key != "values"} for claim in study.claims]
    )
    tables = {
        "curves.csv": _against_opening(study.curves, study.drawn),
        "gains.csv": _against_temperature(study),
        "eq6.csv": _eq6(study),
        "claims.csv": claims,
    }
    return {name: _text(table) for name, table in tables.items()}


def _text(table: pd.DataFrame) -> str:
    out = io.StringIO()
    table.to_csv(out, index=False, float_format="%.7g", lineterminator="\n")
    return out.getvalue()


def _where(curves: SeedCurves, shape: tuple[int, ...], drawn: list[int]) -> dict[str, np.ndarray]:
    """Columns that say which model, pressure and temperature a row of the flattened arrays belongs to."""
    model, supply, temperature = np.indices(shape)[:3]
    index = np.array(drawn)[temperature.ravel()]
    return {
        "model": np.array(MODELS)[model.ravel()],
        "supply_pressure [bar]": curves.supply[supply.ravel()] * BAR,
        "temperature [degC]": curves.temperature[index] - CELSIUS,
        "viscosity [cSt]": curves.viscosity[index] * CST,
    }


def _against_opening(curves: SeedCurves, drawn: list[int]) -> pd.DataFrame:
    shape = (2, len(curves.supply), len(drawn), len(curves.opening))
    table = pd.DataFrame(_where(curves, shape, drawn))
    table["opening [%]"] = np.broadcast_to(100.0 * curves.opening, shape).ravel()
    table["leakage [l/min]"] = curves.leakage[:, :, drawn].ravel() * L_MIN
    table["load_pressure [bar]"] = curves.load_pressure[:, :, drawn].ravel() * BAR
    table["flow [l/min]"] = curves.flow[:, :, drawn].ravel() * L_MIN
    return table


def _against_temperature(study: SeedStudy) -> pd.DataFrame:
    curves = study.curves
    count = len(curves.temperature)
    table = pd.DataFrame(_where(curves, (2, len(curves.supply), count), list(range(count))))
    for share in OPENINGS:
        at, words = curves.at_opening(share), f"at {100 * share:g} %"
        table[f"leakage {words} [l/min]"] = curves.leakage[..., at].ravel() * L_MIN
        table[f"bar_K_PX {words} [-]"] = (
            curves.pressure_gain[..., at] * curves.stroke / paper.NOMINAL_PRESSURE
        ).ravel()
        table[f"bar_K_QX {words} [-]"] = (curves.flow_gain[..., at] * curves.stroke / paper.NOMINAL_FLOW).ravel()
    table["K_QP at 0 % [l/min/bar]"] = study.performance["flow_pressure_gain"].ravel() * L_MIN / BAR
    return table


def _eq6(study: SeedStudy) -> pd.DataFrame:
    rows = []
    for model, macro in study.macro.items():
        for i, fit in enumerate(macro.fits):
            (x0, q0, k), (dx0, dq0, dk) = fit.values, fit.std
            row = {
                "model": model,
                "temperature [degC]": fit.temperature - CELSIUS,
                "viscosity [cSt]": fit.viscosity * CST,
                "X0 [um]": x0 * 1e6,
                "X0_std [um]": dx0 * 1e6,
                "Q0 [l/min]": q0 * L_MIN,
                "Q0_std [l/min]": dq0 * L_MIN,
                "k [um/(l/min)]": k * 1e6 / L_MIN,
                "k_std [um/(l/min)]": dk * 1e6 / L_MIN,
                "worst_error [um]": fit.worst * 1e6,
                "worst_error [% of stroke]": 100.0 * fit.worst / macro.stroke,
                "smooth_worst_error [um]": fit.smooth_worst * 1e6,
                "smooth_worst_error [% of stroke]": 100.0 * fit.smooth_worst / macro.stroke,
            }
            if model == "HM":
                row["two_terms_worst_error [um]"] = study.two_terms[i].worst * 1e6
            rows.append(row)
    return pd.DataFrame(rows)
