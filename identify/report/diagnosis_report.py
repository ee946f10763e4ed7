"""The answer of a diagnosis in plain words, and its printout in a terminal: the verdict first, then what an engineer asks next.

One screen, which reads the same without colour.
"""

from collections.abc import Sequence

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from thermohyd.effects.library import find_effect
from thermohyd.identify.bench.provenance import record_line
from thermohyd.identify.bench.shown_units import amount, beside, decimals_for, display_unit
from thermohyd.identify.bench.test_record import Fault
from thermohyd.identify.diagnosis.result import (
    DiagnosisResult,
    HeldOut,
    NamedEffect,
    ParameterShift,
    Region,
    Suspect,
    Term,
    Variation,
    Verdict,
)
from thermohyd.identify.diagnosis.where import miss_words, region_words
from thermohyd.identify.fitting.misfit import more_than_chance
from thermohyd.identify.fitting.result import ChannelFit, FitResult

from . import diagnosis_words as words
from .diagnosis_words import excess, one_of, percent
from .fit_report import print_known, prior_sentences
from .model_form_words import model_form_sentences
from .term_words import term_headline, term_lines
from .terminal import heading, indented, table


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
    law: str = "",
    faults: tuple[Fault, ...] = (),
    terms: tuple[Term, ...] = (),
    suspects: tuple[Suspect, ...] = (),
    beyond: tuple[ChannelFit, ...] = (),
) -> str:
    """The first sentence of every report. judged: the noise is known, so that agreement with it means something.

    law: the other law of an edge, where the data prefer it. faults: of the bench, that the final model allows for. terms: where in
    the circuit something is missing, and with what. suspects: found and not proven. beyond: channels that are missed by more than chance.
    """
    place = _place(where)
    once = _once(faults)
    if verdict == "ambiguous" and not effects:
        rivals = one_of(list(dict.fromkeys(rival for fault in faults for rival in fault.alternatives)))
        return f"Once {once} allowed for, the ideal valve explains this record, but that cannot be told from {rivals} by these data."
    if verdict == "consistent":
        return _consistent(once, judged, suspects, beyond)
    names = in_a_row([f"{e.name} ({_amount(e)})" for e in effects])
    if verdict == "unexplained":
        first = place or "Model and bench disagree beyond noise"
        better = f"; the {law} law of the edge does better" if law else ""
        if not effects:
            return f"{first}, and nothing in the library explains it{_beyond(terms, smooth)} (reduced chi-square {excess(gap[0])}){better}."
        names = in_a_row([f"{e.name} ({_with_rivals(e)})" for e in effects])
        share = _closed(held)
        closes = f"{_verb(effects, 'closes', 'close')} {share}" if share else _verb(effects, "helps", "help")
        fall = f"(reduced chi-square {excess(gap[0])} to {excess(gap[1])})"
        rest = f"but nothing in the library explains the rest{_beyond(terms, smooth)} {fall}"
        return f"{first}: {names} {closes}, {rest}{better}."
    closes = _closes(held, gap, "it" if len(effects) == 1 else "them")
    lead = f"{place}: " if place else ""
    if verdict == "named":
        return f"{lead}{names} {_verb(effects, 'is', 'are')} missing from the model; {closes}{_bias(shifts)}."
    open_ = [e for e in effects if e.alternatives]
    rivals = "; ".join(
        f"{e.name} cannot be told from {one_of([a.words for a in e.alternatives])} by these data" for e in open_
    )
    return f"{lead}{names} would explain it, and {closes}, but {rivals}."


def _consistent(once: str, judged: bool, suspects: tuple[Suspect, ...], beyond: tuple[ChannelFit, ...]) -> str:
    """Where nothing is named: what was found and not proven is a hint."""
    hints = in_a_row([f"{s.name} ({amount(s.name, s.value, s.unit)})" for s in suspects])
    hint = (
        f"{hints} {'is a hint' if len(suspects) == 1 else 'are hints'} that no rows left out confirm"
        if suspects
        else ""
    )
    nothing = (
        f"{f'Once {once} allowed for, n' if once else 'N'}othing in the library is proven to do better than the ideal valve"
        f"{f' ({hint})' if hint else ''}"
    )
    if beyond:
        return f"{nothing}, but {more_than_chance(beyond, 'it')}. State that noise (noise in bench.toml) or repeat more of the sweeps."
    if judged:
        within = f"The ideal valve explains this record within its noise{f' once {once} allowed for' if once else ''}"
        return f"{within}, but {hint}." if hint else f"{within}: no effect of the library is needed."
    return (
        f"{nothing}, but whether that explains the record cannot be judged: the noise was estimated from what "
        "the fits leave. State it (noise in bench.toml) or run each sweep twice (column run)."
    )


