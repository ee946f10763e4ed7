"""Every output of a comparison: `compare.json` (SI), the page, the figure, and a terminal.

The files are bytes and text in memory: whole before the first one is written.
"""

from importlib.metadata import version
from typing import Any

from rich.console import Console
from rich.text import Text

from thermohyd.identify.bench.provenance import record_json, record_rows
from thermohyd.identify.bench.shown_units import beside
from thermohyd.identify.report.fit_json import fields_of, json_text, plain
from thermohyd.identify.report.next_steps import Step, command, path_of
from thermohyd.identify.report.origin import origin
from thermohyd.identify.report.page import page
from thermohyd.identify.report.style import drawn
from thermohyd.identify.report.terminal import heading, indented, table

from .figures import comparison_figures
from .result import ComparisonResult, Difference, SharedEntry, Side
from .shown_curves import comparison_views


SCHEMA = "thermohyd-compare/1"
METHOD = "single-step max-T over all rows"
STATES = {"differs": "YES", "same": "no", "cannot tell": "cannot tell"}
SMALLEST_P = 1e-6
ROW = (
    "kind", "unit", "state", "difference", "std", "ci95", "std_apart", "p_value", "score", "least", "alone", "alone_std",
    "alternatives", "why",
)  # fmt: skip


def comparison_json(result: ComparisonResult) -> dict[str, Any]:
    """The content of `compare.json`; what is not finite becomes null."""
    content = {
        "schema": SCHEMA,
        "units": "SI: m, Pa (gauge), K, m3/s; differences are the second record minus the first",
        "records": [
            {
                "name": name,
                **record_json(record),
                "verdict": diagnosis.verdict,
                "headline": diagnosis.headline,
                "effects": [effect.name for effect in diagnosis.effects],
                "reduced_chi2": chi2,
            }
            for name, record, diagnosis, chi2 in zip(
                result.names, result.records, result.diagnoses, result.reduced_chi2, strict=True
            )
        ],
        **fields_of(result, "verdict", "headline", "sentences"),
        "differences": {row.name: _row(row) for row in result.rows},
        "shared": {
            entry.name: fields_of(entry, "value", "unit", "std", "prior_std", "p_value") for entry in result.shared
        },
        "effects": result.effects,
        "multiplicity": {"method": METHOD, **fields_of(result, "level", "critical")},
        "others_equal_p": result.same_p,
        "one_of": [
            {
                "names": e.names,
                "p_value": e.p_value,
                "differences": {name: {"difference": value, "std": std} for name, (value, std) in e.values.items()},
            }
            for e in result.one_of
        ],
        "std_over_separate_fits": result.gain,
        **fields_of(result, "same_bench", "converged", "message", "seconds", "notes", "warnings"),
    }
    return plain(content)


def _row(row: Difference) -> dict[str, Any]:
    side = lambda own: None if own is None else fields_of(own, "value", "std", "at_bound")
    return {
        "first": side(row.first),
        "second": side(row.second),
        **fields_of(row, *ROW),
        "degrees_of_freedom": row.freedom,
    }


COLUMNS = (
    "parameter, effect", "differs", "unit", ">{a}", ">{b}", ">difference", ">+/-", ">p", ">95 % interval", ">+/-, two fits",
)  # fmt: skip
IN_A_TERMINAL = 8  # of these columns
LONGEST_NAME = 16  # of a record, above its column


def columns(result: ComparisonResult) -> list[str]:
    a, b = (name if len(name) <= LONGEST_NAME else f"...{name[3 - LONGEST_NAME :]}" for name in result.names)
    return [heading.format(a=a, b=b) for heading in COLUMNS]


def rows(result: ComparisonResult) -> list[tuple[str, ...]]:
    """The table of differences as text in bench units."""
    return [_words(row) for row in result.rows]


def _words(row: Difference) -> tuple[str, ...]:
    unit = row.shown
    head = (row.name, STATES[row.state], unit.label, _side(row.first, unit.factor), _side(row.second, unit.factor))
    if row.difference is None or row.std is None or row.ci95 is None:
        return (*head, *[""] * (len(COLUMNS) - len(head)))
    std = row.std * unit.factor
    number = lambda value: beside(value * unit.factor, std)
    apart = "" if row.std_apart is None else beside(row.std_apart * unit.factor, row.std_apart * unit.factor)
    p = row.p_value if row.p_value is not None else 1.0
    rare = f"<{SMALLEST_P:g}" if p < SMALLEST_P else f"{p:.2g}"
    interval = f"{number(row.ci95[0])} to {number(row.ci95[1])}"
    return (*head, number(row.difference), beside(std, std), rare, interval, apart)


def _side(side: Side | None, factor: float) -> str:
    if side is None:
        return "-"
    std = None if side.std is None else side.std * factor
    return f"{beside(side.value * factor, std)}{' (limit)' if side.at_bound else ''}"


SHARED = ("~shared", "unit", ">value", ">error", ">data sheet", ">p if one", "~what it is")


def shared_rows(result: ComparisonResult) -> list[tuple[str, ...]]:
    """What of the bench is one in both records, as text in bench units."""
    return [_shared(entry) for entry in result.shared]


