"""Every output of a sensitivity study: `sensitivity.json` (SI), the page, the figures, and one screen in a terminal.

The terminal shows the ranked table, the temperature drifts and the next test. The files are bytes and text in memory: whole
before the first one is written.
"""

from collections.abc import Iterable
from importlib.metadata import version
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from thermohyd.identify.report.fit_json import fields_of, json_text, plain, rounded
from thermohyd.identify.report.next_steps import Step, command, path_of
from thermohyd.identify.report.origin import origin
from thermohyd.identify.report.page import page
from thermohyd.identify.report.style import drawn
from thermohyd.identify.report.terminal import heading, indented, table

from . import words
from .curves import READING, TESTS
from .drift import CAUSES
from .figures import along_figure, curve_figure, drift_figure, sobol_figure
from .next_test_figures import information_figure, next_test_figure, posterior_figure
from .result import InformationStudy, PosteriorStudy, SensitivityResult
from .shown_curves import sensitivity_views


SCHEMA = "thermohyd-sensitivity/1"
BINS = 24


def sensitivity_json(result: SensitivityResult) -> dict[str, Any]:
    """The content of `sensitivity.json`; what is not finite becomes null."""
    s = result.subject
    content = {
        "schema": SCHEMA,
        "units": "SI: m, Pa (gauge), K, m3/s; gains Pa/m, m2/s, m3/(s Pa); viscosity and density in units of the oil's table",
        "name": s.name,
        "conditions": fields_of(
            s, "temperature", "supply_pressure", "return_pressure", "temperatures", "supply_pressures"
        ),
        "ranking": [{"factor": result.factors[i].name, "mean_total_index": result.weight(i)} for i in result.ranking()],
        "factors": {
            f.name: {
                "value": f.value,
                "unit": f.unit,
                "tolerance": f.tolerance,
                "interval": [f.low, f.high],
                "normalised": "relative" if f.relative else "per tolerance",
                "meaning": f.meaning,
            }
            for f in result.factors
        },
        "figures": _figures(result),
        "actuator": None if result.actuator is None else result.actuator.to_dict(),
        "temperature": _temperature(result),
        "curves": _curves(result),
        "curve_total_indices": {
            "share_of_stroke": result.tolerances.shares,
            **{
                test: {f.name: result.tolerances.along[test][i] for i, f in enumerate(result.factors)} for test in TESTS
            },
        },
        "sobol": {
            "evaluations": result.tolerances.sobol.evaluations,
            "base_samples": result.tolerances.sobol.base,
            "derivative_samples": result.tolerances.derivative.samples,
            "inputs": "uniform over each factor's interval, independent",
            "confidence": "half widths of 95 % bootstrap intervals",
        },
        "posterior": None if result.posterior is None else _posterior(result.posterior, result),
        "information": _information(result.information, s.model.valve.stroke),
        "noise": s.noise.words(),
        "seconds": result.seconds,
        "notes": result.notes,
    }
    return rounded(plain(content))


def _figures(result: SensitivityResult) -> dict[str, Any]:
    sobol, derivative = result.tolerances.sobol, result.tolerances.derivative
    elasticity = result.elasticity()
    return {
        output.name: {
            "meaning": output.meaning,
            "value": result.nominal[o],
            "unit": output.unit,
            "mean_over_tolerances": sobol.mean[o],
            "std_over_tolerances": np.sqrt(sobol.variance[o]),
            "factors": {
                f.name: {
                    "slope": result.slope[i, o],
                    "normalised": elasticity[i, o],
                    "first_order": sobol.first[o, i],
                    "first_order_ci": sobol.first_ci[o, i],
                    "total": sobol.total[o, i],
                    "total_ci": sobol.total_ci[o, i],
                    "derivative_measure": derivative.nu[o, i],
                    "mean_slope": derivative.mean_slope[o, i],
                    "bound_of_total": derivative.bound[o, i],
                    "bound_of_total_ci": derivative.bound_ci[o, i],
                }
                for i, f in enumerate(result.factors)
            },
        }
        for o, output in enumerate(result.outputs)
    }


def _temperature(result: SensitivityResult) -> dict[str, Any]:
    return {
        name: {
            "unit": drift.unit,
            "temperature": drift.temperature,
            "value": drift.value,
            "per_kelvin": drift.slope,
            "relative_per_kelvin": drift.relative,
            "parts_per_kelvin": dict(zip(CAUSES, drift.parts, strict=True)),
        }
        for name, drift in result.drifts.items()
    }


