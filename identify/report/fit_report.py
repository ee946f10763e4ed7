"""What a fit's report says, as plain words and rows of text, and its printout in a terminal: verdict first.

The terminal and the page both show exactly this; it reads the same without colour.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.panel import Panel
from rich.table import Table
from rich.text import Text
from scipy.special import chdtri, fdtri

from thermohyd.identify.bench.provenance import record_line
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.shown_units import (
    DisplayUnit,
    beside,
    decimals_for,
    significant,
)
from thermohyd.identify.fitting.result import FitResult, ParameterEstimate
from thermohyd.identify.noise.two_parts import TwoParts

from .model_form_words import model_form_rows, model_form_sentences, title
from .terminal import grid, heading, indented, table
from .uncertainty_words import (
    PREDICTIONS,
    TITLE,
    knowledge_sentences,
    print_knowledge,
    print_predictions,
    remedy_sentences,
)


CORRELATION_THRESHOLD = 0.3
MOST_CORRELATIONS = 8


@dataclass(frozen=True)
class ParameterRow:
    """One line of the parameter table, in bench units; empty where there is nothing to say."""

    name: str
    value: str
    unit: str
    std: str
    relative: str
    interval: str
    start: str
    status: str
    alarming: bool


@dataclass(frozen=True)
class TestRow:
    """One line of the table of readings, in bench units."""

    __test__ = False  # not a pytest class

    test: str
    reading: str
    unit: str
    points: str
    rms: str
    noise: str
    reduced_chi2: str
    effective: str


def model_words(record: BenchRecord) -> str:
    """Which model was fitted."""
    if not record.dynamic_tests:
        return "static servovalve model"
    return "models of the servovalve and of the actuator" if record.static_tests else "actuator's model"


def shout(result: FitResult) -> str:
    """The sentence that must not be overlooked where a fit did not converge; empty where it did."""
    if result.converged:
        return ""
    reason = f": {result.message}" if result.message else ""
    return f"THE FIT DID NOT CONVERGE{reason}. Do not use these values or their error bars."


def verdict(result: FitResult) -> list[str]:
    """The verdict's sentences, without the one that `shout` already says louder."""
    return [s for s in result.verdict if result.converged or not s.startswith("The fit did not converge")]


def chi2_band(degrees_of_freedom: float, noise_freedom: float = math.inf) -> tuple[float, float]:
    """Where the reduced chi-square of an exact model lies with 95 % probability.

    noise_freedom: degrees of freedom from which the noise itself was estimated; the law is then Fisher's F.
    """
    if not degrees_of_freedom > 0.0:
        return math.nan, math.nan
    if math.isfinite(noise_freedom):
        found = fdtri(degrees_of_freedom, noise_freedom, [0.025, 0.975])
        return float(found[0]), float(found[1])
    low, high = chdtri(degrees_of_freedom, 0.975), chdtri(degrees_of_freedom, 0.025)
    return float(low / degrees_of_freedom), float(high / degrees_of_freedom)


def statistics(result: FitResult) -> list[tuple[str, str]]:
    """(label, text) of the figures that stand for the whole fit."""
    low, high = chi2_band(result.degrees_of_freedom, result.noise_freedom)
    held = sum(estimate.fixed for estimate in result.parameters.values())
    return [
        ("rows logged", f"{result.rows:,}"),
        ("readings used", f"{result.points:,}"),
        ("parameters", f"{len(result.parameters) - held} fitted, {held} held fixed"),
        ("degrees of freedom", f"{result.degrees_of_freedom:,.0f}"),
        ("chi-square", significant(result.chi2, 5)),
        (
            "reduced chi-square",
            f"{significant(result.reduced_chi2, 3)}  (an exact model: {low:.2f} to {high:.2f} in 95 % of records)",
        ),
        ("time", f"{result.seconds:.2f} s"),
    ]


def test_rows(result: FitResult) -> list[TestRow]:
    """One row per channel of each test."""
    rows = []
    for fit in result.channels:
        unit = fit.unit
        noise = fit.noise * unit.factor
        digits = decimals_for(noise) + 1
        rows.append(
            TestRow(
                test=fit.test,
                reading=fit.channel,
                unit=unit.label,
                points=f"{len(fit.measured):,}",
                rms=f"{fit.residual_rms * unit.factor:.{digits}f}",
                noise=f"{noise:.{digits}f}",
                reduced_chi2=significant(fit.reduced_chi2, 3),
                effective=f"{fit.effective_size:,.0f}",
            )
        )
    return rows


