"""Every file that `servo --out` writes, as bytes and text in memory: whole before the first one is written."""

import base64
from importlib.metadata import version

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from ..fit_json import json_text
from ..plot_style import png, style, svg
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
    with style():
        vectors = {name: svg(figure) for name, figure in figures.items()}
        files: dict[str, bytes | str] = {f"{name}.svg": drawing for name, drawing in vectors.items()}
        files |= {f"{name}.png": png(figure) for name, figure in figures.items()}
    files["servo.json"] = json_text(servo_json(study))
    files["report.html"] = servo_page(study, vectors)
    return files


def servo_page(study: ServoStudy, figures: dict[str, bytes]) -> str:
    """`report.html`: one page without network access; every text is escaped by the template engine."""
    loader = PackageLoader("thermohyd.identify", "templates")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.get_template("servo.html").render(
        name=study.subject.name,
        conditions=words.conditions_in_words(study),
        actuator=words.actuator_in_words(study),
        oil=study.subject.model.oil.name,
        sentences=words.sentences(study),
        alarm=any(words.alarming(sentence) for sentence in words.sentences(study)),
        notes=study.subject.notes,
        columns=tables.COLUMNS,
        slopes=tables.SLOPES,
        models=[(CAPTIONS[m], tables.rows(study, m), tables.slope_rows(study, m)) for m in MODELS],
        figures={name: base64.b64encode(drawing).decode("ascii") for name, drawing in figures.items()},
        version=version("thermohyd"),
    )
