"""What volts and counts mean: the `[sensors]` table, a gain and a zero for each column that an instrument gives as a signal.

    quantity = gain * (signal - zero)

A gain or a zero may be stated, stated with a tolerance (the standard deviation of a prior), or free: then a fit estimates it.
What a stated gain makes of a column is in SI like any other; a column of free gain is kept as its signal. No JAX.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from .columns import KIND_OF, READINGS
from .errors import quoted
from .shown_units import KINDS
from .toml_file import TomlTable
from .units import Unit, UnitError, parse_quantity, parse_unit


# Units of a signal, each with its kind of quantity.
SIGNALS = {"V": "voltage", "count": "number of counts"}
FREE, EACH_RUN = "free", "each run"


@dataclass(frozen=True)
class Sensor:
    """An entry of `[sensors]`: quantity [SI] = gain (signal - zero).

    gain: SI per signal; None: free. signal: "V" or "count"; "": the column has a unit of its own, and the gain is 1; None: free,
    until a file says what it is. tolerance: relative standard deviation of the gain; None: exact. zero: in the signal's unit;
    free_zero: "", "free", or "each run" of a test for itself; zero_tolerance: standard deviation of the zero, None: exact.
    in_loop: it is the sensor of the position loop, which compares the setpoint's signal with its own.
    """

    column: str
    gain: float | None = 1.0
    signal: str | None = ""
    tolerance: float | None = None
    zero: float = 0.0
    free_zero: str = ""
    zero_tolerance: float | None = None
    in_loop: bool = False

    @property
    def reference(self) -> float:
        """By which gain a signal is kept: reading = reference (signal - reference_zero); 1 where the gain is free."""
        return 1.0 if self.gain is None else self.gain

    @property
    def reference_zero(self) -> float:
        return 0.0 if self.gain is None else self.zero

    @property
    def estimated(self) -> bool:
        """Whether a fit has something to find in it."""
        return self.gain is None or bool(self.tolerance or self.free_zero or self.zero_tolerance)

    @property
    def shown_as(self) -> str:
        """The unit of the readings as they are kept, where that is a signal's; empty where they are quantities."""
        return (self.signal or "") if self.gain is None else ""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of signal that the column may be of."""
        if self.signal is None:
            return tuple(SIGNALS.values())
        return (SIGNALS[self.signal],) if self.signal else ()


KEYS = ("gain", "tolerance", "zero", "zero_tolerance")
# What an instrument reads; a drive beside it.
COLUMNS = tuple(dict.fromkeys([n for t in ("leakage", "pressure_gain", "flow_gain", "step") for n in READINGS[t]]))
OTHERS = ("supply_pressure", "return_pressure", "temperature", "command", "external_force")
_PER = re.compile(r"(.*?)/\s*(V|mV|volt|volts|count|counts|cts|digit|digits)\s*", re.IGNORECASE)


def read_sensors(table: TomlTable | None, stroke: float) -> dict[str, Sensor]:
    """{column: sensor} of a `[sensors]` table. stroke [m]: what `%` of a spool's position or command is of.

    Raises BenchInputError.
    """
    if table is None:
        return {}
    table.refuse_unknown((*COLUMNS, *OTHERS), "column")
    found = {}
    for column in table.data:
        entry = table.table(column) if isinstance(table.data[column], dict) else None
        if entry is None:
            raise table.error(f'must be a table: {column} = {{ gain = "free" }}, or gain = "2.1 mm/V"', column)
        entry.refuse_unknown(KEYS)
        found[column] = _sensor(entry, column, stroke)
    return found


def _kind(column: str) -> str:
    return {"command": "length", "external_force": "force"}.get(column) or KIND_OF[column]


def _sensor(entry: TomlTable, column: str, stroke: float) -> Sensor:
    if not entry.data:
        raise entry.error('is empty; write gain = "free", or a value such as gain = "2.1 mm/V"')
    sensor = Sensor(column)
    if "gain" in entry:
        if entry.data["gain"] == FREE:
            sensor = replace(sensor, gain=None, signal=None)
        else:
            gain, signal = _gain(entry, column, stroke)
            sensor = replace(sensor, gain=gain, signal=signal)
    tolerance = entry.quantity("tolerance", "plain number", full_scale=1.0, sign="positive")
    if tolerance is not None and (sensor.gain is None or not sensor.signal):
        raise entry.error("is of a stated gain; a free gain needs none", "tolerance")
    if tolerance is not None and tolerance > 0.5:
        raise entry.error("must be at most 50 %; a gain of which so little is known is free", "tolerance")
    zero, freedom = 0.0, ""
    if entry.data.get("zero") in (FREE, EACH_RUN):
        freedom = str(entry.data["zero"])
    elif "zero" in entry:
        zero, sensor = _zero(entry, "zero", sensor, column)
    spread = None
    if "zero_tolerance" in entry:
        if freedom:
            raise entry.error("is of a stated zero; a free zero needs none", "zero_tolerance")
        spread, sensor = _zero(entry, "zero_tolerance", sensor, column, spread=True)
    return replace(sensor, tolerance=tolerance, zero=zero, free_zero=freedom, zero_tolerance=spread)


def _gain(entry: TomlTable, column: str, stroke: float) -> tuple[float, str]:
    """(SI per signal, unit of the signal) of "2.1 mm/V" or "10 %/V"."""
    text, kind = entry.data["gain"], _kind(column)
    example = f'"1.5 {KINDS[kind].label}/V", "0.01 {KINDS[kind].label}/count" or "free"'
    per = _PER.fullmatch(text) if isinstance(text, str) else None
    if per is None:
        raise entry.error(f"{quoted(text)} must be a quantity per volt or count: {example}", "gain")
    full_scale = stroke if column in ("spool_position", "command") else None
    try:
        # Of an offset unit, such as degC, a gain is a difference.
        unit = parse_unit("1" if per[2].lower().startswith(("c", "d")) else per[2], _kind_of_signal(per[2]))
        value = parse_quantity(per[1].strip(), kind, full_scale) - _offset(per[1].strip(), kind, full_scale)
    except UnitError as error:
        raise entry.error(f"{error}; a gain is written {example}", "gain") from None
    if value == 0.0:
        raise entry.error(f"{quoted(text)} must not be zero", "gain")
    return value / unit.scale, "V" if _kind_of_signal(per[2]) == "voltage" else "count"


def _kind_of_signal(text: str) -> str:
    return "number of counts" if text.lower().startswith(("c", "d")) else "voltage"


def _offset(text: str, kind: str, full_scale: float | None) -> float:
    return parse_quantity(re.sub(r"^[+-]?[\d.]+(?:[eE][+-]?\d+)?", "0", text), kind, full_scale)


def _zero(entry: TomlTable, key: str, sensor: Sensor, column: str, spread: bool = False) -> tuple[float, Sensor]:
    """(a zero or its tolerance in the signal's unit, the sensor with that unit)."""
    value = entry.data[key]
    kinds = sensor.kinds or (_kind(column),)
    sign = "positive" if spread else ""
    if isinstance(value, str):
        for kind in kinds:
            try:
                number = parse_quantity(value, kind)
            except UnitError:
                continue
            if spread and _kind(column) == "temperature" and not sensor.kinds:
                number -= parse_quantity(re.sub(r"^[\d.]+", "0", value), kind)
            if spread and not number > 0.0:
                raise entry.error(f"{quoted(value)} must be positive", key)
            named = next((unit for unit, of in SIGNALS.items() if of == kind), sensor.signal)
            return number, replace(sensor, signal=named)
        words = " or ".join(f'"1.5 {KINDS[kind].label}"' for kind in kinds)
        more = "" if spread else f', "{FREE}" or "{EACH_RUN}"'
        raise entry.error(f"{quoted(value)} must be a signal such as {words}{more}", key)
    return entry.as_quantity(key, value, kinds[0], sign=sign), sensor


def of_signal(sensor: Sensor, unit: Unit, kind: str, *, spread: bool = False) -> tuple[Unit, str]:
    """(unit, kind) in which a column's cells are kept, given those that its header has. spread: a standard deviation.

    Raises UnitError where the header's signal is not that of the stated gain.
    """
    signal = next((name for name, of in SIGNALS.items() if of == kind), None)
    if signal is None:
        return unit, kind
    if sensor.signal not in (None, signal):
        raise UnitError(
            f"{quoted(unit.text)} is {'a voltage' if signal == 'V' else 'in counts'}, but [sensors] {sensor.column} has its "
            f"gain and zero in {sensor.signal or 'the unit of its own quantity'}"
        )
    if sensor.gain is None:
        return unit, kind
    if spread:
        return Unit(unit.text, abs(sensor.gain) * unit.scale, 0.0), _kind(sensor.column)
    return Unit(unit.text, sensor.gain * unit.scale, sensor.gain * (unit.offset - sensor.zero)), _kind(sensor.column)


def with_signals(kinds: Mapping[str, tuple[str, ...]], sensors: Mapping[str, Sensor]) -> dict[str, tuple[str, ...]]:
    """{column: kinds that it may have}, signals where there is a sensor: beside the quantity, or alone where its gain is free."""
    found = dict(kinds)
    for name, sensor in sensors.items():
        for column in (name, f"{name}_std"):
            if column in kinds and sensor.kinds:
                alone = sensor.gain is None and name != "command"
                found[column] = sensor.kinds if alone else (*kinds[column], *sensor.kinds)
    return found


def noise_of_signal(value: object, sensor: Sensor | None) -> float | None:
    """A standard deviation given as a signal, "2 mV", as the readings are kept; None where it is none."""
    if sensor is None or not isinstance(value, str):
        return None
    for kind in sensor.kinds:
        try:
            return abs(sensor.reference) * parse_quantity(value, kind)
        except UnitError:
            continue
    return None
