"""Turn the end of a solve into a `FitResult`: error bars, readings beside the model, identifiability and the verdict.

`Fitted` is what a fit hands over: what was fitted, with which noise, and where the solver ended.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.identify.noise.correlation import NoiseCorrelation, noise_correlation
from thermohyd.identify.noise.level import ChannelNoise
from thermohyd.identify.reduction.monotone_pieces import sweep_ids

from .least_squares import LeastSquaresResult, as_converged
from .misfit import verdict, verdict_of_motion
from .parameters import ParameterPlan
from .profile_intervals import Interval
from .result import ChannelFit, FitResult, ParameterEstimate, StartOutcome
from .static_readings import channel_slices
from .uncertainty import Block, Covariance, Key, covariance_of, identifiability


@dataclass(frozen=True)
class Fitted:
    """A fit before its error bars: what was fitted, with which noise, and where the search ended.

    `tests` are the reduced ones, `free` the fitted parameters in the order of the solution.
    """

    record: BenchRecord
    tests: dict[str, TestRecord]
    plans: dict[str, ParameterPlan]
    free: tuple[str, ...]
    noise: dict[Key, ChannelNoise]
    solution: LeastSquaresResult
    starts: tuple[StartOutcome, ...]
    warnings: tuple[str, ...]

    @property
    def values(self) -> dict[str, float]:
        """{free parameter: value}."""
        return dict(zip(self.free, (float(v) for v in self.solution.p), strict=True))


@dataclass(frozen=True)
class Uncertainty:
    """What the noise of a fit's readings does to its parameters.

    covariance: a sandwich, with the correlation and the excess of the residuals. independent: readings that all are worth.
    inflation (p,): variance of each parameter over what white noise of the size believed would give; without an error bar
    of its own, a parameter takes the others' median.
    """

    covariance: Covariance
    blocks: dict[Key, Block]
    independent: float
    inflation: np.ndarray

    def reach(self, parameters: int, level: float = 0.95) -> float:
        """Standard errors on either side of an interval of this level: Student's t for the independent readings."""
        return float(stdtrit(max(self.independent - parameters, 1.0), 0.5 + 0.5 * level))


def uncertainty_of(fitted: Fitted, covariance: Covariance | None = None) -> Uncertainty:
    """The covariance of a fit's parameters with the correlation of the noise, and what that adds to each variance.

    covariance: where the fit already weighed its rows by the correlation of their noise; else a sandwich is made here.
    """
    slices = channel_slices(fitted.tests)
    blocks = {key: _block(fitted, key, rows) for key, rows in slices.items()}
    solution = fitted.solution
    priors = slice(len(solution.residual) - len(fitted.free), len(solution.residual))
    independent = sum((rows.stop - rows.start) / blocks[key].correlation.inflation for key, rows in slices.items())
    sandwich = covariance is None
    if covariance is None:
        covariance = covariance_of(solution.jacobian, fitted.free, solution.active, list(blocks.values()), priors)
    inflation = np.ones(len(fitted.free))
    if sandwich:
        white = [Block(b.rows, b.sweeps, NoiseCorrelation(), 1.0) for b in blocks.values()]
        plain = covariance_of(solution.jacobian, fitted.free, solution.active, white, priors)
        allowed, white_alone = np.diag(covariance.matrix), np.diag(plain.matrix)
        known = (allowed > 0.0) & (white_alone > 0.0)
        usual = max((b.variance * b.correlation.inflation for b in blocks.values()), default=1.0)
        inflation[known] = allowed[known] / white_alone[known]
        inflation[~known] = np.median(inflation[known]) if known.any() else usual
    return Uncertainty(covariance, blocks, float(independent), inflation)