def noise_sources(result: FitResult) -> list[str]:
    """Where each channel's noise came from, one sentence for each."""
    return [
        f"{fit.test}, {fit.channel}: {'' if fit.noise_parts is None else parts_words(fit.noise_parts, fit.unit) + ', '}"
        f"{fit.noise_source}"
        for fit in result.channels
        if fit.noise_source
    ]


def parts_words(parts: TwoParts, unit: DisplayUnit) -> str:
    """ "0.0021 l/min + 0.31 % of reading" """
    return (
        f"{significant(parts.own * unit.factor, 2)} {unit.label} + {significant(100.0 * parts.share, 2)} % of reading"
    )


def status_of(estimate: ParameterEstimate) -> str:
    """A word or two that a table can hold; the whole reason is in `parameter_remarks`."""
    if estimate.fixed:
        return "fixed"
    if estimate.at_bound:
        return "AT BOUND"
    words = ["relative"] if estimate.relative is not None else []
    words += ["prior"] if estimate.prior_std is not None else []
    if estimate.std is None:
        words.append("NO ERROR")
    return ", ".join(words)


def parameter_rows(result: FitResult) -> list[ParameterRow]:
    """One row per parameter in bench units, each to the digits that its error bar allows."""
    rows = []
    for estimate in result.parameters.values():
        unit = estimate.shown
        value, start = estimate.value * unit.factor, estimate.start * unit.factor
        std = None if estimate.std is None else estimate.std * unit.factor
        relative = "" if std is None or value == 0.0 else f"{abs(100.0 * std / value):.2g} %"
        interval = ""
        if estimate.ci95 is not None:
            low, high = (bound * unit.factor for bound in estimate.ci95)
            interval = f"{beside(low, std)} to {beside(high, std)}"
        rows.append(
            ParameterRow(
                name=estimate.name,
                value=beside(value, std),
                unit=unit.label,
                std="" if std is None else beside(std, std),
                relative=relative,
                interval=interval,
                start=f"{start:.4g}",
                status=status_of(estimate),
                alarming=not estimate.fixed and (estimate.at_bound or std is None),
            )
        )
    return rows


def parameter_remarks(result: FitResult) -> list[str]:
    """Why a fitted parameter has no error bar or stands at its bound, and what prior was put on it."""
    remarks = []
    without: dict[str, list[str]] = {}  # {reason: names}
    for estimate in result.parameters.values():
        unit = estimate.shown
        if estimate.at_bound:
            nearer_lower = abs(estimate.value - estimate.lower) <= abs(estimate.upper - estimate.value)
            side, bound = ("LOWER", estimate.lower) if nearer_lower else ("UPPER", estimate.upper)
            reason = f": {estimate.why_no_error_bar}" if estimate.why_no_error_bar else ""
            if estimate.ci95 is not None:
                low, high = (end * unit.factor for end in estimate.ci95)
                reason = f": the data allow {low:.4g} to {_with_unit(estimate.ci95[1], unit)}" if high > low else reason
            remarks.append(f"{estimate.name} is AT ITS {side} BOUND of {_with_unit(bound, unit)}{reason}")
        elif estimate.std is None and not estimate.fixed:
            without.setdefault(estimate.why_no_error_bar or "no reason is known", []).append(estimate.name)
        if estimate.prior_std is not None and not estimate.fixed and not estimate.prior_because:
            width = _with_unit(estimate.prior_std, unit)
            remarks.append(f"{estimate.name} carries a prior: {estimate.start * unit.factor:.4g} +/- {width}")
    remarks += prior_sentences(result)
    remarks += [f"no error bar for {', '.join(names)}: {reason}" for reason, names in without.items()]
    relative: dict[str, list[str]] = {}
    for estimate in result.parameters.values():
        if estimate.relative is not None:
            relative.setdefault(estimate.relative.why, []).append(estimate.name)
    remarks += [f"relative: {', '.join(names)}; {why}" for why, names in relative.items()]
    if any(estimate.by_profile for estimate in result.parameters.values()):
        remarks.append(
            "95 % intervals by profiles of chi-square: it does not rise evenly about this optimum (limits, kinks where an edge "
            "closes at a measured position), so they need not be even either; the standard error is the root mean square of both sides"
        )
    open_ = [e.name for e in result.parameters.values() if e.by_profile and e.ci95 and _ends_at_limit(e, e.ci95)]
    if open_:
        remarks.append(f"the interval of {', '.join(open_)} ends at a limit of the program's, not of the data's")
    remarks += [
        f"{estimate.name}: error bar and interval also span what it is with {', '.join(estimate.averaged_over)}"
        for estimate in result.parameters.values()
        if estimate.averaged_over
    ]
    pressed = {name for estimate in result.parameters.values() for name in estimate.conditional_on}
    if pressed:
        remarks.append(f"errors and intervals are conditional on {', '.join(sorted(pressed))} staying at the bound")
    return remarks


