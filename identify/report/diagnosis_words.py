"""The tables and sentences of a diagnosis as text in bench units: the terminal and the page both show exactly this."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.shown_units import DisplayUnit, amount, beside, display_unit, effect_unit, significant
from thermohyd.identify.bench.test_record import is_dynamic, kind_of_test
from thermohyd.identify.diagnosis.result import Alternative, Candidate, DiagnosisResult, NamedEffect, Region, Variation
from thermohyd.identify.diagnosis.where import miss_words, region_words


# p-values below are all the same to a reader, and the far tail of any noise model is a guess.
SMALLEST_P = 1e-6
PLACES_SHOWN = 4  # of what acts as an effect does
CHANGES_SIGN = "changes sign"
VERDICTS = {
    "consistent": "no disagreement beyond noise",
    "named": "named: no rival explains the data as well",
    "ambiguous": "ambiguous: the gap closes, but rivals remain",
    "unexplained": "unexplained: a gap remains that no effect of the library closes",
}


@dataclass(frozen=True)
class WhereRow:
    """A region in which a model misses; `miss` says by how much, and on which side the bench lies."""

    reading: str
    place: str
    share: str
    excess: str
    rows: str
    miss: str


@dataclass(frozen=True)
class EffectRow:
    """An effect that was added, in bench units."""

    name: str
    value: str
    std: str
    unit: str
    interval: str
    p: str
    strength: str
    closed: str
    rivals: str
    sentence: str
    status: str


@dataclass(frozen=True)
class ShiftRow:
    """A parameter with and without the named effects, in bench units."""

    name: str
    before: str
    after: str
    std: str
    unit: str
    change: str


@dataclass(frozen=True)
class CandidateRow:
    """An effect of the library beside the ideal valve."""

    name: str
    state: str
    z: str
    p: str
    estimate: str
    least: str
    kept: str
    closed: str
    why: str
    named: bool


def percent(share: float) -> str:
    """A share as whole per cent, with a decimal where it is nearly all; empty where there is none."""
    if not math.isfinite(share):
        return ""
    shown = 100.0 * share
    return f"{shown:.1f} %" if 99.0 <= shown < 99.95 else f"{shown:.0f} %".replace("-0 %", "0 %")


def p_words(p: float) -> str:
    """A p-value to two digits; empty where there is none."""
    if not math.isfinite(p):
        return ""
    if p < SMALLEST_P:
        return f"< {SMALLEST_P:.0e}".replace("e-0", "e-")
    return f"{p:.2f}" if p >= 0.01 else f"{p:.1g}" if p >= 1e-3 else f"{p:.0e}".replace("e-0", "e-")


def excess(gap: float) -> str:
    """A reduced chi-square, or an excess of one, to three digits."""
    return f"{gap:,.0f}" if math.isfinite(gap) and gap >= 1000.0 else significant(gap, 3)


def changed(result: DiagnosisResult) -> bool:
    """Whether the final model differs from the ideal valve."""
    at_fault = any(not fault.rows for fault in result.after.faults)  # others are rows left out of both models
    return bool(result.effects) or at_fault or any(v.learned for v in (*result.variations, *result.terms))


def verdict_words(result: DiagnosisResult) -> str:
    """The verdict in a few words."""
    return "no disagreement that this record could show" if result.open else VERDICTS[result.verdict]


def shout(result: DiagnosisResult) -> str:
    """The sentence that must not be overlooked where the final fit did not converge; empty where it did.

    The ideal valve may be stuck on a kink of a record that it misses: that is what the diagnosis is for, and no failure.
    """
    if result.after.converged:
        return ""
    return f"THE FINAL FIT DID NOT CONVERGE: {result.after.message}. Do not rely on this diagnosis."


def where_rows(result: DiagnosisResult, regions: tuple[Region, ...]) -> list[WhereRow]:
    """Regions in the order given: the largest share first."""
    rows = []
    for region in regions:
        size, side = miss_words(region.unit, region.mean, region.rms)
        record = result.record.tests.get(region.test)
        rows.append(
            WhereRow(
                reading=reading_words(region.test, region.channel),
                place=region_words(region.limits, () if record is None else record.run_names),
                share=percent(region.share),
                excess=f"{region.excess_chi2:,.0f}",
                rows=f"{region.rows:,}",
                miss=f"{size}, {side or CHANGES_SIGN}",
            )
        )
    return rows


def reading_words(test: str, channel: str) -> str:
    """A test's reading in words; the channel is said only where the test alone does not tell."""
    words = test.replace("_", " ")
    if is_dynamic(test):
        return f"{words}, {channel.replace('_', ' ')}"
    return f"{words}, port {channel[-1].upper()}" if channel in ("pressure_a", "pressure_b") else words


