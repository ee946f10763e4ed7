"""What a shop knows of a valve and of its test beside the readings: serial number, type, hours, date, port, order, clean oil.

No fit looks at it. A fleet (`identify/fleet`) tells by it which records are one valve's, and in which order.
"""

import re
from dataclasses import asdict, dataclass
from datetime import date, datetime, time
from typing import Any

from .errors import quoted
from .toml_file import TomlTable


OF_VALVE = ("serial", "type", "operating_hours")
OF_TEST = ("date", "port", "order", "iso_4406")
MOST_HOURS = 1e6
LONGEST_NAME = 60  # bytes
ISO_4406 = re.compile(r"\d{1,2}/\d{1,2}(/\d{1,2})?")


@dataclass(frozen=True)
class Service:
    """None where the record does not say. operating_hours [h]; date: ISO 8601, a day or a day with a time; iso_4406: "18/16/13"."""

    serial: str | None = None
    type: str | None = None
    operating_hours: float | None = None
    date: str | None = None
    port: str | None = None
    order: str | None = None
    iso_4406: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """What the record says, without the rest."""
        return {key: value for key, value in asdict(self).items() if value is not None}


def read_service(root: TomlTable) -> Service:
    """From [valve], [test] and the dates of [tests.NAME], of which the latest stands where [test] has none. Raises BenchInputError."""
    valve, test = root.table("valve"), root.table("test")
    said: dict[str, Any] = {}
    if valve is not None:
        said |= {"serial": _name(valve, "serial"), "type": _name(valve, "type"), "operating_hours": _hours(valve)}
    dates = _dates_of_tests(root)
    if test is not None:
        for key, value in test.data.items():
            if isinstance(value, dict):
                raise test.error(f"a test is described in [tests.{key}]; [test] says when and how it was made", key)
        test.refuse_unknown(OF_TEST)
        said |= {"port": _name(test, "port"), "order": _name(test, "order"), "iso_4406": _cleanliness(test)}
        said["date"] = read_date(test)
    said["date"] = said.get("date") or max(dates, default=None)
    return Service(**said)


def _dates_of_tests(root: TomlTable) -> list[str]:
    tests = root.table("tests")
    tables = [] if tests is None else [tests.table(name) for name in tests.data if isinstance(tests.data[name], dict)]
    found = [read_date(table) for table in tables if table is not None]
    return [day for day in found if day is not None]


def _name(table: TomlTable, key: str) -> str | None:
    """A text; a whole number counts as one, since serial numbers look like numbers. It may become the name of a folder."""
    value = table.data.get(key)
    text = (
        str(value) if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1e30 else table.text(key)
    )
    if text is not None and len(text.encode()) > LONGEST_NAME:
        raise table.error(f"{quoted(text)} is too long; at most {LONGEST_NAME} characters", key)
    return text


def _hours(table: TomlTable) -> float | None:
    value = table.data.get("operating_hours")
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= MOST_HOURS:
        raise table.error(
            f"{quoted(value)} must be a number of hours from 0 to {MOST_HOURS:,.0f}, without quotes and unit",
            "operating_hours",
        )
    return float(value)


def read_date(table: TomlTable) -> str | None:
    """The key `date`, as ISO 8601: a date of TOML, 2026-03-01, or the same in quotes, with or without a time."""
    value = table.data.get("date")
    if value is None:
        return None
    if isinstance(value, datetime | date):
        return value.isoformat()
    if isinstance(value, str) and not isinstance(value, time):
        for kind in (date, datetime):
            try:
                return kind.fromisoformat(value.strip()).isoformat()
            except ValueError:
                continue
    raise table.error(f"{quoted(value)} is not a date; write date = 2026-03-01, or 2026-03-01T14:30:00", "date")


def _cleanliness(table: TomlTable) -> str | None:
    value = table.text("iso_4406")
    if value is not None and not ISO_4406.fullmatch(value):
        raise table.error(f'{quoted(value)} is no code of ISO 4406, such as "18/16/13"', "iso_4406")
    return value
