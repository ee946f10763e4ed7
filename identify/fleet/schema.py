"""The columns of a store, their version, and how a table of an older version becomes one of today's.

A file of results says its version in its own metadata, so that a migration that was interrupted goes on.
"""

from collections.abc import Callable

import pyarrow as pa


SCHEMA = 2
VERSION_KEY = b"thermohyd-fleet"

_VALUE = [
    ("name", pa.string()),
    ("value", pa.float64()),
    ("std", pa.float64()),
    ("low", pa.float64()),  # of the 95 % interval
    ("high", pa.float64()),
    ("unit", pa.string()),
]
PARAMETER = pa.struct([*_VALUE, ("at_bound", pa.bool_()), ("fixed", pa.bool_())])
EFFECT = pa.struct(
    [*_VALUE, ("p_value", pa.float64()), ("gap_closed", pa.float64()), ("alternatives", pa.list_(pa.string()))]
)
FAULT = pa.struct(
    [
        ("name", pa.string()),
        ("test", pa.string()),
        ("channel", pa.string()),
        ("value", pa.float64()),
        ("std", pa.float64()),
        ("unit", pa.string()),
        ("sentence", pa.string()),
    ]
)
TERM = pa.struct(
    [
        ("place", pa.string()),
        ("variable", pa.string()),
        ("law", pa.string()),
        ("value", pa.float64()),
        ("std", pa.float64()),
        ("unit", pa.string()),
        ("sentence", pa.string()),
    ]
)
RESULTS = pa.schema(
    [
        ("identity", pa.string()),
        ("content", pa.string()),
        ("job", pa.string()),
        ("settings", pa.string()),
        ("version", pa.string()),
        ("path", pa.string()),
        ("serial", pa.string()),
        ("port", pa.string()),
        ("order_number", pa.string()),
        ("date", pa.timestamp("us")),
        ("operating_hours", pa.float64()),
        ("iso_4406", pa.string()),
        ("oil_temperature_low", pa.float64()),  # K
        ("oil_temperature_high", pa.float64()),
        ("supply_pressure_low", pa.float64()),  # Pa
        ("supply_pressure_high", pa.float64()),
        ("verdict", pa.string()),
        ("converged", pa.bool_()),
        ("gap_before", pa.float64()),  # reduced chi-square of the ideal valve
        ("gap_after", pa.float64()),
        ("held_out", pa.float64()),  # share of the gap that the named effects close on rows held out; since schema 2
        ("parameters", pa.list_(PARAMETER)),
        ("effects", pa.list_(EFFECT)),
        ("faults", pa.list_(FAULT)),
        ("terms", pa.list_(TERM)),  # since schema 2
        ("sentences", pa.list_(pa.string())),
        ("warnings", pa.list_(pa.string())),
        ("rows", pa.int64()),
        ("report", pa.string()),  # folder of its report, within the store
        ("seconds", pa.float64()),
        ("written", pa.timestamp("us")),  # UTC
    ]
)
FAILURES = pa.schema(
    [
        ("identity", pa.string()),
        ("content", pa.string()),
        ("job", pa.string()),
        ("version", pa.string()),
        ("path", pa.string()),
        ("kind", pa.string()),  # unreadable, failed, crashed, too long, too much memory
        ("reason", pa.string()),
        ("strikes", pa.int64()),
        ("written", pa.timestamp("us")),
    ]
)
# What two runs of the same records need not agree in.
OF_THE_RUN = ("seconds", "written")

# {version: what makes a table of it one of the next}. Every one of them stays: stores are kept for years.
Step = Callable[[pa.Table], pa.Table]
MIGRATIONS: dict[int, Step] = {
    1: lambda table: table,  # held_out and terms were not kept: null, as for any column that a table lacks
}


def version_of(table: pa.Table) -> int:
    """Of a table as it was written. Raises ValueError where it is none of a store."""
    said = (table.schema.metadata or {}).get(VERSION_KEY)
    if said is None or not said.isdigit():
        raise ValueError("is no file of a fleet's store")
    return int(said)


def with_version(table: pa.Table, number: int = SCHEMA) -> pa.Table:
    return table.replace_schema_metadata({VERSION_KEY: str(number).encode()})


def migrated(table: pa.Table, schema: pa.Schema = RESULTS) -> pa.Table:
    """A table of any older version as one of today's: columns in order, new ones null. Raises ValueError for a newer one."""
    number = version_of(table)
    if number > SCHEMA:
        raise ValueError(f"has schema {number}, but this program knows up to {SCHEMA}: update thermohyd")
    for step in range(number, SCHEMA):
        table = MIGRATIONS[step](table)
    for column in schema:
        if column.name not in table.column_names:
            table = table.append_column(column, pa.nulls(len(table), column.type))
    return with_version(table.select(schema.names).cast(schema))
