"""What a fit of motion says first: does the actuator meet its tests, and if not, in which channel and when. NumPy only."""

import numpy as np

from ..display_units import reading_unit
from ..fit_result import DISAGREES, ChannelFit
from ..misfit import agreement


STRETCHES = 12


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
            first = first if all(f.noise_known for f in fits) else agreement(fits, "The actuator's model")
    return (first, *(sentence(fit) for fit in fits))


def sentence(fit: ChannelFit) -> str:
    """One sentence on one channel: RMS beside the noise, and when they disagree most."""
    shown = reading_unit(fit.channel)
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
    axis = "Hz" if fit.test == "frequency" else "s"
    share = 100.0 * sums[worst] / np.sum(squares)
    return f"{what}; worst at {edges[worst]:.3g} to {edges[worst + 1]:.3g} {axis} ({share:.0f} % of the misfit)"
