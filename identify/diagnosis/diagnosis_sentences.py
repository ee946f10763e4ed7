"""The sentences of a diagnosis beside its tables: held-out rows, what cannot be seen, what is left over."""

import math

from ..effect_units import effect_unit
from .condition_words import condition_unit
from .diagnosis_content import changed, excess, p_words, percent, where_rows, with_unit
from .result import DiagnosisResult, Variation


MOST_AMOUNTS = 6
CLEAR = 1e-5  # below it, what is left over decides the verdict
LONGEST = 80  # characters, of which rows were held out


def gap(result: DiagnosisResult) -> str:
    """How far the model was from the bench, and how far it is now."""
    if not changed(result):
        return f"Reduced chi-square {excess(result.gap_before)} with the {result.plain_model} (noise alone: 1)."
    return (
        f"Reduced chi-square {excess(result.gap_before)} with the {result.plain_model}, {excess(result.gap_after)} with the "
        "final model (noise alone: 1)."
    )


def held_out(result: DiagnosisResult, short: bool = False) -> str:
    """What the final model does on rows that took no part in choosing it; `short`: without saying which, if that is long."""
    held = result.held_out
    if held is None:
        return (
            "No rows were held out: every figure comes from the rows that chose the effects." if result.effects else ""
        )
    rows = f"{held.rows:,} rows" if short and len(held.what) > LONGEST else f"{held.what}, {held.rows:,} rows"
    words = f"{rows}: excess of the reduced chi-square over noise {excess(held.before)}"
    if not changed(result):
        return f"{words}."
    closed = percent(held.gap_closed)
    end = (
        f"{closed} closed"
        if held.gap_closed >= 0.0
        else f"{closed[1:]} MORE than before"
        if closed
        else "no gap to close"
    )
    words += f" before, {excess(held.after)} after, {end}."
    if held.exchange:
        others = ", ".join(f"{name} {percent(share)}" for name, share in held.exchange.items())
        words += f" Put in its place instead: {others}."
    return words


def absorbed(result: DiagnosisResult) -> str:
    """Effects on which the record is silent; empty where there are none."""
    if not result.absorbed:
        return ""
    return (
        f"{', '.join(result.absorbed)}: cannot be seen by this record, because the free parameters swallow "
        f"{'it' if len(result.absorbed) == 1 else 'them'}; neither named nor excluded."
    )


def impossible(result: DiagnosisResult) -> str:
    """Effects that no row of the record depends on; empty where there are none."""
    names = [c.name for c in result.candidates if c.state == "impossible"]
    return f"{', '.join(names)}: not testable with this record's tests and columns." if names else ""


def would_show(result: DiagnosisResult) -> str:
    """Amounts from which the record would have shown an effect; empty where that was not worked out."""
    known = [c for c in result.candidates if c.state == "testable" and math.isfinite(c.least)]
    if not known:
        return ""
    amounts = [f"{c.name} {with_unit(c.least, effect_unit(c.name, c.unit))}" for c in known[:MOST_AMOUNTS]]
    more = f", and {len(known) - MOST_AMOUNTS} more in the report" if len(known) > MOST_AMOUNTS else ""
    return f"With 80 % probability the record shows an effect from: {', '.join(amounts)}{more}."


def left_over(result: DiagnosisResult) -> str:
    """What the final model still misses; empty where that was not tested."""
    p = result.left_over_p
    if not math.isfinite(p):
        return ""
    figure = f"p {p_words(p)}" if p_words(p).startswith("<") else f"p = {p_words(p)}"
    if p >= CLEAR:
        words = (
            f"{'nothing smooth' if p >= 0.05 else 'hardly anything smooth'} beyond noise (lack-of-fit test, {figure})"
        )
        return f"{words}, but more scatter than the noise explains." if result.verdict == "unexplained" else f"{words}."
    words = f"a misfit beyond noise (lack-of-fit test, {figure})"
    if not result.where_after:
        return f"{words}."
    worst = where_rows(result, result.where_after[:1])[0]
    return f"{words}, most in {worst.reading}, {worst.place}: bench {worst.miss} ({worst.share} of what is left)."


def variations(result: DiagnosisResult) -> list[str]:
    """What would have to vary with what to close the rest: empirical, and said to be so."""
    sentences = [_variation(found) for found in result.variations]
    if sentences and not any(found.learned for found in result.variations):
        sentences[0] += " --learn adds it to the model."
    return sentences


def _variation(found: Variation) -> str:
    quantity, variable = found.quantity.replace("_", " "), found.variable.replace("_", " ")
    closes = f"{percent(found.gap_closed)} of the gap" if math.isfinite(found.gap_closed) else "part of the gap"
    if found.learned:
        return (
            f"Learned at your word: {quantity} varies with {variable} ({_span(found)}) and closes {closes}. It is a fitted "
            "curve, not a cause, and holds inside that range only."
        )
    return (
        f"If {quantity} varied smoothly with {variable} ({_span(found)}), that would close {closes}: a fitted curve, not a "
        "cause."
    )


def _span(found: Variation) -> str:
    if found.variable == "direction":
        return "rising against falling"
    unit, factor, offset = condition_unit(found.variable)
    ends = [float(end(found.variable_values)) * factor + offset for end in (min, max)]
    low, high = (f"{end:,.0f}" if abs(end) >= 1000.0 else f"{end:.3g}" for end in ends)
    return f"{low} to {high}{f' {unit}' if unit else ''}"
