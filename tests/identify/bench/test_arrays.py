"""Records from arrays and DataFrames: those of the same rows in CSV files, to the last bit; errors that name the place."""

import doctest
import subprocess
import sys
import tomllib
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pandas as pd
import pint
import pytest

from thermohyd import walther_coefficients
from thermohyd.data import sample_record
from thermohyd.identify.bench import record as record_module
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.record import ActuatorData, BenchRecord, StartValue, ValveData
from thermohyd.identify.bench.units import to_si
from thermohyd.identify.noise.level import initial_noise
from thermohyd.identify.reduction.reduce import reduce_test
from thermohyd.oil_definition import OilDefinition


U = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
SAMPLES = ("seed_valve", "seed_actuator")
NOT_ROWS = {"path", "lines", "table"}  # where the rows came from


def told(name: str) -> dict:
    """The bench.toml of a sample as nested tables."""
    return tomllib.loads((sample_record(name) / "bench.toml").read_text(encoding="utf-8"))


def frames(name: str) -> dict[str, pd.DataFrame]:
    folder = sample_record(name)
    return {test: pd.read_csv(folder / table["file"], comment="#") for test, table in told(name)["tests"].items()}


def arguments(name: str) -> dict:
    content = told(name)
    tests = content.pop("tests")
    noise = {test: table["noise"] for test, table in tests.items() if "noise" in table}
    options = {t: {k: v for k, v in table.items() if k in ("output", "absolute")} for t, table in tests.items()}
    return {**content, "noise": noise, "options": options}


def quantity(text: Any) -> Any:
    """ "213 um" as pint's quantity, inside tables and lists too; another text and a number as they are."""
    if isinstance(text, dict):
        return {key: quantity(value) for key, value in text.items()}
    if isinstance(text, list):
        return [quantity(value) for value in text]
    head, _, unit = text.partition(" ") if isinstance(text, str) else ("", "", "")
    try:
        return U.Quantity(float(head), unit)
    except (ValueError, pint.UndefinedUnitError):
        return text


def column(header: Any, values: pd.Series) -> tuple[str, object]:
    name, _, unit = header.rstrip("]").partition(" [")
    found = values.to_numpy()
    return name, U.Quantity(found, "dimensionless" if unit == "1" else unit) if unit else found


def assert_same(one: BenchRecord, other: BenchRecord) -> None:
    for name in ("name", "valve", "oil", "start"):
        assert getattr(one, name) == getattr(other, name), name
    assert list(one.tests) == list(other.tests)
    for name, test in one.tests.items():
        assert_alike(test, other.tests[name])


def assert_alike(one: object, other: object, where: str = "") -> None:
    """Equal to the last bit, arrays and their types too."""
    assert type(one) is type(other), where
    if isinstance(one, np.ndarray):
        assert isinstance(other, np.ndarray)
        assert one.dtype == other.dtype, where
        assert one.tobytes() == other.tobytes() or np.array_equal(one, other), where
    elif hasattr(one, "__dataclass_fields__"):
        for field in fields(one):  # pyright: ignore[reportArgumentType]
            if field.name not in NOT_ROWS | {"std_source"}:
                assert_alike(getattr(one, field.name), getattr(other, field.name), f"{where}.{field.name}")
    elif isinstance(one, tuple):
        assert isinstance(other, tuple)
        assert len(one) == len(other), where
        for i, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_alike(a, b, f"{where}[{i}]")
    else:
        assert one == other, where


@pytest.mark.parametrize("name", SAMPLES)
def test_frames_give_what_their_csv_gives(name):
    read = read_record(sample_record(name))
    made = BenchRecord.from_dataframe(frames(name), **arguments(name))
    assert_same(read, made)
    assert read.actuator == made.actuator


@pytest.mark.parametrize("name", SAMPLES)
def test_arrays_with_units_give_what_their_csv_gives(name):
    tests = {test: dict(column(*pair) for pair in frame.items()) for test, frame in frames(name).items()}
    said = {key: quantity(value) for key, value in arguments(name).items() if key != "options"}
    made = BenchRecord.from_arrays(tests, **said, options=arguments(name)["options"])
    read = read_record(sample_record(name))
    assert_same(read, made)
    assert read.actuator == made.actuator


def test_a_fit_gets_the_same_numbers():
    read, made = read_record(sample_record("seed_valve")), BenchRecord.from_dataframe(
        frames("seed_valve"), **arguments("seed_valve")
    )  # fmt: skip
    for name, test in read.tests.items():
        one, other = reduce_test(test), reduce_test(made.tests[name])
        assert_alike(one, other, name)
        for a, b in zip(one.channels, other.channels, strict=True):
            assert_alike(replace(initial_noise(one, a), source=""), replace(initial_noise(other, b), source=""))


