"""The readings of a record's tests of one kind as a function of named entries: static tests, and tests in motion.

The only place where the two differ for a `Problem`, which puts them behind one another.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np

from thermohyd.conditions import Conditions
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.model.learned_terms import ABSOLUTE, LearnedTerm, term_values
from thermohyd.identify.model.places import place_of, read_as
from thermohyd.identify.model.term_variables import States, of_the_oil
from thermohyd.identify.model.typed_terms import TypedTerm, entry_shifts, reading_shifts
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.noise.level import ChannelNoise
from thermohyd.identify.noise.two_parts import TwoParts
from thermohyd.identify.noise.whitening import Whitening, whiten_on_host, whitening_of
from thermohyd.identify.reduction.monotone_pieces import run_ids
from thermohyd.side_by_side import LastAsked

from .bench_faults import BenchFault, corrected
from .least_squares import Columns
from .library import Library, stores, with_heat
from .library_rows import ENTRIES, LibraryArgs, RowTerms, order_of
from .parameters import PARAMETERS, ParameterPlan
from .row_blocks import Evaluated, RowBlocks
from .row_sizes import coarse_size
from .static_readings import (
    FIELDS,
    StaticData,
    base_valve,
    channel_slices,
    groups_of,
    pad,
    static_data,
    with_columns,
)
from .tied_rows import TiedRows, blocked_tests, rows_of_tests, stored_beside
from .uncertainty import Key


STEP = 1e-3  # of a fault's scale: for a difference, whose error is far below a standard error

# residual (rows,) and its columns (entries, rows), NumPy or `Columns`, at a point (entries,), readings only
Evaluation = Callable[[np.ndarray], tuple[Any, Any]]


@dataclass(frozen=True)
class Noise:
    """The noise of each channel as a problem weighs it: standard deviation per row (SI) and correlation.

    memory: what part of each row's variance (rows,) that correlation is of, where not of all: a position's noise has none. parts: of
    channels whose noise goes with the reading. shared: what one standard deviation of the error of each input {input: (rows,)}, as of
    the position, does to a reading, in standard deviations of it: channels of one test have these errors in common.
    """

    std: dict[Key, np.ndarray]
    correlation: dict[Key, NoiseCorrelation]
    memory: Mapping[Key, np.ndarray] = field(default_factory=dict)
    parts: Mapping[Key, TwoParts] = field(default_factory=dict)
    shared: Mapping[Key, Mapping[str, np.ndarray]] = field(default_factory=dict)

    @property
    def white(self) -> "Noise":
        """The same without memory, nothing shared: residuals and columns are then weighted, not whitened."""
        return replace(self, correlation=dict.fromkeys(self.correlation, NoiseCorrelation()), memory={}, shared={})

    def elsewhere(self, before: Mapping[Key, np.ndarray], after: Mapping[Key, np.ndarray]) -> "Noise":
        """The noise of readings `after` (rows,), SI, where that of readings `before` is this one."""
        std = dict(self.std)
        for key, parts in self.parts.items():
            more = np.square(parts.share) * (after[key] ** 2 - before[key] ** 2)
            std[key] = np.sqrt(np.maximum(std[key] ** 2 + more, parts.own**2))
        shared = {
            key: {name: moved * self.std[key] / std[key] for name, moved in own.items()}
            for key, own in self.shared.items()
        }
        return replace(self, std=std, shared=shared)

    def whitening(self, key: Key, test: TestRecord, used: Mapping[Key, np.ndarray] | None, padded: int) -> Whitening:
        """The filter of a channel's rows; used: of each channel, None where all are."""
        seen = None if used is None else used[key]
        return whitening_of(self.correlation[key], run_ids(test), padded, seen, self.memory.get(key))


def white_noise(noise: Mapping[Key, ChannelNoise]) -> Noise:
    """Independent readings with the standard deviations that a plain fit uses."""
    return Noise(
        {key: n.used for key, n in noise.items()}, dict.fromkeys(noise, NoiseCorrelation()), parts=parts_of(noise)
    )


