"""A comparison as curves to look into: every difference with its interval, and both benches beside their own models."""

from dataclasses import replace

from thermohyd.identify.report.channel_curves import fit_views
from thermohyd.identify.report.curves import Axis, Condition, Draw, Layer, Series, View

from .result import ComparisonResult, Difference
from .words import with_unit


STATES = {"differs": 1, "same": 0, "cannot tell": 6}  # and their colours
FAR = 12.0


def comparison_views(result: ComparisonResult) -> dict[str, list[View]]:
    """{place on the page: views}"""
    return {"differences": _differences(result), "tests": _tests(result)}


def _differences(result: ComparisonResult) -> list[View]:
    """In errors of two separate fits, as the picture."""
    shown = [row for row in result.rows if row.std is not None and row.difference is not None and row.ci95 is not None]
    if not shown:
        return []
    states = list(STATES)
    layers = [Layer("95 %, two separate fits", "interval", colour=6, wide=True, faint=True)]
    for state in states:
        layers += [
            Layer(f"{_called(state)}, 95 %", "interval", colour=STATES[state]),
            Layer(_called(state), "points", colour=STATES[state]),
        ]
    series = []
    for place, row in enumerate(shown):
        size = row.std_apart or row.std or 1.0
        middle, low, high = ((value or 0.0) / size for value in (row.difference, *(row.ci95 or (0.0, 0.0))))
        layer, said = 1 + 2 * states.index(row.state), [_words(row)]
        series += [
            Series((), [middle - 1.96], (Draw(0, [place], x2=[middle + 1.96], words=said),)),
            Series((), [low], (Draw(layer, [place], x2=[high], words=said),)),
            Series((), [middle], (Draw(layer + 1, [place], words=said),)),
        ]
    far = max(abs(v) for one in series for v in one.x) > FAR
    x = Axis(
        f"{result.names[1]} minus {result.names[0]}, in errors of two separate fits",
        scale="symlog" if far else "linear",
        include=(0.0,),
    )
    used = {draw.layer for one in series for draw in one.draw}
    order = sorted(used)
    moved = [replace(one, draw=tuple(replace(d, layer=order.index(d.layer)) for d in one.draw)) for one in series]
    names = tuple(row.name for row in shown)
    return [
        View(
            "What differs", x, (Axis("parameter, effect", names=names),), tuple(layers[i] for i in order), tuple(moved)
        )
    ]


def _called(state: str) -> str:
    return "no difference" if state == "same" else state


def _words(row: Difference) -> str:
    return f"{with_unit(row.difference or 0.0, row.std, row.shown)} ({_called(row.state)})"


def _tests(result: ComparisonResult) -> list[View]:
    """Views of both records by the same title become one, with the record as a choice and as the colour."""
    both = [{view.title: view for view in fit_views(diagnosis.after)} for diagnosis in result.diagnoses]
    return [_merged(both[0][title], both[1][title], result.names) for title in both[0] if title in both[1]]


def _merged(first: View, second: View, names: tuple[str, str]) -> View:
    """Conditions of the two records are put side by side by their words."""
    if [c.name for c in first.conditions] != [c.name for c in second.conditions]:
        first, second = (replace(view, conditions=view.conditions[:3], series=_short(view)) for view in (first, second))
    conditions = [Condition("record", names)]
    for a, b in zip(first.conditions, second.conditions, strict=True):
        values = dict.fromkeys((*a.values, *b.values))
        measured = a.name in ("temperature", "supply")  # "-10 °C", "70 bar"
        conditions.append(
            Condition(a.name, tuple(sorted(values, key=lambda word: float(word.split()[0])) if measured else values))
        )
    series = []
    for record, view in enumerate((first, second)):
        for one in view.series:
            words = [c.values[k] for c, k in zip(view.conditions, one.at, strict=True)]
            at = [c.values.index(word) for c, word in zip(conditions[1:], words, strict=True)]
            series.append(replace(one, at=(record, *at)))
    panels = tuple(a if a.scale == "symlog" else b for a, b in zip(first.panels, second.panels, strict=True))
    note = " ".join(dict.fromkeys(filter(None, (first.note, second.note))))
    static = first.mark is not None
    return replace(
        first, panels=panels, series=tuple(series), conditions=tuple(conditions), colour=0, mark=2 if static else None,
        hollow=3 if static else None, palette="kind", note=note,
    )  # fmt: skip


def _short(view: View) -> tuple[Series, ...]:
    return tuple(replace(one, at=one.at[:3]) for one in view.series)
