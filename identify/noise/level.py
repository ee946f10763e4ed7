"""The standard deviation of each channel's readings, before any fit and after one. NumPy only, free of any valve model.

Of static and of dynamic tests alike it is, in this order: declared by the user or measured on a raw log; taken from the
differences between repeated sweeps or runs; guessed from third differences of neighbouring rows, which are blind to any
parabola, until the fit's own residuals replace the guess (`reweighted`).
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.identify.reduction.monotone_pieces import monotone_pieces, piece_bounds, sweep_ids
from thermohyd.identify.reduction.rounding import local_steps

from .correlation import effective_size
from .two_parts import TwoParts, two_parts


LOG_ROWS = 2000  # from here on, sweeps are looked for under the dither of a log
# Rows compared with their repeats, of a static and of a dynamic test: fewer say too little of their scatter.
FEWEST_PAIRS = 8
FEWEST_IN_MOTION = 60
# Standard errors of its mean from which on a pair of repeated sweeps lies apart by more than noise, and rows that show it.
OFFSET, ROWS_OF_OFFSET = 5.0, 8
SAME_TIME = 1e-6  # s
MOST_OF_THE_ROWS = 0.9  # that runs which repeat each other share: single bad ones may be gone
THIRD_DIFFERENCE = np.array([1.0, -3.0, 3.0, -1.0])  # blind to any parabola; variance 20 for white noise of 1
MEDIAN_OF_CHI2 = 0.4549  # one degree of freedom


@dataclass(frozen=True)
class RepeatNoise:
    """Noise from repeated sweeps. `std` of one row (SI); `correlation` of neighbouring rows; `rows` compared; `source` in words.

    degrees_of_freedom: of `std`; a row of one sweep is compared with several of the other, which it shares.
    """

    std: float
    correlation: float
    rows: int
    source: str

    @property
    def degrees_of_freedom(self) -> float:
        return self.rows / (1.0 + 2.0 * self.correlation**2)


@dataclass(frozen=True)
class NeighbourNoise:
    """Noise from third differences along the sweeps. `std` of one row (SI); not `valid` where the curve's bends outweigh it."""

    std: float
    valid: bool


def noise_from_repeats(test: TestRecord, channel: Channel) -> RepeatNoise | None:
    """Noise from the differences between runs that repeat a sweep; None where no run does.

    A repeat has the same direction and conditions (1 % of supply, 1 K), rates within 20 % and overlapping positions;
    the later run is interpolated to the earlier one's positions, which the variance allows for. In a dynamic test it has the
    same rows, command and conditions. Curve and model fall out of the difference.
    """
    differences = repeat_differences(test, channel)
    rows = sum(len(d) for d in differences)
    if rows < (FEWEST_IN_MOTION if test.in_motion else FEWEST_PAIRS):
        return None
    variance = sum(float(d @ d) for d in differences) / rows
    lagged = sum(float(d[1:] @ d[:-1]) for d in differences) / max(rows - len(differences), 1)
    correlation = float(np.clip(lagged / variance, -1.0, 1.0)) if variance > 0 else 0.0
    source = f"differences between repeated {'runs' if test.in_motion else 'sweeps'} ({rows} pairs of rows)"
    return RepeatNoise(float(np.sqrt(variance)), correlation, rows, source)


def repeat_differences(test: TestRecord, channel: Channel, std: np.ndarray | None = None) -> list[np.ndarray]:
    """Differences between sweeps or runs and their repeats, row by row, one array per pair, scaled to the noise of one row.

    SI; or, where the rows' noise is believed to be `std` (rows,), in units of it. A pair that lies apart by a constant, far beyond
    what its rows scatter, has had its zero moved in between: that is a fault of the bench, no noise.
    """
    std = np.ones(test.rows) if std is None else std
    if test.in_motion:
        return _run_differences(test, channel, std)
    if test.rows < LOG_ROWS:
        sweeps, direction = sweep_ids(test), test.direction
    else:
        sweeps, direction = monotone_pieces(test)  # a log's own directions follow its dither
    pieces = [slice(*bounds) for bounds in piece_bounds(sweeps) if bounds[1] - bounds[0] >= 3]
    differences: list[np.ndarray] = []
    used: set[int] = set()
    for i, first in enumerate(pieces):
        for j in range(i + 1, len(pieces)):
            second = pieces[j]
            if (
                j in used
                or test.run[first.start] == test.run[second.start]
                or not _repeats(test, direction, first, second)
            ):
                continue
            d = _difference(test.spool_position, channel.value, std, first, second)
            if len(d) >= 3:
                differences.append(_without_offset(d))
                used.add(j)
                break
    return differences


