"""The tables of a sweep, shared by terminal and page. Bench units."""

import numpy as np
from numpy.typing import ArrayLike

from ..display_units import decibel, significant
from .study import ServoStudy


COLUMNS = (
    "oil degC", "visc. cSt", "t90 ms", "settles ms", "over %", "GM dB", "GM* dB", "PM deg", "-3dB Hz", "peak dB", "p max bar", "dT K",
)  # fmt: skip
SLOPES = (
    "oil degC",
    "GM dB/K",
    "PM deg/K",
    "-3dB %/K",
    "GM formula dB",
    "PM formula deg",
    "K_l 1/s",
    "f_h Hz",
    "xi_h -",
)
UNSTABLE = "unst."


def rows(study: ServoStudy, model: str) -> list[list[str]]:
    """The cells of COLUMNS, a row per temperature; where the loop is unstable, the phase margin says so.

    GM: at null; GM*: left for motions of any size (`largest_gain_rise`).
    """
    loop, step = study.loops[model], study.steps[model]
    f, found = loop.figures, []
    for i, celsius in enumerate(study.celsius):
        found.append(
            [
                f"{celsius:.0f}",
                number(study.viscosity[i] * 1e6, 3),
                number(step.figures.time_to_90[i] * 1e3, 3),
                number(step.figures.settling_time[i] * 1e3, 3),
                f"{100.0 * step.figures.overshoot[i]:.1f}",
                _fixed(decibel(f.gain_margin[i]), 1),
                _fixed(decibel(study.large_margin(model)[i]), 1),
                _fixed(f.phase_margin[i], 0) if loop.stable[i] else UNSTABLE,
                number(float(f.bandwidth[i]) / (2.0 * np.pi), 3) if loop.stable[i] else "-",
                _fixed(decibel(f.peak[i]), 1) if loop.stable[i] else "-",
                f"{step.largest_pressure[i] * 1e-5:.0f}",
                f"{step.heating[i]:.1f}",
            ]
        )
    return found


def slope_rows(study: ServoStudy, model: str) -> list[list[str]]:
    """The cells of SLOPES: what a kelvin moves, and the linear formulas' figures."""
    loop, linear, found = study.loops[model], study.linear[model], []
    f, d = loop.figures, loop.slope
    for i, celsius in enumerate(study.celsius):
        found.append(
            [
                f"{celsius:.0f}",
                _signed(20.0 / np.log(10.0) * float(d.gain_margin[i]) / float(f.gain_margin[i])),
                _signed(float(d.phase_margin[i])),
                _signed(100.0 * float(d.bandwidth[i]) / float(f.bandwidth[i])),
                _fixed(decibel(linear.gain_margin[i]), 1),
                _fixed(linear.phase_margin[i], 1),
                number(linear.loop_gain[i], 3),
                number(linear.natural_frequency[i] / (2.0 * np.pi), 3),
                number(linear.damping_ratio[i], 2),
            ]
        )
    return found


def number(value: ArrayLike, digits: int) -> str:
    """To so many digits, but never without those before the point."""
    plain = float(np.asarray(value))
    if not np.isfinite(plain):
        return "-"
    return significant(plain, max(digits, len(f"{abs(plain):.0f}")) if abs(plain) < 1e6 else digits)


def _fixed(value: ArrayLike, decimals: int) -> str:
    plain = float(np.asarray(value))
    return f"{plain:.{decimals}f}" if np.isfinite(plain) else "none"


def _signed(value: float) -> str:
    return f"{value:+.2g}" if np.isfinite(value) else "-"
