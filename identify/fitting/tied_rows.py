"""Static tests beside effects that store oil at the ports: each blocked test whole, by one program for all of them, the others by blocks.

What that program is compiled for is a length, one of a few, and what is read: whatever other tests stand beside the blocked ones, and
whichever effects the record can show, records share it, as they share the blocks of `row_blocks`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import numpy as np

from thermohyd.conditions import Conditions

from .library import program_of_all, stores
from .library_rows import MOVES, LibraryArgs, order_of, split
from .parameters import PARAMETERS
from .row_blocks import Evaluated, RowBlocks, blocks_of, complete, place_in_group, rows_of_model
from .static_readings import GROUPS, STORED_GROUP, ChannelRows, StaticData, groups_of
from .stored_programs import storage_program, stored_program, stored_readings


def of_tests(args: LibraryArgs, tests: tuple[str, ...]) -> LibraryArgs:
    """The data of these tests alone, with every column that an effect may ask for."""
    data = args.data
    own = [i for i, channel in enumerate(data.channels) if channel.test in tests]
    terms = {}
    for group, members in groups_of(data.conditions).items():
        begins = {test: place_in_group(data.conditions, test)[1] for test in members if test in tests}
        if begins:
            rows = np.concatenate(
                [first + np.arange(len(data.conditions[test].position)) for test, first in begins.items()]
            )
            terms[group] = jax.tree.map(lambda values, rows=rows: np.asarray(values)[..., rows], args.terms[group])
    alone = StaticData(
        {test: complete(conditions) for test, conditions in data.conditions.items() if test in tests},
        tuple(data.channels[i] for i in own),
        {test: weight for test, weight in data.weights.items() if test in tests},
    )
    return LibraryArgs(args.valve, alone, tuple(args.whitening[i] for i in own), terms)


def rows_of_tests(channels: tuple[ChannelRows, ...]) -> dict[str, slice]:
    """Where each test's residuals stand, those of its channels behind one another."""
    found: dict[str, slice] = {}
    first = 0
    for channel in channels:
        stop = first + len(channel.value)
        found[channel.test] = slice(found[channel.test].start if channel.test in found else first, stop)
        first = stop
    return found


def blocked_tests(args: LibraryArgs) -> tuple[str, ...]:
    """Tests whose ports may store oil."""
    return tuple(test for test in args.data.conditions if test in GROUPS[STORED_GROUP])


# A shorter test is filled up to the length of a record's longest where that takes half as many rows again at most: it then needs no
# program of its own, which takes as long to compile as some hundred evaluations.
FILLED_UP = 1.5


