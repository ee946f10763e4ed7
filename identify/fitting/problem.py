"""A record's readings and a model of them as one least-squares problem, and fits of it with any effects freed.

All tests of a record stand in one problem, static and dynamic ones: `Readings` is the only place where they differ. A
problem is frozen; other noise, other rows or another term make another problem, so that nothing computed for one is ever
taken for another's. The plain fit is the fit with no effect freed.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_record import TestRecord, dynamic_among
from thermohyd.identify.model.learned_terms import LearnedTerm
from thermohyd.identify.model.term_variables import States
from thermohyd.identify.model.typed_terms import TypedTerm
from thermohyd.identify.noise.whitening import Decorrelation, SharedError, Whitening, whiten_on_host
from thermohyd.identify.reduction.monotone_pieces import run_ids
from thermohyd.side_by_side import each

from .bench_faults import BenchFault, allowance_of, info_of, is_fault
from .boxes import Box
from .discrepancy import Discrepancy
from .least_squares import Columns, LeastSquaresResult, solve
from .library import Library, coupled, library_for, relative_cost, stores, with_heat
from .library_rows import ENTRIES
from .parameters import IN_MOTION, PARAMETERS, SEEN_IN_MOTION, ParameterPlan
from .problem_fit import Fit, Work
from .readings import MotionReadings, Noise, Readings, StaticReadings
from .sensed import Sensed, SignalRows, sensed_channels, traced
from .starts import basin_hopping, ended_on_a_slope, on_a_kink
from .static_readings import channel_slices
from .static_residuals import prior_rows
from .trimmed import trimmed_points
from .uncertainty import Key


# Standard errors from an optimum at which a fit that is to stay stops: chi-square is then right to 1e-6.
CLOSE_ENOUGH = 1e-4
# One that is only compared with others: chi-square is right to 1e-3, far below what decides anything. Gauss-Newton halves the
# way to an optimum with each step where the readings are noisy, so that the last two digits took as long as all before them.
# Also in motion: a run is known to its solver's tolerance, and its steps change a little from one point to the next.
CLOSE_TO_COMPARE = 1e-2
# An end counts as an optimum up to here: a twentieth of a standard error is nothing to anybody.
BELIEVE = 0.05
# Amount from which a search starts where the linearised estimate lies at the neutral value or beyond its limit.
SMALL_START = 0.05  # of the effect's scale
START_WITHIN = 3.0  # times the largest usual amount
MOST_STEPS, PATIENCE = 40, 5  # a refit that crawls is no candidate; one that is to stay may go on
WORTH = 0.05  # chi-square: a short look, which compares candidates, goes on for no less
# A search starts beside an optimum that basin hopping has been through: fewer and shorter moves [um] than a first fit's.
MOVES, ROUNDS_OF_MOVES = (2.0, 0.7), 2
BETTER = 1e-5  # relative fall of chi-square that is no rest of another search's way


@dataclass(frozen=True)
class System:
    """A problem as `solve` takes it: entries in order, those that are free, their boxes, residuals with columns (entries, rows).

    chosen: the effects and faults among the free ones. real: of so many rows those that are no pads, the priors of all
    parameters behind them.
    """

    chosen: tuple[str, ...]
    order: tuple[str, ...]
    free: tuple[str, ...]
    boxes: list[Box]
    both: Callable[[Any, Any], tuple[Any, Any]]
    real: Callable[[int], np.ndarray]


@dataclass(frozen=True)
class Problem:
    """One record's refits. plans: of every parameter, held ones too. `used` (rows,) masks rows out of a fit (they still have
    residuals and columns), counted as in a fit's residual. known_effects: {name: amount}, present and held, in motion only.
    also: held parameters that stand in the vector of motion all the same, so that a later fit which frees them finds its
    program compiled. faults: of the bench, that may be freed like effects of the library; of static tests. states: of the model
    that typed terms are counted at; with them static readings can be asked `by_places`. work: one count for the problem and all
    that are made from it. discrepancy: what the model is known to miss, a part of the readings' error.
    """

    record: BenchRecord
    tests: dict[str, TestRecord]
    plans: dict[str, ParameterPlan]
    library: Library
    noise: Noise
    used: np.ndarray | None = None
    terms: tuple[LearnedTerm | TypedTerm, ...] = ()
    states: States | None = None
    known_effects: Mapping[str, float] = field(default_factory=dict)
    also: tuple[str, ...] = ()
    faults: Mapping[str, BenchFault] = field(default_factory=dict)
    work: Work = field(default_factory=Work)
    discrepancy: Discrepancy | None = None

    def with_noise(self, noise: Noise) -> "Problem":
        return replace(self, noise=noise)

    def under(self, tests: Mapping[str, TestRecord], fit: Fit) -> "Problem":
        """The same readings under other conditions, with the noise of those that a fit predicts there."""
        anew = replace(self, tests=dict(tests), used=None)
        if not self.noise.parts:
            return anew
        at = replace(anew, noise=self.noise.white, discrepancy=None).evaluate(fit.values, fit.effects).residual
        before = {(test.name, c.name): c.value for test in self.tests.values() for c in test.channels}
        after = {key: before[key] + at[rows] * self.noise.std[key] for key, rows in anew.rows().items()}
        return anew.with_noise(self.noise.elsewhere(before, after))

    def with_rows(self, used: np.ndarray | None) -> "Problem":
        """The same problem fitted to some rows only (priors are always used)."""
        return replace(self, used=used)

    def with_terms(self, *terms: LearnedTerm | TypedTerm) -> "Problem":
        """The same problem with learned terms in the model, instead of those that it had; typed ones need `with_states`."""
        return self._with_other_terms(terms, self.states)

    def with_discrepancy(self, discrepancy: Discrepancy | None) -> "Problem":
        """The same problem whose readings are known to the noise and to this."""
        return replace(self, discrepancy=discrepancy)

    def with_states(self, states: States) -> "Problem":
        """The same problem with its places open to terms, which are counted at these states of the model."""
        return self._with_other_terms(self.terms, states)

    def _with_other_terms(self, terms: tuple[LearnedTerm | TypedTerm, ...], states: States | None) -> "Problem":
        other = replace(self, terms=terms, states=states)
        parts = self.__dict__.get("readings", ())
        if parts and all(isinstance(part, (StaticReadings, MotionReadings)) for part in parts):
            other.__dict__["readings"] = tuple(
                part.with_terms(_of_static(terms), states)
                if isinstance(part, StaticReadings)
                else part.with_terms(_in_motion(terms))
                for part in parts
            )
        return other

    @cached_property
    def readings(self) -> tuple[Readings, ...]:
        """Static tests first, then dynamic ones, as far as there are any."""
        moving = dynamic_among(self.tests)
        still = {name: test for name, test in self.tests.items() if name not in moving}
        found: list[Readings] = []
        if still:
            library = library_for(still.values()) if moving else self.library
            found.append(
                StaticReadings(
                    self.record, still, self.plans, library, self.noise, self._used, _of_static(self.terms), self.states
                )
            )
        if moving:
            from .motion_readings import simulator_of

            simulator = replace(simulator_of(self.record, self.plans, self.known_effects), tests=moving)
            names = tuple(name for name in (*IN_MOTION, *PARAMETERS) if name in self.plans and self._in_vector(name))
            names += tuple(name for name in traced(moving, self.record) if name in self.plans)
            library = None if still else self.library
            found.append(MotionReadings(simulator, names, library, self.noise, self._used, _in_motion(self.terms)))
        return tuple(found)

    def _in_vector(self, name: str) -> bool:
        """Whether a run's derivative to this parameter is taken."""
        freed = name in self.also or not self.plans[name].fixed
        return name in IN_MOTION or (freed and name in SEEN_IN_MOTION)

    @property
    def in_motion(self) -> bool:
        """Whether all rows are those of dynamic tests."""
        return all(test.in_motion for test in self.tests.values())

    @property
    def parameters(self) -> tuple[str, ...]:
        """Every entry that is no effect; each has one row of priors behind the readings. Those of sensors come last."""
        own = dict.fromkeys(name for part in self.readings for name in part.parameters)
        behind = (name for sensor in self._sensed.values() for name in sensor.names)
        return tuple(dict.fromkeys((*own, *(name for name in behind if name in self.plans))))

    @cached_property
    def _sensed(self) -> dict[Key, Sensed]:
        return sensed_channels(self.tests)

    @cached_property
    def signals(self) -> list[list[SignalRows]]:
        """Of each kind of readings the channels behind a sensor, whitened as the residuals are."""
        found = []
        for part in self.readings:
            own = []
            for key, place in channel_slices(part.tests, part.size).items():
                if key in self._sensed:
                    behind = self._sensed[key]
                    read = part.tests[key[0]].channel(key[1]).value
                    values = self._whitened(key, np.stack([read, *behind.rows], axis=1)).T
                    own.append(SignalRows(place, behind, values[0], values[1:]))
            found.append(own)
        return found

    @property
    def free_parameters(self) -> tuple[str, ...]:
        return tuple(name for name in self.parameters if not self.plans[name].fixed)

    @property
    def _closeness(self) -> float:
        """Standard errors from an optimum at which a fit that is to stay stops."""
        moves = any(test.in_motion for test in self.tests.values())
        return CLOSE_TO_COMPARE if moves else CLOSE_ENOUGH

    def scale_of(self, name: str) -> float:
        """A natural step of a parameter or an effect's amount."""
        return self.plans[name].info.scale if name in self.plans else info_of(name).scale

    def sweeps(self, test: str) -> np.ndarray:
        """Stretches of a test's rows along which its noise remembers."""
        return run_ids(self.tests[test])

    def whitening(self, key: Key) -> Whitening:
        """The filter of a channel's rows, as the readings' own."""
        test = self.tests[key[0]]
        return self.noise.whitening(key, test, self._used, test.rows)

    @cached_property
    def _used(self) -> dict[Key, np.ndarray] | None:
        return None if self.used is None else {key: self.used[place] for key, place in self.rows().items()}

    @cached_property
    def decorrelation(self) -> Decorrelation | None:
        """What makes whitened residuals independent of each other; None where gauges and rows share no errors."""
        where, tests = self.rows(), []
        for name, test in self.tests.items():
            keys = [key for channel in test.channels if (key := (name, channel.name)) in self.noise.shared]
            if not keys or (len(keys) == 1 and not test.input_covariance):
                continue
            weight = {key: np.asarray(self.whitening(key).weight) for key in keys}
            errors = [
                SharedError(
                    np.stack([self.noise.shared[key][error] * weight[key] for key in keys]),
                    test.input_covariance.get(error),
                )
                for error in self.noise.shared[keys[0]]  # of all gauges of a test alike
            ]
            tests.append(([where[key] for key in keys], errors))
        return Decorrelation.of(max((place.stop for place in where.values()), default=0), tests)

    def decorrelated(self, values: np.ndarray) -> np.ndarray:
        """Whitened values (..., rows), gauges of one row and rows that share errors made independent of each other."""
        return values if self.decorrelation is None else self.decorrelation(values)

    def _whitened(self, key: Key, values: np.ndarray) -> np.ndarray:
        """What (rows,) or (rows, columns) in a channel's SI unit is among the residuals."""
        weight = 1.0 / self.noise.std[key]
        weight = weight if self._used is None else weight * self._used[key]
        return whiten_on_host(self.whitening(key), (values.T * weight).T)

    def rows(self) -> dict[Key, slice]:
        """Where each channel's rows lie in a `Fit`'s residual."""
        return channel_slices(self.tests, size=lambda rows: rows)

    def system(self, effects: Iterable[str] = (), start: Mapping[str, float] | None = None) -> System:
        """What a fit with `effects` freed solves, begun at `start`; one who solves several at once puts them together."""
        chosen = tuple(name for name in self.library.names if name in set(effects))
        programs = [part.program(chosen) for part in self.readings]
        chosen = (*chosen, *(name for name in self.faults if name in set(effects)))
        order = self._order(programs, chosen)
        free = (*self.free_parameters, *(name for name in order if name in chosen))
        begin = self._start(order, chosen, start or {})
        boxes = [self._box(name, begin[i], name in free) for i, name in enumerate(order)]
        return System(chosen, order, free, boxes, self._both(programs, order), self.real_rows)

    def fit(
        self,
        effects: Iterable[str] = (),
        start: Mapping[str, float] | None = None,
        *,
        patient: bool = False,
        hop_basins: bool = False,
        far: bool = False,
        most_steps: int = MOST_STEPS,
        goal: float = np.inf,
    ) -> Fit:
        """Fit the free parameters and the amounts of `effects`, from `start` (missing entries: nominal, neutral).

        patient: for a fit that is to stay: to the last digit, and on where it crawls. hop_basins: patient, and over the kinks
        of the underlap; far: as far as a first fit goes. goal: chi-square that alone is of interest: a fit that will not come there
        (`not_worth_while`) is left where that shows.
        """
        system = self.system(effects, start)
        chosen, order, free, begin = system.chosen, system.order, system.free, [box.start for box in system.boxes]
        boxes, both = system.boxes, system.both
        cost = 1.0 if self.in_motion else relative_cost(chosen)

        def from_point(
            point: np.ndarray, enough: float = np.inf, *, closeness: float = CLOSE_TO_COMPARE
        ) -> LeastSquaresResult:
            result = solve(
                None,
                boxes,
                None,
                point,
                tolerance=closeness,
                max_steps=most_steps,
                both=both,
                believe=BELIEVE,
                enough=enough,
                goal=goal,
                worth=WORTH if most_steps < MOST_STEPS else 0.0,
            )
            self.work.add(result.steps + 1, cost)
            return result

        stays = patient or hop_basins
        nominal = {name: self.plans[name].start for name in free if name in self.plans}
        best = from_point(np.array(begin), closeness=self._closeness if patient else CLOSE_TO_COMPARE)
        if not self.in_motion and ended_on_a_slope(best):
            # A start that another fit left off at is on a kink, at a limit, or both. From elsewhere there is often a way down. It may
            # show late, so a search from there is not left for being above the end that it is to beat.
            own = {name: float(value) for name, value in zip(order, best.p, strict=True) if name in self.plans}
            neutral = self._start(order, chosen, own)
            usual = [nominal.get(name, value) for name, value in zip(order, begin, strict=True)]
            ends = each(lambda other: from_point(np.array(other)), (neutral, usual))
            best = min(best, *ends, key=lambda end: end.cost if np.isfinite(end.cost) else np.inf)

        def to_its_end(best: LeastSquaresResult) -> LeastSquaresResult:
            for _ in range(PATIENCE):
                if best.converged or best.exhausted:
                    break
                best = from_point(best.p)
            return best

        best = to_its_end(best) if stays else best
        if hop_basins:
            near = {} if far else {"moves": MOVES, "places": (), "rounds": ROUNDS_OF_MOVES}
            best = to_its_end(basin_hopping(best, order, from_point, better=BETTER, usual=nominal, **near))
            if best.converged and best.relative_offset > self._closeness:
                again = on_a_kink(from_point(best.p, closeness=self._closeness))
                best = min(best, again, key=lambda end: end.cost)
        return self._result(chosen, order, free, best)

    def where_most_agree(self, fit: Fit) -> list[dict[str, float]]:
        """Values of the entries of a fit at which most rows agree with its model (`trimmed_points`), the best first."""
        count = len(fit.residual) - len(self.parameters)
        return trimmed_points(
            fit.values,
            self.rows(),
            fit.used[:count],
            lambda kept, at: self.with_rows(kept).fit(fit.effects, at).values,
            lambda at: self.evaluate(at, fit.effects).residual[:count],
        )

    def unbent(self, fit: Fit) -> Fit:
        """`fit`, or the same begun again where most rows agree with it, whichever ends lower; in motion as it is.

        A valve that what it misses has bent may stay so beside the effect that was missing.
        """
        starts = [] if self.in_motion else self.where_most_agree(fit)[:1]
        again = [self.fit(fit.effects, start, hop_basins=True) for start in starts]
        return min([fit, *again], key=lambda end: end.chi2)

    def evaluate(self, values: Mapping[str, float], effects: Iterable[str] = ()) -> Fit:
        """Residuals and columns at given values; nothing is fitted. `effects` must be present in the program used."""
        wanted = {*effects, *(name for name, value in values.items() if value != 0.0)}
        chosen = tuple(name for name in self.library.names if name in wanted)
        return self._evaluate(values, [part.program(chosen) for part in self.readings], tuple(wanted))

    def _evaluate(
        self, values: Mapping[str, float], programs: list[tuple[str, ...]], present: tuple[str, ...] = ()
    ) -> Fit:
        order = self._order(programs, present)
        point = np.array([values.get(n, self.plans[n].start if n in self.plans else 0.0) for n in order], dtype=float)
        residual, columns = self._both(programs, order)(point, None)
        still = np.zeros(len(point), dtype=int)
        cost = float(np.sum(residual**2))
        result = LeastSquaresResult(point, point, point, cost, residual, np.asarray(columns).T, still, True, "", 0, 0.0)
        return self._result((), order, (), result)

    def with_all_columns(self, fit: Fit) -> Fit:
        """The same fit with the columns of every effect of the library: those of its own program, then of others.

        Beside a coupled effect the column of the heating is that of the valve without the coupling: close enough to say
        whether a refit, which is exact, is worth its while. For the tests of one kind: of the others a search is one of its own.
        """
        missing = [name for name in self.library.names if name not in fit.order]
        if not missing:
            return fit
        (part,) = self.readings
        present = [name for name in fit.order if name in self.library.names and fit.values[name] != 0.0]
        steady, stored = [n for n in missing if not stores(n)], [n for n in missing if stores(n)]
        seen = [fit]
        lasting = [n for n in present if not stores(n)]
        apart = not any(map(coupled, lasting))
        # What ties the ports together, and what is costly beside it only where the model ties them already.
        tied = [n for n in steady if coupled(n) or not (apart or with_heat((n,)))]
        if tied:
            seen.append(self._beside(fit, part.program((*lasting, *tied))))
        if len(tied) < len(steady):
            rest = (n for n in steady if n not in tied)
            seen.append(self._beside(fit, part.program((*(lasting if apart else ()), *rest))))
        if stored:
            # As beside the heating: of the valve without the coupling.
            seen.append(replace(fit, order=tuple(stored), columns=self.stored_beside(fit)[1]))
        order = self._order([self.library.names], fit.order)
        columns = [next(other for other in seen if name in other.order).column(name) for name in order]
        values = {name: fit.values.get(name, 0.0) for name in order}
        return replace(fit, order=order, values=values, columns=np.stack(columns, axis=1))

    def stored_beside(self, fit: Fit, **amounts: float) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (rows,) of a fit that stores nothing with these amounts stored at the ports, and columns (rows, all that store).

        No program that fits stored oil is compiled for it; rows of ports that are not blocked are 0.
        """
        (part,) = self.readings
        assert isinstance(part, StaticReadings)
        amounts = {name: amounts.get(name, 0.0) for name in self.library.names if stores(name)}
        vector = lambda order: np.array([fit.values.get(name, 0.0) for name in order], dtype=float)
        residual, columns = part.storage(vector, self._uncoupled(fit), amounts)
        priors = np.zeros(len(self.parameters))
        real = self.real_rows(len(residual) + len(priors))
        residual = np.concatenate([residual, priors])[real]
        columns = np.concatenate([columns, np.zeros((len(amounts), len(priors)))], axis=1)[:, real]
        return self.decorrelated(residual), self.decorrelated(columns).T

    def _uncoupled(self, fit: Fit) -> tuple[str, ...]:
        """What of a fit's effects leaves the ports apart."""
        return tuple(
            name for name in fit.order if name not in self.parameters and fit.values[name] != 0.0 and not coupled(name)
        )

    def _beside(self, fit: Fit, program: tuple[str, ...]) -> Fit:
        """The same point seen by another program, without the effects that it does not have."""
        held = {name: value for name, value in fit.values.items() if name in self.parameters or name in program}
        faults = {name: fit.values[name] for name in fit.order if is_fault(name)}
        return self._evaluate(held | faults, [program], tuple(faults))

    def _order(self, programs: list[tuple[str, ...]], present: tuple[str, ...] = ()) -> tuple[str, ...]:
        """Names of the entries of the vector: every parameter, every effect that a program has, and of what is present the faults."""
        orders = [part.order(program) for part, program in zip(self.readings, programs, strict=True)]
        faults = (name for name in self.faults if name in present)
        return tuple(dict.fromkeys((*self.parameters, *(name for order in orders for name in order), *faults)))

    def _both(self, programs: list[tuple[str, ...]], order: tuple[str, ...]) -> Callable[[Any, Any], tuple[Any, Any]]:
        """(p, args) -> residuals and columns (entries, rows) of all readings, then of the priors, as `solve` takes it."""
        moving = tuple(self.faults[name] for name in order if is_fault(name) and self.faults[name].info.moves)
        parts = []
        for part, program in zip(self.readings, programs, strict=True):
            own = tuple(fault for fault in moving if set(fault.shapes) <= set(part.tests))
            names = (*part.order(program), *(fault.name for fault in own))
            parts.append((part.evaluation(program, own), [order.index(name) for name in names]))
        # Of each kind of readings the columns of faults of what was read, which never change.
        still = [name for name in order if is_fault(name) and not self.faults[name].info.moves]
        given = [{name: self.added_by(self.faults[name], part) for name in still} for part in self.readings]
        learned = [self._read_shifts(part) for part in self.readings]
        value, weight = (np.asarray(part) for part in prior_rows([self.plans[name] for name in self.parameters]))
        count = len(value)
        slopes = np.zeros((len(order), count))
        slopes[:count] = np.diag(weight)

        def both(p: Any, args: Any) -> tuple[Any, Any]:
            del args
            vector = np.asarray(p, dtype=float)
            residuals, blocks = [], []
            values = dict(zip(order, vector.tolist(), strict=True))
            for (evaluate, places), signals, shifts, more in zip(parts, self.signals, given, learned, strict=True):
                residual, columns = evaluate(vector[places])
                residual = np.array(residual)
                if more is not None:
                    residual += more
                if signals:
                    block = np.zeros((len(order), len(residual)))
                    block[places] = np.asarray(columns)
                    for signal in signals:
                        signal.act(residual, block, values, order)
                    places, columns = range(len(order)), block
                for name, column in shifts.items():
                    residual += values[name] * column
                own = np.full(len(order), -1)  # where each entry of the whole vector stands among those of the part
                own[places] = np.arange(len(places))
                fixed = {order.index(name): column for name, column in shifts.items()}
                blocks.append(
                    (own, columns if isinstance(columns, Columns) else np.asarray(columns), fixed, len(residual))
                )
                residuals.append(residual)
            residuals.append((vector[:count] - value) * weight)
            residual = self._as_known(np.concatenate(residuals))

            def work_out(numbers: np.ndarray) -> np.ndarray:
                found = np.concatenate([*(_rows_of(numbers, *block) for block in blocks), slopes[numbers]], axis=1)
                return self._as_known(found)

            return residual, Columns(len(order), work_out)

        return both

    def _as_known(self, values: np.ndarray) -> np.ndarray:
        """Whitened values (..., rows, pads and all) beside the errors that readings share and what the model is known to miss; in place."""
        if self.discrepancy is not None or self.decorrelation is not None:
            real = self.real_rows(values.shape[-1])
            found = self.decorrelated(values[..., real])
            values[..., real] = found if self.discrepancy is None else self.discrepancy.whitened(found)
        return values

    def _read_shifts(self, part: Readings) -> np.ndarray | None:
        """What typed terms add to the whitened residuals of these tests, padded, before any sensor; None without such terms."""
        shifts = part.read_shifts() if isinstance(part, StaticReadings) else {}
        if not shifts:
            return None
        column = np.zeros(_padded(part))
        for key, place in channel_slices(part.tests, part.size).items():
            if key in shifts:
                column[place] = self._whitened(key, shifts[key])
        return column

    def with_places(self, fit: Fit) -> tuple[dict[str, np.ndarray], States]:
        """What a shift of each place does beside a fit of static tests, and what the model's rows could read there.

        {entry: (readings,)}: the slope of each reading's residual, before whitening and in units of its noise, to a shift at its own
        row, sensors counted in; and {test: {reading: (rows,)}}, SI. Beside a fit that stores oil, of the same without storage. The
        problem must have states.
        """
        part = next(part for part in self.readings if isinstance(part, StaticReadings))
        present = [n for n in fit.order if n in self.library.names and fit.values[n] != 0.0 and not stores(n)]
        program = part.program(tuple(present))
        slopes, states = part.with_places(
            program, np.array([fit.values.get(name, 0.0) for name in part.order(program)])
        )
        found = np.concatenate([slopes[:, place] for place in channel_slices(part.tests, part.size).values()], axis=1)
        for key, place in self.rows().items():
            found[:, place] *= self.factor_of(key, fit)
        return dict(zip(ENTRIES, found, strict=True)), states

    def term_columns_in_motion(self, fit: Fit) -> np.ndarray:
        """(rows, coefficients): whitened columns of the terms in tests in motion, each padded to four coefficients, at a fit; 0 in
        the rows of priors and in those not used."""
        part, program, vector = self._moving_at(fit)
        return self._with_priors(part.term_columns(program, vector).T, fit)

    def table_in_motion(self, fit: Fit, laws: Any) -> tuple[list[np.ndarray], Any]:
        """Of each law its whitened columns (rows, coefficients) beside a fit of tests in motion, and what `MotionReadings.table` says
        of the ranges."""
        part, program, vector = self._moving_at(fit)
        columns, ranges = part.table(program, vector, laws)
        return [self._with_priors(own, fit) for own in columns], ranges

    def _moving_at(self, fit: Fit) -> tuple[MotionReadings, tuple[str, ...], np.ndarray]:
        part = next(part for part in self.readings if isinstance(part, MotionReadings))
        present = tuple(n for n in self.library.names if n in fit.effects or fit.values.get(n, 0.0) != 0.0)
        order = part.order(present)
        return part, present, np.array([fit.values.get(name, 0.0) for name in order], dtype=float)

    def _with_priors(self, columns: np.ndarray, fit: Fit) -> np.ndarray:
        """Columns of readings with sensors counted in, and rows of 0 for the priors."""
        whole = np.zeros((len(fit.residual), columns.shape[1]))
        for key, place in self.rows().items():
            whole[place] = self.factor_of(key, fit) * columns[place]
        return self.decorrelated(whole.T).T * fit.used[:, None]

    def factor_of(self, key: Key, fit: Fit) -> float:
        """What a channel's sensor makes of its quantity: 1 where it is read in SI."""
        return self._sensed[key].factor(fit.values) if key in self._sensed else 1.0

    def read_by_model(self, key: Key, at: Fit) -> np.ndarray:
        """What a model reads (rows,) where a channel was read; at: a fit whose residual is in units of the noise, not whitened."""
        std = self.noise.std[key]
        return self.tests[key[0]].channel(key[1]).value + at.residual[self.rows()[key]] * np.where(
            np.isfinite(std), std, 0.0
        )

    def added_by(self, fault: BenchFault, part: Readings) -> np.ndarray:
        """What a fault of readings adds to the whitened residuals of these tests, padded, per amount: model - what was read + fault."""
        column = np.zeros(_padded(part))
        for key, place in channel_slices(part.tests, part.size).items():
            if key[0] in fault.shapes and key[1] == fault.channel:
                column[place] = self._whitened(key, fault.shapes[key[0]])
        return column

    def _start(self, order: tuple[str, ...], chosen: tuple[str, ...], start: Mapping[str, float]) -> list[float]:
        found = []
        # An estimate beside a fit whose readings are no numbers is none either.
        start = {name: value for name, value in start.items() if np.isfinite(value)}
        for name in order:
            if name in self.plans:
                found.append(start.get(name, self.plans[name].start))
                continue
            if name not in chosen:
                found.append(0.0)
                continue
            info = info_of(name)
            # A linear estimate may lie far outside of what the balances can solve.
            most = START_WITHIN * info.typical[1]
            value = float(np.clip(start.get(name, 0.0), max(info.lower, -most), min(info.upper, most)))
            # An effect even in its amount has no slope at neutral, and a search that starts on a wall may stay there.
            if abs(value) < SMALL_START * info.scale:
                value = SMALL_START * info.scale * (1.0 if value >= 0.0 else -1.0)
            found.append(value)
        return found

    def box_of(self, name: str, value: float) -> Box:
        """The limits and the scale of a free entry."""
        return self._box(name, value, True)

    def _box(self, name: str, value: float, free: bool) -> Box:
        if name not in self.plans:
            info = info_of(name)
            lower, upper, scale = info.lower, info.upper, info.scale
        else:
            plan = self.plans[name]
            lower, upper, scale = plan.lower, plan.upper, plan.info.scale
        if not free:
            return Box(name, value, scale, value, value, held=True)
        return Box(name, min(max(value, lower), upper), scale, lower, upper)

    def real_rows(self, count: int) -> np.ndarray:
        """Of `count` residuals, the priors the last, those that are no pads."""
        places, first = [], 0
        for part in self.readings:
            own = channel_slices(part.tests, part.size).values()
            places += [first + np.arange(place.start, place.stop) for place in own]
            first += _padded(part)
        return np.concatenate([*places, np.arange(count - len(self.parameters), count)])

    def _result(
        self, chosen: tuple[str, ...], order: tuple[str, ...], free: tuple[str, ...], result: LeastSquaresResult
    ) -> Fit:
        priors = len(self.parameters)
        real = self.real_rows(len(result.residual))
        values = dict(zip(order, (float(v) for v in result.p), strict=True))
        pressed = frozenset(name for name, side in zip(order, result.active, strict=True) if side and name in free)
        used = np.ones(len(real), dtype=bool) if self.used is None else np.append(
            self.used[: len(real) - priors], np.ones(priors, dtype=bool)
        )  # fmt: skip
        return Fit(
            chosen, order, free, values, result.cost, result.residual[real], result.jacobian[real], used, pressed,
            result.converged, result.message, result, allowance_of(chosen, self.faults),
        )  # fmt: skip


def _rows_of(
    numbers: np.ndarray, own: np.ndarray, columns: Any, given: Mapping[int, np.ndarray], rows: int
) -> np.ndarray:
    """(k, rows): of these entries of the whole vector the columns in one kind of readings, which has them at its `own` numbers, -1 where it
    has not, and where a fault shifts what was read they are `given`."""
    found = np.zeros((len(numbers), rows))
    there = own[numbers] >= 0
    found[there] = columns[own[numbers[there]]]
    for number, column in given.items():
        found[numbers == number] = column
    return found


def _in_motion(terms: tuple[LearnedTerm | TypedTerm, ...]) -> tuple[TypedTerm, ...]:
    """The terms of tests in motion."""
    return tuple(term for term in terms if isinstance(term, TypedTerm) and term.moving)


def _of_static(terms: tuple[LearnedTerm | TypedTerm, ...]) -> tuple[LearnedTerm | TypedTerm, ...]:
    """All others."""
    return tuple(term for term in terms if not (isinstance(term, TypedTerm) and term.moving))


def _padded(part: Readings) -> int:
    """Rows of all channels of one kind of tests, pads and all."""
    return sum(part.size(test.rows) * len(test.channels) for test in part.tests.values())
