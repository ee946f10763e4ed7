"""Readings of static tests and their derivatives, some hundred rows at a time: one compiled program for the rows of any record.

A row of a static test is a balance of its own unless ports store oil, so that a program of a fixed number of rows serves every test,
however long it is, and whatever other tests stand beside it: whether the use ports are closed or connected, and what is read, are
numbers that it is given (an imposed load has a program of its own). It is compiled once, not once for each record. It holds every
effect of the library that costs no more than those asked for, whether or not the record can show it; what a record lacks (a time,
a rate) is 0 there. What ties rows together (a meter's lag, means over bins, the noise's memory) follows on the host.
"""

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.edge import EdgeLaw
from thermohyd.effects.library import classes_of, effect_info
from thermohyd.identify.noise.whitening import HostWhitening
from thermohyd.kept_programs import KeptProgram, made_once
from thermohyd.numerics import OFTEN, OPTIONS, jitted, known_options

from .least_squares import Both
from .library import run_most, same_program
from .library_rows import ENTRIES, MOVES, Asked, LibraryArgs, RowTerms, filtered, reading_asked, split
from .parameters import PARAMETERS
from .place_program import place_program
from .static_readings import (
    ChannelRows,
    StaticData,
    groups_of,
    read_in,
    rows_called,
    spread_over_rows,
    stacked,
)
from .static_residuals import FitArgs, own_entries


# Rows of a block, and of a test's only one where it has so few: a call takes some 0.2 ms beside its rows, which take a microsecond or
# two each, and pads fill the last block.
BLOCK, SMALL_BLOCK = 512, 256
COLUMNS = 32  # of a program of a filter, a multiple of this


def block_size(counts: Iterable[int]) -> int:
    """Rows of the blocks of tests with so many: one size for all of a record, as each needs a program."""
    return SMALL_BLOCK if max(counts, default=0) <= SMALL_BLOCK else BLOCK


def blocks_of(args: LibraryArgs, test: str, count: int, size: int) -> tuple[LibraryArgs, ...]:
    """A test's operating points and learned terms in blocks of so many rows, under the names that they have in a program; count: its
    rows (or nodes) without pads."""
    group, first = place_in_group(args.data.conditions, test)
    name = rows_called(test)
    (named,) = groups_of({name: args.data.conditions[test]})
    valve = jax.tree.map(lambda leaf: jnp.asarray(leaf) if eqx.is_array(leaf) else leaf, args.valve)
    found = []
    for rows, own in zip(
        _rows_of_blocks(count, size), _in_blocks(args.data.conditions[test], count, size), strict=True
    ):
        terms = jax.tree.map(
            lambda values, rows=rows: _on_device(np.asarray(values)[..., first + rows]), args.terms[group]
        )
        found.append(LibraryArgs(valve, StaticData({name: own}, (), {}), (), {named: terms}))
    return tuple(found)


def _on_device(values: np.ndarray) -> Array:
    """What terms do to rows: where a model has none, which is usual, ones and zeros that all blocks share; they are nine tenths of a
    block, and a search lays out hundreds of them."""
    first = float(values.flat[0])
    return _constant(values.shape, first, values.dtype) if np.all(values == first) else jnp.asarray(values)


@functools.cache
def _constant(shape: tuple[int, ...], value: float, dtype: np.dtype) -> Array:
    return jnp.full(shape, value, dtype)  # without one it would be of a weak type, and need programs of its own


def _rows_of_blocks(count: int, size: int) -> list[np.ndarray]:
    """The last row fills the last block: its operating point is known to be sound."""
    return [np.minimum(np.arange(begin, begin + size), count - 1) for begin in range(0, count, size)]


def _in_blocks(conditions: Conditions, count: int, size: int) -> list[Conditions]:
    whole = jax.tree.map(np.asarray, complete(conditions))
    blocks = [jax.tree.map(lambda column, rows=rows: column[rows], whole) for rows in _rows_of_blocks(count, size)]
    return jax.device_put(blocks)


def complete(conditions: Conditions) -> Conditions:
    """The same with every column that an effect may ask for: a test without time is one at rest."""
    none = _constant(conditions.position.shape, 0.0, np.dtype(float))
    lacks = {name: none for name in ("time", "rate", "direction", "run") if getattr(conditions, name) is None}
    return replace(conditions, **lacks) if lacks else conditions


