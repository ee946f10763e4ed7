"""Figure of what a fit left uncertain: the independent directions of its parameters, and what each does to the figures."""

import numpy as np
from matplotlib.figure import Figure

from .. import plot_style as look
from .plot_parts import sheet
from .result import PosteriorStudy, SensitivityResult
from .words import SHORT


def posterior_figure(result: SensitivityResult, study: PosteriorStudy) -> Figure:
    """Left: each direction in units of the parameters' errors; right: total indices of the directions on each figure."""
    p = study.posterior
    names = [name for name in SHORT if study.std[study.sobol.outputs.index(name)] > 0.0]
    rows = [study.sobol.outputs.index(name) for name in names]
    count = len(p.spread)
    with look.style():
        figure = sheet(
            "What the fit leaves uncertain",
            f"{result.subject.name}: independent directions of the parameters, the most uncertain first, and which figure hangs on which",
            12.0,
            1.9 + 0.36 * max(count, 5),
        )
        axes = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.0, 1.15)})
        figure.subplots_adjust(left=0.09, right=0.985, top=0.76, bottom=0.27, wspace=0.22)
        _matrix(axes[0], p.directions, "RdBu_r", -1.0)
        axes[0].set_xticks(range(count), [f.name for f in p.factors], rotation=25, ha="right", rotation_mode="anchor")
        axes[0].set_yticks(range(count), [f"{i + 1}  (± {spread:.2g})" for i, spread in enumerate(p.spread)])
        axes[0].set_title("directions, in standard errors", loc="left", color=look.FAINT)
        total = np.clip(study.sobol.total[rows].T, 0.0, 1.0)
        _matrix(axes[1], total, "Blues", 0.0)
        marks = [
            f"{SHORT[name]}\n± {100 * study.std[o] / abs(result.nominal[o]):.2g} %"
            if abs(result.nominal[o]) > study.std[o]
            else SHORT[name]
            for name, o in zip(names, rows, strict=True)
        ]
        axes[1].set_xticks(range(len(names)), marks, fontsize=7.5)
        axes[1].set_yticks(range(count), [str(i + 1) for i in range(count)])
        axes[1].set_title("share of each figure's variance by direction", loc="left", color=look.FAINT)
    return figure


def _matrix(axes, table: np.ndarray, colours: str, low: float) -> None:
    axes.imshow(table, cmap=colours, vmin=low, vmax=1.0, aspect="auto")
    axes.grid(False)
    for i, row in enumerate(table):
        for j, value in enumerate(row):
            if abs(value) >= 0.01:
                axes.text(
                    j,
                    i,
                    f"{value:.2f}",
                    ha="center",
                    va="center",
                    fontsize=7.5,
                    color="white" if abs(value) > 0.6 else look.INK,
                )
