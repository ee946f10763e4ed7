"""Read the `[tests.<name>]` tables of a bench.toml (file, columns, noise) and its `[actuator]` table.

A test's table says where its rows are, of which kind each column is, and what the user knows of the scatter of its readings.
The actuator's table holds the jack, its load and its loop, with the defaults that docs/bench_format.md section 2.5 states.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from .columns import ABSOLUTE_RATIO, KIND_OF, READINGS, columns_of, columns_of_frequency, columns_of_step
from .errors import quoted, suggestion
from .record import OF_BOTH_SIDES, ActuatorData, ValveData, misgiven_side
from .sensors import EACH_RUN, FREE, Sensor, noise_of_signal, with_signals
from .test_record import DYNAMIC_TESTS, STATIC_TESTS, is_dynamic, kind_of_test
from .toml_file import TomlTable
from .units import parse_quantity


POSITION_NOISE = {"spool_position": "length"}  # of a static test: what it was read at is measured, too


def read_noise(
    table: TomlTable, readings: Mapping[str, str] | None = None, sensors: Mapping[str, Sensor] | None = None
) -> dict[str, float]:
    """{reading: standard deviation, SI} of a `[tests.<name>]` table: one quantity for all readings, or a table, which may also
    say how noisy the positions are.

    readings: {name: kind} where the test's own keys decide it. sensors: of readings that may be signals; one whose gain is
    free has its noise in volts or counts. Raises BenchInputError.
    """
    given = sensors or {}
    readings = READINGS[table.path[-1]] if readings is None else readings
    if "noise" not in table:
        return {}
    each = table.table("noise") if isinstance(table.data["noise"], dict) else None
    if each is not None:
        kinds = {**readings, **POSITION_NOISE} if table.path[-1] in STATIC_TESTS else dict(readings)
        each.refuse_unknown(tuple(kinds), "reading")
        return {r: _noise(each, r, text, kinds[r], given.get(r)) for r, text in each.data.items()}
    if len(set(readings.values())) > 1:
        example = ", ".join(f'{reading} = "..."' for reading in list(readings)[:2])
        raise table.error(f"the readings differ in kind; write one value per reading: {{ {example} }}", "noise")
    return {r: _noise(table, "noise", table.data["noise"], kind, given.get(r)) for r, kind in readings.items()}


def _noise(table: TomlTable, key: str, text: object, kind: str, sensor: Sensor | None) -> float:
    found = noise_of_signal(text, sensor)
    if found is not None:
        if not found > 0.0:
            raise table.error(f"{quoted(text)} must be positive", key)
        return found
    if sensor is not None and sensor.gain is None:
        return table.as_quantity(key, text, sensor.kinds[0], sign="positive")
    return table.as_quantity(key, text, kind, sign="positive")


# Key: kind of quantity, sign, default (docs/bench_format.md section 2.5); None: the pairs of an unequal jack.
ACTUATOR: dict[str, tuple[str, str, str | None]] = {
    "piston_area": ("area", "positive", "12 cm^2"),
    "piston_area_a": ("area", "positive", None),
    "piston_area_b": ("area", "positive", None),
    "chamber_volume": ("volume", "positive", "60 cm^3"),
    "chamber_volume_a": ("volume", "positive", None),
    "chamber_volume_b": ("volume", "positive", None),
    "piston_stroke": ("length", "positive", "50 mm"),
    "moving_mass": ("mass", "positive", "50 kg"),
    "viscous_friction": ("viscous friction", "not negative", "2000 N s/m"),
    "coulomb_friction": ("force", "not negative", "0 N"),
    "jack_leakage": ("leakage conductance", "not negative", "0 m^3/s/Pa"),
    "spool_frequency": ("frequency", "positive", "100 Hz"),
    "spool_damping": ("plain number", "positive", "0.7"),
    "external_force": ("force", "", "0 N"),
}
CONTROLLER = {"amplifier_gain": "amplifier gain", "sensor_gain": "sensor gain"}
HEAT = ("adiabatic", "isothermal")


def read_loop(table: TomlTable, valve: ValveData, sensors: dict[str, Sensor]) -> tuple[ActuatorData, dict[str, Sensor]]:
    """(the actuator, the sensors with the one that closes the loop marked). Raises BenchInputError.

    A controller without a sensor_gain compares volts with volts: its sensor is that of the piston's position, and 1/gain
    stands for sensor_gain, of a free gain a stand-in until a fit finds it.
    """
    controller = table.table("controller")
    position = sensors.get("piston_position")
    if controller is None or "sensor_gain" in controller or position is None or "amplifier_gain" not in controller:
        return read_actuator(table, valve), sensors
    if position.free_zero == EACH_RUN:
        raise controller.error(f'the loop has one zero: write zero = "{FREE}" for piston_position in [sensors]')
    if position.gain is not None and (not position.signal or position.gain < 0.0):
        raise controller.error(
            "sensor_gain is missing; without it, [sensors] piston_position needs a positive gain per volt or count"
        )
    # Half the piston's stroke is ten volts: only where a search begins.
    stroke = table.quantity("piston_stroke", "length", sign="positive") or parse_quantity("50 mm", "length")
    gain = 20.0 / stroke if position.gain is None else 1.0 / position.gain
    return read_actuator(table, valve, gain), {**sensors, "piston_position": replace(position, in_loop=True)}


def read_actuator(table: TomlTable, valve: ValveData, sensor_gain: float | None = None) -> ActuatorData:
    """Read the `[actuator]` table, SI. sensor_gain: where the controller has none of its own.

    Raises BenchInputError where it says something that an actuator cannot be.
    """
    table.refuse_unknown((*ACTUATOR, "controller", "heat"))
    value: dict[str, float] = {}
    for key, (kind, sign, default) in ACTUATOR.items():
        given = table.quantity(key, kind, sign=sign)
        if given is None and default is not None and f"{key}_a" not in table and f"{key}_b" not in table:
            given = parse_quantity(default, kind)
        if given is not None:
            value[key] = given
    if wrong := misgiven_side(table.data):
        raise table.error(wrong[1], wrong[0])
    for side in ("_a", "_b"):
        area, volume = (key if key in value else f"{key}{side}" for key in OF_BOTH_SIDES)
        swept = 0.5 * value[area] * value["piston_stroke"]
        if not value[volume] > swept:
            raise table.error(
                f"the chamber volume {value[volume] * 1e6:.6g} cm^3 must be larger than {area} * "
                f"piston_stroke / 2 = {swept * 1e6:.6g} cm^3, which the piston sweeps from mid stroke",
                volume if volume in table else None,
            )
    check_word(table, "heat", HEAT)
    gains: dict[str, float] = {}
    controller = table.table("controller")
    if controller is not None:
        controller.refuse_unknown(tuple(CONTROLLER))
        for key, kind in CONTROLLER.items():
            gain = controller.quantity(key, kind, sign="positive")
            if gain is None and key == "sensor_gain":
                gain = sensor_gain
            if gain is None:
                raise controller.error(f"{key} is missing; a controller needs amplifier_gain and sensor_gain")
            gains[key] = gain
        if valve.rated_current is None:
            raise controller.error("a controller drives the valve by a current: [valve] needs rated_current")
    return ActuatorData(**value, **gains, heat=str(table.data.get("heat", HEAT[0])))


def check_word(table: TomlTable, key: str, words: tuple[str, ...]) -> None:
    """Raise BenchInputError where a key holds none of the words."""
    if key in table and table.data[key] not in words:
        raise table.error(f"must be one of {', '.join(words)}", key)


TEST_KEYS = ("kind", "file", "date", "noise", "columns", "ignore", "missing", "skip_rows", "sheet", "variable", "group")
# How the part of a file that holds the rows is called, by its ending.
PARTS = {
    "sheet": ((".xlsx", ".xlsm"), "an .xlsx file has sheets"),
    "variable": ((".mat",), "a .mat file has variables"),
    "group": ((".tdms",), "a .tdms file has groups"),
}
DATA_SHEET = ("gain", "zero")  # of a static test's instrument
PLAN = "plan"  # of a static test that is yet to be run, in the place of its file
OWN_KEYS = {"frequency": ("output", "absolute"), "leakage": ("meter",), "step": ("command",)}
# What the column command of a step test is, where a controller closes the loop.
COMMANDS = ("setpoint", "controller_output")
METERS = ("return", "supply")
OWN_NAME, NO_WORD = re.compile(r"[a-z0-9_]+"), re.compile(r"[^a-z0-9_]+")
OUTPUTS = ("spool_position", "piston_velocity", "piston_position")


@dataclass(frozen=True)
class StaticTest:
    """A `[tests.<name>]` table: where its rows are, and what the user says about its columns."""

    name: str
    file: Path
    noise: dict[str, float]  # {reading: standard deviation, SI}
    columns: dict[str, str]  # {standard column: the user's header}
    ignore: tuple[str, ...]
    table: TomlTable  # for messages
    skip_missing: bool = False  # leave out rows with an empty cell or NaN, instead of refusing them
    skip_rows: int = 0  # lines above the headers
    part: str | None = None  # sheet, variable or group of its file; None: the first, or the only one
    meter: str = "return"  # where a leakage is read
    sensors: Mapping[str, Sensor] = field(default_factory=dict)  # by column
    # What the data sheet says of the instrument, standard deviations: of the gain, and of the zero as a share of the largest reading.
    gain: float | None = None
    zero: float | None = None
    planned: bool = False  # its rows are made by its table `plan`; `file` is then the description

    @property
    def kinds(self) -> dict[str, tuple[str, ...]]:
        """{standard column: kinds of quantity that its unit may be of}"""
        return with_signals({name: (kind,) for name, kind in columns_of(self.name).items()}, self.sensors)

    @property
    def percent_of_stroke(self) -> tuple[str, ...]:
        """Columns that may be given in percent of the valve's stroke."""
        return ("spool_position",)


