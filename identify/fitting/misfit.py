"""Say how well the fitted model meets each test, and where it misses worst: one verdict, then a sentence per channel. NumPy only.

Static tests are judged over position, direction and temperature; dynamic ones over time.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from thermohyd.identify.bench.test_record import kind_of_test

from .result import DISAGREES, ChannelFit, ParameterEstimate, beyond_chance


OVERSTATED = 0.4  # reduced chi-square below which stated noise is too large
STANDS_OUT = 2.0  # residuals over the scatter of neighbours, from which on they are more than noise
MOSTLY_SCATTER = 0.7  # of a reading's own spread that a fit leaves: half of its variance
ENOUGH = 20  # readings


@dataclass(frozen=True)
class Region:
    """A stretch of one sweep direction and temperature where the model misses by `mean` (measured - model, SI)."""

    low: float
    high: float
    direction: float
    temperature: float
    mean: float
    share: float


def worst_region(fit: ChannelFit, stretches: int = 9) -> Region | None:
    """The stretch of positions, direction and temperature that holds the largest share of the excess chi-square."""
    residual = (fit.measured - fit.predicted) / fit.std
    edges = np.unique(np.quantile(fit.position, np.linspace(0.0, 1.0, stretches + 1)))
    if len(edges) < 2:
        return None
    part = np.clip(np.searchsorted(edges, fit.position, side="right") - 1, 0, len(edges) - 2)
    warmth = np.round(fit.temperature, 0)
    total = float(np.sum(residual**2))
    best: Region | None = None
    for i in range(len(edges) - 1):
        for direction in np.unique(fit.direction):
            for temperature in np.unique(warmth)[:20]:
                rows = (part == i) & (fit.direction == direction) & (warmth == temperature)
                if not rows.any():
                    continue
                share = float(np.sum(residual[rows] ** 2)) / max(total, 1e-300)
                if best is None or share > best.share:
                    mean = float(np.mean((fit.measured - fit.predicted)[rows]))
                    best = Region(edges[i], edges[i + 1], float(direction), float(temperature), mean, share)
    return best


def sentence(fit: ChannelFit) -> str:
    """One sentence on one channel: RMS beside the noise, and the worst place where they disagree."""
    shown = fit.unit
    unit, factor = shown.label, shown.factor
    what = f"{fit.test}: {fit.channel} is met to {fit.residual_rms * factor:.3g} {unit} RMS"
    if not fit.noise_known:
        words = f"{what}; its noise was taken from these residuals, so this record alone cannot show a misfit there"
        if fit.neighbours and fit.residual_rms > STANDS_OUT * fit.neighbours:
            words += (
                f", but neighbouring readings scatter by only {fit.neighbours * factor:.2g} {unit} about a smooth curve, so "
                "there probably is one"
            )
        return words
    beside = f"beside a noise of {fit.noise * factor:.2g} {unit} (reduced chi-square {fit.reduced_chi2:.3g})"
    if fit.reduced_chi2 < DISAGREES:
        if fit.reduced_chi2 < OVERSTATED and len(fit.measured) >= ENOUGH:
            return f"{what}, {beside}: the noise is stated larger than it is, and error bars with it"
        return f"{what}, {beside}"
    region = worst_region(fit)
    where = ""
    if region is not None:
        side = "above" if region.mean > 0 else "below"
        sweep = "rising" if region.direction > 0 else "falling"
        where = (
            f"; worst between {region.low * 1e6:.0f} and {region.high * 1e6:.0f} um on {sweep} sweeps, where the bench lies "
            f"{abs(region.mean) * factor:.3g} {unit} {side} the model ({100 * region.share:.0f} % of the misfit)"
        )
    return f"{what}, {beside}: the ideal valve does not explain it{where}"


def verdict(
    fits: tuple[ChannelFit, ...], converged: bool, message: str, parameters: Mapping[str, ParameterEstimate]
) -> tuple[str, ...]:
    """The answer first, then what casts doubt on it, then one sentence per channel."""
    if not converged:
        first = f"The fit did not converge: {message}. Do not use these values."
    else:
        missed = [f for f in fits if f.reduced_chi2 >= DISAGREES and f.noise_known]
        if missed:
            names = ", ".join(dict.fromkeys(f.test for f in missed))
            first = (
                f"The ideal valve does not explain {names}: the misfit is up to "
                f"{max(np.sqrt(f.reduced_chi2) for f in missed):.1f} times the noise. Error bars are widened by it, and the values "
                "are those of the nearest ideal valve."
            )
        else:
            first = agreement(fits, "The ideal valve")
    return (first, *doubts(fits, parameters), *(sentence(fit) for fit in fits))


def agreement(fits: tuple[ChannelFit, ...], model: str) -> str:
    """Whether a model that misses nothing beyond the noise explains the record, as far as the noise is known."""
    if beyond := beyond_chance(fits):
        return f"{more_than_chance(beyond, model)}. `thermohyd diagnose` looks for what is missing."
    open_ = tuple(dict.fromkeys(f.test for f in fits if not f.noise_known))
    judged = tuple(dict.fromkeys(f.test for f in fits if f.noise_known and f.test not in open_))
    if not open_:
        return f"{model} explains the record within its noise."
    reason = (
        "as the noise was taken from the residuals of this very fit. State it (noise in bench.toml) or run each sweep twice "
        "(column run)."
    )
    if not judged:
        return f"Whether {model[0].lower()}{model[1:]} explains the record cannot be judged, {reason}"
    return f"{model} explains {', '.join(judged)} within the noise. Whether it explains {', '.join(open_)} cannot be judged, {reason}"


def more_than_chance(beyond: tuple[ChannelFit, ...], model: str) -> str:
    """What is said where a misfit is too small for a disagreement and too large for chance."""
    channels = ", ".join(f"{f.test} ({f.channel})" for f in beyond)
    worst = max(np.sqrt(f.reduced_chi2) for f in beyond)
    return f"{model} misses {channels} by up to {worst:.2f} times the noise, more than chance makes of it as far as the noise is known"


def doubts(fits: tuple[ChannelFit, ...], parameters: Mapping[str, ParameterEstimate]) -> list[str]:
    """What says that the values should not be believed, whatever the misfit: limits, and readings that are all scatter."""
    found = []
    pressed = [p for p in parameters.values() if p.at_bound]
    if pressed:
        names = ", ".join(f"{p.name} ({_side(p)})" for p in pressed)
        found.append(
            f"At the limit of what is sensible: {names}. Either these data do not determine "
            f"{'it' if len(pressed) == 1 else 'them'}, or something is not as stated: look at units, oil and slot width first."
        )
    for fit in fits:
        scatter = float(np.std(fit.measured))
        if len(fit.measured) >= ENOUGH and fit.residual_rms > MOSTLY_SCATTER * scatter:
            shown = fit.unit
            what = "never changes" if scatter == 0.0 else (
                f"varies by {scatter * shown.factor:.3g} {shown.label} RMS, of which the model leaves "
                f"{100 * min(fit.residual_rms / scatter, 1.0):.0f} %: it hardly follows the model at all"
            )  # fmt: skip
            found.append(f"{fit.test}: {fit.channel} {what}. Is it the right column, in the right unit, of this test?")
    return found


def _side(estimate: ParameterEstimate) -> str:
    nearer_lower = abs(estimate.value - estimate.lower) <= abs(estimate.upper - estimate.value)
    unit = estimate.shown
    bound = (estimate.lower if nearer_lower else estimate.upper) * unit.factor
    label = "" if unit.label in ("", "-") else f" {unit.label}"
    return f"{'lower' if nearer_lower else 'upper'} limit, {bound:.4g}{label}"


STRETCHES = 12  # of a sweep, in whose words a misfit is told


def verdict_of_motion(fits: tuple[ChannelFit, ...], converged: bool, message: str) -> tuple[str, ...]:
    """The answer first, then one sentence per channel."""
    if not converged:
        first = f"The fit did not converge: {message}. Do not use these values."
    else:
        missed = [f for f in fits if f.reduced_chi2 >= DISAGREES and f.noise_known]
        if missed:
            names = ", ".join(dict.fromkeys(f"{f.test} ({f.channel})" for f in missed))
            worst = max(np.sqrt(f.reduced_chi2) for f in missed)
            first = (
                f"The actuator's model does not explain {names}: the misfit is up to {worst:.1f} times the noise. Error bars "
                "are widened by it; thermohyd diagnose looks for what is missing."
            )
        else:
            first = "The actuator's model explains the dynamic tests within their noise."
            known = all(f.noise_known for f in fits) and not beyond_chance(fits)
            first = first if known else agreement(fits, "The actuator's model")
    return (first, *(sentence_of_motion(fit) for fit in fits))


def sentence_of_motion(fit: ChannelFit) -> str:
    """One sentence on one channel of a dynamic test: RMS beside the noise, and when they disagree most."""
    shown = fit.unit
    unit, factor = "" if shown.label == "-" else f" {shown.label}", shown.factor
    what = f"{fit.test}: {fit.channel} is met to {fit.residual_rms * factor:.3g}{unit} RMS"
    if not fit.noise_known:
        return f"{what}; its noise was taken from these residuals, so this record alone cannot show a misfit there"
    what += f", beside a noise of {fit.noise * factor:.2g}{unit} (reduced chi-square {fit.reduced_chi2:.3g})"
    if fit.reduced_chi2 < DISAGREES:
        return what
    squares = ((fit.measured - fit.predicted) / fit.std) ** 2
    edges = np.unique(np.quantile(fit.position, np.linspace(0.0, 1.0, STRETCHES + 1)))
    part = np.clip(np.searchsorted(edges, fit.position, side="right") - 1, 0, len(edges) - 2)
    sums = np.bincount(part, squares, minlength=len(edges) - 1)
    worst = int(np.argmax(sums))
    axis = "Hz" if kind_of_test(fit.test) == "frequency" else "s"
    share = 100.0 * sums[worst] / np.sum(squares)
    return f"{what}; worst at {edges[worst]:.3g} to {edges[worst + 1]:.3g} {axis} ({share:.0f} % of the misfit)"