@dataclass(frozen=True)
class StoredBlocks(RowBlocks):
    """Blocked tests, each of them one block of `stored_programs`, evaluated as other blocks are."""

    @classmethod
    def beside(
        cls, program: tuple[str, ...], shared: tuple[str, ...], args: LibraryArgs, rows: Mapping[str, int]
    ) -> "StoredBlocks":
        """shared: the effects in the compiled programs; of `args` the blocked tests only; rows: of each test, without pads."""
        nodes = rows_of_model(args.data, rows)
        sizes = {test: len(conditions.position) for test, conditions in args.data.conditions.items()}
        longest = max(sizes.values())
        filled = {test: longest if FILLED_UP * own >= longest else own for test, own in sizes.items()}
        blocks = {test: blocks_of(args, test, count, filled[test]) for test, count in nodes.items()}
        return cls(program, shared, args, nodes, blocks)

    @cached_property
    def reads(self) -> dict[str, tuple[str, ...]]:
        """What the channels of any of the tests read: one program for all of them."""
        every = tuple(sorted({channel.reads for channel in self.args.data.channels}))
        return dict.fromkeys(self.blocks, every)

    @cached_property
    def programs(self) -> dict[str, list[Callable[[np.ndarray], Any]]]:
        start = np.zeros(len(PARAMETERS) + len(self.shared))
        return {
            test: [stored_program(self.shared, self.reads[test]).bound(start, block) for block in blocks]
            for test, blocks in self.blocks.items()
        }

    def residuals_alone(self, p: np.ndarray, tests: tuple[str, ...]) -> dict[str, np.ndarray]:
        """The residuals of these tests, at a third of the cost."""
        whole = np.zeros(len(PARAMETERS) + len(self.shared))
        whole[self.entries[: self.given]] = p[: self.given]
        found: dict[str, list[np.ndarray]] = {test: [] for test in tests}
        begun = {test: stored_readings(self.shared, self.reads[test])(whole, self.blocks[test][0]) for test in tests}
        for number, (test, place) in enumerate(self.read_by):
            if test in found:
                reading = self.joined(test, [np.asarray(begun[test])[place]])
                for name, amount in zip(self.kinds[1], p[self.given :], strict=True):
                    if amount != 0.0:
                        none = np.zeros((0, len(reading)))
                        reading, _ = self.behind_filter(name, float(amount), number, reading, none)
                found[test].append(self.residual_of(number, reading))
        return {test: np.concatenate(parts) for test, parts in found.items()}

    def storage(self, stored: tuple[str, ...], p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals with these amounts stored, and their columns (stored, rows); p: of `order_of(program)`, then the amounts."""
        whole = np.zeros(len(PARAMETERS) + len(self.shared) + len(stored))
        whole[self.entries[: self.given]] = p[: self.given]
        whole[-len(stored) :] = p[-len(stored) :]
        begun = {
            test: storage_program(self.shared, stored, self.reads[test])(whole, block)
            for test, (block,) in self.blocks.items()
        }
        residuals, columns = [], []
        for number, (test, place) in enumerate(self.read_by):
            read, moved = (np.asarray(part)[place] for part in begun[test])
            reading, column = self.joined(test, [read]), self.joined(test, [moved], np.arange(len(stored)))
            for name, amount in zip(self.kinds[1], p[self.given : -len(stored)], strict=True):
                reading, column = self.behind_filter(name, float(amount), number, reading, column)
                column = column[:-1]  # without that of the filter
            residuals.append(self.residual_of(number, reading))
            columns.append(self.weighing[number][-1](self.weighed(number, column).T).T)
        return np.concatenate(residuals), np.concatenate(columns, axis=1)


@dataclass(frozen=True)
class TiedRows:
    """The static tests of a record with the effects of a program, some of which store oil.

    program: the effects that the vector holds. stored: the blocked tests; others: those beside them, without what stores oil.
    """

    program: tuple[str, ...]
    args: LibraryArgs
    stored: StoredBlocks
    others: RowBlocks | None

    @classmethod
    def of(cls, program: tuple[str, ...], args: LibraryArgs, rows: Mapping[str, int]) -> "TiedRows":
        """rows: of each test, without pads."""
        blocked = blocked_tests(args)
        shared = split(program_of_all(program, args.valve.heat_retention is not None))[0]
        stored = StoredBlocks.beside(program, shared, of_tests(args, blocked), rows)
        tests = tuple(test for test in args.data.conditions if test not in blocked)
        apart = tuple(name for name in program if not stores(name))
        return cls(program, args, stored, RowBlocks.of(apart, of_tests(args, tests), rows) if tests else None)

    def moved(self, conditions: Mapping[str, Conditions]) -> "TiedRows":
        """The same with other operating points of some tests."""
        args = replace(self.args, data=replace(self.args.data, conditions={**self.args.data.conditions, **conditions}))
        of = lambda part: part.moved({test: read for test, read in conditions.items() if test in part.blocks})
        return replace(self, args=args, stored=of(self.stored), others=self.others and of(self.others))

    @cached_property
    def parts(self) -> list[tuple[RowBlocks, np.ndarray]]:
        """The tests' blocks, and where their entries stand among those of `order_of(program)`."""
        order = order_of(self.program)
        blocks = [part for part in (self.stored, self.others) if part is not None]
        return [(part, np.array([order.index(name) for name in order_of(part.program)])) for part in blocks]

    def at(self, p: np.ndarray) -> "TiedEvaluated":
        """What the programs say at p, which is in the order of `order_of(program)`."""
        return TiedEvaluated(self, tuple(part.at(np.asarray(p, dtype=float)[own]) for part, own in self.parts))

    def evaluate(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(residuals, columns (entries, rows), by_row (fields, rows)): see `RowBlocks.evaluate`; by_row is NaN where ports store oil."""
        found = self.at(p)
        entries = np.arange(len(order_of(self.program)))
        return found.residuals, found.columns(entries), found.by_row

    def placed(self, values: list[np.ndarray]) -> np.ndarray:
        """(..., rows) of all tests from those of each of `parts`."""
        found = {
            test: own[..., rows]
            for (part, _), own in zip(self.parts, values, strict=True)
            for test, rows in rows_of_tests(part.args.data.channels).items()
        }
        return np.concatenate([found[test] for test in rows_of_tests(self.args.data.channels)], axis=-1)


@dataclass(frozen=True)
class TiedEvaluated:
    """What `Evaluated` is of one kind of blocks: of all tests, some of whose ports store oil."""

    rows: TiedRows
    parts: tuple[Evaluated, ...]

    @cached_property
    def residuals(self) -> np.ndarray:
        """(rows,), all channels behind one another."""
        return self.rows.placed([part.residuals for part in self.parts])

    def columns(self, numbers: np.ndarray) -> np.ndarray:
        """(k, rows): those of these entries, numbers in `order_of(program)`."""
        found = []
        for part, (_, own) in zip(self.parts, self.rows.parts, strict=True):
            has = np.isin(numbers, own)
            columns = part.columns(np.searchsorted(own, np.asarray(numbers)[has]))
            every = np.zeros((len(has), columns.shape[1]))
            every[has] = columns
            found.append(every)
        return self.rows.placed(found)

    @property
    def by_row(self) -> np.ndarray:
        """(fields, rows): see `Evaluated.whole`."""
        return self.rows.placed([part.whole[2][:MOVES] for part in self.parts])


def stored_beside(
    program: tuple[str, ...], amounts: Mapping[str, float], p: np.ndarray, args: LibraryArgs, rows: Mapping[str, int]
) -> tuple[np.ndarray, np.ndarray]:
    """What `StoredBlocks.storage` gives, of all tests, beside the effects of a program, none of which stores oil: 0 where ports are not
    blocked. p: of `order_of(program)`; rows: of each test, without pads."""
    heat = args.valve.heat_retention is not None
    every = tuple(name for name in program_of_all((*program, *amounts), heat) if not stores(name))
    blocked = StoredBlocks.beside(program, split(every)[0], of_tests(args, blocked_tests(args)), rows)
    found = blocked.storage(tuple(amounts), np.concatenate([p, [*amounts.values()]]))
    places = rows_of_tests(args.data.channels)
    whole = [np.zeros((*part.shape[:-1], max(rows.stop for rows in places.values()))) for part in found]
    for test, own in rows_of_tests(blocked.args.data.channels).items():
        for into, part in zip(whole, found, strict=True):
            into[..., places[test]] = part[..., own]
    return whole[0], whole[1]
