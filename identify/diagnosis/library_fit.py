"""Fits of one record with any of the library's effects freed: the same compiled solve for all of them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.bench.record import BenchRecord, TestRecord
from thermohyd.identify.fitting.boxes import Box
from thermohyd.identify.fitting.least_squares import Both, LeastSquaresResult, solve
from thermohyd.identify.fitting.parameters import ParameterPlan
from thermohyd.identify.fitting.starts import hop
from thermohyd.identify.fitting.static_readings import (
    Size,
    StaticData,
    base_valve,
    channel_slices,
    coarse_size,
    groups_of,
    pad,
    prior_rows,
    static_data,
)
from thermohyd.identify.model.learned_terms import ABSOLUTE, LearnedTerm, term_values
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.noise.whitening import whitening_of
from thermohyd.identify.reduction.legs import piece_bounds

from .library import Library, coupled, with_heat
from .library_model import PARAMETERS, LibraryArgs, RowTerms, library_program, order_of


Key = tuple[str, str]  # test, channel

# A search stops a thousandth of a standard error from its optimum: chi-square is then right to 1e-6.
CLOSE_ENOUGH = 1e-4
# An end counts as an optimum up to here: a twentieth of a standard error is nothing to anybody.
BELIEVE = 0.05
# Amount from which a search starts where the linearised estimate lies at the neutral value or beyond its limit.
SMALL_START = 0.05  # of the effect's scale
START_WITHIN = 3.0  # times the largest usual amount
MOST_STEPS, PATIENCE = 40, 5  # a refit that crawls is no candidate; one that is to stay may go on
# A search starts beside an optimum that has been hopped over already: fewer and shorter hops than a first fit's.
HOPS, ROUNDS_OF_HOPS = (2.0, 0.7), 2


@dataclass(frozen=True)
class Noise:
    """What the diagnosis believes of the noise of each channel: standard deviation per row (SI) and correlation."""

    std: dict[Key, np.ndarray]
    correlation: dict[Key, NoiseCorrelation]


@dataclass(frozen=True)
class LibraryFit:
    """The end of a fit with the effects `effects` free. Rows: the real ones of every channel in turn, then the priors.

    residual (rows,): whitened, model - reading. columns (rows, entries): its derivatives to every parameter and effect of
    `order`, free or not. values: every entry of `order`. used (rows,): rows that the fit saw.
    """

    effects: tuple[str, ...]
    order: tuple[str, ...]
    free: tuple[str, ...]
    values: dict[str, float]
    chi2: float
    residual: np.ndarray
    columns: np.ndarray
    used: np.ndarray
    active: frozenset[str]  # free ones that press against a limit
    converged: bool
    message: str
    solution: LeastSquaresResult

    def column(self, name: str) -> np.ndarray:
        return self.columns[:, self.order.index(name)]

    @property
    def nuisance(self) -> np.ndarray:
        """Columns of what this fit adjusted, those at a limit left out."""
        names = [name for name in self.free if name not in self.active]
        return self.columns[:, [self.order.index(name) for name in names]]


@dataclass
class LibraryProblem:
    """One record's refits. `used` (rows,) masks rows out of a fit (they still have residuals and columns)."""

    record: BenchRecord
    tests: dict[str, TestRecord]
    plans: dict[str, ParameterPlan]
    library: Library
    noise: Noise
    used: np.ndarray | None = None
    terms: tuple[LearnedTerm, ...] = ()
    evaluations: int = 0
    _args: dict[str, LibraryArgs] = field(default_factory=dict)

    def with_noise(self, noise: Noise) -> "LibraryProblem":
        return replace(self, noise=noise, evaluations=0, _args={})

    def with_rows(self, used: np.ndarray | None) -> "LibraryProblem":
        """The same problem fitted to some rows only, counted as in a fit's residual (priors are always used)."""
        return replace(self, used=used, evaluations=0, _args={})

    def with_terms(self, *terms: LearnedTerm) -> "LibraryProblem":
        """The same problem with learned smooth terms in the model, instead of those that it had."""
        return replace(self, terms=terms, evaluations=0, _args={})

    @property
    def in_motion(self) -> bool:
        """Whether the rows are those of dynamic tests."""
        return False

    @property
    def parameters(self) -> tuple[str, ...]:
        """Every entry that is no effect; each has one row of priors behind the readings."""
        return PARAMETERS

    @property
    def free_parameters(self) -> tuple[str, ...]:
        return tuple(name for name in self.parameters if not self.plans[name].fixed)

    def order_of(self, program: tuple[str, ...]) -> tuple[str, ...]:
        """Entries of the vector of a program with these effects."""
        return order_of(program)

    @property
    def _closeness(self) -> tuple[float, float]:
        """Standard errors from an optimum at which a search stops, and up to which it is believed."""
        return CLOSE_ENOUGH, BELIEVE

    @property
    def _size(self) -> Size:
        """Rows that a channel is padded to."""
        return coarse_size

    def sweeps(self, test: str) -> np.ndarray:
        """Stretches of a test's rows along which its noise remembers."""
        return noise_sweeps(self.tests[test])

    def rows(self) -> dict[Key, slice]:
        """Where each channel's rows lie in a `LibraryFit`'s residual."""
        found, first = {}, 0
        for key, padded in channel_slices(self.tests, self._size).items():
            count = padded.stop - padded.start
            found[key] = slice(first, first + count)
            first += count
        return found

    def fit(
        self,
        effects: Iterable[str] = (),
        start: Mapping[str, float] | None = None,
        *,
        hops: bool = False,
        most_steps: int = MOST_STEPS,
    ) -> LibraryFit:
        """Fit the free parameters and the amounts of `effects`, from `start` (missing entries: nominal, neutral).

        hops: with patience, and over the kinks of the underlap, for a fit that is to stay.
        """
        chosen = tuple(name for name in self.library.names if name in set(effects))
        program = self._program(chosen)
        order = self.order_of(program)
        free = (*self.free_parameters, *(name for name in order if name in chosen))
        begin = self._start(order, chosen, start or {})
        boxes = [self._box(name, begin[i], name in free) for i, name in enumerate(order)]
        args = self._arguments(program)

        def from_point(point: np.ndarray) -> LeastSquaresResult:
            both = self._both(program)
            close, believe = self._closeness
            result = solve(None, boxes, args, point, tolerance=close, max_steps=most_steps, both=both, believe=believe)
            self.evaluations += result.steps + 1
            return result

        best = from_point(np.array(begin))
        for _ in range(PATIENCE if hops else 0):
            if best.converged or best.exhausted:
                break
            best = from_point(best.p)
        if hops:
            best = hop(best, order, from_point, hops=HOPS, rounds=ROUNDS_OF_HOPS)
        return self._result(chosen, order, free, best)

    def evaluate(self, values: Mapping[str, float], effects: Iterable[str] = ()) -> LibraryFit:
        """Residuals and columns at given values; nothing is fitted. `effects` must be present in the program used."""
        chosen = tuple(name for name in self.library.names if name in set(effects) or values.get(name, 0.0) != 0.0)
        return self._evaluate(values, self._program(chosen))

    def _both(self, program: tuple[str, ...]) -> Both:
        """Residuals and columns of a program."""
        return library_program(program)

    def _evaluate(self, values: Mapping[str, float], program: tuple[str, ...]) -> LibraryFit:
        order = self.order_of(program)
        point = [values.get(name, 0.0 if name not in self.parameters else self.plans[name].start) for name in order]
        boxes = [self._box(name, point[i], False) for i, name in enumerate(order)]
        result = solve(
            None, boxes, self._arguments(program), np.array(point), tolerance=CLOSE_ENOUGH,
            max_steps=MOST_STEPS, both=self._both(program),
        )  # fmt: skip
        self.evaluations += result.steps + 1
        return self._result((), order, (), result)

    def with_all_columns(self, fit: LibraryFit) -> LibraryFit:
        """The same fit with the columns of every effect of the library: those of its own program, then of others.

        Beside a coupled effect the column of the heating is that of the valve without the coupling: close enough to say
        whether a refit, which is exact, is worth its while.
        """
        missing = [name for name in self.library.names if name not in fit.order]
        if not missing:
            return fit
        present = [name for name in fit.order if name not in self.parameters and fit.values[name] != 0.0]
        other = self.library.plain if with_heat(missing) else self._program((*present, *missing))
        held = {name: value for name, value in fit.values.items() if name in self.parameters or name in other}
        at = self._evaluate(held, other)
        order = self.order_of(self.library.names)
        columns = [(fit if name in fit.order else at).column(name) for name in order]
        values = {name: fit.values.get(name, 0.0) for name in order}
        return replace(fit, order=order, values=values, columns=np.stack(columns, axis=1))

    def _program(self, chosen: tuple[str, ...]) -> tuple[str, ...]:
        """The effects present in the cheapest program that serves `chosen`."""
        if not any(coupled(name) for name in chosen):
            return self.library.plain
        return self.library.names if with_heat(chosen) or self._heat_asked else self.library.cold

    @property
    def _heat_asked(self) -> bool:
        plan = self.plans["heat_retention"]
        return not plan.fixed or plan.start > 0.0

    def _start(self, order: tuple[str, ...], chosen: tuple[str, ...], start: Mapping[str, float]) -> list[float]:
        found = []
        for name in order:
            if name in self.parameters:
                found.append(start.get(name, self.plans[name].start))
                continue
            if name not in chosen:
                found.append(0.0)
                continue
            info = effect_info(name)
            # A linear estimate may lie far outside of what the balances can solve.
            most = START_WITHIN * info.typical[1]
            value = float(np.clip(start.get(name, 0.0), max(info.lower, -most), min(info.upper, most)))
            # An effect even in its amount has no slope at neutral, and a search that starts on a wall may stay there.
            if abs(value) < SMALL_START * info.scale:
                value = SMALL_START * info.scale * (1.0 if value >= 0.0 else -1.0)
            found.append(value)
        return found

    def _box(self, name: str, value: float, free: bool) -> Box:
        if name not in self.parameters:
            info = effect_info(name)
            lower, upper, scale = info.lower, info.upper, info.scale
        else:
            plan = self.plans[name]
            lower, upper, scale = plan.lower, plan.upper, plan.info.scale
        if not free:
            return Box(name, value, scale, value, value, held=True)
        return Box(name, min(max(value, lower), upper), scale, lower, upper)

    def _arguments(self, program: tuple[str, ...]) -> LibraryArgs:
        args = self._all_arguments()
        if with_heat(program) or self._heat_asked:
            return args
        return replace(args, valve=replace(args.valve, heat_retention=None))

    def _all_arguments(self) -> LibraryArgs:
        if "args" not in self._args:
            values = {name: plan.start for name, plan in self.plans.items()}
            data = static_data(self.tests, self.noise.std, coarse_size)
            whitening, channels = [], []
            rows = self.rows()
            for channel in data.channels:
                key = (channel.test, channel.name)
                test = self.tests[channel.test]
                sweeps = self.sweeps(channel.test)
                whitening.append(whitening_of(self.noise.correlation[key], sweeps, coarse_size(test.rows)))
                weight = channel.weight
                if self.used is not None:
                    weight = weight * pad(self.used[rows[key]].astype(float), fill=0.0, size=coarse_size)
                channels.append(type(channel)(channel.test, channel.name, channel.value, weight))
            data = type(data)(data.conditions, tuple(channels), data.weights)
            plans = [self.plans[name] for name in PARAMETERS]
            value, weight = prior_rows(plans)
            self._args["args"] = LibraryArgs(
                base_valve(self.record, values, heat=True), data, tuple(whitening), self._row_terms(data), value, weight
            )
        return self._args["args"]

    def _row_terms(self, data: StaticData) -> dict[str, RowTerms]:
        found = {}
        for group, tests in groups_of(data.conditions).items():
            nodes = [1 if (own := self.tests[name].nodes) is None else own.count for name in tests]
            sizes = [coarse_size(self.tests[name].rows) * k for name, k in zip(tests, nodes, strict=True)]
            factor, shift = np.ones((len(PARAMETERS), sum(sizes))), np.zeros((len(PARAMETERS), sum(sizes)))
            viscosity = np.ones(sum(sizes))
            first = 0
            for name, size, k in zip(tests, sizes, nodes, strict=True):
                rows = slice(first, first + self.tests[name].rows * k)
                for term in self.terms:
                    change = np.repeat(term_values(term, self.tests[name], self.record.oil), k)
                    if term.quantity == "viscosity":
                        viscosity[rows] *= 1.0 + change
                    elif term.quantity in ABSOLUTE:
                        shift[PARAMETERS.index(term.quantity), rows] += change
                    else:
                        factor[PARAMETERS.index(term.quantity), rows] *= 1.0 + change
                first += size
            found[group] = RowTerms(factor, shift, viscosity)
        return found

    def _result(
        self, chosen: tuple[str, ...], order: tuple[str, ...], free: tuple[str, ...], result: LeastSquaresResult
    ) -> LibraryFit:
        priors = len(self.parameters)
        real = np.concatenate(
            [np.arange(s.start, s.stop) for s in channel_slices(self.tests, self._size).values()]
            + [np.arange(len(result.residual) - priors, len(result.residual))]
        )
        values = dict(zip(order, (float(v) for v in result.p), strict=True))
        pressed = frozenset(name for name, side in zip(order, result.active, strict=True) if side and name in free)
        used = np.ones(len(real), dtype=bool) if self.used is None else np.append(
            self.used[: len(real) - priors], np.ones(priors, dtype=bool)
        )  # fmt: skip
        return LibraryFit(
            chosen, order, free, values, result.cost, result.residual[real], result.jacobian[real], used, pressed,
            result.converged, result.message, result,
        )  # fmt: skip


def noise_sweeps(test: TestRecord) -> np.ndarray:
    """Stretches of rows along which noise remembers: one sweep after the other within a run hangs together."""
    ids = np.zeros(test.rows, dtype=int)
    for number, (start, stop) in enumerate(piece_bounds(test.run)):
        ids[start:stop] = number
    return ids
