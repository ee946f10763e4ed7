"""A fit's or a diagnosis's JSON as one row of the store. SI units, as in the JSON."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.fitting.result import DISAGREES

from .identity import Found, Settings


UNKNOWN_TYPE = "unknown"
FAULT_KEYS = ("name", "test", "channel", "value", "std", "unit", "sentence")
TERM_KEYS = ("place", "variable", "law", "value", "std", "unit", "sentence")


def row_of(
    found: Found,
    settings: Settings,
    record: BenchRecord,
    content: Mapping[str, Any],
    seconds: float,
    report: str | None = None,
) -> dict[str, Any]:
    """content: `to_dict()` of a FitResult or of a DiagnosisResult; empty where the record was read only.

    Without a type a valve is of the type "unknown"; without a serial number its name stands in, which is the folder's where bench.toml
    has none.
    """
    service = record.service
    fit = content.get("fit", content)
    return {
        "identity": found.identity(settings),
        "content": found.content,
        "job": settings.job,
        "settings": settings.text,
        "version": settings.version,
        "path": found.folder,
        "type": service.type or UNKNOWN_TYPE,
        "serial": service.serial or record.name,
        "port": service.port,
        "order_number": service.order,
        "date": day_of(service.date),
        "operating_hours": service.operating_hours,
        "iso_4406": service.iso_4406,
        **_ranges(record),
        "verdict": _verdict(content),
        "converged": content.get("converged"),
        "gap_before": content.get("gap_before", fit.get("reduced_chi2")),
        "gap_after": content.get("gap_after", fit.get("reduced_chi2")),
        "parameters": [_estimate(name, p) for name, p in fit.get("parameters", {}).items()],
        "effects": [_effect(effect) for effect in content.get("effects", ())],
        "held_out": (content.get("held_out") or {}).get("gap_closed"),
        "faults": [{key: fault.get(key) for key in FAULT_KEYS} for fault in content.get("faults", ())],
        "terms": [{key: term.get(key) for key in TERM_KEYS} for term in content.get("terms", ())],
        "sentences": list(content.get("sentences", fit.get("verdict", ()))),
        "warnings": list(content.get("warnings", record.warnings)),
        "rows": sum(test.rows for test in record.tests.values()),
        "report": report,
        "seconds": seconds,
        "written": now(),
    }


def failure_of(found: Found, settings: Settings, kind: str, reason: str, strikes: int = 1) -> dict[str, Any]:
    """Why a record has no result."""
    return {
        "identity": found.identity(settings),
        "content": found.content,
        "job": settings.job,
        "version": settings.version,
        "path": found.folder,
        "kind": kind,
        "reason": reason,
        "strikes": strikes,
        "written": now(),
    }


def now() -> datetime:
    return datetime.now(UTC).replace(tzinfo=None)


def day_of(text: str | None) -> datetime | None:
    """The date of a record, in UTC where it names its zone, else as it stands."""
    if text is None:
        return None
    found = datetime.fromisoformat(text)
    return found if found.tzinfo is None else found.astimezone(UTC).replace(tzinfo=None)


def _verdict(content: Mapping[str, Any]) -> str:
    """A diagnosis's own word; of a fit whether the ideal valve is enough."""
    if not content:
        return "read"
    if isinstance(content["verdict"], str):
        return content["verdict"]
    return "misfit" if content["judged"] and (content["reduced_chi2"] or 0.0) > DISAGREES else "fitted"


def _estimate(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    low, high = given.get("ci95") or (None, None)
    known = {key: given.get(key) for key in ("value", "std", "unit")}
    return {"name": name, **known, "low": low, "high": high, **{k: given.get(k) for k in ("at_bound", "fixed")}}


def _effect(given: Mapping[str, Any]) -> dict[str, Any]:
    amount = {k: v for k, v in _estimate(given["name"], given["parameter"]).items() if k not in ("at_bound", "fixed")}
    return {**amount, **{key: given.get(key) for key in ("p_value", "gap_closed", "alternatives")}}


def _ranges(record: BenchRecord) -> dict[str, float]:
    found = {}
    for column, name in (("temperature", "oil_temperature"), ("supply_pressure", "supply_pressure")):
        values = [getattr(test, column) for test in record.tests.values()]
        if values:
            found[f"{name}_low"] = float(min(v.min() for v in values))
            found[f"{name}_high"] = float(max(v.max() for v in values))
    return found