@dataclass(frozen=True)
class DynamicTestTable(StaticTest):
    """A `[tests.step]`, `[tests.step_<own name>]` or `[tests.frequency]` table."""

    closed_loop: bool = False
    output: str = "spool_position"
    absolute: bool = False

    @property
    def kind(self) -> str:
        return kind_of_test(self.name)

    @property
    def kinds(self) -> dict[str, tuple[str, ...]]:
        if self.kind == "step":
            return with_signals(columns_of_step(self.closed_loop), self.sensors)
        known = columns_of_frequency(self.closed_loop, "plain number")
        if not self.absolute:
            return known
        ratios = (ABSOLUTE_RATIO[self.output, False],) + (
            () if self.closed_loop else (ABSOLUTE_RATIO[self.output, True],)
        )
        return {**known, "amplitude_ratio": ratios, "amplitude_ratio_std": ratios}

    @property
    def percent_of_stroke(self) -> tuple[str, ...]:
        return ("spool_position",) if self.closed_loop else ("spool_position", "command")


def read_tests(
    table: TomlTable, actuator: ActuatorData, sensors: Mapping[str, Sensor] | None = None
) -> tuple[dict[str, StaticTest], dict[str, DynamicTestTable]]:
    """(static tests, dynamic tests) by name, in the order of the file. Raises BenchInputError."""
    sensors = sensors or {}
    names = (*STATIC_TESTS, *DYNAMIC_TESTS)
    for name in table.data:
        _check_name(table, name, names)
    if not table.data:
        raise table.error(f"is empty; add one of {', '.join(f'[tests.{name}]' for name in names)}")
    static: dict[str, StaticTest] = {}
    dynamic: dict[str, DynamicTestTable] = {}
    for name in table.data:
        test = table.table(name)
        assert test is not None
        test.refuse_unknown(
            (*TEST_KEYS, *(() if is_dynamic(name) else (*DATA_SHEET, PLAN)), *OWN_KEYS.get(kind_of_test(name), ()))
        )
        if "kind" in test and test.data["kind"] != kind_of_test(name):
            raise test.error(f'must be "{kind_of_test(name)}", with which the name of the test begins', "kind")
        planned = not is_dynamic(name) and test.table(PLAN) is not None
        if planned and "file" in test:
            raise test.error("stands beside a file; keep one: a test is planned, or it was run", PLAN)
        file = (test.source.path or Path()).name if planned else test.text("file")
        if file is None:
            raise test.error(f'file is missing; write for example file = "{name}.csv"')
        path = (test.source.folder or Path()) / file
        if is_dynamic(name):
            dynamic[name] = _dynamic(name, path, test, actuator.closed_loop, sensors)
        else:
            known = tuple(columns_of(name))
            check_word(test, "meter", METERS)
            meter = str(test.data.get("meter", METERS[0]))
            static[name] = StaticTest(
                name,
                path,
                read_noise(test, sensors=sensors),
                _mapping(test, known),
                _ignored(test),
                test,
                **_layout(test),
                meter=meter,
                sensors=sensors,
                gain=_tolerance(test, "gain"),
                zero=_tolerance(test, "zero"),
                planned=planned,
            )
    return static, dynamic


