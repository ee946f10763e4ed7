"""The picture of a check: every reading over its axis, the rows as read, the points that a fit sees, and the rows it leaves out."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.test_record import FaultyRow, TestRecord
from thermohyd.identify.report import style as look

from .result import CheckedTest, CheckResult


MOST_ROWS = 4000  # drawn of a log
ROWS, POINTS, LEFT_OUT = "#9aa7b4", "#1f5fa8", "#c9302c"
ACROSS = 2


def check_figure(result: CheckResult) -> Figure:
    """One panel per reading. The result must have one."""
    panels = [(test, channel.name) for test in result.tests.values() for channel in test.read.channels]
    down = -(-len(panels) // ACROSS)
    with look.style():
        figure = Figure(figsize=(10.0, 0.7 + 2.6 * down))
        grid = figure.subplots(down, ACROSS, squeeze=False)
        for axes, (test, channel) in zip(grid.flat, panels, strict=False):
            _draw(axes, test, channel)
        for axes in grid.flat[len(panels) :]:
            axes.set_axis_off()
        height = 0.7 + 2.6 * down
        figure.subplots_adjust(
            left=0.085, right=0.985, top=1 - 0.55 / height, bottom=0.75 / height, wspace=0.22, hspace=0.5
        )
        handles = {label: h for axes in grid.flat for h, label in zip(*axes.get_legend_handles_labels(), strict=True)}
        figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=3, markerscale=2.0)
    return figure


def _draw(axes: Axes, test: CheckedTest, channel: str) -> None:
    along = test.read.axis
    if test.name == "load_flow":
        along = "load_pressure"
    x, y = column_unit(along), column_unit(channel)
    value = test.read.channel(channel)
    label = value.signal or y.label
    factor, place = (1.0 if value.signal else y.factor), lambda read: _place(read, along) * x.factor
    step = -(-test.read.rows // MOST_ROWS)
    axes.plot(
        place(test.read)[::step],
        value.value[::step] * factor,
        ".",
        color=ROWS,
        markersize=3.0,
        label="as read",
        rasterized=True,
    )
    if test.reduced:
        seen = test.seen.channel(channel)
        sign = -1.0 if channel in test.turned else 1.0
        axes.plot(
            place(test.seen),
            sign * seen.value * factor,
            ".",
            color=POINTS,
            markersize=2.2,
            label="points of a fit",
            rasterized=True,
        )
    out = [i for fault in test.faults if fault.masked for i in _rows_of(test, fault.rows)]
    if out:
        axes.plot(
            place(test.read)[out], value.value[out] * factor, "x", color=LEFT_OUT, markersize=4.0, label="left out"
        )
    if along == "frequency":
        axes.set_xscale("log")
        look.plain_numbers(axes.xaxis)
    axes.set_title(
        f"{look.TITLES.get(test.name, test.name.replace('_', ' '))}: {channel.replace('_', ' ')}", loc="left"
    )
    look.label_axes(axes, f"{along.replace('_', ' ')} [{x.label}]", f"[{label}]")


def _place(test: TestRecord, along: str) -> np.ndarray:
    return np.asarray(getattr(test, along))


def _rows_of(test: CheckedTest, rows: tuple[FaultyRow, ...]) -> list[int]:
    """Places of rows that a fault names by their lines."""
    if test.read.lines is None:
        return []
    where = {int(line): i for i, line in enumerate(test.read.lines)}
    return [where[row.line] for row in rows if row.line in where]