def prior_sentences(result: FitResult) -> list[str]:
    """What the program held near what is usual because the record does not determine it, and the line that changes that."""
    names: dict[str, list[str]] = {}  # {reason: names}
    for estimate in result.parameters.values():
        if estimate.prior_because:
            names.setdefault(estimate.prior_because, []).append(estimate.name)
    return [f"{' and '.join(own)}: {because}" for because, own in names.items()]


def _ends_at_limit(estimate: ParameterEstimate, interval: tuple[float, float]) -> bool:
    return interval[0] <= estimate.lower or interval[1] >= estimate.upper


def _with_unit(value: float, unit: DisplayUnit) -> str:
    shown = f"{value * unit.factor:.4g}"
    return shown if unit.label == "-" else f"{shown} {unit.label}"


def correlations(result: FitResult) -> list[tuple[str, str, float]]:
    """Pairs of fitted parameters whose correlation exceeds the threshold, the strongest first."""
    pairs = [
        (a, b, float(result.correlation[i, j]))
        for i, a in enumerate(result.free)
        for j, b in enumerate(result.free)
        if i < j and abs(result.correlation[i, j]) > CORRELATION_THRESHOLD
    ]
    return sorted(pairs, key=lambda pair: -abs(pair[2]))[:MOST_CORRELATIONS]


def identifiability(result: FitResult) -> list[str]:
    """How well the data tell the parameters apart, in sentences."""
    found = result.identifiability
    number = found.condition_number
    if not math.isfinite(number) or number > 1e8:
        opening = "The data leave at least one direction of the parameters undetermined."
    else:
        words = "well apart" if number < 30.0 else "apart with some trade-off" if number < 1000.0 else "barely apart"
        opening = f"The data tell the parameters {words} (condition number {number:.0f}, scaled)."
    return [opening, *found.weak_directions, *found.sentences]


def multi_start(result: FitResult) -> list[str]:
    """How many of the starts agree, what that means, and where the others went."""
    starts = [start for start in result.starts if not start.restart]
    if not starts:
        return []
    if len(result.starts) == 1:
        return [f"One start, {starts[0].steps} steps."]
    best = min((start.cost for start in result.starts if math.isfinite(start.cost)), default=math.nan)
    # a chi-square within 0.1 % (or 0.1) of the best is the same minimum: far less than one standard error of anything
    near = [start for start in starts if start.cost - best <= max(1e-3 * best, 0.1)]
    others = [start for start in starts if not start.cost - best <= max(1e-3 * best, 0.1)]
    sentences = [_agreement(len(near), len(starts))]
    for start in sorted(others, key=lambda start: start.cost)[:3]:
        how = "another minimum" if start.converged else f"not converged ({start.message})"
        sentences.append(
            f"One ended at {significant(start.cost / best, 3)} times its chi-square after {start.steps} steps: {how}."
        )
    if len(others) > 3:
        sentences.append(f"{len(others) - 3} more ended higher still.")
    return sentences


def _agreement(near: int, count: int) -> str:
    reached = f"{near} of {count} starts reached the same best fit"
    if near > 1:
        return f"{reached}: that several ways lead there speaks for it."
    if near == 1:
        return (
            f"1 of {count} starts reached the best fit, the others ended higher. That is no failure, but nothing confirms it: "
            "values of your own in [start] would."
        )
    return (
        f"None of the {count} starts ended at the best fit: a restart found it, beside the best of them or where most readings "
        "agree. "
        "Nothing else confirms it: values of your own in [start] would."
    )


VERDICT_STYLE = {"good": "bold", "open": "bold yellow", "bad": "bold red"}


