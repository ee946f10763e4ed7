"""Check a record's columns against each other: what is physically impossible is an error, what is unusual a warning."""

import numpy as np

from .columns import column_unit, likely_unit
from .test_file import BenchTable
from .test_record import Channel, TestRecord
from .valve_tables import BenchFile, equivalent_slot_width


LOW_SUPPLY = 10e5  # Pa: below it servovalves are not tested
LEAST_DROP = (
    0.1e5  # Pa from supply to return: below it a number was meant in another unit, and the simulator refuses it
)
NO_PRESSURE = 100.0  # Pa
LOWEST_REACH = 0.01  # of the stroke: a sweep within it resolves no edge
BEYOND_OIL = 40.0  # K that the viscosity may be extrapolated without a word
FREE_FLOW = 3.0  # times the flow through the open slots without any loss: beyond it no valve
UNLIKE = 3.0  # factor between the slots that are stated and those that pass the rated flow
SATURATED = 1.5  # times the supply: no static load pressure exceeds it


def check_supply(table: BenchTable, bench: BenchFile, supply: np.ndarray, back: np.ndarray) -> None:
    """Raise BenchInputError where the supply pressure [Pa] does not exceed the return pressure: nothing flows then, or next to it."""
    low = np.flatnonzero(supply - back < LEAST_DROP)
    if not len(low):
        refuse_next_to_nothing(table, bench, "return_pressure", back)
        return
    row = int(low[0])
    by = "" if supply[row] <= back[row] else f", by as much as {LEAST_DROP / 1e5:g} bar"
    over = f"does not exceed the return pressure, {back[row] / 1e5:.4g} bar{by}"
    what = f"the supply pressure, {supply[row] / 1e5:.4g} bar, {over}"
    if "supply_pressure" not in table.values and "return_pressure" not in table.values:
        conditions = bench.source.root.table("conditions")
        assert conditions is not None  # a supply pressure stands there
        raise conditions.error(f"{what}; is the unit right?", "supply_pressure")
    name = "supply_pressure" if "supply_pressure" in table.values else "return_pressure"
    more = "" if len(low) == 1 else f" (so in {len(low):,} rows)"
    raise table.error(name, row, f"{what}{more}; is the unit right? Leave out rows without supply")


def refuse_next_to_nothing(table: BenchTable, bench: BenchFile, name: str, pressure: np.ndarray) -> None:
    """Raise BenchInputError where a pressure [Pa] is the same few pascals in every row: the simulator takes those for bars."""
    size = float(np.abs(pressure).max(initial=0.0))
    if not 0.0 < size <= NO_PRESSURE or np.ptp(pressure) > 0.0:
        return
    words = f"{size / 1e5:.3g} bar in every row is next to nothing; is the unit right? If so, write 0 bar"
    conditions = bench.source.root.table("conditions")
    if name in table.values or conditions is None:
        raise table.error(name, None, words)
    raise conditions.error(words, name)


def refuse_zeros(table: BenchTable, readings: tuple[Channel, ...]) -> None:
    """Raise BenchInputError where a static test's reading is zero in every row: a sensor that is not connected, or another column."""
    for channel in readings:
        if len(channel.value) > 1 and not channel.value.any():
            raise table.error(
                channel.name,
                None,
                "every reading is 0; is the sensor connected, and this its column? Leave the column out otherwise",
            )


def static_warnings(test: TestRecord, table: BenchTable, bench: BenchFile) -> tuple[str, ...]:
    """What is unusual about a static test, one sentence each."""
    file = test.path.name
    found = list(condition_warnings(test, table, bench))
    stroke = bench.valve.stroke
    reach = float(np.abs(test.spool_position).max(initial=0.0))
    if test.rows > 1 and reach < LOWEST_REACH * stroke:
        name = "current" if test.abscissa == "current" else "spool_position"
        found.append(
            f"{file}: {name} reaches only {100.0 * reach / stroke:.2g} % of {'the rated one' if name == 'current' else 'the stroke'}: "
            "is its unit right?"
        )
    for channel in test.channels:
        if channel.signal:  # volts say nothing before their gain is known
            continue
        if channel.name in ("leakage_flow", "flow"):
            found += _flow_warning(test, bench, file, channel.name, channel.value)
        elif channel.name in ("load_pressure", "pressure_a", "pressure_b"):
            over = np.flatnonzero(np.abs(channel.value) > SATURATED * test.supply_pressure + 1e5)
            if len(over):
                row = int(over[0])
                found.append(
                    f"{file}: {channel.name} is {channel.value[row] / 1e5:.4g} bar at a supply of "
                    f"{test.supply_pressure[row] / 1e5:.4g} bar{_place(table, row, len(over))}: no load pressure exceeds its "
                    "supply; are the units right?"
                )
    return tuple(found)


