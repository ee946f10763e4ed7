"""A store as a folder of static pages that works from a disk: all valves, worst first; a valve's life; a type's distribution.

One page, one script, and the data in script files, since a page from a disk may load scripts and nothing else. The table's data come
with the page; the lives of a hundred valves at a time, when one of them is looked at.
"""

import json
import os
from collections import defaultdict
from collections.abc import Callable, Mapping
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from thermohyd.identify.bench.shown_units import display_unit
from thermohyd.identify.report.files import Writer, write_all

from .life import AXES, FleetLife, Trend, Valve, fleet_life
from .query import query
from .remaining import Limit
from .rows import now
from .store import Store


TOGETHER = 100  # valves of a file of lives
BINS = 20
RATED = {"hours": ("1000 h", 1000.0), "date": ("year", 1.0)}  # per how much a rate is shown
SPARK = 24  # points of a sparkline


def fleet_page(
    store: Store,
    folder: Path,
    limits: Mapping[str, Mapping[str, Limit]] | None = None,
    progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """Write the pages of a store, all of them or none; index.html is the one to open. Raises OSError, and as `fleet_life`."""
    say = progress or (lambda words: None)
    life = fleet_life(store, limits, progress)
    say("writing the pages")
    return write_all(
        folder, page_files(life, _records(store, folder), store.failures()), Writer("fleet report", str(store.folder))
    )


def page_files(
    life: FleetLife, records: Mapping[tuple[str, str], list[dict[str, Any]]], failures: list[dict[str, Any]]
) -> dict[str, bytes | str]:
    """{name: content} of all files. records: {(type, serial): its records, the last first}."""
    out: dict[str, bytes | str] = {}
    for number, first in enumerate(range(0, len(life.valves), TOGETHER)):
        lives = {
            str(i): _life(life.valves[i], records.get((life.valves[i].type, life.valves[i].serial), []))
            for i in range(first, min(first + TOGETHER, len(life.valves)))
        }
        out[f"data/lives-{number}.js"] = f"fleet.lives({number}, {_json(lives)});\n"
    head = {
        "valves": [_row(valve) for valve in life.valves],
        "types": _types(life),
        "failures": [{key: row[key] for key in ("path", "kind", "reason", "strikes")} for row in failures],
        "together": TOGETHER,
        "undated": life.undated,
        "made": f"{now():%Y-%m-%d %H:%M} UTC, thermohyd {version('thermohyd')}",
    }
    out["data/valves.js"] = f"var fleet = {_json(head)};\n"
    templates = files("thermohyd.identify").joinpath("templates")
    for name in ("fleet.html", "fleet.js", "fleet.css"):
        out["index.html" if name == "fleet.html" else name] = templates.joinpath(name).read_text(encoding="utf-8")
    return out


def _json(content: Any) -> str:
    return json.dumps(content, separators=(",", ":"), allow_nan=False)


def _row(valve: Valve) -> list[Any]:
    """One line of the table: what `fleet.js` calls columns."""
    leading = _leading(valve)
    spark = [] if leading is None else [float(f"{value:.4g}") for _, value, _ in leading.points[-SPARK:]]
    nearest = min((r for r in valve.remaining if r.low is not None), key=lambda r: r.low or 0.0, default=None)
    left = (
        None if nearest is None else [_digits(nearest.low), _digits(nearest.high), AXES[valve.axis], nearest.quantity]
    )
    return [
        valve.grade, valve.type, valve.serial, valve.records, valve.last_date or "", _digits(valve.last_hours), valve.verdict,
        spark, "" if leading is None else leading.quantity, left, "; ".join(valve.reasons),
    ]  # fmt: skip


def _leading(valve: Valve) -> Trend | None:
    """The quantity whose course says most: one with a limit, else the one that moves most beside its error."""
    limited = {one.quantity for one in valve.remaining}
    moved = lambda trend: (trend.quantity in limited, abs(trend.rate) / max(trend.rate_std, 1e-300))
    return max(valve.trends, key=moved, default=None)


def _life(valve: Valve, records: list[dict[str, Any]]) -> dict[str, Any]:
    """A valve's page: each quantity in its bench unit."""
    trends = []
    rated, per = RATED[valve.axis]
    for trend in valve.trends:
        unit = display_unit(trend.unit)
        scaled = lambda rows, f=unit.factor: [[_digits(t), _digits(y * f), _digits(s * f)] for t, y, s in rows]
        ends = [_digits(one.limit * unit.factor) for one in valve.remaining if one.quantity == trend.quantity]
        trends.append(
            {
                "name": trend.quantity, "unit": _label(unit.label), "points": scaled(trend.points),
                "line": scaled(trend.line), "limits": ends,
                "rate": [_digits(x * unit.factor * per) for x in (trend.rate, trend.rate_std, trend.type_rate, trend.type_rate_std)],
            }
        )  # fmt: skip
    overhauls = [
        {"after": _digits(o.after), "before": _digits(o.before), "names": o.quantities, "sure": o.confirmed}
        for o in valve.overhauls
    ]
    left = [
        {"name": r.quantity, "limit": r.limit * display_unit(r.unit).factor, "unit": _label(display_unit(r.unit).label),
         "times": [_digits(r.low), _digits(r.middle), _digits(r.high)]} for r in valve.remaining
    ]  # fmt: skip
    return {
        "axis": valve.axis,
        "per": AXES[valve.axis],
        "rated": rated,
        "trends": trends,
        "overhauls": overhauls,
        "left": left,
        "records": records,
    }


def _label(unit: str) -> str:
    return "" if unit in ("-", "1") else unit


def _digits(value: float | None, digits: int = 5) -> float | None:
    return None if value is None else float(f"{value:.{digits}g}")


def _types(life: FleetLife) -> dict[str, Any]:
    """{type: how many valves, and how levels and rates of each quantity are spread}"""
    of_type: dict[str, list[Valve]] = defaultdict(list)
    for valve in life.valves:
        of_type[valve.type].append(valve)
    return {type_: _type(valves) for type_, valves in sorted(of_type.items())}


def _type(valves: list[Valve]) -> dict[str, Any]:
    trends: dict[str, list[Trend]] = defaultdict(list)
    for valve in valves:
        for trend in valve.trends:
            trends[trend.quantity].append(trend)
    spread = []
    rated, per = RATED[valves[0].axis]
    for name, found in sorted(trends.items()):
        unit = display_unit(found[0].unit)
        rate = [found[0].type_rate * unit.factor * per, found[0].type_rate_std * unit.factor * per]
        both = {
            "level": _bins([t.level * unit.factor for t in found]),
            "rate": _bins([t.rate * unit.factor * per for t in found]),
        }
        spread.append({"name": name, "unit": _label(unit.label), "type_rate": [_digits(x) for x in rate], **both})
    verdicts = pd.Series([valve.verdict for valve in valves]).value_counts()
    return {
        "valves": len(valves),
        "rated": rated,
        "verdicts": {str(k): int(v) for k, v in verdicts.items()},
        "spread": spread,
    }


def _bins(values: list[float]) -> dict[str, Any]:
    """A histogram over the middle 98 %: one valve far out must not hide the others; what lies outside stands in the end bins."""
    array = np.array(values)
    low, high = np.quantile(array, [0.01, 0.99])
    if not high > low:
        low, high = low - 0.5 * (abs(low) or 1.0), low + 0.5 * (abs(low) or 1.0)
    counts, _ = np.histogram(np.clip(array, low, high), BINS, (low, high))
    return {"low": _digits(float(low)), "high": _digits(float(high)), "counts": counts.tolist()}


def _records(store: Store, folder: Path) -> dict[tuple[str, str], list[dict[str, Any]]]:
    """What a valve's page lists of each record, the last first; a link where it has a report of its own."""
    table = query(
        store,
        """SELECT type, serial, date, operating_hours, verdict, path, report, gap_after,
        [e.name FOR e IN effects] AS effects, [f.name FOR f IN faults] AS faults
        FROM records ORDER BY date DESC NULLS LAST, operating_hours DESC, identity""",
    )
    found: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in table.to_dict("records"):
        page = None if pd.isna(row["report"]) else store.folder / row["report"] / "report.html"
        listed = lambda value: [] if value is None or isinstance(value, float) else [str(one) for one in value]
        found[row["type"], row["serial"]].append(
            {
                "date": "" if pd.isna(row["date"]) else row["date"].date().isoformat(),
                "hours": None if pd.isna(row["operating_hours"]) else _digits(row["operating_hours"]),
                "verdict": row["verdict"],
                "gap": None if pd.isna(row["gap_after"]) else _digits(row["gap_after"], 3),
                "found": [*listed(row["effects"]), *listed(row["faults"])],
                "path": row["path"],
                "report": None if page is None else _link(page, folder),
            }
        )
    return found


def _link(page: Path, folder: Path) -> str:
    from urllib.parse import quote

    return quote(Path(os.path.relpath(page.resolve(), folder.resolve())).as_posix())
