"""Every output of a plan: `plan.json` (SI), the page, the figures, and a terminal.

The files are bytes and text in memory: whole before the first one is written.
"""

from importlib.metadata import version
from typing import Any

from rich.console import Console
from rich.text import Text

from thermohyd.identify.bench.provenance import record_json, record_rows
from thermohyd.identify.bench.shown_units import beside, significant
from thermohyd.identify.report.fit_json import fields_of, json_text, plain, rounded
from thermohyd.identify.report.origin import origin
from thermohyd.identify.report.page import page
from thermohyd.identify.report.style import drawn
from thermohyd.identify.report.terminal import heading, indented, table

from . import words
from .figures import plan_figures
from .result import PlannedEffect, PlanResult


SCHEMA = "thermohyd-plan/1"
EFFECT = ("unit", "least", "usual", "seen", "alone", "confused", "kept", "strength", "why")


def plan_json(result: PlanResult) -> dict[str, Any]:
    """The content of `plan.json`; what is not finite becomes null."""
    content = {
        "schema": SCHEMA,
        "units": "SI: m, Pa (gauge), K, m3/s; amounts of effects in their own SI unit",
        **record_json(result.record),
        **fields_of(result, "headline", "sentences"),
        "effects": {effect.name: fields_of(effect, *EFFECT) for effect in result.effects},
        "parameters": {p.name: fields_of(p, "value", "unit", "std", "why") for p in result.parameters},
        "confusion": rounded(plain({"effects": result.order, "cosine": result.correlation})),
        "groups": result.groups,
        "added_runs": [
            fields_of(run, "words", "rows", "seconds", "shows", "separates", "per_hour") for run in result.added
        ],
        "readings": [fields_of(r, "test", "channel", "rows", "noise", "source") for r in result.readings],
        "detection": {
            "method": "single-step max-T over the library",
            **fields_of(result, "level", "critical", "power"),
        },
        **fields_of(result, "reading_seconds", "seconds", "notes"),
    }
    return plain(content)


COLUMNS = ("effect", "", ">found from", ">usual", "unit", ">told from all", "~may be taken for")
LISTED = 3  # names in a cell


def effect_rows(result: PlanResult, listed: int = LISTED) -> list[tuple[str, ...]]:
    """The table of effects as text in bench units; what cannot be seen at all is left to the sentences."""
    return [_effect(effect, listed) for effect in result.effects if effect.least is not None]


def _effect(effect: PlannedEffect, listed: int) -> tuple[str, ...]:
    unit = effect.shown
    number = lambda value: significant(value * unit.factor, 2)
    usual = f"{number(effect.usual[0])} to {number(effect.usual[1])}"
    alone = "never" if effect.alone is None else number(effect.alone)
    more = len(effect.confused) - listed
    names = ", ".join(effect.confused[:listed]) + (f" and {more} more" if more > 0 else "")
    assert effect.least is not None
    return (effect.name, words.state(effect), number(effect.least), usual, unit.label, alone, names)


PARAMETERS = ("parameter", "unit", ">expected", ">error")


def parameter_rows(result: PlanResult) -> list[tuple[str, ...]]:
    """What the tests will tell of the parameters, in bench units."""
    rows = []
    for p in result.parameters:
        unit = p.shown
        std = None if p.std is None else p.std * unit.factor
        rows.append(
            (p.name, unit.label, beside(p.value * unit.factor, std), p.why if std is None else beside(std, std))
        )
    return rows


ADDED = ("~added run", ">takes", "~shows", "~tells apart", ">gains per hour")


def added_rows(result: PlanResult) -> list[tuple[str, ...]]:
    """What may be added, the best first."""
    rows = []
    for run in result.added:
        apart = [f"{a} / {b}" for a, b in run.separates]
        shown = lambda names: (
            ", ".join(names[:LISTED]) + (f" and {len(names) - LISTED} more" if len(names) > LISTED else "")
        )
        rows.append((run.words, words.cost(run), shown(run.shows), shown(apart), f"{run.per_hour:.1f}"))
    return rows


def reading_rows(result: PlanResult) -> list[tuple[str, ...]]:
    rows = []
    for r in result.readings:
        unit = result.record.unit_of(r.test, r.channel)
        name = f"{r.test.replace('_', ' ')}: {r.channel}"
        rows.append((name, f"{r.rows:,}", f"{significant(r.noise * unit.factor, 2)} {unit.label}", r.source))
    return rows


READINGS = ("reading", ">rows", ">noise", "~source")


def how(result: PlanResult) -> str:
    """What "found" means, in a sentence."""
    return (
        f"Found: an effect of this amount scores {result.critical:.2f} or more in {100.0 * result.power:.0f} % of records, which one in "
        f"{1.0 / result.level:.0f} with nothing wrong would do in any effect (single-step max-T over the library). Told from all: no other "
        "effect comes within a likelihood ratio of 20, as often."
    )


def plan_page(result: PlanResult, figures: dict[str, bytes]) -> str:
    """`report.html`: one page without network access."""
    return page(
        "plan.html",
        figures,
        origin=origin("plan", [result.record]),
        name=result.record.name,
        headline=result.headline,
        sentences=result.sentences,
        notes=result.notes,
        how=how(result),
        columns=list(COLUMNS),
        effects=effect_rows(result, listed=len(result.effects)),
        parameter_columns=list(PARAMETERS),
        parameters=parameter_rows(result),
        added_columns=list(ADDED),
        added=added_rows(result),
        reading_columns=list(READINGS),
        readings=reading_rows(result),
        record_rows=record_rows(result.record),
        version=version("thermohyd"),
    )


def plan_files(result: PlanResult) -> dict[str, bytes | str]:
    """{file name: content}: plan.json, report.html, and a PNG and an SVG per figure."""
    vectors, files = drawn(plan_figures(result))
    files["plan.json"] = json_text(plan_json(result))
    files["report.html"] = plan_page(result, vectors)
    return files


def print_plan(result: PlanResult, console: Console) -> None:
    """The headline, the tables, then the sentences."""
    console.print(Text(result.headline, style="bold"))
    console.print(heading("Effects"))
    styles = {"seen": "", "only if large": "yellow"}
    shown = [[Text(cell, style=styles.get(cells[1], "")) for cell in cells] for cells in effect_rows(result)]
    console.print(indented(table(COLUMNS, shown)))
    console.print(Text(how(result)))
    console.print(heading("Parameters"))
    console.print(indented(table(PARAMETERS, parameter_rows(result))))
    if result.added:
        console.print(heading("Runs to add"))
        console.print(indented(table(ADDED, added_rows(result))))
    console.print(heading("Noise"))
    console.print(indented(table(READINGS, reading_rows(result))))
    console.print()
    for sentence in result.sentences:
        console.print(Text(sentence))
    for note in result.notes:
        console.print(Text(note, style="yellow"))