def suspect_sentences(suspects: tuple[Suspect, ...]) -> tuple[str, ...]:
    """What was found and did not prove itself, or in an amount that it cannot have, or is of no use beside a typed term."""
    but = lambda s: (
        f"takes {s.times_usual:.0f} times its largest usual amount for that: something else that looks like it is more likely."
        if s.implausible
        else f"makes the rows worse that took no part in its choice (2 ln E = {s.held_out:.1f} there)."
        if s.held_out is not None and s.held_out <= 0.0
        else f"does not predict rows that are left out of its fit (2 ln E = {s.evidence:.1f} over all conditions; 10.6 would prove it)."
    )
    weak = lambda s: f" At {s.strength:.1f} standard errors it is a hint, no misfit." if s.hint else ""
    words = lambda s: f"{s.name} ({amount(s.name, s.value, s.unit)})"
    said = [
        f"Suspected, not named: {words(s)} lowers the misfit of the rows it is fitted to, but {but(s)}{weak(s)}"
        for s in suspects
        if not s.outdone_by
    ]
    for term in dict.fromkeys(s.outdone_by for s in suspects if s.outdone_by):
        outdone = [words(s) for s in suspects if s.outdone_by == term]
        one = len(outdone) == 1
        said.append(
            f"Suspected, not named: {in_a_row(outdone)} {'lowers' if one else 'lower'} the misfit, but beside {term} "
            + (
                "it is of no use: it only stands in for that."
                if one
                else "they are of no use: they only stand in for that."
            )
        )
    return tuple(said)


def _once(faults: tuple[Fault, ...]) -> str:
    """The faults of the bench, each with its figures, and the verb behind them."""
    if not faults:
        return ""
    return f"{in_a_row([f'{f.name} ({f.sentence})' for f in faults])} {'is' if len(faults) == 1 else 'are'}"


def _beyond(terms: tuple[Term, ...], smooth: tuple[Variation, ...]) -> str:
    """The second tier's best answer, where it closes most of the gap: a place and a variable, else a quantity that varies."""
    if not terms or not (terms[0].gap_closed > MOST_OF_THE_GAP and (terms[0].holds or not terms[0].on_held_out)):
        return _curve(smooth) if not terms else ""
    return f"; {term_headline(terms[0])}"


def _curve(smooth: tuple[Variation, ...]) -> str:
    """The second tier's best answer, where it closes most of the gap."""
    if not smooth or not smooth[0].gap_closed > MOST_OF_THE_GAP:
        return ""
    best = smooth[0]
    what, closes = f"{best.quantity.replace('_', ' ')}", percent(best.gap_closed)
    closing = f"closes {closes}" if best.learned else f"would close {closes}"
    return f"; {what} varying smoothly with {best.variable.replace('_', ' ')} {closing}, a fitted curve, not a cause"


def _with_rivals(effect: NamedEffect) -> str:
    own = _amount(effect)
    return f"{own}, or {one_of([a.words for a in effect.alternatives])}" if effect.alternatives else own


def _amount(effect: NamedEffect) -> str:
    """With its error bar; where that spans the mirror, too, it is no range about the amount."""
    own = amount(effect.name, effect.value, effect.unit, effect.std, with_std=not effect.either_sign)
    return f"{own} or about as much of the other sign" if effect.either_sign else own


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
    size, side = miss_words(worst.unit, worst.mean, worst.rms)
    port = f"pressure at port {worst.channel[-1].upper()}" if worst.channel in ("pressure_a", "pressure_b") else ""
    miss = f"The {port or worst.channel.replace('_', ' ')} deviates by {size}{f' ({side} the model)' if side else ''}"
    return f"{miss}{_at(region_words({k: v for k, v in worst.limits.items() if k != 'run'}))} in {worst.test}"


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
        info = find_effect(effect.name)
        if info is not None and info.caveat and not any(c.channel in info.settled_by for c in before.channels):
            line += f"; {info.caveat}"
        lines.append(f"{line}.")
    return tuple(lines)


def _verb(effects: tuple[NamedEffect, ...], one: str, many: str) -> str:
    return one if len(effects) == 1 else many


