"""Static tests beside effects that store oil at the ports: each blocked test whole, by a program of its own, the others by blocks.

What a test's program is compiled for is its length, one of a few, and what it reads: whatever other tests stand beside it, and
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
from .library_program import MOVES, LibraryArgs, library_program, library_residual, order_of
from .row_blocks import RowBlocks, complete, place_in_group
from .static_readings import GROUPS, STORED_GROUP, ChannelRows, StaticData, groups_of
from .storage_columns import storage_columns


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


def _placed(order: tuple[str, ...], p: np.ndarray, among: tuple[str, ...]) -> tuple[np.ndarray, list[int]]:
    """(the vector of `among` with the values of `order`, and where these stand in it)."""
    places = [among.index(name) for name in order]
    whole = np.zeros(len(among))
    whole[places] = p
    return whole, places


@dataclass(frozen=True)
class TiedRows:
    """The static tests of a record with the effects of a program, some of which store oil.

    program: the effects that the vector holds. rows: of each test, without pads.
    """

    program: tuple[str, ...]
    args: LibraryArgs
    rows: Mapping[str, int]

    def moved(self, conditions: Mapping[str, Conditions]) -> "TiedRows":
        """The same with other operating points of some tests."""
        args = replace(self.args, data=replace(self.args.data, conditions={**self.args.data.conditions, **conditions}))
        return replace(self, args=args)

    @cached_property
    def _all(self) -> tuple[str, ...]:
        """The effects in the programs of the blocked tests."""
        return program_of_all(self.program, self.args.valve.heat_retention is not None)

    @cached_property
    def _blocked(self) -> dict[str, Callable[[np.ndarray], Any]]:
        start = np.zeros(len(order_of(self._all)))
        return {
            test: library_program(self._all).bound(start, of_tests(self.args, (test,)))
            for test in blocked_tests(self.args)
        }

    @cached_property
    def _others(self) -> RowBlocks | None:
        tests = tuple(test for test in self.args.data.conditions if test not in self._blocked)
        apart = tuple(name for name in self.program if not stores(name))
        return RowBlocks.of(apart, of_tests(self.args, tests), self.rows) if tests else None

    def evaluate(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(residuals, columns (entries, rows), by_row (fields, rows)) of p in the order of `order_of(program)`: see `RowBlocks.evaluate`;
        by_row is NaN where ports store oil."""
        order = order_of(self.program)
        whole, places = _placed(order, p, order_of(self._all))
        begun = {test: program(whole) for test, program in self._blocked.items()}
        found: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        if self._others is not None:
            own = [order.index(name) for name in order_of(self._others.program)]
            residual, columns, by_row = self._others.evaluate(p[own])
            every = np.zeros((len(order), columns.shape[1]))
            every[own] = columns
            for test, rows in rows_of_tests(self._others.args.data.channels).items():
                found[test] = residual[rows], every[:, rows], by_row[:MOVES, rows]
        for test, (residual, columns, by_row) in begun.items():
            found[test] = np.asarray(residual), np.asarray(columns)[places], np.asarray(by_row)[:MOVES]
        residuals, columns, by_row = zip(*(found[test] for test in rows_of_tests(self.args.data.channels)), strict=True)
        return np.concatenate(residuals), np.concatenate(columns, axis=1), np.concatenate(by_row, axis=1)

    def residual(self, p: np.ndarray, tests: tuple[str, ...]) -> dict[str, np.ndarray]:
        """The residuals of these blocked tests alone, at a third of the cost."""
        whole, _ = _placed(order_of(self.program), p, order_of(self._all))
        alone = library_residual(self._all)
        return {test: np.asarray(alone(whole, of_tests(self.args, (test,)))) for test in tests}


def stored_beside(
    program: tuple[str, ...], amounts: Mapping[str, float], p: np.ndarray, args: LibraryArgs
) -> tuple[np.ndarray, np.ndarray]:
    """What `storage_columns` gives of all tests, beside the effects of a program, none of which stores oil; p: of `order_of(program)`."""
    heat = args.valve.heat_retention is not None
    every = tuple(name for name in program_of_all((*program, *amounts), heat) if not stores(name))
    whole, _ = _placed(order_of(program), p, order_of(every))
    values = np.array([*amounts.values()])
    places = rows_of_tests(args.data.channels)
    residual = np.zeros(max(rows.stop for rows in places.values()))
    columns = np.zeros((len(amounts), len(residual)))
    for test in blocked_tests(args):
        found = storage_columns(every, tuple(amounts), whole, values, of_tests(args, (test,)))
        residual[places[test]], columns[:, places[test]] = map(np.asarray, found)
    return residual, columns
