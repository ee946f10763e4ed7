"""Look at a record before any fit: columns and units, how logs are reduced, what is known of the noise, what is missing. No JAX."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from thermohyd.identify.bench.columns import CONDITIONS, column_unit
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.provenance import provenance_of
from thermohyd.identify.bench.read import NAME, described_record, read_each_test
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_file import BenchTable
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.bench.valve_tables import BenchFile
from thermohyd.identify.fitting.parameters import free_parameters, plan_motion, plan_parameters
from thermohyd.identify.fitting.reversed_signs import reversed_channels, warning_of, with_signs_turned
from thermohyd.identify.noise.level import initial_noise
from thermohyd.identify.reduction.limits import without_limits
from thermohyd.identify.reduction.monotone_pieces import monotone_pieces
from thermohyd.identify.reduction.reduce import reduce_test

from .missing import what_is_missing
from .result import CheckedColumn, CheckedNoise, CheckedTest, CheckResult


def check(bench: str | Path, *, progress: Callable[[str], None] | None = None) -> CheckResult:
    """What a fit would read of the record in a folder, and what it would miss. Every test is read by itself: `refused` names each
    that cannot be used. Raises BenchInputError where the folder or its bench.toml cannot be read at all.
    """
    say = progress or (lambda _: None)
    folder, description = described_record(bench)
    say(f"reading {bench}")
    found = read_each_test(description, folder)
    refused = {name: str(error) for name, error in found.refused.items()}
    if found.record is None:
        return CheckResult(description.valve.name, folder, None, {}, refused, (), (), (), (), "")
    try:
        made = provenance_of(folder, folder / NAME, found.record.tests.values())
    except OSError as error:  # gone since it was read
        raise BenchInputError(f"cannot be read ({error.strerror})", file=error.filename) from None
    record = replace(found.record, provenance=made)
    planned = {test.name for test in description.tests.values() if test.planned}
    tests, warnings = {}, list(record.warnings)
    for name, test in record.tests.items():
        if test.rows > 2000:
            say(f"reducing {name}: {test.rows:,} rows")
        turned = () if test.in_motion else reversed_channels(test)
        warnings += [warning_of(test, channel) for channel in turned]
        seen = _as_seen(test, turned)
        tests[name] = _checked(test, seen, found.tables[name], description, name in planned, turned)
    free: tuple[str, ...] = ()
    if not refused:
        try:
            free = _free(record, {name: test.seen for name, test in tests.items()})
        except BenchInputError as error:  # about the record as a whole, so under no test's name
            refused[""] = str(error)
    lost = [name for name in refused if name and name not in found.without_readings]
    missing = () if lost else what_is_missing(record, tests)  # once all is read: a refused test is no missing one
    command = "" if refused else f"thermohyd fit {bench} --out DIR"
    if refused and not lost and "" not in refused:
        command = f"thermohyd {'plan' if planned else 'simulate'} {bench} --out DIR"
    return CheckResult(
        record.name,
        folder,
        record,
        tests,
        refused,
        found.without_readings,
        free,
        missing,
        tuple(warnings),
        command,
    )


def _as_seen(test: TestRecord, turned: tuple[str, ...]) -> TestRecord:
    """The test as a fit sees it: of static ones logs reduced, and what is no reading left out."""
    if not test.channels:
        return test
    return reduce_test(without_limits(with_signs_turned(test, turned)))


def _checked(
    test: TestRecord, seen: TestRecord, table: BenchTable, bench: BenchFile, planned: bool, turned: tuple[str, ...]
) -> CheckedTest:
    places = {place: name for name, place in table.columns.items()}
    columns = []
    for place, header in enumerate(table.source.header):
        name = places.get(place, "")
        unit, values = table.units.get(name), table.values.get(name)
        if unit is None or values is None:
            columns.append(CheckedColumn(header, name, "", None, None))
            continue
        own = (values - unit.offset) / unit.scale
        columns.append(CheckedColumn(header, name, unit.text, float(own.min()), float(own.max())))
    given = bench.conditions
    conditions = {
        name: f"{column_unit(name).words(given[name], 5)} in all rows, as [conditions] or the default has it"
        for name in CONDITIONS
        if name not in table.values and name in given
    }
    noise = []
    for channel in seen.channels:
        level = initial_noise(seen, channel)
        noise.append(CheckedNoise(channel.name, float(np.median(level.std)), level.known, level.source))
    legs = 0 if test.in_motion else int(monotone_pieces(test)[0].max(initial=0)) + 1
    notes = tuple(note for note in seen.notes if note not in test.notes)
    return CheckedTest(test.name, test, seen, tuple(columns), conditions, tuple(noise), legs, planned, turned, notes)


def _free(record: BenchRecord, tests: Mapping[str, TestRecord]) -> tuple[str, ...]:
    """What a fit of these tests would look for, the gains of sensors left out. Raises BenchInputError where they hold too little."""
    free: list[str] = []
    static = {name: test for name, test in tests.items() if not test.in_motion}
    moving = {name: test for name, test in tests.items() if test.in_motion}
    if static:
        free += free_parameters(record, plan_parameters(record.valve, record.start), static)
    if moving and record.actuator is not None:
        plans = plan_motion(record.valve, record.actuator, record.start)
        free += [name for name in free_parameters(record, plans, moving) if name not in free]
    return tuple(free)