def effect_rows(result: DiagnosisResult) -> list[EffectRow]:
    """One row per named effect."""
    return [_effect_row(effect) for effect in result.effects]


def _effect_row(effect: NamedEffect) -> EffectRow:
    unit = effect_unit(effect.name, effect.unit)
    std = None if effect.std is None else effect.std * unit.factor
    interval = ""
    if effect.ci95 is not None:
        low, high = (beside(bound * unit.factor, std) for bound in effect.ci95)
        interval = f"{low} to {high}"
    return EffectRow(
        name=effect.name,
        value=beside(effect.value * unit.factor, std),
        std="" if std is None else beside(std, std),
        unit=unit.label,
        interval=interval,
        p=p_words(effect.p_value),
        strength=significant(effect.strength, 3),
        closed=percent(effect.gap_closed),
        rivals=", ".join(rival.words for rival in effect.alternatives) or "none",
        sentence=effect.sentence,
        status="AT BOUND" if effect.at_bound else "",
    )


def meanings(result: DiagnosisResult) -> list[str]:
    """What each named effect is, where the diagnosis's own sentences do not say it."""
    said = [
        f"{effect.name}: {effect.sentence}."
        for effect in result.effects
        if not any(sentence.startswith(f"{effect.name}:") for sentence in result.sentences)
    ]
    return said


def proof(result: DiagnosisResult) -> str:
    """How the named effects do on conditions left out of their fit, and how much of their evidence a few rows hold."""
    if result.proof is None or not result.effects:
        return ""
    them = "it" if len(result.effects) == 1 else "them"
    words = f"Each condition left out in turn is predicted better with {them}: 2 ln E = {significant(result.proof, 3)} (10.6 proves)"
    top = [f"{percent(e.top_rows)} of that for {e.name}" for e in result.effects if math.isfinite(e.top_rows)]
    return f"{words}; the strongest 1 % of the rows hold {', '.join(top)}." if top else f"{words}."


def rival_sentences(result: DiagnosisResult) -> list[str]:
    """What each rival would have to amount to, and how much worse it is."""
    sentences = []
    beside = ", beside what is missed" if result.discrepancy else ""
    for effect in result.effects:
        if effect.alternatives:
            fits = [
                f"{rival.words}{_of_amount(rival)} (chi-square {round(rival.chi2_more, 1) + 0.0:+.1f})"  # no -0.0
                for rival in effect.alternatives
            ]
            sentences.append(f"In place of {effect.name} the data allow as well{beside}: {'; '.join(fits)}.")
    return sentences


def alike_sentences(result: DiagnosisResult) -> list[str]:
    """At which places of the circuit something would be read as a named effect is, whatever it be."""
    sentences = []
    for effect in result.effects:
        if effect.places:
            acting = [pair_words(pair) for pair in effect.places[:PLACES_SHOWN]]
            acting += [f"{len(effect.places) - PLACES_SHOWN} more"] if len(effect.places) > PLACES_SHOWN else []
            sentences.append(f"What acts as {one_of(acting)} reads as {effect.name} does, be it in the library or not.")
    return sentences


def pair_words(pair: tuple[str, str]) -> str:
    """ "position with direction"; of what goes with nothing its place."""
    place, variable = pair
    return place if variable == "constant" else f"{place} with {variable}"


