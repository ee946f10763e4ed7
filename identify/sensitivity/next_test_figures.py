"""Draw the information: which measurement tells which parameter, what each next sweep would bring, and what a fit left uncertain."""

import numpy as np
from matplotlib.figure import Figure

from thermohyd.identify.bench.shown_units import BAR, CELSIUS
from thermohyd.identify.report import style as look

from .curves import TESTS
from .figures import position_axis, sheet, stretched
from .next_test import Measurements
from .result import PosteriorStudy, SensitivityResult
from .words import SHORT, TEST_WORDS


BINS = 31
MOST_ROWS = 40


def information_figure(result: SensitivityResult) -> Figure:
    """One map per parameter: test and condition down, position across, the share of the information as colour."""
    study, stroke = result.information, result.subject.model.valve.stroke
    m = study.measurements
    labels, row_of = _conditions(m)
    edges = np.linspace(-1.0, 1.0, BINS + 1)
    columns = 3
    rows = -(-len(m.parameters) // columns)
    with look.style():
        panel_height = 0.7 + 0.10 * max(len(labels), 12)
        height = rows * (panel_height + 0.55) + 0.95
        figure = sheet(
            "Where the information on each parameter is",
            f"Share of {study.of}, with what the other unknown parameters take already lost. Each map adds up to 100 %",
            12.0,
            height,
        )
        grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
        figure.subplots_adjust(
            left=0.155,
            right=0.985,
            top=1.0 - 0.95 / height,
            bottom=0.5 / height,
            wspace=0.12,
            hspace=0.55 / panel_height,
        )
        x = stretched(m.position, stroke)
        for i, (panel, name) in enumerate(zip(grid.flat, m.parameters, strict=False)):
            share = np.nan_to_num(study.share[:, i])
            table = np.histogram2d(row_of, x, bins=[np.arange(len(labels) + 1) - 0.5, edges], weights=share)[0]
            largest = float(table.max())
            panel.imshow(
                100.0 * table,
                aspect="auto",
                extent=(-1.0, 1.0, len(labels) - 0.5, -0.5),
                cmap="Blues",
                vmin=0.0,
                vmax=100.0 * largest or 1.0,
                interpolation="nearest",
            )
            by_test = [
                f"{100 * share[m.test == t].sum():.0f} % {t.split('_')[0]}" for t in TESTS if (m.test == t).any()
            ]
            panel.set_title(f"{name}: {', '.join(by_test)}", loc="left", fontsize=7.4)
            for line in _borders(labels):
                panel.axhline(line, color=look.FAINT, linewidth=0.8)
            position_axis(panel, stroke)
            panel.grid(False)
            if i >= len(m.parameters) - columns:
                panel.set_xlabel("position [% of stroke]")
        for line in grid:
            line[0].set_yticks(range(len(labels)), labels, fontsize=6.3)
        for panel in list(grid.flat)[len(m.parameters) :]:
            panel.set_visible(False)
    return figure


def _conditions(m: Measurements) -> tuple[list[str], np.ndarray]:
    """(label of each row of the map, row of each point): tests, then temperature, then pressure."""
    t_group, temperatures = look.group(m.temperature - CELSIUS, 4.0)
    p_group, pressures = look.group(m.supply_pressure * BAR, max(4.0, 0.06 * float(m.supply_pressure.max()) * BAR))
    test = np.array([TESTS.index(name) for name in m.test.tolist()])
    keys = np.stack([test, t_group, p_group], axis=1)
    used, row_of = np.unique(keys, axis=0, return_inverse=True)
    labels = [
        f"{TEST_WORDS[TESTS[a]]}, {round(temperatures[b])} °C, {pressures[c]:.0f} bar" for a, b, c in used.tolist()
    ]
    return labels, row_of.reshape(-1)


def _borders(labels: list[str]) -> list[float]:
    first = [label.split(",")[0] for label in labels]
    return [i - 0.5 for i in range(1, len(first)) if first[i] != first[i - 1]]


def next_test_figure(result: SensitivityResult) -> Figure:
    """The gain in ln det of the information by every possible next sweep, and each parameter's error before and after."""
    study = result.information
    factors = {f.name: f for f in result.factors}
    temperatures = sorted({choice.temperature for choice in study.tests})
    pressures = sorted({choice.supply_pressure for choice in study.tests})
    gain = {(c.test, c.temperature, c.supply_pressure): c.gain for c in study.tests}
    best = study.tests[0]
    largest = max(gain.values())
    with look.style():
        figure = sheet(
            "The next test",
            f"Gain in ln det of the information by one more sweep, given {study.source}; right: errors after the best one",
            12.0,
            3.9,
        )
        axes = figure.subplots(1, 3)
        figure.subplots_adjust(left=0.055, right=0.635, top=0.77, bottom=0.14, wspace=0.22)
        right = figure.add_axes((0.765, 0.14, 0.215, 0.63))
        for panel, test in zip(axes, TESTS, strict=True):
            table = np.array([[gain[test, t, p] for p in pressures] for t in temperatures])
            panel.imshow(table, aspect="auto", cmap="Blues", vmin=0.0, vmax=largest, origin="lower")
            for i, t in enumerate(temperatures):
                for j, p in enumerate(pressures):
                    chosen = (test, t, p) == (best.test, best.temperature, best.supply_pressure)
                    panel.text(
                        j,
                        i,
                        f"{table[i, j]:.1f}" + (" best" if chosen else ""),
                        ha="center",
                        va="center",
                        fontsize=8.5,
                        fontweight="bold" if chosen else "normal",
                        color="white" if table[i, j] > 0.6 * largest else look.INK,
                    )
            panel.set_xticks(range(len(pressures)), [f"{p * BAR:.0f}" for p in pressures])
            panel.set_yticks(range(len(temperatures)), [f"{t - CELSIUS:.0f}" for t in temperatures])
            panel.grid(False)
            panel.set_title(TEST_WORDS[test], loc="left")
            look.label_axes(panel, "supply pressure [bar]", "temperature [°C]" if test == TESTS[0] else "")
        names = list(study.known)
        ratio = [100.0 * best.std[name] / study.known[name] for name in names]
        right.barh(range(len(names)), ratio, color="#2f6fb0", height=0.6)
        for row, value in enumerate(ratio):
            inside = value > 70.0
            right.text(
                value + (-2.0 if inside else 2.0),
                row,
                f"{value:.0f} %" if value >= 10.0 else f"{value:.1f} %",
                va="center",
                ha="right" if inside else "left",
                fontsize=8,
                color="white" if inside else look.INK,
            )
        right.set_yticks(range(len(names)), [factors[name].name for name in names], fontsize=8)
        right.set_ylim(len(names) - 0.4, -0.6)
        right.set_xlim(0.0, 105.0)
        right.grid(axis="y", visible=False)
        right.set_title("standard deviation after the best", loc="left", fontsize=9)
        right.set_xlabel("% of that before")
    return figure


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
