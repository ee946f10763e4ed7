"""How well the fitted valve meets each test, and where it misses worst: in plain words with figures. NumPy only."""

from dataclasses import dataclass

import numpy as np

from .display_units import reading_unit
from .fit_result import ChannelFit


# Reduced chi-square above which the program says that model and bench disagree (about 1.5 noise units RMS).
DISAGREES = 2.0


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
    shown = reading_unit(fit.channel)
    unit, factor = shown.label, shown.factor
    what = f"{fit.test}: {fit.channel} is met to {fit.residual_rms * factor:.3g} {unit} RMS"
    if "residuals" in fit.noise_source:
        return f"{what}; its noise was taken from these residuals, so this record alone cannot show a misfit there"
    beside = f"beside a noise of {fit.noise * factor:.2g} {unit} (reduced chi-square {fit.reduced_chi2:.3g})"
    if fit.reduced_chi2 < DISAGREES:
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


def verdict(fits: tuple[ChannelFit, ...], converged: bool, message: str) -> tuple[str, ...]:
    """The answer first, then one sentence per channel."""
    if not converged:
        first = f"The fit did not converge: {message}. Do not use these values."
    else:
        missed = [f for f in fits if f.reduced_chi2 >= DISAGREES and "residuals" not in f.noise_source]
        if missed:
            names = ", ".join(dict.fromkeys(f.test for f in missed))
            first = (
                f"The ideal valve does not explain {names}: the misfit is up to "
                f"{max(np.sqrt(f.reduced_chi2) for f in missed):.1f} times the noise. Error bars are widened by it, and the values "
                "are those of the nearest ideal valve."
            )
        else:
            first = "The ideal valve explains the record within its noise."
    return (first, *(sentence(fit) for fit in fits))