def condition_warnings(test: TestRecord, table: BenchTable, bench: BenchFile) -> tuple[str, ...]:
    """What is unusual about the supply pressure and the temperature of a test."""
    file = test.path.name
    found = []
    supply = float(np.median(test.supply_pressure))
    if supply < LOW_SUPPLY:
        unit = table.units.get("supply_pressure")
        likely = None if unit is None else likely_unit("pressure", supply / unit.scale)
        hint = f"are the values in {likely}?" if likely is not None else "is the unit right?"
        found.append(f"{file}: the supply pressure is {supply / 1e5:.3g} bar, low for a servovalve; {hint}")
    if bench.oil.coldest is not None and bench.oil.hottest is not None:
        low, high = bench.oil.coldest, bench.oil.hottest
        coldest, hottest = float(test.temperature.min()), float(test.temperature.max())
        if coldest < low - BEYOND_OIL or hottest > high + BEYOND_OIL:
            found.append(
                f"{file}: the oil is at {_degrees(coldest, hottest)}, but its viscosity is given for {_degrees(low, high)} "
                "only: what it is there is a guess, and with it the result; is the unit of temperature right?"
            )
    return tuple(found)


def rating_warnings(bench: BenchFile) -> tuple[str, ...]:
    """What is unusual about a rated flow beside slots that are stated: these rule, and pass another flow."""
    valve = bench.valve
    if not valve.slot_width_stated or valve.rated_flow is None or valve.rated_pressure_drop is None:
        return ()
    width = equivalent_slot_width(valve.rated_flow, valve.rated_pressure_drop, valve.stroke, bench.oil)
    if 1.0 / UNLIKE < width / valve.slot_width < UNLIKE:
        return ()
    flow, shown = column_unit("rated_flow"), column_unit("slot_width")
    passed = valve.rated_flow * valve.slot_width / width
    return (
        f"{bench.source.words}: slots of {shown.words(valve.slot_width, 3)} over the whole stroke pass about "
        f"{flow.words(passed, 3)} at the rated pressure drop, but rated_flow is {flow.words(valve.rated_flow, 3)}: is a unit "
        "wrong? The slot width rules",
    )


def _flow_warning(test: TestRecord, bench: BenchFile, file: str, name: str, flow: np.ndarray) -> list[str]:
    """No valve passes more than its open slots would without any loss: w X_n sqrt(2 dp / rho)."""
    drop = np.maximum(test.supply_pressure - test.return_pressure, 0.0)
    free = bench.valve.slot_width * bench.valve.stroke * np.sqrt(2.0 * drop / bench.oil.density)
    over = np.flatnonzero(np.abs(flow) > FREE_FLOW * free)
    if not len(over):
        return []
    row = int(over[np.abs(flow[over]).argmax()])
    line = "" if test.lines is None else f" ({'in one row' if len(over) == 1 else f'so in {len(over):,} rows'})"
    return [
        f"{file}: {name} reaches {flow[row] * 6e4:.4g} l/min{line}, but slots of this width and stroke pass "
        f"{free[row] * 6e4:.3g} l/min at most: are the units right, of the flow and in [valve]?"
    ]


def _place(table: BenchTable, row: int, count: int) -> str:
    more = "" if count == 1 else f" and in {count - 1:,} more"
    return f" in {table.source.word} {table.lines[row]}{more}"


def _degrees(low: float, high: float) -> str:
    least, most = f"{low - 273.15:.3g}", f"{high - 273.15:.3g}"
    return f"{least} degC" if least == most else f"{least} to {most} degC"