def _tolerance(test: TomlTable, key: str) -> float | None:
    """A share, such as "1 %"; None where it is not given."""
    share = test.quantity(key, "plain number", full_scale=1.0, sign="positive")
    if share is not None and share > 0.5:
        raise test.error('must be at most 50 %; of which so little is known belongs into [sensors] as "free"', key)
    return share


def _check_name(table: TomlTable, name: str, names: tuple[str, ...]) -> None:
    """Raise BenchInputError where a test's name is neither a kind nor a dynamic kind with a word of the user's behind it."""
    if name in names:
        return
    given = table.data[name].get("kind") if isinstance(table.data[name], dict) else None
    if is_dynamic(name):
        if not OWN_NAME.fullmatch(name):
            raise table.error(
                f"{quoted(name)} becomes the name of files: use only small letters, digits and underscores", name
            )
    elif given in DYNAMIC_TESTS:
        raise table.error(
            f"a {given} test's own name must begin with its kind: [tests.{given}_{NO_WORD.sub('_', name.lower())}]",
            name,
        )
    elif given in STATIC_TESTS or any(name.startswith(f"{kind}_") for kind in STATIC_TESTS):
        kind = given if given in STATIC_TESTS else next(k for k in STATIC_TESTS if name.startswith(f"{k}_"))
        raise table.error(
            f"a record has one {kind} test; put all its sweeps into one file, told apart by a column run", name
        )
    else:
        raise table.error(f"unknown test {quoted(name)}; {suggestion(name, names)}", name)