def place_in_group(conditions: Mapping[str, Conditions], test: str) -> tuple[str, int]:
    """(the group that a test is solved with, the first of its rows there)."""
    for group, tests in groups_of(dict(conditions)).items():
        if test in tests:
            return group, sum(len(conditions[one].position) for one in tests[: tests.index(test)])
    raise KeyError(test)


@made_once
def _program(effects: tuple[str, ...], classes: tuple[type, ...], rows_of: str, law: EdgeLaw) -> KeptProgram:
    """`reading_and_slopes`, compiled; classes: what stands behind the names; a user may put another effect under a name.

    With the lubrication law the options of `OFTEN` take 1.7 times as long to compile and save a twentieth of a call.
    """
    options = known_options(OFTEN if run_most(effects) and law == "orifice" else OPTIONS)
    return jitted(functools.partial(reading_and_slopes, effects, rows_of), options, classes)


def reading_and_slopes(
    effects: tuple[str, ...], rows_of: str, p: Float[Array, " given"], args: LibraryArgs, asked: Asked
) -> tuple[Float[Array, " rows"], Float[Array, "entries rows"]]:
    """Of the rows of a block: the reading asked for (`reading_asked`) and its slopes.

    Entries: parameters, amounts of `effects`, changes of what was read of the operating point in the order of FIELDS.
    """
    (group,) = args.terms
    spread = spread_over_rows(jnp.concatenate([p, jnp.zeros(MOVES)]), args.data.conditions)

    def of_rows(spread: dict[str, Any]) -> Array:
        return reading_asked(effects, rows_of, spread, args, asked)[0]

    reading, pull = jax.vjp(of_rows, spread)
    return reading, stacked(pull(jnp.ones_like(reading))[0])[group]


