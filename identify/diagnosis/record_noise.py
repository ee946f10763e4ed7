"""Estimate how large a record's noise is and how it correlates: from repeated sweeps, else from what no effect can explain."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.identify.fitting.problem import Key, Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.readings import Noise, parts_of
from thermohyd.identify.noise.correlation import NoiseCorrelation, ProjectedNoise, Remembered, Sums, noise_correlation
from thermohyd.identify.noise.level import ChannelNoise, repeat_differences
from thermohyd.identify.noise.two_parts import TwoParts, two_parts

from .left_over import smooth_block
from .screening import Projection
from .screening_faults import fault_columns, slopes_of_inputs


MOST_TAKEN = 0.4  # of the rows by columns, so that what is left still shows the noise
# Rows compared, below which repeats say too little of the correlation, whose standard error is 1/sqrt(rows) = 0.13 there.
ENOUGH_REPEATS = 60
# Standard errors of a correlation, of a dozen, by which repeats may differ from all rows.
DISAGREE = 3.0
# Scatter beyond the stated noise, as a ratio of variances, from which on it counts as noise that tests must allow for; of few
# readings it must also be more than chance makes of one channel in a hundred.
EXCESS, CHANCE = 1.2, 0.01
# Share of a channel's variance that errors of its positions may make for its size to say how long its noise remembers.
FEW_OF_POSITIONS = 0.1
# Of what is logged beside the readings, for a slope by differences: far below what bends a curve, far above rounding.
STEPS = {
    "spool_position": 1e-8,
    "supply_pressure": 1e4,
    "return_pressure": 1e4,
    "temperature": 0.1,
    "load_pressure": 1e4,
    "external_force": 1.0,
    "command": 2e-6,
}


@dataclass(frozen=True)
class NoiseEstimate:
    """The noise of one channel: rows' standard deviation (SI), correlation, and where both come from, in words."""

    std: np.ndarray
    correlation: NoiseCorrelation
    source: str
    correlation_source: str
    known: bool  # stated, or measured free of any model: a reduced chi-square of 1 means "all explained"
    warning: str = ""
    degrees_of_freedom: float = np.inf  # from which `std` was estimated; infinite: stated
    memory: np.ndarray | None = None  # the part of each row's variance that the correlation is of; None: all of it
    # What one standard deviation of the error of each logged input makes of a reading {input: (rows,)}, in shares of `std`.
    shared: Mapping[str, np.ndarray] | None = None
    parts: TwoParts | None = None  # what `std` is made of beside that, where it grows with the reading


@dataclass(frozen=True)
class Repeats:
    """What repeated sweeps say of a channel: variance relative to the noise believed so far, and correlation."""

    variance: float
    correlation: NoiseCorrelation
    rows: int
    sums: Sums  # of the differences, whose variance is `variance`

    def as_large_as(self, variance: float) -> Sums:
        """Their sums, were the noise of this variance."""
        return replace(self.sums, products=self.sums.products * variance / max(self.variance, 1e-300))

    def agree(self, correlation: NoiseCorrelation) -> bool:
        """Whether no lag of theirs lies further from this correlation than chance makes it (Bartlett 1946, for the later lags)."""
        lag = np.arange(1, len(self.sums.pairs))
        pairs = self.sums.pairs[lag]
        seen = self.sums.products[lag] / np.maximum(pairs * self.variance, 1e-300)
        away = np.abs(seen - correlation.share * correlation.phi**lag) * np.sqrt(correlation.independent(1.0) * pairs)
        return bool(np.all(away <= DISAGREE))


def repeats_of(test: TestRecord, channel: Channel, std: np.ndarray) -> Repeats | None:
    """Variance and correlation of the differences between repeated sweeps; None where there are too few."""
    return repeats_in(repeat_differences(test, channel, std))


def repeats_in(pieces: list[np.ndarray]) -> Repeats | None:
    """The same from the differences themselves, one array per pair, in units of the noise believed so far."""
    rows = sum(len(piece) for piece in pieces)
    if rows < ENOUGH_REPEATS:
        return None
    values = np.concatenate(pieces)
    ids = np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces])
    return Repeats(float(np.mean(values**2)), noise_correlation(values, ids, 0.0), rows, Sums.of(pieces))