def fit_result(
    fitted: Fitted,
    covariance: Covariance | None = None,
    *,
    uncertainty: Uncertainty | None = None,
    intervals: Mapping[int, Interval] | None = None,
) -> FitResult:
    """Put a fit into figures and words; `seconds` is left to the caller.

    covariance: where the fit already weighed its rows by the correlation of their noise; else a sandwich is made here.
    intervals: by index of the free parameter, where the covariance does not hold.
    """
    fitted = replace(fitted, solution=as_converged(fitted.solution))
    slices = channel_slices(fitted.tests)
    known = uncertainty_of(fitted, covariance) if uncertainty is None else uncertainty
    covariance = known.covariance
    channels = tuple(_channel_fit(fitted, key, slices[key], known.blocks[key], covariance) for key in slices)
    chi2 = sum(float(np.sum(((c.measured - c.predicted) / _noise(fitted, c).std) ** 2)) for c in channels)
    points = sum(len(c.measured) for c in channels)
    degrees_of_freedom = float(max(points - len(fitted.free), 1))
    correlation = _correlation(covariance.matrix)
    solution = fitted.solution
    scales = np.array([fitted.plans[name].info.scale for name in fitted.free])
    words = identifiability(solution.jacobian, scales, fitted.free, correlation, covariance.why)
    notes = [note for test in fitted.tests.values() for note in test.notes]
    if solution.nearly and solution.converged:
        notes.append(f"the fit {solution.message}: its error bars are worth that much less")
    parameters = _estimates(fitted, known, intervals or {})
    return FitResult(
        record=fitted.record,
        parameters=parameters,
        free=fitted.free,
        covariance=covariance.matrix,
        correlation=correlation,
        reduced_chi2=chi2 / degrees_of_freedom,
        chi2=chi2,
        degrees_of_freedom=degrees_of_freedom,
        noise_freedom=_noise_freedom(fitted, points),
        channels=channels,
        identifiability=words,
        rows=sum(fitted.record.tests[name].rows for name in fitted.tests),
        points=points,
        seconds=0.0,
        converged=solution.converged,
        message=solution.message,
        starts=fitted.starts,
        notes=tuple(notes),
        warnings=fitted.warnings,
        faults=tuple(fault for test in fitted.tests.values() for fault in test.faults),
        verdict=_words(fitted, channels, parameters),
    )


def _words(
    fitted: Fitted, channels: tuple[ChannelFit, ...], parameters: Mapping[str, ParameterEstimate]
) -> tuple[str, ...]:
    """What the fit says first: of the valve in its static tests, then of the actuator in its dynamic ones."""
    solution = fitted.solution
    moves = {name for name, test in fitted.tests.items() if test.in_motion}
    moving, still = (tuple(c for c in channels if (c.test in moves) == which) for which in (True, False))
    words = verdict(still, solution.converged, solution.message, parameters) if still else ()
    if moving and (solution.converged or not still):
        words = (*words, *verdict_of_motion(moving, solution.converged, solution.message))
    return words


def _noise_freedom(fitted: Fitted, points: int) -> float:
    """Degrees of freedom from which the noise itself was estimated, all channels together; infinite where it was stated."""
    spread = 0.0
    for test in fitted.tests.values():
        for channel in test.channels:
            spread += (len(channel.value) / points) ** 2 / fitted.noise[test.name, channel.name].degrees_of_freedom
    return 1.0 / spread if spread > 0.0 else np.inf


def _noise(fitted: Fitted, channel: ChannelFit) -> ChannelNoise:
    return fitted.noise[channel.test, channel.channel]


def _find(fitted: Fitted, key: Key) -> tuple[TestRecord, Channel]:
    test = fitted.tests[key[0]]
    return test, test.channel(key[1])


def _block(fitted: Fitted, key: Key, rows: slice) -> Block:
    """One channel's share of the sandwich: the correlation of its residuals, and their variance where it exceeds 1."""
    test, _ = _find(fitted, key)
    residual = fitted.solution.residual[rows]
    sweeps = sweep_ids(test)
    share = len(fitted.free) * len(residual) / max(sum(t.rows * len(t.channels) for t in fitted.tests.values()), 1)
    correlation = noise_correlation(residual, sweeps, share)
    degrees_of_freedom = max(len(residual) - share, 1.0)
    # Residuals larger than the noise are the model's misfit: it widens the error bars. Smaller ones are luck.
    return Block(rows, sweeps, correlation, max(float(np.sum(residual**2)) / degrees_of_freedom, 1.0))


