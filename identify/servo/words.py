"""The sentences of a servo study in bench units, shared by terminal and page."""

import numpy as np

from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.shown_units import KINDS, decibel

from .study import MODELS, ServoStudy, number


SAFE = 2.0  # a gain margin of 6 dB
SWINGS = 0.02  # of the step, from lowest to highest at the end of a run


def conditions_in_words(study: ServoStudy) -> str:
    s = study.subject
    bar = KINDS["pressure"]
    back = f", return {bar.words(s.return_pressure, 3)}" if s.return_pressure else ""
    return f"step of {column_unit('setpoint').words(s.step, 3)} at {bar.words(s.supply_pressure, 4)}{back}"


def actuator_in_words(study: ServoStudy) -> str:
    """Whose loop it is."""
    a = study.subject.actuator
    area, volume = (
        " and ".join(f"{side:.3g}" for side in np.ravel(values)) for values in (a.areas * 1e4, a.volumes * 1e6)
    )
    spool = f"spool {float(a.spool_frequency):.3g} Hz, damping {float(a.spool_damping):.2g}"
    gains = f"loop {float(a.amplifier_gain):.3g} A/V and {float(a.sensor_gain):.3g} V/m"
    return f"Piston {area} cm2, chambers {volume} cm3, mass {float(a.moving_mass):.3g} kg; {spool}; {gains}."


def sentences(study: ServoStudy) -> list[str]:
    """What temperature does to the loop, the most important first; of the model that keeps its heat (THM)."""
    return [
        stability(study),
        *large_motions(study),
        *rapidity(study),
        *room_for_gain(study),
        *heat(study),
        formulas(study),
    ]


def alarming(sentence: str) -> bool:
    """Whether a sentence says that the loop does not come to rest."""
    return any(word in sentence for word in ("UNSTABLE", "KEEPS SWINGING"))


def stability(study: ServoStudy) -> str:
    """Whether the loop is stable everywhere, in either model."""
    shaky = sorted({float(t) for m in MODELS for t in study.celsius[~study.loops[m].stable]})
    if shaky:
        return f"The loop is UNSTABLE at {_list(shaky)} degC: even the smallest motion grows there."
    loop = study.loops["THM"]
    gain = np.asarray(loop.figures.gain_margin)
    least, phase = int(np.argmin(gain)), float(np.nanmin(np.asarray(loop.figures.phase_margin)))
    if len(gain) == 1:
        margins = f"gain margin {float(decibel(gain[0])):.1f} dB, phase margin {phase:.0f} deg"
        return f"The loop is stable at {study.celsius[0]:.0f} degC: {margins}."
    return (
        f"The loop is stable from {study.celsius[0]:.0f} to {study.celsius[-1]:.0f} degC; its gain margin is smallest at "
        f"{study.celsius[least]:.0f} degC, {float(decibel(gain[least])):.1f} dB (phase margin at least {phase:.0f} deg)."
    )


def large_motions(study: ServoStudy) -> list[str]:
    """Where a loop that is stable at rest keeps swinging after the step; how much of the margin large motions take."""
    said, rise = [], study.gain_rise["THM"]
    kept, late = _still_moving(study, beyond=True), _still_moving(study, beyond=False)
    step = f"a step of {column_unit('setpoint').words(study.subject.step, 3)}"
    if kept:
        said.append(
            f"Stable at rest, it KEEPS SWINGING after {step} at {_list(kept)} degC: the margins at null do not cover "
            "large motions (GM* does)."
        )
    if late:
        said.append(f"After {step} it still moves when the run ends at {_list(late)} degC.")
    most = int(np.argmax(rise))
    if rise[most] > 1.01:
        said.append(
            f"Away from null the valve's gain rises by up to {float(decibel(rise[most])):.1f} dB ({study.celsius[most]:.0f} degC): "
            f"GM* is the gain margin left for motions of any size, at least "
            f"{float(np.min(decibel(study.large_margin('THM')))):.1f} dB."
        )
    return said