def parts_of(noise: Mapping[Key, Any]) -> dict[Key, TwoParts]:
    """Of the channels whose noise goes with the reading."""
    return {key: n.parts for key, n in noise.items() if n.parts is not None}


@runtime_checkable
class Readings(Protocol):
    """The tests of one kind as a function of named entries: parameters first, then amounts of effects."""

    @property
    def tests(self) -> Mapping[str, TestRecord]:
        """The tests, in the order of their rows."""
        ...

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the entries that are no effects."""
        ...

    def program(self, chosen: tuple[str, ...]) -> tuple[str, ...]:
        """The effects present in the cheapest program that serves `chosen`."""
        ...

    def order(self, program: tuple[str, ...]) -> tuple[str, ...]:
        """Names of the entries of a program's vector."""
        ...

    def size(self, rows: int) -> int:
        """Rows that a channel of so many is padded to."""
        ...

    def evaluation(self, program: tuple[str, ...], faults: tuple[BenchFault, ...] = ()) -> Evaluation:
        """Whitened residuals and columns of a program, all channels of the tests behind one another.

        faults: of positions and labels; their amounts stand behind the program's entries.
        """
        ...


@dataclass(frozen=True)
class StaticReadings:
    """Static tests: compiled programs for any set of effects and any record, whose columns come row by row (`row_blocks`, `tied_rows`)."""

    record: BenchRecord
    tests: dict[str, TestRecord]
    plans: Mapping[str, ParameterPlan]
    library: Library
    noise: Noise
    used: Mapping[Key, np.ndarray] | None
    terms: tuple[LearnedTerm | TypedTerm, ...]
    states: States | None = None  # of the model that typed terms are counted at; with them every place can be shifted

    @property
    def parameters(self) -> tuple[str, ...]:
        return PARAMETERS

    def program(self, chosen: tuple[str, ...]) -> tuple[str, ...]:
        if self.states is not None:  # no more than the model holds: see `place_program`
            return chosen
        return self.library.program(chosen, self._heat_asked)

    def order(self, program: tuple[str, ...]) -> tuple[str, ...]:
        return order_of(program)

    def size(self, rows: int) -> int:
        return coarse_size(rows)

    def evaluation(self, program: tuple[str, ...], faults: tuple[BenchFault, ...] = ()) -> Evaluation:
        if not faults:
            return lambda p: self._at(program, p)
        place = {column: i for i, column in enumerate(FIELDS)}
        steps = np.diag([STEP * fault.info.scale for fault in faults])
        white = {
            (name, c.name): self.noise.whitening((name, c.name), test, self.used, test.rows)
            for name, test in self.tests.items()
            for c in test.channels
        }

        def evaluate(p: np.ndarray) -> tuple[Any, Any]:
            own, amounts = p[: -len(faults)], p[-len(faults) :]
            moved = lambda by: self._moved(dict(zip(faults, (amounts + by).tolist(), strict=True)))
            rows = self._blocks(program).moved(moved(0.0))
            residual, columns, by_row = rows.evaluate(own)
            slopes = [self._of_rows(fault, by_row[place[fault.info.moves]], white) for fault in faults]
            for fault, slope, step in zip(faults, slopes, steps, strict=True):
                if isinstance(rows, TiedRows):
                    self._of_stored(fault, slope, residual, rows.moved(moved(step)), own, step.sum())
            return residual, np.concatenate([columns, np.stack(slopes)])

        return evaluate

    def _of_stored(
        self, fault: BenchFault, slope: np.ndarray, residual: np.ndarray, moved: TiedRows, p: np.ndarray, step: float
    ) -> None:
        """Put into a fault's column that of the tests whose ports store oil: where a row's readings are of the rows before it, too, by
        a difference. moved: with the fault larger by a step."""
        places = rows_of_tests(moved.args.data.channels)
        tests = tuple(test for test in blocked_tests(moved.args) if test in fault.shapes)
        for test, there in moved.stored.residuals_alone(p, tests).items():
            slope[places[test]] = (there - residual[places[test]]) / step

    def _blocks(self, program: tuple[str, ...]) -> RowBlocks | TiedRows:
        """The readings with a program's effects, laid out once: by blocks of rows, blocked tests whole where ports store oil."""
        if program not in self._laid_out:
            rows, args = {name: test.rows for name, test in self.tests.items()}, self.arguments(program)
            tied = any(stores(name) for name in program)  # a row's readings are of the rows before it, too
            self._laid_out[program] = TiedRows.of(program, args, rows) if tied else RowBlocks.of(program, args, rows)
        return self._laid_out[program]

    @cached_property
    def _laid_out(self) -> dict[tuple[str, ...], RowBlocks | TiedRows]:
        return {}

    def with_terms(self, terms: tuple[LearnedTerm | TypedTerm, ...], states: States | None) -> "StaticReadings":
        """The same readings with other terms; what does not depend on them is not laid out again."""
        other = replace(self, terms=terms, states=states)
        if "_with_heat" in self.__dict__:
            args = self._with_heat
            other.__dict__["_with_heat"] = replace(args, terms=other._row_terms(args.data))
        return other

    def with_places(self, program: tuple[str, ...], p: np.ndarray) -> tuple[np.ndarray, States]:
        """(entries, padded rows): what a shift of each of `ENTRIES` at a reading's own row does to its weighted residual, and what
        the model's rows could read at that point, SI. The readings must have states, and no effect may store oil."""
        found = self._evaluated(program, p)
        assert isinstance(found, Evaluated)
        states = {
            test: {name: value[: self.tests[test].rows] for name, value in own.items()}
            | of_the_oil(self.record.oil, self.tests[test].temperature)
            for test, own in found.states.items()
        }
        return found.whole[2], states

    def _at(self, program: tuple[str, ...], p: np.ndarray) -> tuple[np.ndarray, Any]:
        found = self._evaluated(program, p)
        return found.residuals, Columns(len(p), found.columns)

    def _evaluated(self, program: tuple[str, ...], p: np.ndarray) -> Any:
        """What `RowBlocks.at` or `TiedRows.at` gives at a point; asked again for the same one, it is not computed again."""
        key = (program, np.asarray(p, dtype=float).tobytes())

        return self._last.of(key, lambda: self._blocks(program).at(np.asarray(p, dtype=float)))

    @cached_property
    def _last(self) -> LastAsked:
        return LastAsked()

    def _of_rows(self, fault: BenchFault, slope: np.ndarray, white: Mapping[Key, Whitening]) -> np.ndarray:
        """A fault's column: what was read is too large in its rows. slope: of each row's weighted residual to what was read."""
        found = np.zeros_like(slope)
        for key, place in channel_slices(self.tests, coarse_size).items():
            if key[0] in fault.shapes:
                found[place] = whiten_on_host(white[key], -slope[place] * fault.shapes[key[0]])
        return found

    def moved_by(self, fault: BenchFault) -> dict[str, dict[str, np.ndarray]]:
        """{test: {field of its operating points: (rows,)}}: by how much one unit of a fault made what was read there too large, SI,
        padded."""
        if not fault.info.moves:
            return {}
        name, read, true = FIELDS[fault.info.moves], self._with_heat.data.conditions, self._moved({fault: 1.0})
        return {t: {name: np.asarray(getattr(read[t], name)) - np.asarray(getattr(true[t], name))} for t in true}

    def _moved(self, amounts: Mapping[BenchFault, float]) -> dict[str, Conditions]:
        """The operating points of tests with these faults as they would have been read without them."""
        touched: dict[str, set[str]] = {}
        for fault in amounts:
            for test in fault.shapes:
                touched.setdefault(test, set()).add(fault.info.moves)
        tests = corrected({name: self.tests[name] for name in touched}, amounts)
        before = self._with_heat.data.conditions
        return {
            name: with_columns(before[name], tests[name], columns, coarse_size) for name, columns in touched.items()
        }

    def storage(
        self, vector: Callable[[tuple[str, ...]], np.ndarray], present: tuple[str, ...], amounts: Mapping[str, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """What `stored_beside` gives beside the effects `present`; vector: the values of named entries."""
        program = tuple(name for name in self.program((*present, *amounts)) if not stores(name))
        rows = {name: test.rows for name, test in self.tests.items()}
        return stored_beside(program, amounts, vector(self.order(program)), self.arguments(program), rows)

    @property
    def _heat_asked(self) -> bool:
        plan = self.plans["heat_retention"]
        return not plan.fixed or plan.start > 0.0

    def arguments(self, program: tuple[str, ...]) -> LibraryArgs:
        """The data of a program with these effects."""
        if with_heat(program) or self._heat_asked:
            return self._with_heat
        return replace(self._with_heat, valve=replace(self._with_heat.valve, heat_retention=None))

    @cached_property
    def _with_heat(self) -> LibraryArgs:
        values = {name: self.plans[name].start for name in PARAMETERS}
        data = static_data(self.tests, self.noise.std, coarse_size)
        whitening, channels = [], []
        for channel in data.channels:
            key = (channel.test, channel.name)
            test = self.tests[channel.test]
            whitening.append(self.noise.whitening(key, test, self.used, coarse_size(test.rows)))
            weight = channel.weight
            if self.used is not None:
                weight = weight * pad(self.used[key].astype(float), fill=0.0, size=coarse_size)
            # Sensors act on what the program gives, and so none of them needs a program of its own.
            channels.append(replace(channel, weight=weight, sensor=None))
        data = type(data)(data.conditions, tuple(channels), data.weights)
        return LibraryArgs(base_valve(self.record, values, heat=True), data, tuple(whitening), self._row_terms(data))

    def _row_terms(self, data: StaticData) -> dict[str, RowTerms]:
        terms = {}
        for group, tests in groups_of(data.conditions).items():
            nodes = [1 if (points := self.tests[name].nodes) is None else points.count for name in tests]
            sizes = [coarse_size(self.tests[name].rows) * k for name, k in zip(tests, nodes, strict=True)]
            factor, shift = np.ones((len(PARAMETERS), sum(sizes))), np.zeros((len(PARAMETERS), sum(sizes)))
            viscosity = np.ones(sum(sizes))
            places = None if self.states is None else np.zeros((len(ENTRIES), sum(sizes)))
            first = 0
            for name, size, k in zip(tests, sizes, nodes, strict=True):
                rows = slice(first, first + self.tests[name].rows * k)
                for term in self.terms:
                    if isinstance(term, TypedTerm):
                        assert self.states is not None
                        assert places is not None
                        for entry, moved in entry_shifts(term, self.tests[name], self.states).items():
                            places[ENTRIES.index(entry), rows] += np.repeat(moved, k)
                        continue
                    change = np.repeat(term_values(term, self.tests[name], self.record.oil), k)
                    if term.quantity == "viscosity":
                        viscosity[rows] *= 1.0 + change
                    elif term.quantity in ABSOLUTE:
                        shift[PARAMETERS.index(term.quantity), rows] += change
                    else:
                        factor[PARAMETERS.index(term.quantity), rows] *= 1.0 + change
                first += size
            terms[group] = RowTerms(factor, shift, viscosity, places)
        return terms

    def read_shifts(self) -> dict[Key, np.ndarray]:
        """What typed terms add to what is read, before any sensor: {(test, channel): (rows,)}, SI."""
        found: dict[Key, np.ndarray] = {}
        for term in self.terms:
            if not isinstance(term, TypedTerm) or self.states is None:
                continue
            shifted = place_of(term.place).readings
            for name, test in self.tests.items():
                read = {c.name: own for c in test.channels if (own := read_as(test, c.name)) in shifted}
                shifts = reading_shifts(term, test, self.states) if read else {}
                for channel, own in read.items():
                    found[name, channel] = found.get((name, channel), 0.0) + shifts[own]
        return found


@dataclass(frozen=True)
class MotionReadings:
    """Dynamic tests: runs of the machine with forward derivatives, and its small-signal response (`motion_readings`).

    parameters: names of the vector's entries; the simulator holds all others. library: effects of a search; None where only
    those are present that are asked for: a program of its own, but with fewer columns to integrate.
    """

    simulator: Any  # a DynamicSimulator, whose module a static problem does not wait for
    parameters: tuple[str, ...]
    library: Library | None
    noise: Noise
    used: Mapping[Key, np.ndarray] | None
    terms: tuple[TypedTerm, ...] = ()

    @property
    def tests(self) -> Mapping[str, TestRecord]:
        return self.simulator.tests

    def program(self, chosen: tuple[str, ...]) -> tuple[str, ...]:
        if self.library is None or self.terms:
            return chosen
        return self.library.names if chosen else ()

    def order(self, program: tuple[str, ...]) -> tuple[str, ...]:
        return (*self.parameters, *program)

    def size(self, rows: int) -> int:
        return rows

    def evaluation(self, program: tuple[str, ...], faults: tuple[BenchFault, ...] = ()) -> Evaluation:
        assert not faults  # they are looked for in static tests alone
        # Here, not above: a static problem does not wait for the solvers of motion.
        from .motion_readings import rows_of_readings

        if self.terms:
            return lambda p: self._with_terms(program, p)[:2]
        weighing = self._weighing
        return lambda p: rows_of_readings(self.simulator, self.parameters, program, weighing, p)

    @property
    def _weighing(self) -> Any:
        from .motion_readings import Weighing

        weight = {(n, c.name): 1.0 / self.noise.std[n, c.name] for n, t in self.tests.items() for c in t.channels}
        if self.used is not None:
            weight = {key: w * self.used[key] for key, w in weight.items()}
        return Weighing(weight, whiten=self._whiten)

    def with_terms(self, terms: tuple[TypedTerm, ...]) -> "MotionReadings":
        """The same readings with other terms in the machine."""
        return replace(self, terms=terms)

    def term_columns(self, program: tuple[str, ...], p: np.ndarray) -> np.ndarray:
        """(coefficients, rows): the whitened columns of all terms' coefficients, before any sensor."""
        return self._with_terms(program, p)[2]

    def _with_terms(self, program: tuple[str, ...], p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residuals, columns of the vector, columns of the terms' coefficients; asked again for one point, not computed again."""
        from .motion_term_columns import rows_with_terms

        key = (program, np.asarray(p, dtype=float).tobytes())
        return self._last.of(
            key, lambda: rows_with_terms(self.simulator, self.parameters, program, self._weighing, p, self.terms)
        )

    @cached_property
    def _last(self) -> LastAsked:
        return LastAsked()

    def table(self, program: tuple[str, ...], p: np.ndarray, laws: Any) -> tuple[list[np.ndarray], Any]:
        """Of each law (see `motion_term_columns.Law`) its columns (rows, coefficients) in units of the noise, whitened, beside the
        machine at a point, before any sensor; and the ranges of what they follow."""
        from .motion_term_columns import columns_of_laws

        return columns_of_laws(self.simulator, self.parameters, program, self._weighing, p, laws)

    def _whiten(self, key: Key, values: np.ndarray) -> np.ndarray:
        correlation = self.noise.correlation[key]
        if correlation == NoiseCorrelation():
            return values
        test = self.tests[key[0]]
        return whiten_on_host(self.noise.whitening(key, test, self.used, test.rows), values.T).T