def first_noise(noise: dict[Key, ChannelNoise]) -> Noise:
    """White noise of the size that the plain fit believed: where the search for the real one starts."""
    return Noise(
        {key: n.std for key, n in noise.items()}, dict.fromkeys(noise, NoiseCorrelation()), parts=parts_of(noise)
    )


def estimated_noise(
    problem: Problem, fit: Fit, stated: dict[Key, ChannelNoise], repeats: dict[Key, Repeats | None]
) -> dict[Key, NoiseEstimate]:
    """The noise of each channel beside `fit`: repeated sweeps first, for its correlation with what no effect can explain.

    Repeats owe nothing to a model, but one sweep in five is not much to tell a memory from: all rows say it more sharply, and are
    believed together with the repeats unless these contradict. What neither the parameters, nor any effect of the library, nor a
    fault of the bench, nor smooth curves over the conditions explain is noise. A missing effect thus is not taken for noise, as it
    would be if the residuals of the fit were used, nor a zero that moved from run to run for a noise with a long memory. Faults of
    single runs are left in where they would take more than `MOST_TAKEN` of the rows.
    """
    stated = beside_inputs(problem.with_noise(first_noise(stated)), fit, stated)
    plain = problem.with_noise(first_noise(stated))
    beside = plain.with_all_columns(plain.evaluate(fit.values, fit.effects))
    every = np.isfinite(beside.columns).all(axis=0)
    columns = [beside.columns[:, every], smooth_block(plain, len(beside.residual))]
    for names in (list(plain.faults), [name for name, fault in plain.faults.items() if not fault.place]):
        taken = sum(part.shape[1] for part in columns) + len(names)
        if names and taken <= MOST_TAKEN * len(beside.residual):
            columns.append(np.stack([*fault_columns(plain, beside, names).values()], axis=1))
            break
    columns = np.concatenate(columns, axis=1)
    saturated = Projection.beside(columns)
    rest = saturated(beside.residual)
    where = problem.rows()
    stretches = np.arange(len(rest))  # no two rows of a prior remember each other
    for key, rows in where.items():
        stretches[rows] = len(rest) + len(rest) * rows.start + problem.sweeps(key[0])
    projected = ProjectedNoise(saturated.q, stretches)
    noise = {}
    kept = np.maximum(1.0 - np.sum(saturated.q**2, axis=1), 0.05)
    for key, rows in where.items():
        before = stated[key]
        like = _going_with_readings(before, rest[rows] * before.std, kept[rows])
        rest[rows] *= before.std / like.std
        degrees_of_freedom = max(projected.degrees_of_freedom(rows), 1.0)
        variance = float(np.sum(rest[rows] ** 2)) / degrees_of_freedom
        size = variance if _excessive(variance, degrees_of_freedom) else 1.0
        repeated = repeats[key]
        beside_repeats = None if repeated is None else repeated.as_large_as(size)
        # Rows of one smooth sweep share the errors of their positions, and scatter by less than these are large.
        part = like.position_part
        of_positions = 0.0 if part is None else float(np.mean((part / like.std) ** 2))
        sized = like.known and of_positions < FEW_OF_POSITIONS
        left = projected.remembered(rest, rows, size if sized else None, beside_repeats)
        found = _channel(like, repeated, variance, degrees_of_freedom, left)
        scale = float(np.sqrt(np.mean(found.std**2) / np.mean(like.std**2)))
        found = replace(found, parts=None if like.parts is None else like.parts.times(scale))
        if like.inputs is not None:
            found = replace(found, shared={name: moved / like.std for name, moved in like.inputs.items()})
        noise[key] = _beside_positions(found, like.position_part, like.std, stretches[rows])
    return noise


