"""What a result was made from: files with hashes, date, program version, valve, oil, conditions; in words and for JSON."""

import hashlib
from collections.abc import Iterable
from dataclasses import asdict
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from .columns import SIZES, column_unit
from .record import BenchRecord, Provenance, RecordFile
from .shown_units import significant
from .test_record import TestRecord


# {condition: words before}
_CONDITIONS = {
    "temperature": "",
    "supply_pressure": "supply ",
    "return_pressure": "return ",
    "load_pressure": "load ",
    "spool_position": "spool ",
    "frequency": "",
}


def provenance_of(folder: Path, description: Path, tests: Iterable[TestRecord]) -> Provenance:
    """Of a record that is being read: its description (bench.toml) and the files of its tests. Raises OSError."""
    files = [RecordFile(_name(description, folder), _hash(description), None, None)]
    for test in tests:
        used = test.rows if test.channels else 0
        files.append(RecordFile(_name(test.path, folder), _hash(test.path), test.rows, used))
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    return Provenance(str(folder.resolve()), tuple(files), now, version("thermohyd"))


def _name(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else str(path)


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def record_json(record: BenchRecord) -> dict[str, Any]:
    """record, oil, geometry and conditions (the range of each, per test), SI. The actuator where there are dynamic tests."""
    made = record.provenance
    content = {
        "record": {
            "name": record.name,
            "path": str(record.folder) if made is None else made.path,
            "files": [] if made is None else [asdict(file) for file in made.files],
            "date": None if made is None else made.date,
            "version": version("thermohyd") if made is None else made.version,
            **({"service": said} if (said := record.service.to_dict()) else {}),
        },
        "oil": asdict(record.oil),
        "geometry": asdict(record.valve),
        "conditions": {name: _ranges(test) for name, test in record.tests.items()},
    }
    if record.actuator is not None:
        content["actuator"] = record.actuator.to_dict()
        loop = record.sensors.get("piston_position")
        if loop is not None and loop.in_loop and loop.gain is None:
            content["actuator"]["sensor_gain"] = None  # what stands in for it says nothing
    return content


def _ranges(test: TestRecord) -> dict[str, list[float]]:
    """{condition: [least, greatest]} of a test, SI; the position of a dynamic test is no condition."""
    columns = [name for name in _CONDITIONS if name != "spool_position" or test.place is test.spool_position]
    values = {name: getattr(test, name, None) for name in columns}
    return {name: [float(np.min(v)), float(np.max(v))] for name, v in values.items() if v is not None and np.size(v)}


def record_line(record: BenchRecord) -> str:
    """The same in one line for a terminal."""
    made = record.provenance
    parts = [f"record {record.folder if made is None else made.path}"]
    if made is not None:
        rows = sum(file.rows or 0 for file in made.files)
        parts[0] += f", {len(made.files)} files, {rows:,} rows, read {made.date[:16].replace('T', ' ')}"
    where = _shown(_of_all(record), ("temperature", "supply_pressure"))
    parts += [", ".join(part for part in (record.oil.name, where) if part)]
    parts += [f"thermohyd {version('thermohyd') if made is None else made.version}"]
    return "; ".join(part for part in parts if part)


def record_rows(record: BenchRecord) -> list[tuple[str, str]]:
    """(label, words): a block of a report."""
    made = record.provenance
    rows = [("record", str(record.folder) if made is None else made.path)]
    if made is not None:
        rows.append(("read", f"{made.date.replace('T', ' ')} by thermohyd {made.version}"))
    rows += [("valve", _geometry(record)), ("oil", _oil(record))]
    for name, test in record.tests.items():
        rows.append((name.replace("_", " "), f"{test.rows:,} rows: {_shown(_ranges(test), _CONDITIONS)}"))
    return rows


def file_rows(record: BenchRecord) -> list[tuple[str, str, str, str]]:
    """(name, rows, rows used, SHA-256) of each file."""
    files = () if record.provenance is None else record.provenance.files
    number = lambda count: "" if count is None else f"{count:,}"
    return [(file.name, number(file.rows), number(file.used), file.sha256) for file in files]


def _geometry(record: BenchRecord) -> str:
    valve = record.valve
    found = {key: getattr(valve, key) for key in SIZES}
    parts = [
        f"{'at' if key == 'rated_pressure_drop' else key.replace('_', ' ')} {column_unit(key).words(value, 5)}"
        for key, value in found.items()
        if value is not None and (key != "stroke" or valve.stroke_stated)
    ]
    parts += [] if valve.stroke_stated else ["no stroke stated"]
    parts += [] if valve.slot_width_stated else ["slot width by the rated flow"]
    return f"{valve.name}: {', '.join(parts)}"


def _oil(record: BenchRecord) -> str:
    oil = record.oil
    viscosity = [
        f"{significant(10.0 ** (10.0 ** (oil.viscosity_a - oil.viscosity_b * np.log10(c + 273.15))) - 0.7, 3)} cSt at {c} degC"
        for c in (40, 100)
    ]
    words = f"{', '.join(viscosity)}, {oil.density:.0f} kg/m3 at 15 degC"
    return f"{oil.name}: {words}" if oil.name else words


def _of_all(record: BenchRecord) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    for test in record.tests.values():
        for name, (low, high) in _ranges(test).items():
            known = found.get(name, [low, high])
            found[name] = [min(known[0], low), max(known[1], high)]
    return found


def _shown(ranges: dict[str, list[float]], names: Iterable[str]) -> str:
    parts = []
    for name in names:
        if name in ranges:
            unit = column_unit(name)
            low, high = (f"{unit.of(value):.4g}" for value in ranges[name])
            shown = low if low == high else f"{low} to {high}"
            parts.append(f"{_CONDITIONS[name]}{shown} {unit.label}".replace("-0 ", "0 "))
    return ", ".join(parts)