@dataclass(frozen=True)
class RowBlocks:
    """The static tests of a record, evaluated by blocks, with the effects of a program; none of them may store oil.

    program: the effects that the vector holds. shared: those in the compiled programs, the row-wise ones of `program` among them.
    rows: of each test, or nodes, without pads. places: whether every place of the circuit can be shifted (`place_program`).
    """

    program: tuple[str, ...]
    shared: tuple[str, ...]
    args: LibraryArgs
    rows: Mapping[str, int]
    blocks: Mapping[str, tuple[LibraryArgs, ...]]
    places: bool = False

    @classmethod
    def of(cls, program: tuple[str, ...], args: LibraryArgs, rows: Mapping[str, int]) -> "RowBlocks":
        """rows: of each test, without pads."""
        places = all(terms.places is not None for terms in args.terms.values())
        shared = split(program)[0] if places else same_program(program, args.valve.heat_retention is not None)
        nodes = rows_of_model(args.data, rows)
        size = block_size(nodes.values())
        blocks = {test: blocks_of(args, test, count, size) for test, count in nodes.items()}
        return cls(program, shared, args, nodes, blocks, places)

    def moved(self, conditions: Mapping[str, Conditions]) -> "RowBlocks":
        """The same with other operating points of some tests."""
        args = replace(self.args, data=replace(self.args.data, conditions={**self.args.data.conditions, **conditions}))
        blocks = dict(self.blocks)
        for test, read in conditions.items():
            ((name, before),) = self.blocks[test][0].data.conditions.items()
            there = zip(self.blocks[test], _in_blocks(read, self.rows[test], len(before.position)), strict=True)
            blocks[test] = tuple(replace(block, data=StaticData({name: own}, (), {})) for block, own in there)
        return replace(self, args=args, blocks=blocks)

    @property
    def behind(self) -> int:
        """Entries of a row behind parameters and amounts."""
        return len(ENTRIES) if self.places else MOVES

    @cached_property
    def reads(self) -> dict[str, tuple[str, ...]]:
        """What the channels of each test read, each once."""
        channels = self.args.data.channels
        return {test: tuple(dict.fromkeys(c.reads for c in channels if c.test == test)) for test in self.blocks}

    @cached_property
    def programs(self) -> dict[str, list[Callable[[np.ndarray], Any]]]:
        """Of each test's blocks what gives its readings and their slopes, of parameters and amounts, behind one another; with places
        also what the rows could read."""
        law = self.args.valve.edge_law
        start = np.zeros(len(PARAMETERS) + len(self.shared))
        asked = {test: [Asked.of(test, read) for read in reads] for test, reads in self.reads.items()}

        def of_test(test: str, block: LibraryArgs) -> Callable[[np.ndarray], Any]:
            shared = (self.shared, classes_of(self.shared), rows_called(test))
            program = place_program(*shared) if self.places else _program(*shared, law)
            of_reads = [program.bound(start, block, one) for one in asked[test]]
            return lambda p: tuple(zip(*(program(p) for program in of_reads), strict=True))

        return {test: [of_test(test, block) for block in blocks] for test, blocks in self.blocks.items()}

    @cached_property
    def kinds(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The program's effects: those that act row by row, and the filters."""
        return split(self.program)

    @cached_property
    def entries(self) -> np.ndarray:
        """Where the entries of a row stand among those of the compiled programs: parameters, amounts, and what stands behind them."""
        count = len(PARAMETERS) + len(self.shared)
        own = (len(PARAMETERS) + self.shared.index(name) for name in self.kinds[0])
        return np.array([*range(len(PARAMETERS)), *own, *range(count, count + self.behind)], dtype=int)

    @cached_property
    def read_by(self) -> list[tuple[str, int]]:
        """Of each channel its test, and the number of what it reads there."""
        return [(c.test, self.reads[c.test].index(c.reads)) for c in self.args.data.channels]

    @cached_property
    def weighing(self) -> list[tuple[str, np.ndarray, np.ndarray, HostWhitening]]:
        """Of each channel its test, weights and readings (padded,), and its filter: laid out once, asked for at every point."""
        both = zip(self.args.data.channels, self.args.whitening, strict=True)
        return [(c.test, np.asarray(c.weight), np.asarray(c.value), HostWhitening.of(white)) for c, white in both]

    @property
    def given(self) -> int:
        """Entries of a row's parameters and amounts: those of `order_of(program)` without the filters'."""
        return len(PARAMETERS) + len(self.kinds[0])

    def _begun(self, p: np.ndarray) -> dict[str, list[Any]]:
        """What the programs give for the blocks of each test; p: parameters, then amounts of the row-wise effects of the program. All are
        begun before any is waited for: blocks run side by side."""
        whole = np.zeros(len(PARAMETERS) + len(self.shared))
        whole[self.entries[: len(p)]] = p
        return {test: [program(whole) for program in programs] for test, programs in self.programs.items()}

    def at(self, p: np.ndarray) -> "Evaluated":
        """What the programs say at p, which is in the order of `order_of(program)`."""
        return Evaluated(self, np.asarray(p[self.given :], dtype=float), self._begun(p[: self.given]))

    def evaluate(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(residuals, columns (entries, rows), by_row (fields, rows)) of p: see `Evaluated.whole`."""
        return self.at(p).whole

    def residual_of(self, number: int, reading: np.ndarray) -> np.ndarray:
        """(rows,): a channel's whitened residuals, of its reading (padded,)."""
        test, weight, value, white = self.weighing[number]
        return white((self.means(test, reading) - value) * weight)

    def weighed(self, number: int, slopes: np.ndarray) -> np.ndarray:
        """(entries, rows): a channel's slopes (entries, padded) in units of its noise, not whitened."""
        test, weight, _, _ = self.weighing[number]
        return self.means(test, slopes) * weight

    def joined(self, test: str, parts: list[np.ndarray], entries: np.ndarray | None = None) -> np.ndarray:
        """(..., padded) of a test's blocks (..., block); entries: of the last axis but one."""
        padded, size = len(self.args.data.conditions[test].position), parts[0].shape[-1]
        lead = parts[0].shape[:-1] if entries is None else (len(entries),)
        whole = np.zeros((*lead, padded))
        for number, part in enumerate(parts):
            rows = slice(number * size, min((number + 1) * size, self.rows[test]))
            own = part[..., : rows.stop - rows.start]
            whole[..., rows] = own if entries is None else own[entries]
        return whole

    def behind_filter(
        self, name: str, amount: float, channel: int, reading: np.ndarray, columns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """A channel's reading and columns behind a filter, with that of its own amount as the last: compiled for the length of one
        test alone."""
        about = self.args.data.channels[channel]
        if about.test not in effect_info(name).shows:
            return reading, np.concatenate([columns, np.zeros_like(reading)[None]])
        # At 0 it leaves what passes as it is. Filled up, the columns of most sets of effects share a program.
        passing = columns if amount != 0.0 else columns[:0]
        filled = np.zeros((-len(passing) % COLUMNS, len(reading)))
        together = np.concatenate([np.full_like(reading, amount)[None], reading[None], passing, filled])
        key = (name, channel, len(together))
        if key not in self._filters:
            none = jnp.zeros(0)
            alone = replace(about, value=none, weight=none, sensor=None)
            conditions = {about.test: complete(self.args.data.conditions[about.test])}
            own = LibraryArgs(replace(self.args.valve, heat_retention=None), StaticData(conditions, (), {}), (), {})
            self._filters[key] = _filter(name, classes_of((name,))).bound(together, alone, own)
        behind = np.asarray(self._filters[key](together))
        passed = columns if amount == 0.0 else behind[1 : 1 + len(columns)]
        return (reading if amount == 0.0 else behind[0]), np.concatenate([passed, behind[-1:]])

    @cached_property
    def _filters(self) -> dict[tuple[str, int, int], Callable[[np.ndarray], Any]]:
        """By a filter's name, a channel and the number of columns."""
        return {}

    def means(self, test: str, values: np.ndarray) -> np.ndarray:
        """See `StaticData.means`."""
        weight = self.args.data.weights.get(test)
        if weight is None:
            return values
        weight = np.asarray(weight)
        return np.sum(values.reshape(*values.shape[:-1], *weight.shape) * weight, axis=-1)


@dataclass(frozen=True)
class Evaluated:
    """The readings at a point, as the programs gave them for the blocks of each test; amounts: of the filters.

    What a fit asks of them at every trial is a fraction of what they hold, and is worked out when it is asked for.
    """

    rows: RowBlocks
    amounts: np.ndarray
    begun: dict[str, list[Any]]

    @cached_property
    def residuals(self) -> np.ndarray:
        """(rows,), all channels behind one another."""
        if self._filtered:
            return self.whole[0]
        return np.concatenate([self.rows.residual_of(n, self._reading(n)) for n in self._channels])

    def columns(self, numbers: np.ndarray) -> np.ndarray:
        """(k, rows): those of these entries, numbers in `order_of(program)`."""
        if self._filtered or np.any(numbers >= self.rows.given):
            return self.whole[1][numbers]
        entries = self.rows.entries[numbers]
        weighed = [self.rows.weighed(n, self._slopes(n, entries)) for n in self._channels]
        return np.concatenate(self._whitened(weighed), axis=1)

    @cached_property
    def whole(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(residuals, columns (entries, rows), by_row (fields, rows)) with every entry of the program.

        by_row: what a change of a row's own operating point, in the order of FIELDS, or a shift of each of `ENTRIES`, does to its residual
        before whitening.
        """
        own = slice(self.rows.given, self.rows.given + self.rows.behind)
        residuals, weighed = [], []
        for n in self._channels:
            reading, slopes = self._reading(n), self._slopes(n, self.rows.entries)
            for name, amount in zip(self.rows.kinds[1], self.amounts, strict=True):
                reading, slopes = self.rows.behind_filter(name, float(amount), n, reading, slopes)
            residuals.append(self.rows.residual_of(n, reading))
            weighed.append(self.rows.weighed(n, slopes))
        columns = self._whitened([np.delete(slopes, own, axis=0) for slopes in weighed])
        by_row = [slopes[own] for slopes in weighed]
        return np.concatenate(residuals), np.concatenate(columns, axis=1), np.concatenate(by_row, axis=1)

    @property
    def readings(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of each channel (reading (padded,), slopes (entries, padded)) before any filter and any mean, pads, which weigh nothing, being 0.

        entries: parameters, amounts of the row-wise effects of the program, and what was read in the order of FIELDS, or the shifts of
        `ENTRIES`.
        """
        return [(self._reading(n), self._slopes(n, self.rows.entries)) for n in self._channels]

    @property
    def states(self) -> dict[str, dict[str, np.ndarray]]:
        """With places what the model's readings could be of: {test: {reading: (padded,)}}, SI."""
        states = lambda test, parts, name: self.rows.joined(test, [np.asarray(part[2][0][name]) for part in parts])
        return {
            test: {name: self.rows.means(test, states(test, parts, name)) for name in read_in(test)}
            for test, parts in (self.begun.items() if self.rows.places else ())
        }

    @property
    def _channels(self) -> range:
        return range(len(self.rows.read_by))

    @property
    def _filtered(self) -> bool:
        """Whether a filter does anything: one at 0 leaves readings and slopes as they are."""
        return bool(np.any(self.amounts != 0.0))

    def _reading(self, number: int) -> np.ndarray:
        test, i = self.rows.read_by[number]
        return self.rows.joined(test, [_one_of(part[0], i) for part in self.begun[test]])

    def _slopes(self, number: int, entries: np.ndarray) -> np.ndarray:
        test, i = self.rows.read_by[number]
        return self.rows.joined(test, [_one_of(part[1], i) for part in self.begun[test]], entries)

    def _whitened(self, weighed: list[np.ndarray]) -> list[np.ndarray]:
        return [white(slopes.T).T for (*_, white), slopes in zip(self.rows.weighing, weighed, strict=True)]


def _one_of(given: Any, number: int) -> np.ndarray:
    """Of what a block's reads were given, a tuple with one array each or one array with all."""
    return np.asarray(given[number]) if isinstance(given, tuple) else np.asarray(given)[number]


def plain_by_rows(names: tuple[str, ...], args: FitArgs) -> Both:
    """(p, unused) -> residuals and columns of a plain fit of these parameters, as `static_residuals.residual_and_columns` gives them."""
    data, own = args.data, own_entries(names)
    places = [PARAMETERS.index(names[i]) for i in own]
    held = [getattr(args.valve, name) for name in PARAMETERS]
    begin = np.array([0.0 if value is None else float(value) for value in held])
    counts = {test: len(conditions.position) for test, conditions in data.conditions.items()}
    terms = {}
    for group, tests in groups_of(data.conditions).items():
        ones = np.ones((len(PARAMETERS), sum(counts[test] for test in tests)))
        terms[group] = RowTerms(ones, 0.0 * ones, ones[0])
    whole = LibraryArgs(args.valve, data, (), terms)
    size = block_size(counts.values())
    blocks = {test: blocks_of(whole, test, count, size) for test, count in counts.items()}
    # The program that a diagnosis asks most, unless the oil keeps heat, which few records ask for and its effects make dear.
    shared = () if args.valve.heat_retention is not None else same_program((), heat=False)
    rows = RowBlocks((), shared, whole, counts, blocks)
    prior_value, prior_weight = np.asarray(args.prior_value), np.asarray(args.prior_weight)

    def both(values: Any, _: Any) -> tuple[np.ndarray, np.ndarray]:
        values = np.asarray(values, dtype=float)
        given, p = dict(zip(names, values, strict=True)), begin.copy()
        p[places] = values[own]
        residuals, columns = [], []
        for channel, (reading, slopes) in zip(data.channels, rows.at(p).readings, strict=True):
            reading, slopes = rows.means(channel.test, reading), rows.means(channel.test, slopes[places])
            column = np.zeros((len(names), len(reading)))
            if (sensor := channel.sensor) is not None:
                reading, more = sensor.readings(
                    {name: jnp.asarray(value) for name, value in given.items()}, jnp.asarray(reading)
                )
                slopes = slopes * (float(sensor.reference) / given[sensor.gain] if sensor.gain else 1.0)
                for name, slope in more.items():
                    column[names.index(name)] = np.asarray(slope)
            column[own] = slopes
            weight = np.asarray(channel.weight)
            residuals.append((np.asarray(reading) - np.asarray(channel.value)) * weight)
            columns.append(column * weight)
        residuals.append((values - prior_value) * prior_weight)
        columns.append(np.diag(prior_weight))
        return np.concatenate(residuals), np.concatenate(columns, axis=1)

    return both


def rows_of_model(data: StaticData, rows: Mapping[str, int]) -> dict[str, int]:
    """The operating points of every test, without pads: some for each of its `rows` readings where these are means over nodes."""
    nodes = {test: data.weights[test].shape[1] for test in data.weights}
    return {test: rows[test] * nodes.get(test, 1) for test in data.conditions}


@made_once
def _filter(name: str, classes: tuple[type, ...]) -> KeptProgram:
    """`filtered_together`, compiled; classes: what stands behind the name."""
    return jitted(functools.partial(filtered_together, name), known_options(OPTIONS), classes)


def filtered_together(
    name: str, together: Float[Array, "given padded"], channel: ChannelRows, args: LibraryArgs
) -> Float[Array, "behind padded"]:
    """`filtered`, of one array: a filter's amount (in every row), a reading, and its columns."""
    amount, reading, columns = together[0, 0], together[1], together[2:]
    behind, along = filtered(name, amount, channel, reading, columns, args)
    return jnp.concatenate([behind[None], along])