def _without_offset(difference: np.ndarray) -> np.ndarray:
    mean = float(np.mean(difference))
    scatter = difference - mean
    error = float(np.std(difference)) / np.sqrt(effective_size(scatter))
    return scatter if len(difference) >= ROWS_OF_OFFSET and abs(mean) > OFFSET * error else difference


def _run_differences(test: TestRecord, channel: Channel, std: np.ndarray) -> list[np.ndarray]:
    """Differences between runs with the same rows, command and conditions; frequency tests are not compared."""
    if test.time is None:
        return []
    columns = test.conditions.values()
    rows = [np.flatnonzero(test.run == code) for code in np.unique(test.run)]
    differences, used = [], set()
    for i, a in enumerate(rows):
        for j in range(i + 1, len(rows)):
            if j in used or i in used:
                continue
            one, other = _at_the_same_times(test.time, a, rows[j])
            if len(one) and all(np.allclose(c[one], c[other], rtol=1e-3, atol=1e-9) for c in columns):
                differences.append((channel.value[one] - channel.value[other]) / np.hypot(std[one], std[other]))
                used |= {i, j}
    return differences


def _at_the_same_times(time: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rows of two runs that were read at the same times since their starts, to a microsecond; none where many were not."""
    of_a, of_b = time[a] - time[a[0]], time[b] - time[b[0]]
    near = np.clip(np.searchsorted(of_b, of_a - SAME_TIME), 0, len(b) - 1)
    same = np.abs(of_b[near] - of_a) <= SAME_TIME
    if same.sum() < MOST_OF_THE_ROWS * max(len(a), len(b)):
        return a[:0], b[:0]
    return a[same], b[near[same]]


def noise_from_neighbours(test: TestRecord, channel: Channel) -> NeighbourNoise:
    """Rough noise from third differences along each sweep, at the rows' own positions; median based.

    Differences of noise alternate in sign (77 % of neighbours), those of a bending curve do not: `valid` asks for 60 %. Rows
    of a dynamic test are taken as evenly spaced, and never as `valid`: a run bends between one row and the next.
    """
    differences, alternating = [], []
    sweeps = sweep_ids(test)
    along = np.arange(float(test.rows)) if test.in_motion else test.spool_position
    for start, stop in piece_bounds(sweeps):
        x, y = along[start:stop], channel.value[start:stop]
        if stop - start < 4:
            continue
        e = divided_third(x, y)
        differences.append(e)
        alternating.append(e[1:] * e[:-1] < 0)
    if not differences:
        return NeighbourNoise(0.0, False)
    e, signs = np.concatenate(differences), np.concatenate(alternating)
    std = float(np.sqrt(np.median(e**2) / MEDIAN_OF_CHI2))
    return NeighbourNoise(std, bool(not test.in_motion and len(signs) >= 8 and np.mean(signs) > 0.6 and std > 0))


def divided_third(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Combination of four neighbours that is blind to a parabola through uneven positions, scaled to the noise of one row."""
    points = np.stack([x[k : len(x) - 3 + k] for k in range(4)])
    distance = points[:, None, :] - points[None, :, :]
    distance[np.arange(4), np.arange(4)] = 1.0
    product = np.prod(distance, axis=1)
    flat = (product == 0).any(axis=0)  # equal positions: fall back on even spacing
    weight = np.where(flat, THIRD_DIFFERENCE[:, None], 1.0 / np.where(product == 0, 1.0, product))
    weight = weight / np.sqrt(np.sum(weight**2, axis=0))
    return np.sum(weight * np.stack([y[k : len(y) - 3 + k] for k in range(4)]), axis=0) * np.sign(weight[1])


def _repeats(test: TestRecord, direction: np.ndarray, first: slice, second: slice) -> bool:
    if direction[first.start] != direction[second.start]:
        return False
    supply = 0.01 * max(float(np.max(np.abs(test.supply_pressure))), 1e-300)
    for column, step in ((test.supply_pressure, supply), (test.return_pressure, supply), (test.temperature, 1.0),
                         (test.load_pressure, supply)):  # fmt: skip
        if column is not None and abs(float(np.mean(column[first]) - np.mean(column[second]))) > step:
            return False
    if test.time is not None or test.rate is not None:
        rates = [_pace(test, part) for part in (first, second)]
        if abs(rates[0] - rates[1]) > 0.2 * max(rates):
            return False
    return True


def _pace(test: TestRecord, part: slice) -> float:
    """Mean speed of a sweep, m/s."""
    if test.time is not None:
        span = float(test.time[part][-1] - test.time[part][0])
        return float(np.ptp(test.spool_position[part])) / span if span > 0 else 0.0
    return abs(float(np.median(test.rate[part]))) if test.rate is not None else 0.0


def _difference(position: np.ndarray, value: np.ndarray, std: np.ndarray, first: slice, second: slice) -> np.ndarray:
    """Rows of one sweep less its repeat, interpolated to their positions, over what the noise of all rows involved makes it.

    By the cubic through four rows where their positions rise evenly enough, so that the curve's bend is not taken for
    noise; else by a straight line.
    """
    order = np.argsort(position[second], kind="stable")
    x, y, s = position[second][order], value[second][order], std[second][order]
    inside = (position[first] >= x[0]) & (position[first] <= x[-1])
    wanted = position[first][inside]
    right = np.clip(np.searchsorted(x, wanted), 1, len(x) - 1)
    width = x[right] - x[right - 1]
    w = np.where(width > 0, (wanted - x[right - 1]) / np.where(width > 0, width, 1.0), 0.5)
    other = (1 - w) * y[right - 1] + w * y[right]
    variance = ((1 - w) * s[right - 1]) ** 2 + (w * s[right]) ** 2
    if len(x) >= 4:
        places = np.clip(right - 2, 0, len(x) - 4)[:, None] + np.arange(4)
        near = x[places]
        gaps = np.diff(near, axis=1)
        even = gaps.min(axis=1) > 0.2 * gaps.max(axis=1)
        apart = near[:, :, None] - near[:, None, :]
        apart[:, np.arange(4), np.arange(4)] = 1.0
        way = np.repeat((wanted[:, None] - near)[:, None, :], 4, axis=1)
        way[:, np.arange(4), np.arange(4)] = 1.0
        weight = np.prod(way, axis=2) / np.where(even[:, None], np.prod(apart, axis=2), 1.0)
        other = np.where(even, np.sum(weight * y[places], axis=1), other)
        variance = np.where(even, np.sum((weight * s[places]) ** 2, axis=1), variance)
    return (value[first][inside] - other) / np.sqrt(std[first][inside] ** 2 + variance)


@dataclass(frozen=True)
class ChannelNoise:
    """Standard deviations of a channel's readings, one per row (SI), and where they come from, in words.

    known: stated by the user or measured free of the model, so that a chi-square means something.
    declared: stated by the user, and therefore not to be touched.
    """

    std: np.ndarray
    source: str
    known: bool
    declared: bool
    # What the fit weighs with: `std`, widened where the model misses the curve by more than its noise.
    used: np.ndarray
    degrees_of_freedom: float = np.inf  # degrees of freedom from which `std` was estimated
    neighbours: float | None = None  # scatter of neighbouring rows about a smooth curve, where that says something
    position_part: np.ndarray | None = None  # what of `std` the positions' noise makes, row by row
    position_error: np.ndarray | None = None  # standard error of each position (rows,), m, behind that part
    # That part by the inputs whose errors make it {input: (rows,)}, SI, with their signs.
    inputs: Mapping[str, np.ndarray] | None = None
    # Size of each reading (rows,), SI, with which noise that is not known may grow.
    level: np.ndarray | None = None
    parts: TwoParts | None = None  # what `std` is made of beside the positions', where it grows with the reading

    def by_slopes(self, slope: np.ndarray) -> "ChannelNoise":
        """The same where a reading goes with its position by these slopes (rows,), SI: a model's instead of those of neighbours."""
        if self.position_error is None or not np.isfinite(slope).all():
            return self
        return self.beside_inputs({"spool_position": slope * self.position_error})

    def beside_inputs(self, inputs: Mapping[str, np.ndarray]) -> "ChannelNoise":
        """The same where errors of what was logged beside it add these to a reading {input: (rows,)}, SI; its own noise stays."""
        part = np.sqrt(np.sum([moved**2 for moved in inputs.values()], axis=0))
        before = np.zeros(len(self.std)) if self.position_part is None else self.position_part
        # Where positions made all of the noise, a thousandth stands for its own.
        own = np.sqrt(np.maximum(self.std**2 - before**2, 1e-6 * self.std**2))
        std = np.hypot(own, part)
        return replace(self, std=std, used=std, position_part=part, inputs=inputs)

    def of_parts(self, parts: TwoParts) -> "ChannelNoise":
        """The noise made of these parts and the positions'."""
        assert self.level is not None
        beside = np.zeros(len(self.std)) if self.position_part is None else self.position_part
        std = np.hypot(parts.std(self.level), beside)
        return replace(self, std=std, used=std, parts=parts if parts.share > 0.0 else None)


FROM_RESIDUALS = "taken from the fit's residuals"


def initial_noise(test: TestRecord, channel: Channel) -> ChannelNoise:
    """The noise known before any fit; where nothing is known, a first guess from neighbouring rows."""
    # Positions are left out of it: in a table of a few hundred rows an even grid is a choice, not a rounding.
    floor = local_steps(channel.as_read) / np.sqrt(12.0)
    part = np.zeros(test.rows) if channel.position_part is None else channel.position_part
    error = test.input_error.get("spool_position")
    level = np.abs(channel.as_read) if test.axis != "frequency" else None
    if channel.std is not None:
        std = np.hypot(np.maximum(channel.std, floor), part)
        declared = channel.std_source.startswith("declared")
        return ChannelNoise(
            std, channel.std_source, True, declared, std, channel.freedom, position_part=channel.position_part,
            position_error=error,
        )  # fmt: skip
    repeated = noise_from_repeats(test, channel)
    if repeated is not None:
        alike = repeated.std
        if part.any():
            alike = noise_beside(
                part, lambda std: float(np.mean(np.concatenate(repeat_differences(test, channel, std)) ** 2))
            )
        std = np.hypot(np.maximum(np.full(test.rows, alike), floor), part)
        return ChannelNoise(
            std, repeated.source, True, False, std, repeated.degrees_of_freedom, position_part=channel.position_part,
            position_error=error,
        )  # fmt: skip
    rough = noise_from_neighbours(test, channel)
    guess = rough.std
    smallest = 1e-4 * max(float(np.ptp(channel.value)), float(np.max(np.abs(channel.value))), 1e-300)
    std = np.hypot(np.maximum(np.full(test.rows, max(guess, smallest)), floor), part)
    scatter = guess if rough.valid else None
    return ChannelNoise(
        std, FROM_RESIDUALS, False, False, std, neighbours=scatter, position_part=channel.position_part,
        position_error=error, level=level,
    )  # fmt: skip


def initial_noises(tests: Iterable[TestRecord]) -> dict[tuple[str, str], ChannelNoise]:
    """The noise of every reading, known or guessed before any fit: {(test, channel): noise}."""
    return counted_once(
        {(test.name, channel.name): initial_noise(test, channel) for test in tests for channel in test.channels}
    )


def counted_once(noise: Mapping[tuple[str, str], ChannelNoise]) -> dict[tuple[str, str], ChannelNoise]:
    """The noise {(test, channel): noise} with what a fit weighs with widened by `shared_variance`, of which `used` has nothing so far."""
    more = shared_variance(noise)
    return {key: replace(n, used=np.sqrt(n.used**2 + more[key])) if key in more else n for key, n in noise.items()}


def shared_variance(noise: Mapping[tuple[str, str], ChannelNoise]) -> dict[tuple[str, str], np.ndarray]:
    """Variance (rows,) by which each channel is to be widened, where several of one test are read at the same positions. SI.

    One error of a position moves them all: counted as one of each channel, n gauges would place a shift of the positions sqrt(n)
    times too well. A plain fit, which weighs each reading for itself, widens it; a diagnosis has the covariance of the row
    (`Decorrelation`). With s_i what a position adds and o_i a channel's own noise, all of a row together say
    (sum s_i^2/o_i^2)/(1 + sum s_i^2/o_i^2) of it. Each channel's part is therefore o_i^2 sum s_j^2/o_j^2 instead of s_i^2, at most
    n s_i^2, so that a gauge which no position moves keeps what it knows.
    """
    tests: dict[str, list[tuple[str, str]]] = {}
    for key, n in noise.items():
        if n.position_part is not None and np.any(n.position_part):
            tests.setdefault(key[0], []).append(key)
    found = {}
    for keys in tests.values():
        if len(keys) < 2:
            continue
        moved = {key: noise[key].position_part ** 2 for key in keys}  # pyright: ignore[reportOptionalOperand]
        # Where positions make all of the noise their part is the whole of it: a thousandth stands for what is left.
        own = {key: np.maximum(noise[key].std ** 2 - moved[key], 1e-6 * noise[key].std ** 2) for key in keys}
        ratio = np.sum([moved[key] / own[key] for key in keys], axis=0)
        for key in keys:
            found[key] = np.clip(own[key] * ratio, moved[key], len(keys) * moved[key]) - moved[key]
    return found


def reweighted(noise: ChannelNoise, misfit: np.ndarray, left: np.ndarray) -> ChannelNoise:
    """The noise after a fit whose residuals (SI) are `misfit`, of which the shares `left` (rows,), 0..1, are left to chance.

    Unknown noise becomes the residuals' own, of one part or of two (`two_parts`). Known noise stays what it is, but where the
    model misses the curve the weights allow for that miss as one more, equal, error of every point, as large as makes the mean square of
    the weighted misfits 1 (Mandel and Paule, Anal. Chem. 42, 1970): else a channel with very small noise would drag the whole valve into
    its misfit. Declared noise is obeyed as it stands.
    """
    if noise.declared:
        return replace(noise, used=noise.std)
    square = misfit**2 / left
    if not noise.known:
        beside = None if noise.position_part is None else noise.position_part**2
        level = np.zeros(len(square)) if noise.level is None else noise.level
        return replace(noise, level=level).of_parts(two_parts(square, level, beside, left))
    mean_square = lambda used: float(left @ (square / used**2) / left.sum())
    if mean_square(noise.std) <= 2.0:  # less than twice the noise's variance: chance, or nothing to speak of
        return replace(noise, used=noise.std)
    return replace(noise, used=np.hypot(noise.std, noise_beside(noise.std, mean_square)))


def noise_beside(part: np.ndarray, mean_square: Callable[[np.ndarray], float]) -> float:
    """The s for which rows of variance s^2 + part^2 scatter as they should: mean_square(std of the rows) = 1. All in SI.

    At least a hundredth of what it would be without `part`, which is an estimate and may be too large.
    """
    high = np.sqrt(mean_square(np.ones_like(part)))
    low = 0.01 * high
    for _ in range(20):  # to 1e-5 of it
        middle = np.sqrt(low * high)
        low, high = (middle, high) if mean_square(np.hypot(middle, part)) > 1.0 else (low, middle)
    return float(high)
