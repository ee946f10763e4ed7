"""The plain fits of many records at once: every search of every record is a lane of one program.

Each record's fit is the one of `fit.py`, in a thread of its own that waits whenever it needs a search; once all wait, the searches
go on together (`lanes.py`), and those that have ended wake their records. So a record is asked the same questions in the same order as
alone, and its answers differ by rounding only. What shares a program with no other record is searched as it would be alone.
"""

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.numerics import require_float64

from .boxes import Box
from .fit import STARTS, Progress, fit, plain_fit
from .lanes import Lanes, Search
from .least_squares import BELIEVE_BELOW, STOP_AT, LeastSquaresResult, Residual, judged, solve
from .result import FitResult


TOGETHER = 16
FEW = 0.25  # share of the lanes: fewer searches than that go on alone, as lanes that stand still cost as much as those that search
Ended = Callable[[int, FitResult | Exception], None]


def fit_many(
    records: Sequence[BenchRecord],
    *,
    together: int = TOGETHER,
    starts: int = STARTS,
    progress: Progress | None = None,
    ended: Ended | None = None,
) -> list[FitResult | Exception]:
    """`fit` of many records, up to `together` of them at a time as one program; results in the order of the records.

    A record that cannot be fitted has its exception in the place of a result. One that does not converge here is fitted again alone;
    one with dynamic tests is always fitted alone. ended: called with a record's number and result as soon as it is there.
    Raises RuntimeError in single precision.
    """
    require_float64("fit")
    if together < 1:
        raise ValueError(f"together must be at least 1, not {together}")
    return _Run(records, together, starts, progress or (lambda words: None), ended).results_of_all()


class _GivenUp(BaseException):
    """The run has ended: whoever waits for a search need not wait any more."""


class _Run:
    """The threads that fit records, and the one that moves their searches on: the caller's."""

    def __init__(
        self, records: Sequence[BenchRecord], together: int, starts: int, say: Progress, ended: Ended | None
    ) -> None:
        self.records, self.together, self.starts, self.say, self.ended = records, together, starts, say, ended
        self.results: dict[int, Any] = {}
        self.static = [i for i, record in enumerate(records) if record.static_tests and not record.dynamic_tests]
        self.changed = threading.Condition()
        # Below: only with `changed` held.
        self.left = list(reversed(self.static))
        self.busy, self.over = 0, False  # threads that wait for no search
        self.waiting: list[Search] = []
        self.fitted: list[tuple[int, Any]] = []
        self.groups: list[Lanes] = []

    def results_of_all(self) -> list[FitResult | Exception]:
        self.busy = min(self.together, len(self.static))
        try:
            for _ in range(self.busy):
                threading.Thread(target=self._fit_records, daemon=True).start()
            self._move_on()
        finally:
            self._give_up()
        for i in range(len(self.records)):
            if i not in self.results:
                self._keep(i, self._alone(i))
        return [self.results[i] for i in range(len(self.records))]

    # In the threads

    def _fit_records(self) -> None:
        while True:
            with self.changed:
                if not self.left or self.over:
                    self.busy -= 1
                    self.changed.notify_all()
                    return
                i = self.left.pop()
            began = time.perf_counter()
            try:
                result: Any = plain_fit(self.records[i], starts=self.starts, solver=self._solve)[1]
                result = replace(result, seconds=time.perf_counter() - began)
            except _GivenUp:
                return
            except Exception as error:
                result = error
            with self.changed:
                self.fitted.append((i, result))
                self.changed.notify_all()

    def _solve(
        self,
        residual: Residual,
        boxes: Sequence[Box],
        args: Any,
        start: np.ndarray,
        *,
        tolerance: float = STOP_AT,
        believe: float = BELIEVE_BELOW,
        enough: float = np.inf,
    ) -> LeastSquaresResult:
        """`least_squares.solve`, together with what other records ask."""
        search = Search(residual, boxes, args, np.array(start, dtype=float), tolerance, enough)
        with self.changed:
            if not self.over:
                self.waiting.append(search)
                self.busy -= 1
                self.changed.notify_all()
        search.woken.wait()
        if self.over:
            raise _GivenUp
        if search.out is None:
            return solve(residual, boxes, args, start, tolerance=tolerance, believe=believe, enough=enough)
        return judged(boxes, search.start, search.out, believe)

    # In the caller's thread

    def _move_on(self) -> None:
        """Until all threads have ended."""
        while True:
            with self.changed:
                self.changed.wait_for(lambda: self.fitted or not self.busy)
                fitted, self.fitted = self.fitted, []
                new = [] if self.busy else self.waiting
                if not self.busy:
                    self.waiting = []
                all_wait = not self.busy
            for i, result in fitted:
                sound = isinstance(result, BenchInputError) or (isinstance(result, FitResult) and result.converged)
                self._keep(i, result if sound else self._alone(i))
            if not all_wait:
                continue
            if lonely := self._placed(new):
                self._wake(lonely)
                continue
            ended = [search for lanes in self.groups if lanes.searching for search in lanes.advance()]
            self._wake(ended)
            if not any(lanes.searching for lanes in self.groups) and not ended:
                return

    def _placed(self, searches: Iterable[Search]) -> list[Search]:
        """Put searches into lanes; those that share a program with no other, or with too few, are handed back."""
        rest, lonely = list(searches), []
        for lanes in self.groups:
            mine = [search for search in rest if lanes.takes(search)]
            rest = [search for search in rest if not lanes.takes(search)]
            few = lanes.searching + len(mine) < max(2, FEW * len(lanes))
            put = [] if few else mine[: lanes.free]
            for search in put:
                lanes.put(search)
            lonely += mine[len(put) :]
        while rest:
            alike = [search for search in rest if search.key == rest[0].key]
            rest = [search for search in rest if search.key != rest[0].key]
            if len(alike) < 2:
                lonely += alike
                continue
            lanes = Lanes(alike[0], 1 << (len(alike) - 1).bit_length())
            self.groups.append(lanes)
            for search in alike:
                lanes.put(search)
        return lonely

    def _wake(self, searches: Sequence[Search]) -> None:
        with self.changed:
            self.busy += len(searches)
        for search in searches:
            search.woken.set()

    def _keep(self, i: int, result: FitResult | Exception) -> None:
        self.results[i] = result
        self.say(f"{len(self.results):,} of {len(self.records):,} records fitted")
        if self.ended is not None:
            self.ended(i, result)

    def _alone(self, i: int) -> FitResult | Exception:
        try:
            return fit(self.records[i], starts=self.starts)
        except Exception as error:
            return error

    def _give_up(self) -> None:
        """Whatever ends the run, no thread waits for ever."""
        with self.changed:
            self.over = True
            waiting, self.waiting = self.waiting, []
        for search in (*waiting, *(search for lanes in self.groups for search in lanes.searches())):
            search.woken.set()
