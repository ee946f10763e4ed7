"""When was a valve worked on? A step in its parameters that wear alone does not make, found in all of them together.

Every place between two records of a valve is tried for every quantity, as a free step beside the type's wear
(`pooling.step_evidence`). The best is kept as long as, all lines fitted with it, it is rarer than ERROR, counted over all places and
quantities (Bonferroni: estimates of one record go together, and that bound holds whatever they do). A step that further ones make
needless goes out again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from .pooling import Pooled, Series, fit_pooled, robust_tau, step_evidence


ERROR = 0.01  # of a valve without an overhaul, to be said to have one
FEWEST = 3  # records of a valve
ROUNDS = 8


@dataclass(frozen=True)
class ChangePoint:
    """A step of a valve before one of its records. confirmed: a second record after it agrees; before that a bad test looks alike.

    quantities: in which it shows beyond chance by itself, the clearest first. p_value: of all that was tried in this valve.
    """

    valve: int
    before: int
    p_value: float
    quantities: tuple[str, ...]
    confirmed: bool


def find_overhauls(
    quantities: Mapping[str, Sequence[Series]],
) -> tuple[dict[str, list[Series]], dict[str, Pooled], list[ChangePoint]]:
    """({quantity: series with their steps}, {quantity: lines}, change points) of the valves of one type.

    quantities: {name: a series for each valve, on the same records}; where a record has no value, its standard error is infinite.
    """
    with_steps = {name: list(series) for name, series in quantities.items()}
    lines = _lines(with_steps)
    # Steps that are not known yet pass for scatter between tests, and hide themselves: the search takes the scatter of neighbours.
    scatter = {name: robust_tau(series) for name, series in with_steps.items()}
    steps: list[set[int]] = [set() for _ in next(iter(with_steps.values()), [])]
    tried: list[set[int]] = []
    for _ in range(ROUNDS):
        hopeful = {name: replace(line, tau=min(line.tau, scatter[name])) for name, line in lines.items()}
        gains = _gains(with_steps, hopeful)
        new = {i: found for i, found in enumerate(map(_best, gains)) if found is not None and found[1] < ERROR}
        for i, (before, _) in new.items():
            steps[i].add(before)
        dropped = False
        if new:
            with_steps, lines = _refitted(with_steps, steps)
        for i, kept in enumerate(steps):
            for before in sorted(kept):
                if _p_without(with_steps, lines, i, before) >= ERROR:
                    kept.discard(before)
                    dropped = True
        if dropped:
            with_steps, lines = _refitted(with_steps, steps)
        if not new or tried == (tried := [set(kept) for kept in steps]):
            break
    points = [_point(with_steps, lines, i, before) for i, kept in enumerate(steps) for before in sorted(kept)]
    return with_steps, {name: fit_pooled(series) for name, series in with_steps.items()}, points


def _gains(series: Mapping[str, list[Series]], lines: Mapping[str, Pooled]) -> list[np.ndarray]:
    """(quantities, places) of each valve."""
    each = [step_evidence(series[name], lines[name]) for name in series]
    return [np.array([gains[i] for gains in each]) for i in range(len(each[0]) if each else 0)]


def _best(gains: np.ndarray) -> tuple[int, float] | None:
    """(the record before which the best step is, its p-value over all that was tried)"""
    if gains.shape[1] + 1 < FEWEST:
        return None
    best = int(np.argmax(gains.max(axis=0)))
    return best + 1, min(1.0, gains.size * float(chi2.sf(gains[:, best].max(), 1)))


def _refitted(
    series: Mapping[str, list[Series]], steps: Sequence[set[int]]
) -> tuple[dict[str, list[Series]], dict[str, Pooled]]:
    new = {
        name: [replace(one, steps=tuple(sorted(s))) for one, s in zip(all_, steps, strict=True)]
        for name, all_ in series.items()
    }
    return new, _lines(new)


def _lines(series: Mapping[str, list[Series]]) -> dict[str, Pooled]:
    return {name: fit_pooled(all_, averaged=False) for name, all_ in series.items()}


def _without(series: Mapping[str, list[Series]], valve: int, before: int) -> dict[str, Series]:
    left = lambda one: replace(one, steps=tuple(s for s in one.steps if s != before))
    return {name: left(all_[valve]) for name, all_ in series.items()}


def _evidence_of(
    series: Mapping[str, list[Series]], lines: Mapping[str, Pooled], valve: int, before: int
) -> dict[str, float]:
    alone = _without(series, valve, before)
    return {name: float(step_evidence([one], lines[name])[0][before - 1]) for name, one in alone.items()}


def _p_without(series: Mapping[str, list[Series]], lines: Mapping[str, Pooled], valve: int, before: int) -> float:
    gains = _evidence_of(series, lines, valve, before)
    places = len(next(iter(series.values()))[valve].time) - 1
    return min(1.0, len(gains) * places * float(chi2.sf(max(gains.values()), 1)))


def _point(series: Mapping[str, list[Series]], lines: Mapping[str, Pooled], valve: int, before: int) -> ChangePoint:
    gains = _evidence_of(series, lines, valve, before)
    ordered = sorted(gains, key=lambda name: -gains[name])
    records = len(next(iter(series.values()))[valve].time)
    shown = tuple(name for name in ordered if float(chi2.sf(gains[name], 1)) < ERROR)
    later = [s for s in next(iter(series.values()))[valve].steps if s > before]
    after = (later[0] if later else records) - before
    return ChangePoint(valve, before, _p_without(series, lines, valve, before), shown, after >= 2)