def beside_inputs(problem: Problem, fit: Fit, noise: dict[Key, ChannelNoise]) -> dict[Key, ChannelNoise]:
    """The noise with what errors of logged positions, conditions and commands do to each reading by the slopes of the model; in motion as
    if one error were that of a whole run.

    problem: weighed by this noise, white.
    """
    tests = problem.tests
    logged = {name for test in tests.values() for name in test.input_error}
    slopes = slopes_of_inputs(problem, fit, {name: STEPS[name] for name in STEPS if name in logged})
    found = dict(noise)
    for key, rows in problem.rows().items():
        test = tests[key[0]]
        errors = {**test.input_error, **{name: np.sqrt(np.diag(own)) for name, own in test.input_covariance.items()}}
        parts = {n: noise[key].std * slopes[n][rows] * error for n, error in errors.items() if n in slopes}
        if parts and np.isfinite([*parts.values()]).all():
            found[key] = noise[key].beside_inputs(parts)
    return found


def _going_with_readings(noise: ChannelNoise, rest: np.ndarray, kept: np.ndarray) -> ChannelNoise:
    """A channel's noise that is not known, with the readings as what no model explains goes. rest (rows,): that, SI, of which a
    projection has left the shares `kept` (rows,): of few rows it leaves too little to tell."""
    if noise.known or noise.level is None or float(np.mean(kept)) < 1.0 - MOST_TAKEN:
        return noise
    beside = None if noise.position_part is None else noise.position_part**2
    return noise.of_parts(two_parts(rest**2 / kept, noise.level, beside, kept))


def _beside_positions(
    found: NoiseEstimate, part: np.ndarray | None, std: np.ndarray, stretches: np.ndarray
) -> NoiseEstimate:
    """The noise with a memory of the readings' own part alone: what positions add to a row of steep slope, no other remembers.

    part (rows,): standard deviation that positions add to `std` (rows,), SI. The correlation found is that of all rows together.
    """
    if part is None or found.correlation.share == 0.0:
        return found
    memory = np.clip(1.0 - (part / std) ** 2, 0.0, 1.0)
    pairs = np.sqrt(memory[1:] * memory[:-1])[stretches[1:] == stretches[:-1]]
    seen = float(np.mean(pairs)) if len(pairs) else 1.0
    share = min(found.correlation.share / max(seen, found.correlation.share), 1.0)
    return replace(found, correlation=replace(found.correlation, share=share), memory=memory)


def _excessive(variance: float, degrees_of_freedom: float) -> bool:
    """Whether readings scatter by more than the stated noise, whose variance is 1."""
    return variance > max(EXCESS, float(chdtri(degrees_of_freedom, CHANCE)) / degrees_of_freedom)


def _channel(
    stated: ChannelNoise,
    repeats: Repeats | None,
    variance: float,
    degrees_of_freedom: float,
    left: Remembered,
) -> NoiseEstimate:
    if repeats is not None:
        correlation, source = repeats.correlation, f"differences between repeated sweeps ({repeats.rows} pairs of rows)"
        if repeats.agree(left.correlation):
            correlation, source = left.correlation, f"{source} and what neither effects nor smooth curves explain"
        variance, degrees_of_freedom = repeats.variance, correlation.independent(repeats.rows)
    else:
        correlation, source = left.correlation, "what neither effects nor smooth curves explain"
    if not stated.known:
        size = variance if repeats is not None else left.variance
        std = stated.std * np.sqrt(size)
        return NoiseEstimate(std, correlation, source, source, repeats is not None, "", degrees_of_freedom)
    warning = ""
    std, freedom = stated.std, stated.degrees_of_freedom
    if repeats is not None and np.isfinite(freedom):
        freedom = min(freedom, correlation.independent(repeats.rows))
    if _excessive(variance, degrees_of_freedom):
        std, freedom = stated.std * np.sqrt(variance), degrees_of_freedom
        what = "repeated sweeps differ" if repeats is not None else "the readings scatter beyond any smooth curve"
        warning = f"{what} by {np.sqrt(variance):.2f} times the stated noise; tests allow for that"
    return NoiseEstimate(std, correlation, stated.source, source, True, warning, freedom)


def noise_of(estimates: dict[Key, NoiseEstimate]) -> Noise:
    """The noise as problems weigh it."""
    memory = {key: n.memory for key, n in estimates.items() if n.memory is not None}
    shared = {key: n.shared for key, n in estimates.items() if n.shared is not None}
    std, correlation = ({key: getattr(n, name) for key, n in estimates.items()} for name in ("std", "correlation"))
    return Noise(std, correlation, memory, parts_of(estimates), shared)