def print_report(result: FitResult, console: Console) -> None:
    """Write the whole report to a console; user text is never read as markup."""
    wide = console.width >= 100
    _heading(console, f"Fit of {result.record.name}")
    console.print(Padding(Text(record_line(result.record), style="dim"), (0, 0, 0, 2)))
    alarm = shout(result)
    if alarm:
        console.print(
            Panel(Text(alarm, style="bold red"), border_style="bold red", box=box.DOUBLE, title="NOT CONVERGED")
        )
    _sentences(console, verdict(result), VERDICT_STYLE[result.standing])
    _section(console, "Warnings", result.warnings, "yellow")

    _heading(console, "Parameters")
    console.print(_parameters(result, wide))
    _sentences(console, parameter_remarks(result), "")
    _model_form(console, result, wide)
    print_known(console, result, wide)
    _correlations(console, result)
    _section(console, "Identifiability", identifiability(result))

    _heading(console, "Fit statistics")
    console.print(indented(grid(statistics(result))))
    _heading(console, "Readings")
    console.print(_tests(result, wide))
    _section(console, "Where the noise came from", noise_sources(result))
    _section(console, "Starts", multi_start(result))
    _section(console, "Notes", result.notes)
    if alarm:
        console.print(Text(f"\n{alarm}", style="bold red"))


def _heading(console: Console, words: str) -> None:
    console.print(heading(words), highlight=False)


def _sentences(console: Console, sentences: Iterable[str], style: str) -> None:
    for sentence in sentences:
        line = Table.grid(padding=(0, 1))
        line.add_row(Text("*"), Text(sentence, style=style))
        console.print(Padding(line, (0, 0, 0, 2)))


def _section(console: Console, title: str, sentences: Iterable[str], style: str = "") -> None:
    sentences = tuple(sentences)
    if sentences:
        _heading(console, title)
        _sentences(console, sentences, style)


def _parameters(result: FitResult, wide: bool) -> Padding:
    headings = ("name", ">value", "unit", ">std err", *([">rel"] if wide else []), ">95 % interval", ">start", "status")
    rows = []
    for row in parameter_rows(result):
        cells = (row.name, row.value, row.unit, row.std, *([row.relative] if wide else []), row.interval, row.start)
        rows.append((*cells, Text(row.status, style="bold red" if row.alarming else "dim")))
    return indented(table(headings, rows, gap=int(wide)))


def _model_form(console: Console, result: FitResult, wide: bool) -> None:
    asked = result.other_law
    if asked is None:
        return
    _heading(console, title(result))
    headings = (
        "name",
        f">{asked.own}",
        f">{asked.law}",
        "unit",
        ">95 % with either",
        *([">move", "status"] if wide else []),
    )
    rows = []
    for row in model_form_rows(result):
        cells = (row.name, row.own if wide else row.value, row.other, row.unit, row.interval)
        rows.append((*cells, *([row.move, Text(row.status, style="bold red")] if wide else [])))
    if rows:
        console.print(indented(table(headings, rows, gap=int(wide))))
    _sentences(console, model_form_sentences(result), "")


def print_known(console: Console, result: FitResult, wide: bool) -> None:
    """What is known of each parameter beyond its error bar, where that was asked."""
    if result.knowledge is None:
        return
    _heading(console, TITLE)
    print_knowledge(result, console, wide)
    if result.knowledge.predictions:
        console.print(Text(PREDICTIONS, style="bold"))
        print_predictions(result, console, wide)
    _sentences(console, knowledge_sentences(result), "")
    _section(console, "Which test would tell more", remedy_sentences(result))


def _tests(result: FitResult, wide: bool) -> Padding:
    headings = ("test", "reading", ">points", ">n eff", ">RMS", ">noise", "unit", ">red. chi2")
    rows = [
        (r.test, r.reading, r.points, r.effective, r.rms, r.noise, r.unit, r.reduced_chi2) for r in test_rows(result)
    ]
    return indented(table(headings, rows, gap=int(wide)))


def _correlations(console: Console, result: FitResult) -> None:
    pairs = correlations(result)
    _heading(console, f"Correlations above {CORRELATION_THRESHOLD:g}")
    if not pairs:
        _sentences(console, ("none",), "")
        return
    rows = [(a, b, Text(f"{value:+.2f}", style="bold" if abs(value) > 0.9 else "")) for a, b, value in pairs]
    console.print(indented(grid(rows)))