def _channel_fit(fitted: Fitted, key: Key, rows: slice, block: Block, covariance: Covariance) -> ChannelFit:
    test, channel = _find(fitted, key)
    noise = fitted.noise[key]
    misfit = fitted.solution.residual[rows] * noise.used  # model - reading
    slopes = fitted.solution.jacobian[rows] * noise.used[:, None]
    spread = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", slopes, covariance.matrix, slopes), 0.0))
    return ChannelFit(
        test=key[0],
        channel=key[1],
        position=test.place,
        measured=channel.value,
        predicted=channel.value + misfit,
        std=noise.std,
        predicted_std=spread,
        direction=test.direction,
        run=test.run,
        supply_pressure=test.supply_pressure,
        temperature=test.temperature,
        residual_rms=float(np.sqrt(np.mean(misfit**2))),
        noise=float(np.sqrt(np.mean(noise.std**2))),
        noise_source=noise.source,
        reduced_chi2=float(np.mean((misfit / noise.std) ** 2)),
        autocorrelation=_neighbours(block.correlation),
        effective_size=float(len(misfit) / block.correlation.inflation),
        noise_known=noise.known,
        neighbours=noise.neighbours,
        signal=channel.signal,
        noise_freedom=noise.degrees_of_freedom,
        noise_parts=noise.parts,
    )


def _neighbours(correlation: NoiseCorrelation) -> float:
    return correlation.share * correlation.phi


def _of_two_sides(below: float, above: float) -> float:
    """Root mean square about the mode of a normal law in two pieces (Wallis, Statistical Science 29, 2014), by its sides."""
    return float(np.sqrt(below**2 - below * above + above**2))


def _correlation(covariance: np.ndarray) -> np.ndarray:
    std = np.sqrt(np.diag(covariance))
    safe = np.where(std > 0.0, std, 1.0)
    matrix = covariance / np.outer(safe, safe)
    np.fill_diagonal(matrix, 1.0)
    return matrix


def _estimates(fitted: Fitted, known: Uncertainty, intervals: Mapping[int, Interval]) -> dict[str, ParameterEstimate]:
    """Every parameter, free or held, with its 95 % interval by Student's t for the independent readings.

    Where a profile gave the interval, the standard error is that of a normal law in two pieces with its sides. Else, beside
    parameters at their limits, both are conditional on these staying there.
    """
    covariance, reach = known.covariance, known.reach(len(fitted.free))
    pressed = tuple(name for name, side in zip(fitted.free, fitted.solution.active, strict=True) if side)
    estimates: dict[str, ParameterEstimate] = {}
    for name, plan in fitted.plans.items():
        if not plan.shown:
            continue
        value, std, why, at_bound = plan.start, None, "held fixed", False
        interval: tuple[float, float] | None = None
        by_profile = False
        if name in fitted.free:
            i = fitted.free.index(name)
            value, why = float(fitted.solution.p[i]), covariance.why.get(i, "")
            at_bound = bool(fitted.solution.active[i])
            if not fitted.solution.converged:
                why = why or "the fit did not converge"
            elif i in intervals:
                profile, by_profile = intervals[i], True
                # Between two kinks chi-square is steep on a scale of its own: never narrower than the covariance's interval.
                wide = 0.0 if why else reach * float(np.sqrt(covariance.matrix[i, i]))
                low, high = (
                    min(profile.low, max(value - wide, plan.lower)),
                    max(profile.high, min(value + wide, plan.upper)),
                )
                interval = (low, high)
                if profile.open_low and profile.open_high:
                    why = "the data allow every value within its limits"
                elif not at_bound:
                    std, why = _of_two_sides(value - low, high - value) / reach, ""
            elif not why:
                std = float(np.sqrt(covariance.matrix[i, i]))
                # What lies beyond a bound is known to be false, so the interval ends there.
                interval = (max(value - reach * std, plan.lower), min(value + reach * std, plan.upper))
        estimates[name] = ParameterEstimate(
            name=name,
            value=value,
            unit=plan.info.unit,
            std=std,
            ci95=interval,
            start=plan.start,
            lower=plan.lower,
            upper=plan.upper,
            at_bound=at_bound,
            fixed=plan.fixed,
            prior_std=None if plan.prior is None else plan.prior.std,
            prior_because="" if plan.prior is None or plan.fixed else plan.prior.why,
            why_no_error_bar=why,
            by_profile=by_profile,
            conditional_on=() if by_profile or std is None else pressed,
            relative=plan.relative,
        )
    return estimates