def _dynamic(name: str, path: Path, test: TomlTable, closed: bool, sensors: Mapping[str, Sensor]) -> DynamicTestTable:
    check_word(test, "output", OUTPUTS)
    check_word(test, "command", COMMANDS)
    if test.data.get("command") == COMMANDS[0] and not closed:
        raise test.error("a setpoint needs a controller in [actuator], which closes the loop", "command")
    # A measured output drives the valve, whoever made it.
    closed = closed and test.data.get("command") != COMMANDS[1]
    output, absolute = str(test.data.get("output", OUTPUTS[0])), test.flag("absolute")
    if output == "piston_position" and not closed and not absolute:
        raise test.error(
            "a piston position in open loop has no low-frequency asymptote: write absolute = true, or give [actuator] "
            "the controller that closes the loop",
            "output" if "output" in test else None,
        )
    used = _with_command(sensors, closed) if kind_of_test(name) == "step" else {}
    settings: dict[str, Any] = {"closed_loop": closed, "output": output, "absolute": absolute, "sensors": used}
    plain = DynamicTestTable(name, path, {}, {}, (), test, **settings)
    readings = {reading: KIND_OF[reading] for reading in READINGS[plain.kind]}
    readings |= {reading: plain.kinds[reading][0] for reading in readings if reading not in used}
    columns = _mapping(test, tuple(plain.kinds))
    noise = read_noise(test, readings, used)
    return DynamicTestTable(name, path, noise, columns, _ignored(test), test, **_layout(test), **settings)


def _with_command(sensors: Mapping[str, Sensor], closed: bool) -> dict[str, Sensor]:
    """The sensors of a step test: a setpoint in volts is one of the sensor that it is compared with."""
    position = sensors.get("piston_position")
    if closed and "command" not in sensors and position is not None and position.in_loop:
        return {**sensors, "command": position}
    return dict(sensors)


def _mapping(test: TomlTable, columns: tuple[str, ...]) -> dict[str, str]:
    table = test.table("columns")
    if table is None:
        return {}
    table.refuse_unknown(("run", *columns), "standard column")
    headers = {}
    for column in table.data:
        header = table.text(column)
        assert header is not None
        if header in headers.values():
            raise table.error(f"{quoted(header)} stands for two columns", column)
        headers[column] = header
    return headers


def _ignored(test: TomlTable) -> tuple[str, ...]:
    names = test.data.get("ignore", [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise test.error('must be a list of headers, such as ignore = ["remarks"]', "ignore")
    return tuple(name.strip() for name in names)


def _layout(test: TomlTable) -> dict[str, Any]:
    """What the user says of the file itself, as keyword arguments of a test."""
    if "missing" in test and test.data["missing"] != "skip":
        raise test.error(
            'must be "skip", which leaves out rows with an empty cell or NaN (without it they are refused)', "missing"
        )
    skip_rows = test.data.get("skip_rows", 0)
    if isinstance(skip_rows, bool) or not isinstance(skip_rows, int) or skip_rows < 0:
        raise test.error(f"{quoted(skip_rows)} must be the number of lines above the headers, such as 3", "skip_rows")
    part = None
    for key, (endings, whose) in PARTS.items():
        if key in test:
            part = test.text(key)
            if not str(test.data.get("file")).lower().endswith(endings):
                raise test.error(f"only {whose}", key)
    return {"skip_missing": "missing" in test, "skip_rows": skip_rows, "part": part}
