"""Every output of `thermohyd seed`: `seed.json`, CSVs, the page, the figures, and a line per claim in a terminal.

The files are bytes and text in memory: whole before the first one is written.
"""

import io
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from rich.console import Console
from rich.text import Text

from thermohyd import seed_paper as paper
from thermohyd.identify.bench.shown_units import BAR, CELSIUS, CST, L_MIN, UM
from thermohyd.identify.flow_curve_fit import flow_curve_formulas, flow_curve_json
from thermohyd.identify.report.fit_json import json_text
from thermohyd.identify.report.next_steps import Step, command
from thermohyd.identify.report.origin import origin
from thermohyd.identify.report.page import page
from thermohyd.identify.report.style import drawn
from thermohyd.identify.report.terminal import table

from . import figures
from .curves import MODELS, SeedCurves
from .figures import macro_figure
from .shown_curves import seed_views
from .study import SeedStudy


OPENINGS = (0.0, 0.01, 0.025, 0.03, 0.05, 0.1, 1.0)  # whose gains go into gains.csv


def seed_json(study: SeedStudy) -> dict[str, Any]:
    """Claims and Eq. 6 as dictionaries, curves as nested lists in SI units, axes named."""
    curves, oil = study.curves, paper.seed_valve().oil
    drawn = study.drawn
    names = ("leakage", "load_pressure", "pressure_gain", "flow", "flow_gain")
    return {
        "units": "SI: m, Pa (gauge), K, m3/s; viscosity m2/s; opening as a share of the stroke",
        "edge_law": study.edge_law,
        "claims": [asdict(claim) for claim in study.claims],
        **(
            {}
            if study.of_the_paper is None
            else {"claims_with_the_orifice_law": [asdict(claim) for claim in study.of_the_paper]}
        ),
        "claims_that": {word: study.count(word) for word in ("holds", "partly", "no")},
        "eq6": {model: flow_curve_json(fit, oil) for model, fit in study.macro.items()},
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
                "X0 [um]": x0 * UM,
                "X0_std [um]": dx0 * UM,
                "Q0 [l/min]": q0 * L_MIN,
                "Q0_std [l/min]": dq0 * L_MIN,
                "k [um/(l/min)]": k * UM / L_MIN,
                "k_std [um/(l/min)]": dk * UM / L_MIN,
                "worst_error [um]": fit.worst * UM,
                "worst_error [% of stroke]": 100.0 * fit.worst / macro.stroke,
                "smooth_worst_error [um]": fit.smooth_worst * UM,
                "smooth_worst_error [% of stroke]": 100.0 * fit.smooth_worst / macro.stroke,
            }
            if model == "HM":
                row["two_terms_worst_error [um]"] = study.two_terms[i].worst * UM
            rows.append(row)
    return pd.DataFrame(rows)


CAPTIONS = {
    "figure_3": "Leakage against opening at several temperatures",
    "figure_4": "Leakage at 0, 2.5 and 5 % opening at 300 cSt, at 70 and 210 bar",
    "figure_5": "Leakage against temperature",
    "figure_6": "Pressure gain against temperature at 1 and 3 % opening",
    "figure_7": "Flow against opening at several temperatures",
    "figure_8": "Flow gain at small opening against temperature",
    "heat": "THM against HM at 70 and 210 bar",
    "eq6": "Eq. 6: curves, errors and parameters",
}


def seed_figures(study: SeedStudy) -> dict[str, Figure]:
    """{name: figure}, the paper's Figures 3 to 8, the effect of heat and Eq. 6."""
    curves, drawn = study.curves, study.drawn
    return {
        "figure_3": figures.figure_3(curves, drawn),
        "figure_4": figures.figure_4(curves),
        "figure_5": figures.figure_5(curves),
        "figure_6": figures.figure_6(curves, paper.NOMINAL_PRESSURE),
        "figure_7": figures.figure_7(curves, drawn),
        "figure_8": figures.figure_8(curves, paper.NOMINAL_FLOW),
        "heat": figures.heat_figure(curves),
        "eq6": macro_figure(study.macro["HM"], study.two_terms, drawn),
    }


def seed_files(study: SeedStudy) -> dict[str, bytes | str]:
    """{file name: content}: seed.json, eq6.json, seed.html, the CSVs, and a PNG and an SVG per figure."""
    oil = paper.seed_valve().oil
    figures = seed_figures(study)
    vectors, files = drawn(figures)
    files |= seed_tables(study)
    files["seed.json"] = json_text(seed_json(study))
    files["eq6.json"] = json_text({model: flow_curve_json(fit, oil) for model, fit in study.macro.items()})
    files["seed.html"] = seed_page(study, vectors)
    return files


NEXT_STEPS = (
    Step("For a model of a system take the smooth laws of Eq. 6 below, or eq6.json: an opening from a flow, without iteration."),
    Step("See which claims stand with the other law of an edge.", command("seed", "--edge-law", "lubrication", "--out", "FOLDER")),
    Step("Ask the same of your own valve: fit its record.", command("new", "FOLDER")),
)  # fmt: skip


def seed_page(study: SeedStudy, vectors: dict[str, bytes]) -> str:
    """`seed.html`: claims, figures and Eq. 6 on one page without network access."""
    return page(
        "seed.html",
        {CAPTIONS[name]: drawing for name, drawing in vectors.items()},
        views={"seed": seed_views(study)},
        drawn=[CAPTIONS[name] for name in vectors if name != "figure_4"],
        origin=origin("seed"),
        next_steps=NEXT_STEPS,
        study=study,
        score=_score(study),
        macro=study.macro["HM"],
        formulas=flow_curve_formulas(study.macro["HM"], paper.seed_valve().oil),
        version=version("thermohyd"),
    )


def _score(study: SeedStudy) -> str:
    return f"{len(study.claims)} claims: {study.count('holds')} hold, {study.count('partly')} in part, {study.count('no')} not."


COLOURS = {"holds": "green", "partly": "yellow", "no": "red"}


def print_seed(study: SeedStudy, console: Console) -> None:
    """A row per claim with its figure, and the error of Eq. 6."""
    verdict = lambda claim: Text(claim.holds, style=COLOURS[claim.holds])
    rows = [(claim.title, claim.short, verdict(claim)) for claim in study.claims]
    if study.of_the_paper is None:
        console.print(table(("claim of the paper", "computed", ""), rows, gap=2))
    else:
        both = [(*row, own.short, verdict(own)) for row, own in zip(rows, study.of_the_paper, strict=True)]
        console.print(table(("claim of the paper", study.edge_law, "", "orifice", ""), both, gap=2))
        console.print(Text(next(claim.computed for claim in study.claims if claim.key == "hm_pressure_gain_constant")))
    macro = study.macro["HM"]
    own = max(fit.worst for fit in macro.fits)
    console.print(
        Text(
            f"{_score(study)}\n"
            f"Eq. 6 misses the opening by at most {own * UM:.1f} um ({100 * own / macro.stroke:.1f} % of stroke) at each temperature "
            f"alone, {macro.worst * UM:.1f} um ({100 * macro.worst / macro.stroke:.1f} %) with smooth laws."
        )
    )