def test_numbers_are_si_and_the_records_own_classes_are_taken():
    read = read_record(sample_record("seed_actuator"))
    assert read.actuator is not None
    options = {name: {"output": t.output} for name, t in read.dynamic_tests.items() if name == "frequency"}
    tests = {}
    for name, test in read.dynamic_tests.items():
        columns: dict[str, Any] = {c.name: c.value for c in test.channels} | {
            f"{c.name}_std": c.std for c in test.channels if c.std is not None
        }
        columns["run"] = np.array(test.run_names)[test.run] if test.run_names != ("",) else None
        columns |= {"time": test.time, "command": test.command} if name == "step" else {"frequency": test.frequency}
        for condition in ("supply_pressure", "return_pressure", "temperature"):
            columns[condition] = getattr(test, condition)[0]  # a number for all rows
        tests[name] = {key: values for key, values in columns.items() if values is not None}
    made = BenchRecord.from_arrays(
        tests, valve=read.valve, oil=read.oil, actuator=read.actuator, start=read.start, options=options
    )
    assert_same(read, made)
    assert made.actuator is not None
    assert made.actuator == read.actuator


SWEEP = {"spool_position": np.linspace(-2e-4, 2e-4, 9), "leakage_flow": np.full(9, 2e-6)}
VALVE = {"stroke": 213e-6, "slot_width": 12e-3}
CONDITIONS = {"supply_pressure": U.Quantity(1000, "psi"), "temperature": "40 degC"}


def record(leakage: object = None, **changes) -> BenchRecord:
    given = {"valve": VALVE, "oil": "mil-prf-5606", "conditions": CONDITIONS} | changes
    return BenchRecord.from_arrays({"leakage": SWEEP if leakage is None else leakage}, **given)  # pyright: ignore[reportArgumentType]


def test_what_else_may_be_given():
    law = walther_coefficients([233.15, 343.15], [4000e-6, 30e-6])
    turned = {"spool_position": SWEEP["spool_position"], "leakage_flow": list(SWEEP["leakage_flow"]), "run": ["up"] * 9}
    made = record(
        turned,
        valve=ValveData("mine", 213e-6, 12e-3),
        oil=OilDefinition(*law),
        start={
            "clearance": StartValue(2e-6, prior_std=1e-7),
            "underlap": {"value": U.Quantity(15, "um"), "fixed": True},
        },
        noise={"leakage": U.Quantity(0.002, "l/min")},
    )
    assert made.name == "mine"
    assert made.start["clearance"] == StartValue(2e-6, prior_std=1e-7)
    assert made.start["underlap"].fixed
    (leakage,) = made.tests["leakage"].channels
    assert leakage.std == pytest.approx(np.full(9, 0.002 / 6e4))
    assert leakage.std_source == "declared in the arguments"
    assert made.tests["leakage"].run_names == ("up",)
    assert made.tests["leakage"].supply_pressure[0] == pytest.approx(68.9476e5)


def test_a_record_says_which_arrays_it_was_made_from():
    changed = {**SWEEP, "leakage_flow": np.full(9, 2.1e-6)}
    made = [record(leakage).provenance for leakage in (None, changed, changed)]
    one, other, again = (file for found in made if found is not None for file in found.files)
    assert (one.name, one.rows, one.used) == ("leakage", 9, 9)
    assert one.sha256 != other.sha256 == again.sha256


def test_what_a_caller_gave_stays_as_it_was():
    frame = pd.DataFrame({"spool_position [um]": [1, 2, 3], "leakage_flow [l/min]": ["0.1", "0.2", "0.3"]})
    before = frame.copy()
    made = BenchRecord.from_dataframe({"leakage": frame}, valve=VALVE, oil="mil-prf-5606", conditions=CONDITIONS)
    pd.testing.assert_frame_equal(frame, before)
    assert made.tests["leakage"].channels[0].value[1] == to_si(0.2, "l/min")


def gap(**changes) -> dict:
    return {**SWEEP, **changes}