def in_a_row(words: Sequence[str]) -> str:
    """ "a, b and c"."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""


SCREEN = 40  # lines
COLOURS = {"consistent": "green", "named": "green", "ambiguous": "yellow", "unexplained": "red"}
# How many rows of a section are shown at most; a screen that runs over is tried again with fewer.
ROWS = (5, 4, 3, 2, 1)


def print_summary(result: DiagnosisResult, console: Console) -> None:
    """Write at most one screen to a console, and what was asked beyond error bars; user text is never read as markup."""
    screens = (_screen(result, console, rows) for rows in ROWS)
    fitting = (screen for screen in screens if len(console.render_lines(screen, pad=False)) <= SCREEN)
    console.print(next(fitting, None) or _screen(result, console, ROWS[-1]))
    print_known(console, result.after, console.width >= 100)


def _screen(result: DiagnosisResult, console: Console, rows: int) -> Group:
    parts: list[RenderableType] = [Text(result.headline, style="bold")]
    shout = words.shout(result)
    if shout:
        parts.append(Text(shout, style="bold red"))
    facts = f"{result.record.name}: {words.verdict_words(result)} ({result.before.points:,} readings, "
    colour = "yellow" if result.open else COLOURS[result.verdict]
    parts.append(Text(f"{facts}{result.seconds:.1f} s)", style=colour))
    parts.append(Text(record_line(result.record), style="dim"))
    parts += [Text(f"warning: {warning}", style="yellow") for warning in result.warnings[: max(1, rows - 3)]]
    if result.where:
        parts += [heading(f"Where the {result.plain_model} misses"), _where(result, rows)]
    if result.effects:
        parts += [heading("Effects added to the model"), _effects(result, console.width >= 100)]
    shifts = words.shift_rows(result)
    if shifts:
        parts += [heading("Parameters"), _shifts(shifts, rows + 2, result.plain_model)]
    parts += [Text(""), _facts(result, rows)]
    return Group(*parts)


def _facts(result: DiagnosisResult, rows: int) -> Table:
    """What fits on a line or two each, with its label before it."""
    labelled = [
        ("meaning", result.sentences[: max(0, rows - 2)]),
        ("gap", [words.gap(result)]),
        ("next test", [] if result.next_test is None else [result.next_test.sentence]),
        ("held out", [words.held_out(result, short=True)]),
        ("proof", [words.proof(result)]),
        ("rivals", words.rival_sentences(result)[:rows]),
        ("alike", words.alike_sentences(result)[:rows]),
        ("prior", prior_sentences(result.after)),
        ("edge law", model_form_sentences(result.after)[:rows]),
        ("left over", [words.left_over(result)]),
        ("known to", [words.discrepancy(result)]),
        ("place", term_lines(result.terms)[: max(1, rows - 2)]),
        ("empirical", [] if result.terms else words.variations(result)[: max(1, rows - 3)]),
        ("absorbed", [words.absorbed(result)]),
        ("least seen", [words.would_show(result)] if result.verdict == "consistent" else []),
    ]
    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column()
    for label, sentences in labelled:
        for sentence in filter(None, sentences):
            grid.add_row(Text(label, style="bold"), Text(sentence))
            label = ""
    return grid


def _where(result: DiagnosisResult, rows: int) -> Padding:
    shown = [(r.reading, r.place, r.share, r.excess, r.miss) for r in words.where_rows(result, result.where)[:rows]]
    made = table(("test", "~where", ">share", ">excess chi2", "~bench against model"), shown)
    more = len(result.where) - rows
    if more > 0:
        made.add_row(Text(f"and {more} more", style="dim"))
    return indented(made)


def _effects(result: DiagnosisResult, wide: bool) -> Padding:
    rows = []
    for row in words.effect_rows(result):
        value = f"{row.value} +/- {row.std}" if row.std else row.value
        status = Text(f"{row.status} ", style="bold red") if row.status else Text("")
        p = [row.p] if wide else []
        rows.append((row.name, value, row.unit, *p, row.closed, status + Text(row.rivals)))
    return indented(table(("name", ">value", "unit", *([">p"] if wide else []), ">gap closed", "~rivals"), rows))


def _shifts(shifts: list[words.ShiftRow], rows: int, plain: str) -> Padding:
    headings = ("name", f">{plain}", ">final model", ">std err", "unit", ">bias / std err")
    return indented(table(headings, [(r.name, r.before, r.after, r.std, r.unit, r.change) for r in shifts[:rows]]))
