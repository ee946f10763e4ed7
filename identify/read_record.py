"""Read a bench record: a folder with bench.toml and one CSV per test, checked, in SI units. No JAX here."""

import os
from pathlib import Path

import numpy as np

from .bench_csv import BenchTable
from .bench_tests import StaticTest
from .bench_toml import BenchFile, read_bench_toml
from .columns_of_tests import CONDITIONS, READINGS
from .errors import BenchInputError
from .plausibility import check_supply, condition_warnings, static_warnings
from .provenance import provenance_of
from .read_dynamic import read_dynamic
from .record import BenchRecord, Channel, TestRecord
from .sweeps import first_step_back, sweep_direction, sweep_rate
from .table_parts import NAME, channels_of, condition, missing, read_tables, runs
from .units import to_si


def record_folder(path: str | Path) -> Path:
    """The folder of a record that is named by itself or by its bench.toml."""
    path = Path(path)
    return path.parent if path.name == NAME and not os.path.isdir(path) else path


def read_record(folder: str | Path, *, readings_required: bool = True) -> BenchRecord:
    """The record in a folder (BENCH_FORMAT), or the one whose bench.toml is named. With `readings_required=False`
    (predictions) readings may be missing: a test without any then has no channels.

    Raises BenchInputError, and nothing else, for whatever is wrong with the folder or its files.
    """
    folder = record_folder(folder)
    try:
        if not folder.is_dir():
            what = f"is a file; give the folder of the record or its {NAME}" if folder.exists() else "no such folder"
            raise BenchInputError(what, file=folder)
        if not (folder / NAME).is_file():
            raise BenchInputError(f"holds no {NAME}; `thermohyd new` writes a template", file=folder)
    except (OSError, ValueError) as error:  # a name that no file system takes
        raise BenchInputError(f"cannot be read ({error})", file=folder) from None
    bench = read_bench_toml(folder / NAME)
    tables = read_tables(bench)
    tests = {test.name: _read_test(test, tables[test.name], bench, readings_required) for test in bench.tests.values()}
    dynamic = read_dynamic(bench, tables, readings_required=readings_required)
    moving = {} if dynamic is None else dynamic.tests
    warnings = [w for name, test in tests.items() for w in static_warnings(test, tables[name], bench)]
    for name, test in moving.items():
        warnings += condition_warnings(test, tables[name], bench)
    try:
        provenance = provenance_of(folder, folder / NAME, (*tests.values(), *moving.values()))
    except OSError as error:  # gone since it was read
        raise BenchInputError(f"cannot be read ({error.strerror})", file=error.filename) from None
    return BenchRecord(
        folder,
        bench.valve.name,
        bench.valve,
        bench.oil,
        tests,
        bench.start,
        warnings=tuple(warnings),
        dynamic=dynamic,
        provenance=provenance,
    )


def _read_test(test: StaticTest, table: BenchTable, bench: BenchFile, readings_required: bool) -> TestRecord:
    position, abscissa = _position(table, bench, test)
    given = {name: condition(table, bench, test, name) for name in CONDITIONS}
    check_supply(table, bench, given["supply_pressure"], given["return_pressure"])
    load_pressure = None
    if test.name == "load_flow":
        load_pressure = table.values.get("load_pressure")
        if load_pressure is None:
            raise missing(table, test, "load_pressure [bar], the imposed load pressure")
    channels = _channels(table, test, readings_required)
    run, run_names = runs(table)
    time = table.values.get("time")
    if time is not None and (back := first_step_back(time, run)) is not None:
        raise table.error(
            "time",
            back,
            "time runs backwards within one run; keep the order of the sweep, and give each sweep its own run",
        )
    return TestRecord(
        name=test.name,
        path=test.file,
        spool_position=position,
        supply_pressure=given["supply_pressure"],
        return_pressure=given["return_pressure"],
        temperature=given["temperature"],
        channels=channels,
        run=run,
        run_names=run_names,
        direction=sweep_direction(position, run),
        load_pressure=load_pressure,
        time=time,
        rate=None if time is None else sweep_rate(position, time, run),
        lines=table.lines,
        abscissa=abscissa,
        table=table.table,
        notes=table.notes,
    )


def _position(table: BenchTable, bench: BenchFile, test: StaticTest) -> tuple[np.ndarray, str]:
    valve = bench.valve
    if "spool_position" in table.values:
        name, position = "spool_position", table.values["spool_position"]
    elif "current" in table.values:
        name = "current"
        if valve.rated_current is None:
            raise bench.source.root.table_error(
                "valve", f'rated_current is missing, but {test.file.name} has a current; write rated_current = "25 mA"'
            )
        position = valve.stroke * table.values["current"] / valve.rated_current * valve.polarity
    else:
        raise missing(table, test, "spool_position [um] or current [mA]")
    far = np.flatnonzero(np.abs(position) > 2.0 * valve.stroke)
    if len(far):
        row = int(far[0])
        cell = table.text(name, row)
        limit, full = "the stroke", f"{valve.stroke * 1e6:.6g} um"
        if name == "current" and valve.rated_current is not None:
            limit, full = "the rated current", f"{valve.rated_current * 1e3:.6g} mA"
        number = float(np.abs(position[far[0]]) / table.units[name].scale) if name == "spool_position" else 0.0
        fitting = (u for u in ("um", "mm", "inch") if 0.02 * valve.stroke <= to_si(number, u) <= 2.0 * valve.stroke)
        hint = next((f" In {unit} it would fit" for unit in fitting), "")
        raise table.error(name, row, f"{cell} is beyond twice {limit} ({full}); is the unit right?{hint}")
    return position, name


def _channels(table: BenchTable, test: StaticTest, required: bool) -> tuple[Channel, ...]:
    found = [reading for reading in READINGS[test.name] if reading in table.values]
    if required:
        if not found:
            what = {"pressure_gain": "load_pressure [bar], or pressure_a and pressure_b"}
            reading, kind = next(iter(READINGS[test.name].items()))
            example = "l/min" if kind == "flow" else "bar"
            raise missing(table, test, what.get(test.name, f"{reading} [{example}]"))
        if len(found) == 1 and found[0] in ("pressure_a", "pressure_b"):
            other = {"pressure_a": "pressure_b", "pressure_b": "pressure_a"}[found[0]]
            raise missing(table, test, f"{other} [bar] beside {found[0]}")
    return channels_of(table, test, tuple(found))