def _curves(result: SensitivityResult) -> dict[str, Any]:
    c, at = result.curves, result.subject
    found: dict[str, Any] = {}
    for test in TESTS:
        conditions = []
        normalised = c.normalised(test)
        for temperature in at.temperatures:
            rows = c.rows_at(temperature, at.supply_pressure)
            conditions.append(
                {
                    "temperature": temperature,
                    "supply_pressure": at.supply_pressure,
                    "position": c.position[rows],
                    "value": c.value[test][rows],
                    "normalised": {f.name: normalised[i, rows] for i, f in enumerate(c.factors)},
                }
            )
        found[test] = {
            "reading": READING[test],
            "relative_to": "the reading" if test == "leakage" else "the largest reading of the curve",
            "at": conditions,
        }
    return found


def _posterior(study: PosteriorStudy, result: SensitivityResult) -> dict[str, Any]:
    p = study.posterior
    return {
        "of": [factor.name for factor in p.factors],
        "std": p.std,
        "directions": [
            {"name": name, "in_units_of_std": direction, "spread": spread}
            for name, direction, spread in zip(p.names, p.directions, p.spread, strict=True)
        ],
        "evaluations": study.sobol.evaluations,
        "figures": {
            output.name: {
                "unit": output.unit,
                "std": study.std[o],
                "linear_std": study.linear_std[o],
                "first_order": study.sobol.first[o],
                "total": study.sobol.total[o],
                "total_ci": study.sobol.total_ci[o],
            }
            for o, output in enumerate(result.outputs)
        },
    }


def _information(study: InformationStudy, stroke: float) -> dict[str, Any]:
    m = study.measurements
    edges = np.linspace(-1.0, 1.0, BINS + 1)
    place = np.sign(m.position) * np.sqrt(np.abs(m.position) / stroke)
    keys = list(zip(m.test.tolist(), m.temperature.tolist(), m.supply_pressure.tolist(), strict=True))
    tests = {}
    for test in dict.fromkeys(m.test.tolist()):
        rows = m.test == test
        binned = {
            name: np.histogram(place[rows], edges, weights=study.share[rows, i])[0]
            for i, name in enumerate(m.parameters)
        }
        tests[test] = {"share": {name: float(b.sum()) for name, b in binned.items()}, "by_position": binned}
    by_condition: dict[tuple, np.ndarray] = {}
    if len(set(keys)) <= 60:
        for key, share in zip(keys, study.share, strict=True):
            by_condition[key] = by_condition.get(key, 0.0) + share
    return {
        "of": study.of,
        "position_edges": np.sign(edges) * edges**2 * stroke,
        "tests": tests,
        "conditions": [
            {
                "test": k[0],
                "temperature": k[1],
                "supply_pressure": k[2],
                "share": dict(zip(m.parameters, v, strict=True)),
            }
            for k, v in by_condition.items()
        ],
        "known_std": study.known,
        "known_from": study.source,
        "next_tests": [
            {
                "test": choice.test,
                "temperature": choice.temperature,
                "supply_pressure": choice.supply_pressure,
                "log_det_gain": choice.gain,
                "std_after": choice.std,
            }
            for choice in study.tests
        ],
        "d_optimal_points": [
            {"test": test, "temperature": t, "supply_pressure": p, "position": x, "readings": int(n)}
            for test, t, p, x, n in zip(
                study.points.test.tolist(),
                study.points.temperature.tolist(),
                study.points.supply_pressure.tolist(),
                study.points.position.tolist(),
                study.repeats,
                strict=True,
            )
        ],
    }


def sensitivity_figures(result: SensitivityResult) -> dict[str, Figure]:
    """{file name without ending: figure}, in the order in which a report shows them."""
    figures = {"sobol": sobol_figure(result), "sobol_along": along_figure(result), "drift": drift_figure(result)}
    figures |= {test: curve_figure(result, test) for test in TESTS}
    figures["information"] = information_figure(result)
    figures["next_test"] = next_test_figure(result)
    if result.posterior is not None:
        figures["posterior"] = posterior_figure(result, result.posterior)
    return figures


def sensitivity_files(result: SensitivityResult) -> dict[str, bytes | str]:
    """{file name: content}: sensitivity.json, report.html, and a PNG and an SVG per figure."""
    figures = sensitivity_figures(result)
    vectors, files = drawn(figures)
    files["sensitivity.json"] = json_text(sensitivity_json(result))
    files["report.html"] = sensitivity_page(result, vectors, version("thermohyd"))
    return files