def _shared(entry: SharedEntry) -> tuple[str, ...]:
    unit = entry.shown
    std = None if entry.std is None else entry.std * unit.factor
    prior = "" if entry.prior_std is None else beside(entry.prior_std * unit.factor, entry.prior_std * unit.factor)
    value = beside(entry.value * unit.factor, std)
    return (
        entry.name,
        unit.label,
        value,
        "" if std is None else beside(std, std),
        prior,
        f"{entry.p_value:.2g}",
        entry.meaning,
    )


def diagnosis_rows(result: ComparisonResult) -> list[tuple[str, str]]:
    """What each record's diagnosis says."""
    return [(name, d.headline) for name, d in zip(result.names, result.diagnoses, strict=True)]


def how(result: ComparisonResult) -> str:
    """How a difference is judged, in a sentence."""
    tighter = (
        "" if not result.gain < 0.995 else f" Errors are {result.gain:.2g} times those of two separate fits (median)."
    )
    return (
        f"A difference must reach {result.critical:.2f} of its own errors: with nothing different one in "
        f"{1.0 / result.level:.0f} comparisons would call anything so ({METHOD}).{tighter}"
    )


def next_steps(result: ComparisonResult) -> list[Step]:
    """What the differences ask for."""
    paths = [path_of(record) for record in result.records]
    if not result.converged:
        return [Step(f"Diagnose {name} by itself: its own report says what its model misses.", command("diagnose", path))
                for name, path in zip(result.names, paths, strict=True)]  # fmt: skip
    steps = []
    instruments = [row.name for row in result.differing if row.kind == "instrument"]
    if instruments:
        steps.append(
            Step(f"Calibrate first what reads {', '.join(instruments)}: an instrument differs, and the valve may not.")
        )
    doubtful = [row.name for row in result.differing if row.alternatives]
    if doubtful or (result.verdict == "different" and not result.differing):
        what = f"for {', '.join(doubtful)}" if doubtful else "which of them it is"
        words = f"The data leave more than one explanation {what}: the plan of a further test says what would decide."
        steps.append(Step(words, command("plan", paths[1])))
    for name, path, diagnosis in zip(result.names, paths, result.diagnoses, strict=True):
        if diagnosis.verdict == "unexplained":
            steps.append(
                Step(
                    f"Resolve the misfit of {name} first: differences may be its consequence.",
                    command("diagnose", path),
                )
            )
    blind = [row.name for row in result.rows if row.state == "cannot tell"]
    if blind and result.verdict != "different":
        words = f"Nothing can be said of {', '.join(blind)}: a plan says which further test would show a change there."
        steps.append(Step(words, command("plan", paths[1])))
    if not steps:
        found = ", ".join(row.name for row in result.differing)
        steps.append(Step(f"Ask what was done to the valve, or what it went through, between the records: {found}." if found else
                          "Nothing has to be done: go on with either model, or both records in one."))  # fmt: skip
    return steps


def comparison_page(result: ComparisonResult, figures: dict[str, bytes]) -> str:
    """`report.html`: one page without network access."""
    return page(
        "compare.html",
        figures,
        views=comparison_views(result),
        origin=origin("compare", result.records),
        next_steps=next_steps(result),
        names=result.names,
        headline=result.headline,
        sentences=result.sentences,
        alarm=result.verdict == "different" or not result.converged,
        columns=columns(result),
        rows=rows(result),
        how=how(result),
        shared_columns=list(SHARED),
        shared=shared_rows(result),
        diagnoses=diagnosis_rows(result),
        records=[(name, record_rows(record)) for name, record in zip(result.names, result.records, strict=True)],
        notes=result.notes,
        warnings=result.warnings,
        version=version("thermohyd"),
    )


def comparison_files(result: ComparisonResult) -> dict[str, bytes | str]:
    """{file name: content}: compare.json, report.html, and a PNG and an SVG per figure."""
    vectors, files = drawn(comparison_figures(result))
    files["compare.json"] = json_text(comparison_json(result))
    files["report.html"] = comparison_page(result, vectors)
    return files


def print_comparison(result: ComparisonResult, console: Console) -> None:
    """The headline, the table, then the sentences."""
    style = "bold red" if not result.converged else "bold yellow" if result.differing else "bold green"
    console.print(Text(result.headline, style=style))
    console.print(heading("Differences"))
    shown = []
    for cells in rows(result):
        style = "bold yellow" if cells[1] == STATES["differs"] else ""
        shown.append([Text(cell, style=style) for cell in cells[:IN_A_TERMINAL]])
    console.print(indented(table(columns(result)[:IN_A_TERMINAL], shown)))
    console.print(Text(how(result)))
    if result.shared:
        console.print(heading("One in both records"))
        console.print(indented(table(SHARED, shared_rows(result))))
    console.print()
    for sentence in result.sentences:
        console.print(Text(sentence))
    console.print(heading("Each record alone"))
    for name, words in diagnosis_rows(result):
        console.print(Text(f"  {name}: {words}"))
    for words in (*result.notes, *result.warnings):
        console.print(Text(words, style="yellow"))
