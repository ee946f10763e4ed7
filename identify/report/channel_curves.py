"""Each test beside its models, as curves to look into: readings, model with its band, what the plain model misses, residuals.

Static tests go over the spool position, one panel each for reading, gap and residuals; dynamic ones over time or frequency, a
panel per channel. Reader's choices are temperature, supply pressure, direction and run, where there are several.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from thermohyd.identify.bench.shown_units import UM
from thermohyd.identify.bench.test_record import is_dynamic, kind_of_test
from thermohyd.identify.fitting.result import ChannelFit, FitResult

from .curves import Axis, Condition, Draw, Layer, Series, View, every, left_out
from .style import READINGS, TITLES, pressure_groups, temperature_groups


Pair = tuple[
    ChannelFit | None, ChannelFit
]  # without and with what a diagnosis added; without: None where it is the same
NOISE = (-1.96, 1.96)
MOST_RUNS = 12
BAND, BENCH, MODEL, PLAIN = "95 % band of the model", "bench", "model", "plain model"


def fit_views(fit: FitResult, plain: FitResult | None = None, words: tuple[str, str] = (MODEL, PLAIN)) -> list[View]:
    """A view per channel of static tests and per dynamic test. plain: the model before anything was added, of the same rows.

    words: what the final and the plain model are called.
    """
    before = (None,) * len(fit.channels) if plain is None else plain.channels
    pairs: list[Pair] = list(zip(before, fit.channels, strict=True))
    views = []
    for test in dict.fromkeys(channel.test for channel in fit.channels):
        own = [pair for pair in pairs if pair[1].test == test]
        record = fit.record.tests.get(test)
        names = () if record is None else record.run_names
        if is_dynamic(test):
            views.append(_dynamic(own, names, words))
        else:
            views += [_static(pair, names, words, alone=len(own) == 1) for pair in own]
    return views


def _static(pair: Pair, run_names: Sequence[str], words: tuple[str, str], *, alone: bool) -> View:
    before, fit = pair
    groups = _Groups(fit, run_names)
    reading = READINGS.get(fit.channel, fit.channel.replace("_", " "))
    layers = [Layer(BENCH, "points"), Layer(words[0], "line"), Layer(BAND, "band"), Layer("residual", "points")]
    panels = [Axis(reading, fit.unit.label, log=fit.test == "leakage")]
    if before is not None:
        layers += [
            Layer(words[1], "line", "dot"),
            Layer(f"residual of the {words[1]}", "points", shown=False, hollow=True),
        ]
        panels.append(Axis(f"{reading} beyond the {words[1]}", fit.unit.label, rules=(0.0,), tall=0.8))
    largest = float(np.max(np.abs(_residual(fit)), initial=0.0))
    panels.append(
        Axis("residual / noise", rules=(NOISE, 0.0), scale="symlog" if largest > 30.0 else "linear", tall=0.55)
    )
    step = every(len(fit.measured))
    series = [
        _sweep(before, fit, rows[np.argsort(fit.position[rows], kind="stable")][::step], at)
        for at, rows in groups.rows()
    ]
    title = TITLES.get(fit.test, fit.test.replace("_", " ").capitalize())
    return View(
        title if alone else f"{title}, {reading}",
        Axis("spool position", "um"),
        tuple(panels),
        tuple(layers),
        tuple(series),
        groups.conditions,
        palette="warm",
        note=left_out(step),
        **groups.shown,
    )


def _residual(fit: ChannelFit) -> np.ndarray:
    return (fit.measured - fit.predicted) / fit.std


def _sweep(before: ChannelFit | None, fit: ChannelFit, rows: np.ndarray, at: tuple[int, ...]) -> Series:
    unit, last = fit.unit.factor, 1 if before is None else 2
    of = lambda values: values[rows] * unit
    band = 1.96 * fit.predicted_std
    draws = [
        Draw(2, of(fit.predicted - band), y2=of(fit.predicted + band)),
        Draw(0, of(fit.measured)),
        Draw(1, of(fit.predicted)),
        Draw(3, _residual(fit)[rows], last, plain=True),
    ]
    if before is not None:
        draws += [
            Draw(4, of(before.predicted)),
            Draw(0, of(fit.measured - before.predicted), 1),
            Draw(1, of(fit.predicted - before.predicted), 1),
            Draw(5, _residual(before)[rows], last, plain=True),
        ]
    return Series(at, fit.position[rows] * UM, tuple(draws))


def _dynamic(pairs: Sequence[Pair], run_names: Sequence[str], words: tuple[str, str]) -> View:
    test = pairs[0][1].test
    swept = kind_of_test(test) == "frequency"
    codes = [int(code) for code in np.unique(pairs[0][1].run)]
    runs = tuple(run_names[code] if code < len(run_names) and run_names[code] else str(code) for code in codes)
    changed = any(before is not None for before, _ in pairs)
    layers = [Layer(BENCH, "points"), Layer(words[0], "line"), Layer(BAND, "band")]
    layers += [Layer(words[1], "line", "dot")] if changed else []
    series, step = [], 1
    for panel, (before, fit) in enumerate(pairs):
        step = max(step, every(len(fit.measured)))
        for place, code in enumerate(codes):
            rows = np.flatnonzero(fit.run == code)
            rows = rows[np.argsort(fit.position[rows], kind="stable")][:: every(len(fit.measured))]
            series.append(_history(before, fit, rows, place, panel))
    amplitude = lambda fit: swept and fit.channel == "amplitude_ratio"
    panels = tuple(
        Axis(
            fit.channel.replace("_", " "),
            fit.unit.label,
            "log" if amplitude(fit) else "linear",
            log=amplitude(fit),
            tall=0.8,
        )
        for _, fit in pairs
    )
    kind = "Frequency response" if swept else "Step test"
    own = test.removeprefix(kind_of_test(test)).strip("_").replace("_", " ")
    shown = (0,) if len(codes) > 1 and not swept else ()
    return View(
        f"{kind}{f' ({own})' if own else ''}",
        Axis("frequency", "Hz", "log") if swept else Axis("time", "s"),
        panels,
        tuple(layers),
        tuple(series),
        (Condition("run", runs, shown),),
        colour=0,
        note=left_out(step),
    )


def _history(before: ChannelFit | None, fit: ChannelFit, rows: np.ndarray, place: int, panel: int) -> Series:
    of = lambda values: values[rows] * fit.unit.factor
    band = 1.96 * fit.predicted_std
    draws = [
        Draw(2, of(fit.predicted - band), panel, y2=of(fit.predicted + band)),
        Draw(0, of(fit.measured), panel),
        Draw(1, of(fit.predicted), panel),
    ]
    draws += [] if before is None else [Draw(3, of(before.predicted), panel)]
    return Series((place,), fit.position[rows], tuple(draws))


class _Groups:
    """A channel's rows by temperature, supply pressure, direction and run; `shown`: which of these says what in a picture."""

    def __init__(self, fit: ChannelFit, run_names: Sequence[str]):
        by_temperature, celsius = temperature_groups(fit)
        by_pressure, bar = pressure_groups(fit)
        codes, by_run = np.unique(fit.run, return_inverse=True)
        names = [str(run_names[code]) if code < len(run_names) and run_names[code] else f"run {code}" for code in codes]
        falling = (fit.direction < 0).astype(int)
        several = {(t, p, d): set() for t, p, d in zip(by_temperature, by_pressure, falling, strict=True)}
        for key, run in zip(zip(by_temperature, by_pressure, falling, strict=True), by_run, strict=True):
            several[key].add(int(run))
        self.conditions = (
            Condition("temperature", tuple(f"{round(value)} °C" for value in celsius)),
            Condition("supply", tuple(f"{round(value)} bar" for value in bar)),
            Condition("direction", ("rising", "falling") if falling.any() and not falling.all() else ("",)),
        )
        # A run that the other conditions name already is no choice of its own.
        columns = [
            by_temperature,
            by_pressure,
            falling if len(self.conditions[2].values) > 1 else np.zeros_like(falling),
        ]
        if max(map(len, several.values()), default=1) > 1 and len(codes) <= MOST_RUNS:
            self.conditions += (Condition("run", tuple(names)),)
            columns.append(by_run.reshape(-1))
        self._columns = np.stack(columns, axis=1).astype(int)
        self._run = by_run.reshape(-1)
        self.shown: Mapping[str, int] = {"colour": 0, "mark": 1, "hollow": 2}
        if len(celsius) == 1 and len(self.conditions) == 4:
            self.shown = {"colour": 3, "mark": 1, "hollow": 2}

    def rows(self) -> list[tuple[tuple[int, ...], np.ndarray]]:
        """(which of each condition's values, rows); every run is a curve of its own."""
        keys = np.column_stack([self._columns, self._run])
        return [
            (tuple(int(part) for part in key[:-1]), np.flatnonzero((keys == key).all(axis=1)))
            for key in np.unique(keys, axis=0)
        ]
