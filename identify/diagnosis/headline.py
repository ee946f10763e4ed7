"""The answer in plain words with figures: one sentence for the verdict, then what an engineer asks next."""

import numpy as np

from ..display_units import beside, decimals_for, display_unit
from ..effect_units import amount
from ..fit_result import FitResult
from .condition_words import miss_words, region_words
from .diagnosis_content import excess, percent
from .result import HeldOut, NamedEffect, ParameterShift, Region, Variation, Verdict


MOST_OF_THE_GAP = 0.7


def headline(
    verdict: Verdict,
    effects: tuple[NamedEffect, ...],
    where: tuple[Region, ...],
    held: HeldOut | None,
    gap: tuple[float, float],
    shifts: tuple[ParameterShift, ...],
    smooth: tuple[Variation, ...] = (),
    judged: bool = True,
) -> str:
    """The first sentence of every report. judged: the noise is known, so that agreement with it means something."""
    place = _place(where)
    if verdict == "consistent":
        if judged:
            return "The ideal valve explains this record within its noise: no effect of the library is needed."
        return (
            "Nothing in the library does better than the ideal valve, but whether that explains the record cannot be judged: "
            "the noise was estimated from what the fits leave. State it (noise in bench.toml) or run each sweep twice (column run)."
        )
    names = _and([f"{e.name} ({amount(e.name, e.value, e.unit, e.std)})" for e in effects])
    if verdict == "unexplained":
        first = place or "Model and bench disagree beyond noise"
        if not effects:
            return f"{first}, and nothing in the library explains it{_curve(smooth)} (reduced chi-square {excess(gap[0])})."
        names = _and([f"{e.name} ({_with_rivals(e)})" for e in effects])
        share = _closed(held)
        closes = f"{_verb(effects, 'closes', 'close')} {share}" if share else _verb(effects, "helps", "help")
        rest = f"but nothing in the library explains the rest{_curve(smooth)} (reduced chi-square {excess(gap[0])} to {excess(gap[1])})"
        return f"{first}: {names} {closes}, {rest}."
    closes = _closes(held, gap, "it" if len(effects) == 1 else "them")
    lead = f"{place}: " if place else ""
    if verdict == "named":
        return f"{lead}{names} {_verb(effects, 'is', 'are')} missing from the model; {closes}{_bias(shifts)}."
    open_ = [e for e in effects if e.alternatives]
    rivals = "; ".join(
        f"{e.name} cannot be told from {_or([a.name for a in e.alternatives])} by these data" for e in open_
    )
    return f"{lead}{names} would explain it, and {closes}, but {rivals}."


def _curve(smooth: tuple[Variation, ...]) -> str:
    """The second tier's best answer, where it closes most of the gap."""
    if not smooth or not smooth[0].gap_closed > MOST_OF_THE_GAP:
        return ""
    best = smooth[0]
    what, closes = f"{best.quantity.replace('_', ' ')}", percent(best.gap_closed)
    closing = f"closes {closes}" if best.learned else f"would close {closes}"
    return f"; {what} varying smoothly with {best.variable.replace('_', ' ')} {closing}, a fitted curve, not a cause"


def _with_rivals(effect: NamedEffect) -> str:
    own = amount(effect.name, effect.value, effect.unit, effect.std)
    return f"{own}, or {_or([a.name for a in effect.alternatives])}" if effect.alternatives else own


def _closed(held: HeldOut | None) -> str:
    return (
        f"{percent(max(held.gap_closed, 0.0))} of the gap on rows held out"
        if held is not None and held.before > 0.0
        else ""
    )


def _place(where: tuple[Region, ...]) -> str:
    if not where:
        return ""
    worst = where[0]
    size, side = miss_words(worst.channel, worst.mean, worst.rms)
    what = worst.channel.replace("_", " ").capitalize()
    miss = f"{size} {side if side == 'off' else f'too {side}'}"
    return f"{what} is {miss}{_at(region_words({k: v for k, v in worst.limits.items() if k != 'run'}))} in {worst.test}"


def _at(place: str) -> str:
    return f" {place}" if place == "everywhere" else f" at {place}"


def _closes(held: HeldOut | None, gap: tuple[float, float], it: str) -> str:
    if held is not None and held.before > 0.0:
        return f"with {it} {percent(max(held.gap_closed, 0.0))} of the gap closes on rows held out"
    return f"reduced chi-square falls from {excess(gap[0])} to {excess(gap[1])}"


def _bias(shifts: tuple[ParameterShift, ...]) -> str:
    """The identified parameter that ignoring the effects would have spoiled most, in its own error bars."""
    seen = [s for s in shifts if s.std_after]
    if not seen:
        return ""
    worst = max(seen, key=lambda s: abs(s.before - s.after) / (s.std_after or np.inf))
    off = worst.before - worst.after
    if abs(off) < 2.0 * (worst.std_after or np.inf):
        return ""
    unit = display_unit(worst.unit)
    word = "inflated" if off > 0 else "lowered"
    label = "" if unit.label in ("", "-") else f" {unit.label}"
    std = (worst.std_after or np.inf) * unit.factor
    # the difference of the two values as the table of parameters shows them
    before, after = (round(value * unit.factor, decimals_for(std)) for value in (worst.before, worst.after))
    return f"; ignoring it would have {word} {worst.name} by {beside(abs(before - after), std)}{label}"


def further_sentences(
    effects: tuple[NamedEffect, ...], before: FitResult, variations: tuple[Variation, ...]
) -> tuple[str, ...]:
    """What stands under the headline, one line each."""
    lines = []
    for effect in effects:
        line = f"{effect.name}: {effect.sentence}"
        if effect.name == "unequal_underlap" and not _ports_measured(before):
            line += "; the same with the other sign fits as well unless both port pressures are measured"
        lines.append(f"{line}.")
    return tuple(lines)


def _ports_measured(fit: FitResult) -> bool:
    return any(c.channel in ("pressure_a", "pressure_b") for c in fit.channels)


def _verb(effects: tuple[NamedEffect, ...], one: str, many: str) -> str:
    return one if len(effects) == 1 else many


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""


def _or(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}" if words else ""