def one_of(words: Sequence[str]) -> str:
    """ "a, b or c"."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}" if words else ""


def _of_amount(rival: Alternative) -> str:
    """Another law of the edge has no amount."""
    return f" of {amount(rival.name, rival.value, rival.unit)}" if math.isfinite(rival.value) else ""


def shift_rows(result: DiagnosisResult) -> list[ShiftRow]:
    """The parameters that the ideal valve and the final model share."""
    rows = []
    for shift in result.shifts:
        unit = display_unit(shift.unit)
        std = None if shift.std_after is None else shift.std_after * unit.factor
        rows.append(
            ShiftRow(
                name=shift.name,
                before=beside(shift.before * unit.factor, std),
                after=beside(shift.after * unit.factor, std),
                std="" if std is None else beside(std, std),
                unit=unit.label,
                change=_in_std(shift.before - shift.after, shift.std_after),
            )
        )
    return rows


def _in_std(change: float, std: float | None) -> str:
    if std is None or not std > 0.0:
        return ""
    return f"{change / std:+.1f}" if abs(change) < 100.0 * std else f"{change / std:+.0f}"


def candidate_rows(result: DiagnosisResult) -> list[CandidateRow]:
    """Every effect of the library: the named ones first, then by their evidence, then what cannot be tested."""
    named = [effect.name for effect in result.effects]
    order = {"testable": 1, "absorbed": 2, "impossible": 3}

    def key(c: Candidate) -> tuple[float, float]:
        z = -abs(c.z) if math.isfinite(c.z) else 0.0
        return (0, named.index(c.name)) if c.name in named else (order.get(c.state, 4), z)

    return [_candidate_row(c, c.name in named) for c in sorted(result.candidates, key=key)]


def _candidate_row(c: Candidate, named: bool) -> CandidateRow:
    unit = effect_unit(c.name, c.unit)
    tested = c.state == "testable"
    return CandidateRow(
        name=c.name,
        state="named" if named else c.state,
        z=f"{c.z:+.1f}" if tested and math.isfinite(c.z) else "",
        p=p_words(c.p_value),
        estimate=with_unit(c.estimate, unit) if tested else "",
        least=with_unit(c.least, unit),
        kept=percent(c.kept) if c.state != "impossible" else "",
        closed=percent(c.gap_closed),
        why=c.why,
        named=named,
    )


def with_unit(value: float, unit: DisplayUnit) -> str:
    """An amount in SI as two digits with its bench unit; empty where there is none."""
    if not math.isfinite(value):
        return ""
    shown = significant(value * unit.factor, 2)
    return shown if unit.label == "-" else f"{shown} {unit.label}"


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
        learned = any(found.learned for found in (*result.variations, *result.terms))
        rough = result.verdict == "unexplained" and not learned
        return f"{words}, but more scatter than the noise explains." if rough else f"{words}."
    words = f"a misfit beyond noise (lack-of-fit test, {figure})"
    if not result.where_after:
        return f"{words}."
    worst = where_rows(result, result.where_after[:1])[0]
    along = "in time" if kind_of_test(result.where_after[0].test) == "step" else "along the sweep"
    miss = f"{worst.miss} {along if worst.miss.endswith(CHANGES_SIGN) else 'the model'}"
    return f"{words}, most in {worst.reading}, {worst.place}: {miss} ({worst.share} of what is left)."


SMALL = 0.1  # of a channel's noise: what the model misses is then nothing to speak of


def discrepancy(result: DiagnosisResult) -> str:
    """How far readings are believed beside a misfit that remains; empty where nothing remains."""
    noise = {(n.test, n.channel): n.std for n in result.noise}
    known = [
        f"{found.unit.words(found.std, 2)} ({found.test.replace('_', ' ')}, {found.channel.replace('_', ' ')})"
        for found in result.discrepancy
        if found.std > SMALL * noise.get((found.test, found.channel), 0.0)
    ]
    if not known:
        return ""
    return (
        f"Beside their noise readings count as known to {', '.join(known)}, which is what the model misses: error bars hold that, and "
        "values are those that predict runs left out best."
    )


def variations(result: DiagnosisResult) -> list[str]:
    """What would have to vary with what to close the rest: empirical, and said to be so."""
    sentences = [_variation(found) for found in result.variations]
    if sentences and not result.terms and not any(found.learned for found in result.variations):
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
    unit = column_unit(found.variable)
    ends = [unit.of(float(end(found.variable_values))) for end in (min, max)]
    low, high = (f"{end:,.0f}" if abs(end) >= 1000.0 else f"{end:.3g}" for end in ends)
    return f"{low} to {high}{f' {unit.label}' if unit.label else ''}"