def _still_moving(study: ServoStudy, beyond: bool) -> list[float]:
    """Temperatures [degC] at which a loop that is stable at rest has not come to rest; beyond its large-motion margin or not."""
    found = set()
    for model in MODELS:
        moving = study.loops[model].stable & (study.steps[model].figures.swing > SWINGS)
        found |= set(study.celsius[moving & ((study.large_margin(model) < 1.0) == beyond)].tolist())
    return sorted(found)


def rapidity(study: ServoStudy) -> list[str]:
    """How slow the coldest step is beside the hottest, and whether the valve's flow gain accounts for it."""
    reached, band = study.steps["THM"].figures.time_to_90, np.asarray(study.loops["THM"].figures.bandwidth)
    ends = study.loops["THM"].stable[[0, -1]]
    if not np.all(np.isfinite([reached[0], reached[-1], band[0], band[-1]])) or len(band) == 1 or not ends.all():
        return []
    flow = study.linear["THM"].flow_gain
    return [
        f"From {study.celsius[0]:.0f} to {study.celsius[-1]:.0f} degC 90 % of the step takes {number(1e3 * reached[0], 3)} to "
        f"{number(1e3 * reached[-1], 3)} ms and the bandwidth goes from {number(band[0] / (2 * np.pi), 3)} to "
        f"{number(band[-1] / (2 * np.pi), 3)} Hz (x {band[-1] / band[0]:.3g}); the valve's flow gain at null rises "
        f"x {flow[-1] / flow[0]:.3g}."
    ]


def room_for_gain(study: ServoStudy) -> list[str]:
    """What amplifier gain keeps 6 dB for motions of any size, at the worst and at the best temperature."""
    gain = study.large_margin("THM")
    if not np.all(np.isfinite(gain)):
        return []
    own = float(study.subject.actuator.amplifier_gain)
    least, most = int(np.argmin(gain)), int(np.argmax(gain))
    verb = "could rise to" if gain[least] > SAFE else "must fall to"
    alone = (
        f"{study.celsius[most]:.0f} degC alone would stand {own * gain[most] / SAFE:.2g} A/V" if most != least else ""
    )
    said = f"For 6 dB at every temperature and amplitude the amplifier {verb} {own * gain[least] / SAFE:.2g} A/V ({own:.2g} now)"
    return [f"{said}; {alone}." if alone else f"{said}."]


def heat(study: ServoStudy) -> list[str]:
    """Where oil that keeps its heat (THM) differs most from isothermal oil (HM)."""
    thm, hm = (study.loops[m].figures for m in ("THM", "HM"))
    band = np.asarray(thm.bandwidth) / np.asarray(hm.bandwidth) - 1.0
    band = np.where(study.loops["THM"].stable & study.loops["HM"].stable, band, np.nan)
    if not np.any(np.isfinite(band)):
        return []
    i = int(np.nanargmax(np.abs(band)))
    late = study.steps["THM"].figures.time_to_90[i] / study.steps["HM"].figures.time_to_90[i] - 1.0
    margin = float(decibel(thm.gain_margin[i]) - decibel(hm.gain_margin[i]))
    return [
        f"Heat kept by the oil (THM against HM) matters most at {study.celsius[i]:.0f} degC: bandwidth {100 * band[i]:+.1f} %, "
        f"gain margin {margin:+.1f} dB, time to 90 % {100 * late:+.1f} %."
    ]


def formulas(study: ServoStudy) -> str:
    """Where the linear formulas at null differ from the linearised equations."""
    if not study.subject.actuator.symmetric:
        return "The linear formulas at null are those of a symmetric jack; of this one there are none."
    parts = []
    for model in ("HM", "THM"):
        figures, linear = study.loops[model].figures, study.linear[model]
        with np.errstate(invalid="ignore"):
            gain = decibel(linear.gain_margin) - decibel(figures.gain_margin)
            phase = linear.phase_margin - np.asarray(figures.phase_margin)
        parts.append(f"{_largest(gain)} dB and {_largest(phase)} deg ({model})")
    return f"The linear formulas at null give margins that differ by at most {' and '.join(parts)}."


def _largest(values: np.ndarray) -> str:
    finite = np.abs(values[np.isfinite(values)])
    return f"{finite.max():.2g}" if finite.size and finite.max() >= 1e-4 else "0.0001"


def _list(values: list[float]) -> str:
    words = [f"{value:.0f}" for value in values]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
