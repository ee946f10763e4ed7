"""Every file that `servo --out` writes, as bytes and text in memory: whole before the first one is written."""

from importlib.metadata import version

from matplotlib.figure import Figure

from ..fit_json import json_text
from ..page import page
from ..plot_style import drawn
from . import tables, words
from .servo_json import servo_json
from .servo_plots import bode_of_study, step_figure, trend_figure
from .study import MODELS, ServoStudy


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


def servo_page(study: ServoStudy, figures: dict[str, bytes]) -> str:
    """`report.html`: one page without network access."""
    sentences = words.sentences(study)
    return page(
        "servo.html",
        figures,
        name=study.subject.name,
        conditions=words.conditions_in_words(study),
        actuator=words.actuator_in_words(study),
        oil=study.subject.model.oil.name,
        sentences=sentences,
        alarm=any(words.alarming(sentence) for sentence in sentences),
        notes=study.subject.notes,
        columns=tables.COLUMNS,
        slopes=tables.SLOPES,
        models=[(CAPTIONS[m], tables.rows(study, m), tables.slope_rows(study, m)) for m in MODELS],
        version=version("thermohyd"),
    )