def next_steps(result: SensitivityResult) -> list[Step]:
    """The sweep that tells most, then what to do with it."""
    steps = [Step(sentence) for sentence in words.next_test_sentences(result)]
    if result.subject.fit is not None:
        return [
            *steps,
            Step("Add it to the record, and fit again.", command("fit", path_of(result.subject.fit.record))),
        ]
    return [
        *steps,
        Step(
            "Tolerances of your own change the ranking: state them.",
            command("sensitivity", "BENCH", "--settings", "FILE"),
        ),
    ]


def sensitivity_page(result: SensitivityResult, figures: dict[str, bytes], version: str) -> str:
    """`report.html`: one page without network access; every text is escaped by the template engine."""
    return page(
        "sensitivity.html",
        figures,
        views=sensitivity_views(result),
        origin=origin("sensitivity", [] if result.subject.fit is None else [result.subject.fit.record]),
        answer=words.answer_sentences(result),
        next_steps=next_steps(result),
        name=result.subject.name,
        conditions=words.conditions_in_words(result),
        oil=result.subject.model.oil.name,
        result=result,
        evaluations=f"{result.tolerances.sobol.evaluations:,}",
        interval=f"{words.largest_interval(result):.0f}",
        ranking_columns=words.RANKING_COLUMNS,
        ranking=words.ranking_rows(result),
        spread=words.spread_row(result),
        drift_columns=words.DRIFT_COLUMNS,
        drifts=words.drift_rows(result),
        actuator=words.actuator_sentence(result.actuator),
        information=words.information_sentences(result),
        of=result.information.of,
        noise=result.subject.noise.words(),
        posterior=words.posterior_sentences(result),
        tests=TESTS,
        version=version,
    )


FIRST_CAUSE = 4  # of the drift table's columns


def print_sensitivity(result: SensitivityResult, console: Console) -> None:
    """Write the tables to a console."""
    sobol = result.tolerances.sobol
    console.print(
        heading(f"Which parameter matters: {result.subject.name}, {words.conditions_in_words(result)}"), highlight=False
    )
    console.print(_ranking(console, result))
    _line(
        console,
        f"Total Sobol indices in % over the tolerances (+/- {words.largest_interval(result):.0f} at most), sign: which way the "
        f"figure moves; {sobol.evaluations:,} evaluations.",
    )
    console.print(heading("Drift with temperature, and the causes of it [%/K]"), highlight=False)
    console.print(_drifts(result))
    _line(console, words.actuator_sentence(result.actuator))
    console.print(heading("What to measure"), highlight=False)
    for sentence in words.next_test_sentences(result):
        _line(console, sentence)
    if result.posterior is not None:
        console.print(heading("What the fit leaves uncertain"), highlight=False)
        for sentence in words.posterior_sentences(result):
            _line(console, sentence)
    for note in result.notes:
        _line(console, note, "yellow")


def _line(console: Console, text: str, style: str = "") -> None:
    console.print(Padding(Text(text, style=style), (0, 0, 0, 2)))


def _narrow(headings: Iterable[str]) -> list[str]:
    """Headings over two lines each."""
    return [title.replace(" ", "\n", 1) for title in headings]


def _ranking(console: Console, result: SensitivityResult) -> Padding:
    columns = words.RANKING_COLUMNS
    keep = [0, 1, 2, 3, 4] if console.width >= 106 else [1, 3, 4] if console.width >= 92 else [1, 4]
    rows = []
    for row in words.ranking_rows(result):
        style = "bold" if int(row[4]) >= 10 else ""
        rows.append([Text(cell, style=style) for cell in (*(row[i] for i in keep), *row[5:])])
    made = table(_narrow((*(columns[i] for i in keep), *columns[5:])), rows)
    label = ["" for _ in keep]
    label[keep.index(1)] = "spread (1 std)"
    made.add_section()
    made.add_row(*[Text(cell, style="dim") for cell in (*label, *words.spread_row(result))])
    return indented(made)


def _drifts(result: SensitivityResult) -> Padding:
    rows = words.drift_rows(result)
    # A cause that moves nothing needs no column.
    keep = [i for i in range(len(words.DRIFT_COLUMNS)) if i < FIRST_CAUSE or any(row[i] != "0" for row in rows)]
    return indented(table(_narrow(words.DRIFT_COLUMNS[i] for i in keep), [[row[i] for i in keep] for row in rows]))
