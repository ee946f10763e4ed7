"""Two records' problems as one: every entry its own in each record, but for those of the bench that both share.

A shared entry (an instrument's gain or zero, an amount that the oil or the instruments have) is one unknown with one prior, so
that what is not known of it moves both records alike and leaves their difference alone. Rows of each record are weighed by the
misfit that its own model leaves, as its error bars are (docs/diagnosis.md section 6).
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from thermohyd.identify.diagnosis.max_t import NoiseFreedom
from thermohyd.identify.fitting.boxes import Box
from thermohyd.identify.fitting.least_squares import LeastSquaresResult, as_converged, solve
from thermohyd.identify.fitting.problem import BELIEVE, CLOSE_TO_COMPARE, MOST_STEPS, PATIENCE, Problem, System
from thermohyd.identify.fitting.starts import on_a_kink
from thermohyd.identify.fitting.uncertainty import Covariance, covariance_of


SHARED = ""  # in the place of a record's name
SMALL_STEP = 0.05  # of an entry's natural step
Entry = tuple[str, str]  # record, name


@dataclass(frozen=True)
class Part:
    """One record's share of a joint fit: its problem, the effects (and faults of the bench) freed, where it starts.

    scale: variance of its whitened residuals, 1 where its model leaves nothing but noise. freedom: of its noise.
    """

    record: str
    problem: Problem
    effects: tuple[str, ...]
    start: Mapping[str, float]
    scale: float
    freedom: NoiseFreedom


@dataclass(frozen=True)
class JointFit:
    """The optimum of both records together. Rows: the real ones of the first record, then of the second, each with its priors.

    free: the entries that were found, in the order of the columns. residual (rows,) and columns (rows, free): weighed, a shared
    prior once. alone {record: columns (rows, free)}: that record's rows only, with all its priors. values: of every entry.
    active (free,): -1 or 1 where an entry presses against a limit.
    """

    free: tuple[Entry, ...]
    values: dict[Entry, float]
    residual: np.ndarray
    columns: np.ndarray
    alone: dict[str, np.ndarray]
    active: np.ndarray
    freedom: NoiseFreedom
    chi2: float
    converged: bool
    message: str

    def covariance(self, record: str | None = None, freed: Collection[Entry] = ()) -> Covariance:
        """(J'J)^-1 over `free`: of both records together, or as one of them alone would give it.

        Entries at a limit stay there, as in the error bars of a fit, but for those `freed`.
        """
        columns = self.columns if record is None else self.alone[record]
        held = np.array([0 if entry in freed else side for entry, side in zip(self.free, self.active, strict=True)])
        return covariance_of(columns, tuple(name for _, name in self.free), held, [], slice(0, len(columns)))


@dataclass(frozen=True)
class _Side:
    """A part as its share of the joint system: `left` are shared entries whose prior stands in the other record."""

    part: Part
    shared: frozenset[str]
    left: frozenset[str]

    @cached_property
    def system(self) -> System:
        return self.part.problem.system(self.part.effects, self.part.start)

    @cached_property
    def order(self) -> tuple[Entry, ...]:
        return tuple(map(self.entry, self.system.order))

    @property
    def free(self) -> tuple[Entry, ...]:
        return tuple(map(self.entry, self.system.free))

    def entry(self, name: str) -> Entry:
        return (SHARED if name in self.shared else self.part.record, name)

    def prior_rows(self, rows: int) -> dict[str, int]:
        """{parameter: its row} among so many."""
        names = self.part.problem.parameters
        return dict(zip(names, range(rows - len(names), rows), strict=True))

    def weights(self, rows: int) -> np.ndarray:
        """(rows,): by the misfit; of priors 1, or 0 where the other record holds it."""
        found = np.full(rows, 1.0 / np.sqrt(max(self.part.scale, 1.0)))
        for name, row in self.prior_rows(rows).items():
            found[row] = 0.0 if name in self.left else 1.0
        return found

    def both(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residual, columns = (np.asarray(found) for found in self.system.both(vector, None))
        weight = self.weights(len(residual))
        return residual * weight, columns * weight


def joint_fit(first: Part, second: Part, shared: frozenset[str]) -> JointFit:
    """Fit both records at once, from where each ended alone; `shared`: names free in both that are one unknown."""
    left = _priors_left_out(first, second, shared)
    sides = [_Side(part, shared, own) for part, own in zip((first, second), left, strict=True)]
    entries = tuple(dict.fromkeys(entry for side in sides for entry in side.order))
    places = [np.array([entries.index(entry) for entry in side.order]) for side in sides]
    boxes = [_box(entry, sides) for entry in entries]

    def both(p: Any, args: Any) -> tuple[Any, Any]:
        del args
        vector, residuals, blocks = np.asarray(p, dtype=float), [], []
        for side, place in zip(sides, places, strict=True):
            residual, columns = side.both(vector[place])
            block = np.zeros((len(entries), len(residual)))
            block[place] = columns
            residuals.append(residual)
            blocks.append(block)
        return np.concatenate(residuals), np.concatenate(blocks, axis=1)

    best = _searched(both, boxes, np.array([box.start for box in boxes]))
    free = tuple(dict.fromkeys(entry for side in sides for entry in side.free))
    pick = [entries.index(entry) for entry in free]
    columns = best.jacobian[:, pick]
    for k, place in enumerate(pick):
        if best.active[pick[k]] or not np.any(columns[:, k]):
            columns[:, k] = _by_a_step(both, best, place, _step(free[k], entries, best.p, boxes))
    sizes = [len(side.both(best.p[place])[0]) for side, place in zip(sides, places, strict=True)]
    rows, alone = [], {}
    for side, begin, size in zip(sides, (0, sizes[0]), sizes, strict=True):
        real = begin + side.system.real(size)
        own = columns.copy()
        for name, row in side.prior_rows(size).items():
            prior = side.part.problem.plans[name].prior
            if name in side.left and prior is not None:
                own[begin + row, free.index((SHARED, name))] = 1.0 / prior.std
        alone[side.part.record] = own[real]
        rows.append(real)
    chosen = np.concatenate(rows)
    return JointFit(
        free, dict(zip(entries, (float(v) for v in best.p), strict=True)), best.residual[chosen], columns[chosen], alone,
        best.active[pick], _freedom_of_both(first.freedom, second.freedom), best.cost, best.converged, best.message,
    )  # fmt: skip


def _freedom_of_both(first: NoiseFreedom, second: NoiseFreedom) -> NoiseFreedom:
    count = len(first.degrees_of_freedom)
    channel = np.concatenate([first.channel, second.channel + count])
    return NoiseFreedom(channel, np.concatenate([first.degrees_of_freedom, second.degrees_of_freedom]))


def _priors_left_out(first: Part, second: Part, shared: frozenset[str]) -> tuple[frozenset[str], frozenset[str]]:
    """Of each record the shared entries whose prior is left to the other: the wider of two counts, once."""
    of = lambda part, name: part.problem.plans[name].prior if name in part.problem.plans else None
    known = [
        (name, a, b) for name in shared if (a := of(first, name)) is not None and (b := of(second, name)) is not None
    ]
    narrow = frozenset(name for name, a, b in known if a.std < b.std)
    return narrow, frozenset(name for name, *_ in known) - narrow


def _box(entry: Entry, sides: list[_Side]) -> Box:
    own = [side.system.boxes[side.order.index(entry)] for side in sides if entry in side.order]
    if len(own) == 1 or any(box.held for box in own):
        return own[0]
    lower, upper = min(box.lower for box in own), max(box.upper for box in own)
    return replace(own[0], start=float(np.mean([box.start for box in own])), lower=lower, upper=upper)


def _searched(both: Any, boxes: list[Box], start: np.ndarray) -> LeastSquaresResult:
    search = lambda p: solve(
        None, boxes, None, p, tolerance=CLOSE_TO_COMPARE, max_steps=MOST_STEPS, both=both, believe=BELIEVE
    )
    best = search(start)
    for _ in range(PATIENCE):
        if best.converged or best.exhausted:
            break
        best = search(best.p)
    return as_converged(on_a_kink(best))


def _step(entry: Entry, entries: tuple[Entry, ...], values: np.ndarray, boxes: list[Box]) -> float:
    """Into the box of an entry: to the other record's value, else of a natural size."""
    place = entries.index(entry)
    box = boxes[place]
    other = next(
        (values[i] for i, (record, name) in enumerate(entries) if name == entry[1] and record != entry[0]),
        values[place],
    )
    step = float(other - values[place])
    if abs(step) < SMALL_STEP * box.scale:
        step = box.scale
    return step if box.lower <= values[place] + step <= box.upper else -step


def _by_a_step(both: Any, best: LeastSquaresResult, place: int, step: float) -> np.ndarray:
    """The column of an entry at its limit, or without a derivative there: of a finite step, as where only its square acts."""
    moved = best.p.copy()
    moved[place] += step
    return (np.asarray(both(moved, None)[0]) - best.residual) / step
