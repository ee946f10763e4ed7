"""Every file that `seed --out` writes, as bytes and text in memory: whole before the first one is written."""

from importlib.metadata import version

from matplotlib.figure import Figure

from ..fit_json import json_text
from ..macro_output import macro_formulas, macro_json
from ..page import page
from ..plot_style import drawn
from . import gain_figures as gains, leakage_figures as leaks, seed_valve as paper
from .macro_figure import macro_figure
from .seed_json import seed_json, seed_tables
from .seed_study import SeedStudy


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
        "figure_3": leaks.figure_3(curves, drawn),
        "figure_4": leaks.figure_4(curves),
        "figure_5": leaks.figure_5(curves),
        "figure_6": gains.figure_6(curves, paper.NOMINAL_PRESSURE),
        "figure_7": gains.figure_7(curves, drawn),
        "figure_8": gains.figure_8(curves, paper.NOMINAL_FLOW),
        "heat": gains.heat_figure(curves),
        "eq6": macro_figure(study.macro["HM"], study.two_terms, drawn),
    }


def seed_files(study: SeedStudy) -> dict[str, bytes | str]:
    """{file name: content}: seed.json, eq6.json, seed.html, the CSVs, and a PNG and an SVG per figure."""
    oil = paper.seed_valve().oil
    figures = seed_figures(study)
    vectors, files = drawn(figures)
    files |= seed_tables(study)
    files["seed.json"] = json_text(seed_json(study))
    files["eq6.json"] = json_text({model: macro_json(fit, oil) for model, fit in study.macro.items()})
    files["seed.html"] = seed_page(study, vectors)
    return files


def seed_page(study: SeedStudy, vectors: dict[str, bytes]) -> str:
    """`seed.html`: claims, figures and Eq. 6 on one page without network access."""
    return page(
        "seed.html",
        {CAPTIONS[name]: drawing for name, drawing in vectors.items()},
        study=study,
        macro=study.macro["HM"],
        formulas=macro_formulas(study.macro["HM"], paper.seed_valve().oil),
        version=version("thermohyd"),
    )