@pytest.mark.parametrize(
    ("leakage", "changes", "message"),
    [
        (
            gap(leakage_flow=np.full(8, 2e-6)),
            {},
            'leakage, column "leakage_flow": has 8 values, but spool_position has 9',
        ),
        (gap(leakage_flow=np.zeros((9, 2))), {}, 'leakage, column "leakage_flow": has the shape (9, 2)'),
        (gap(leakage_flow=np.full(9, 1j)), {}, 'leakage, column "leakage_flow": has complex numbers'),
        (
            gap(leakage_flow=U.Quantity(np.ones(9), "bar")),
            {},
            'leakage, column "leakage_flow [bar]": "bar" is a pressure; expected a flow such as l/min',
        ),
        (
            gap(leakage_flow=np.array([1e-6, np.nan] + [1e-6] * 7)),
            {},
            'leakage, row 1, column "leakage_flow [m^3/s]": the cell is empty; leave the row out',
        ),
        (gap(leakage_flow=np.array([np.inf] + [1e-6] * 8)), {}, "leakage, row 0, column"),
        (gap(leakage_flow=np.full(9, 100.0)), {}, "is above 60,000 l/min; is the unit right?"),
        (gap(spool_position=1e3 * SWEEP["spool_position"]), {}, "is beyond twice the stroke (213 um)"),
        (
            {"spool_position": SWEEP["spool_position"]},
            {},
            'leakage: the leakage test needs a column leakage_flow [l/min], but the table has "spool_position [m]"',
        ),
        (gap(leakage_flw=1e-6), {}, 'unknown column "leakage_flw"; did you mean "leakage_flow"?'),
        ({"spool_position": 0.0, "leakage_flow": 1e-6}, {}, "leakage: holds no array"),
        ({"spool_position": [], "leakage_flow": []}, {}, "leakage: is empty"),
        (
            None,
            {"valve": {"stroke": 213e-6}},
            '[valve]: slot_width is missing; write for example slot_width = "12 mm", or both rated_flow and rated_pressure_drop',
        ),
        (None, {"valve": {**VALVE, "stroke": 213.0}}, '[valve] stroke: "213.0" is none'),
        (None, {"valve": {**VALVE, "stroke": np.nan}}, '[valve] stroke: "nan" is not finite'),
        (None, {"valve": {**VALVE, "stroke": U.Quantity(2, "bar")}}, '[valve] stroke: "bar" is a pressure'),
        (None, {"valve": {**VALVE, "stroke": U.Quantity([1.0, 2.0], "um")}}, "has the shape (2,); expected one number"),
        (None, {"valve": {**VALVE, "strok": 1.0}}, '[valve] strok: unknown key "strok"; did you mean "stroke"?'),
        (None, {"oil": "milprf"}, 'no oil preset "milprf"'),
        (
            None,
            {"conditions": {"temperature": 313.15}},
            "[conditions]: supply_pressure is missing: leakage has no such",
        ),
        (None, {"conditions": {**CONDITIONS, "temperature": 40}}, "lies outside -80 to 250 degC; is the unit right?"),
        (None, {"conditions": {**CONDITIONS, "supply_pressure": 0.0}}, "does not exceed the return pressure"),
        (None, {"noise": {"flow": 1.0}}, 'noise: unknown test "flow"; known: leakage'),
        (None, {"options": {"leakage": {"file": "x"}}}, 'options: unknown key "file"'),
        (None, {"start": {"clearence": 1e-6}}, 'unknown parameter "clearence"; did you mean "clearance"?'),
        (None, {"noise": {"leakage": -1e-9}}, "must be positive"),
    ],
)
def test_a_mistake_names_its_place(leakage, changes, message):
    with pytest.raises(BenchInputError) as caught:
        record(leakage, **changes)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_bad_cells_of_all_tests_come_in_one_message():
    holes = gap(leakage_flow=np.array([1e-6, np.nan] + [1e-6] * 7))
    flow = {"spool_position": SWEEP["spool_position"], "flow": np.array([np.nan] + [1e-6] * 8)}
    with pytest.raises(BenchInputError, match=r"2 bad cells in 2 files: .*row 1.*row 0") as caught:
        BenchRecord.from_arrays(
            {"leakage": holes, "flow_gain": flow}, valve=VALVE, oil="mil-prf-5606", conditions=CONDITIONS
        )
    assert caught.value.file is None
    skipping = record(holes, options={"leakage": {"missing": "skip"}})
    assert skipping.tests["leakage"].rows == 8
    assert list(skipping.tests["leakage"].lines) == [0, *range(2, 9)]  # pyright: ignore[reportArgumentType]


def test_an_unknown_test_gets_a_suggestion():
    with pytest.raises(BenchInputError, match=r'unknown test "leak"; did you mean "leakage"'):
        BenchRecord.from_arrays({"leak": SWEEP}, valve=VALVE, oil="mil-prf-5606")


@pytest.mark.parametrize(
    ("how", "tests", "message"),
    [
        ("arrays", "[sweep]", "tests: is of type list; expected a dictionary"),
        ("arrays", "{'leakage': [1, 2]}", "leakage: is of type list; expected a dictionary"),
        (
            "arrays",
            "{'leakage': pd.DataFrame(sweep)}",
            "leakage: is a DataFrame; BenchRecord.from_dataframe takes those",
        ),
        ("dataframe", "{'leakage': sweep}", "leakage: is of type dict; expected a pandas DataFrame"),
    ],
)
def test_another_type_is_one_sentence(how, tests, message):
    """In a process of its own: here the types of arguments are checked before."""
    code = (
        "import pandas as pd\n"
        "from thermohyd import identify\n"
        "sweep = {'spool_position': [0.0, 1e-5], 'leakage_flow': [1e-6, 2e-6]}\n"
        "try:\n"
        f"    identify.BenchRecord.from_{how}({tests}, valve={{'stroke': 213e-6, 'slot_width': 0.012}}, oil='mil-prf-5606')\n"
        "except identify.BenchInputError as error:\n"
        "    print(error)\n"
    )
    ran = subprocess.run([sys.executable, "-P", "-c", code], check=True, capture_output=True, text=True)
    assert ran.stdout == f"{message}\n"


def test_an_actuator_needs_what_a_file_needs():
    with pytest.raises(BenchInputError, match="needs rated_current"):
        BenchRecord.from_dataframe(
            {}, valve=VALVE, oil="mil-prf-5606", actuator=ActuatorData(amplifier_gain=0.03, sensor_gain=100.0)
        )


def test_the_examples_of_the_docstrings_hold():
    assert doctest.testmod(record_module).failed == 0
