"""Every output of a servo study: `servo.json` (SI), the page, the figures, and a terminal of 80 columns.

The files are bytes and text in memory: whole before the first one is written.
"""

from dataclasses import fields
from importlib.metadata import version
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from thermohyd.dynamics.linear import LoopFigures
from thermohyd.identify.report.fit_json import json_text, plain, rounded
from thermohyd.identify.report.next_steps import Step, command
from thermohyd.identify.report.origin import origin
from thermohyd.identify.report.page import page
from thermohyd.identify.report.style import drawn
from thermohyd.identify.report.terminal import heading, indented, table

from . import study as tables, words
from .figures import bode_of_study, phase, step_figure, trend_figure
from .shown_curves import servo_views
from .study import MODELS, ServoStudy


SCHEMA = "thermohyd-servo/1"
EVERY = 16  # of the frequency response's pulsations
ROWS = 400  # of a step response


def servo_json(study: ServoStudy) -> dict[str, Any]:
    """The content of `servo.json`; what is not finite becomes null."""
    s = study.subject
    content = {
        "schema": SCHEMA,
        "units": "SI: m, s, Pa (gauge), K, rad/s; margins: factor of gain and degrees; closed loop: factor",
        "name": s.name,
        "conditions": {
            "temperature": s.temperatures,
            "kinematic_viscosity": study.viscosity,
            "supply_pressure": s.supply_pressure,
            "return_pressure": s.return_pressure,
            "step": s.step,
        },
        "actuator": s.actuator.to_dict(),
        "models": {model: _model(study, model) for model in MODELS},
        "in_words": words.sentences(study),
        "notes": s.notes,
        "seconds": study.seconds,
    }
    return rounded(plain(content))


def _model(study: ServoStudy, model: str) -> dict[str, Any]:
    loop, step, linear = study.loops[model], study.steps[model], study.linear[model]
    names = [field.name for field in fields(LoopFigures)]
    keep = np.unique(np.linspace(0, step.readings.time.shape[1] - 1, ROWS).astype(int))
    shown = ("time", "piston_position", "spool_position", "pressure_a", "pressure_b", "temperature_a", "temperature_b")
    opened, closed = np.asarray(loop.opened), loop.closed
    return {
        "stable": loop.stable,
        "largest_gain_rise": study.gain_rise[model],
        "gain_margin_of_large_motions": study.large_margin(model),
        "small_signal": {name: np.asarray(getattr(loop.figures, name)) for name in names},
        "per_kelvin": {name: np.asarray(getattr(loop.slope, name)) for name in names},
        "closed_loop_poles": {"real": np.real(loop.poles), "imaginary": np.imag(loop.poles)},
        "step": {
            **step.figures._asdict(),
            "largest_pressure": step.largest_pressure,
            "heating": step.heating,
        },
        "linear_formulas": {field.name: getattr(linear, field.name) for field in fields(linear)},
        "frequency_response": {
            "pulsation": loop.pulsation[::EVERY],
            "open": {"magnitude": np.abs(opened)[:, ::EVERY], "phase": phase(opened)[:, ::EVERY]},
            "closed": {"magnitude": np.abs(closed)[:, ::EVERY], "phase": phase(closed)[:, ::EVERY]},
        },
        "step_response": {name: np.asarray(getattr(step.readings, name))[:, keep] for name in shown},
    }


CAPTIONS = {"THM": "THM: the oil in the chambers keeps its heat", "HM": "HM: isothermal oil"}


def servo_figures(study: ServoStudy) -> dict[str, Figure]:
    """{file name without ending: figure}, in the order in which the page shows them."""
    return {"step": step_figure(study), "trend": trend_figure(study), "bode": bode_of_study(study)}


def servo_files(study: ServoStudy) -> dict[str, bytes | str]:
    """{file name: content}: servo.json, report.html, and a PNG and an SVG per figure."""
    figures = servo_figures(study)
    vectors, files = drawn(figures)
    files["servo.json"] = json_text(servo_json(study))
    files["report.html"] = servo_page(study, vectors)
    return files


def next_steps(study: ServoStudy) -> list[Step]:
    """What the loop asks for: the gain that it stands at every temperature, else what to look at with it."""
    gain = study.large_margin("THM")
    own = float(study.subject.actuator.amplifier_gain)
    room = words.room_for_gain(study)
    if not room or not np.all(np.isfinite(gain)):
        return [
            Step(
                "The gain margin is not known at every temperature: look at the Bode diagram before the gain is changed."
            )
        ]
    stands = f"{own * float(np.min(gain)) / words.SAFE:.2g} A/V"
    return [Step(room[0]), Step("See what that gain does to the steps.", command("servo", "BENCH", "--gain", stands))]


def servo_page(study: ServoStudy, figures: dict[str, bytes]) -> str:
    """`report.html`: one page without network access."""
    steps = next_steps(study)
    sentences = [sentence for sentence in words.sentences(study) if sentence != steps[0].words]
    return page(
        "servo.html",
        figures,
        views=servo_views(study),
        origin=origin("servo"),
        next_steps=steps,
        name=study.subject.name,
        conditions=words.conditions_in_words(study),
        actuator=words.actuator_in_words(study),
        oil=study.subject.model.oil.name,
        sentences=sentences,
        alarm=any(words.alarming(sentence) for sentence in sentences),
        notes=study.subject.notes,
        columns=[f">{title}" for title in tables.COLUMNS],
        slopes=[f">{title}" for title in tables.SLOPES],
        models=[(CAPTIONS[m], tables.rows(study, m), tables.slope_rows(study, m)) for m in MODELS],
        version=version("thermohyd"),
    )


def print_servo(study: ServoStudy, console: Console) -> None:
    """The sentences, then a row per temperature and model."""
    title = f"The position loop over temperature: {study.subject.name}, {words.conditions_in_words(study)}"
    console.print(Text(title, style="bold cyan"), highlight=False)
    console.print(Text(words.actuator_in_words(study)))
    for model in MODELS:
        title = "THM: the oil keeps its heat" if model == "THM" else "HM: isothermal oil"
        console.print(heading(title), highlight=False)
        console.print(_table(study, model))
    console.print()
    for sentence in words.sentences(study):
        console.print(Text(sentence, style="bold red" if words.alarming(sentence) else ""))
    for note in study.subject.notes:
        console.print(Text(note, style="yellow"))


def _table(study: ServoStudy, model: str) -> Padding:
    headings = [">" + "\n".join(title.rsplit(" ", 1)) for title in tables.COLUMNS]
    shown = []
    for row in tables.rows(study, model):
        style = "red" if tables.UNSTABLE in row else ""
        shown.append([Text(cell, style=style) for cell in row])
    return indented(table(headings, shown))
