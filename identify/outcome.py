"""From the end of a solve to a `FitResult`: error bars, channels beside the model, identifiability and the verdict."""

import numpy as np
from scipy.special import stdtrit

from .channel_noise import ChannelNoise
from .covariance import Block, Covariance, covariance_of
from .fit_result import ChannelFit, FitResult, ParameterEstimate
from .fitted import Fitted, Key
from .identifiability import identifiability
from .legs import sweep_ids
from .misfit import verdict
from .noise_correlation import NoiseCorrelation, noise_correlation
from .record import Channel, TestRecord
from .static_model import channel_slices


def fit_result(fitted: Fitted, covariance: Covariance | None = None) -> FitResult:
    """Put a fit into figures and words; `seconds` is left to the caller.

    covariance: where the fit already weighed its rows by the correlation of their noise; else a sandwich is made here.
    """
    slices = channel_slices(fitted.tests)
    blocks = {key: _block(fitted, key, rows) for key, rows in slices.items()}
    priors = slice(len(fitted.solution.residual) - len(fitted.free), len(fitted.solution.residual))
    if covariance is None:
        covariance = covariance_of(
            fitted.solution.jacobian, fitted.free, fitted.solution.active, list(blocks.values()), priors
        )
    channels = tuple(_channel_fit(fitted, key, slices[key], blocks[key], covariance) for key in slices)
    chi2 = sum(float(np.sum(((c.measured - c.predicted) / _noise(fitted, c).std) ** 2)) for c in channels)
    points = sum(len(c.measured) for c in channels)
    freedom = float(max(points - len(fitted.free), 1))
    correlation = _correlation(covariance.matrix)
    solution = fitted.solution
    scales = np.array([fitted.plans[name].info.scale for name in fitted.free])
    words = identifiability(solution.jacobian, scales, fitted.free, correlation, covariance.why)
    notes = [note for test in fitted.tests.values() for note in test.notes]
    return FitResult(
        record=fitted.record,
        parameters=_estimates(fitted, covariance, _independent(channels)),
        free=fitted.free,
        covariance=covariance.matrix,
        correlation=correlation,
        reduced_chi2=chi2 / freedom,
        chi2=chi2,
        degrees_of_freedom=freedom,
        channels=channels,
        identifiability=words,
        rows=sum(test.rows for test in fitted.record.tests.values()),
        points=points,
        seconds=0.0,
        converged=solution.converged,
        message=solution.message,
        starts=fitted.starts,
        notes=tuple(notes),
        warnings=fitted.warnings,
        verdict=verdict(channels, solution.converged, solution.message),
    )


def _noise(fitted: Fitted, channel: ChannelFit) -> ChannelNoise:
    return fitted.noise[channel.test, channel.channel]


def _find(fitted: Fitted, key: Key) -> tuple[TestRecord, Channel]:
    test = fitted.tests[key[0]]
    return test, next(c for c in test.channels if c.name == key[1])


def _block(fitted: Fitted, key: Key, rows: slice) -> Block:
    """One channel's share of the sandwich: the correlation of its residuals, and their variance where it exceeds 1."""
    test, _ = _find(fitted, key)
    residual = fitted.solution.residual[rows]
    sweeps = sweep_ids(test)
    share = len(fitted.free) * len(residual) / max(sum(t.rows * len(t.channels) for t in fitted.tests.values()), 1)
    correlation = noise_correlation(residual, sweeps, share)
    freedom = max(len(residual) - share, 1.0)
    # Residuals larger than the noise are the model's misfit: it widens the error bars. Smaller ones are luck.
    return Block(rows, sweeps, correlation, max(float(np.sum(residual**2)) / freedom, 1.0))


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
    )


def _neighbours(correlation: NoiseCorrelation) -> float:
    return correlation.share * correlation.phi


def _independent(channels: tuple[ChannelFit, ...]) -> float:
    return float(sum(c.effective_size for c in channels))


def _correlation(covariance: np.ndarray) -> np.ndarray:
    std = np.sqrt(np.diag(covariance))
    safe = np.where(std > 0.0, std, 1.0)
    matrix = covariance / np.outer(safe, safe)
    np.fill_diagonal(matrix, 1.0)
    return matrix


def _estimates(fitted: Fitted, covariance: Covariance, independent: float) -> dict[str, ParameterEstimate]:
    """Every parameter, free or held, with its 95 % interval by Student's t for the independent readings."""
    reach = float(stdtrit(max(independent - len(fitted.free), 1.0), 0.975))
    found: dict[str, ParameterEstimate] = {}
    for name, plan in fitted.plans.items():
        if plan.fixed and name == "heat_retention" and not plan.given:
            continue  # nobody asked for it
        value, std, why, at_bound = plan.start, None, "held fixed", False
        if name in fitted.free:
            i = fitted.free.index(name)
            value, why = float(fitted.solution.p[i]), covariance.why.get(i, "")
            at_bound = bool(fitted.solution.active[i])
            if not why and fitted.solution.converged:
                std = float(np.sqrt(covariance.matrix[i, i]))
            elif not why:
                why = "the fit did not converge"
        found[name] = ParameterEstimate(
            name=name,
            value=value,
            unit=plan.info.unit,
            std=std,
            # What lies beyond a bound is known to be false, so the interval ends there.
            ci95=None if std is None else (max(value - reach * std, plan.lower), min(value + reach * std, plan.upper)),
            start=plan.start,
            lower=plan.lower,
            upper=plan.upper,
            at_bound=at_bound,
            fixed=plan.fixed,
            prior_std=None if plan.prior is None else plan.prior.std,
            why_no_error_bar=why,
        )
    return found
