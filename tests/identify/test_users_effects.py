"""A static and a dynamic effect of a user's own module through everything: hidden in rows, fitted, named, reported, predicted."""

import io
import json
import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from helpers.quick_compile import quick_jit
from helpers.small_bench import VALVE, conditions_only, record_of
from helpers.users_effects import LOAD_DRAG, METER_TARE, registered
from rich.console import Console

from thermohyd.effects.library import DYNAMIC_EFFECTS, EFFECTS, unregister_effect, with_effects
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import ActuatorData, BenchRecord, StartValue
from thermohyd.identify.bench.test_record import Channel, DynamicTest
from thermohyd.identify.diagnosis.diagnose import diagnose
from thermohyd.identify.diagnosis.result import DiagnosisResult
from thermohyd.identify.fitting.motion_readings import DynamicSimulator, actuator_of
from thermohyd.identify.fitting.parameters import IN_MOTION
from thermohyd.identify.fitting.static_readings import base_valve, conditions_of, predict
from thermohyd.identify.model.model_file import load_model, model_json
from thermohyd.identify.model.predict import simulate
from thermohyd.identify.report.diagnosis_page import diagnosis_files
from thermohyd.identify.report.diagnosis_report import print_summary
from thermohyd.identify.users_effects import GROUP, load_entry_points


# What is searched beside the user's own: few, as each is paid for in compiling.
STATIC = ("viscosity_shift", "pilot_leakage", "bushing_leakage", "flowmeter_offset")
MOVING = ("coulomb_friction",)
TARE, DRAG = 1.2e-13, 3e4  # m3/(s Pa), N s2/m2
READING = {"leakage": "leakage_flow", "pressure_gain": "load_pressure"}
NOISE = {
    "leakage_flow": 0.004 / 6e4, "load_pressure": 0.4e5, "piston_position": 1e-5, "pressure_a": 0.2e5, "pressure_b": 0.2e5,
}  # fmt: skip
UNITS = {"l/min": 1 / 6e4, "bar": 1e5, "mm": 1e-3}
JACK = ActuatorData(amplifier_gain=0.03, sensor_gain=100.0)
PARAMETERS = {
    name: float(getattr(VALVE, name))
    for name in ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
}


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """Where a small package of effects is installed: a module, and what says that it is one, as pip leaves them."""
    site = tmp_path_factory.mktemp("site")
    (site / "bench_meters.py").write_text("from helpers.users_effects import METER_TARE as ENTRY\n")
    info = site / "bench_meters-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: bench-meters\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\ntare = bench_meters:ENTRY\n")
    return site


@pytest.fixture(scope="module", autouse=True)
def library(package):
    """A short library with the user's two effects in it; the static one comes with the installed package."""
    static, moving = (
        {name: known[name] for name in names} for known, names in ((EFFECTS, STATIC), (DYNAMIC_EFFECTS, MOVING))
    )
    with (
        patch.dict(EFFECTS, static, clear=True),
        patch.dict(DYNAMIC_EFFECTS, moving, clear=True),
        patch.object(sys, "path", [str(package), *sys.path]),
        registered(LOAD_DRAG),
    ):
        assert load_entry_points() == {"bench-meters": (METER_TARE.name,)}
        yield
        unregister_effect(METER_TARE.name)


def noisy(name: str, value: np.ndarray) -> Channel:
    std, rng = np.full(len(value), NOISE[name]), np.random.default_rng(len(name))
    return Channel(name, value + std * rng.standard_normal(len(value)), std, "declared")


@pytest.fixture(scope="module")
def static_record(library) -> BenchRecord:
    """Rows of the project's own simulator; the flowmeter of the leakage test has the tare."""
    bare = record_of({name: conditions_only(name) for name in READING})
    valve = with_effects(base_valve(bare, PARAMETERS), {"meter_tare": TARE})
    exact = quick_jit(predict)(valve, {name: conditions_of(test) for name, test in bare.tests.items()})
    value = lambda name: np.asarray(exact[name][READING[name]])[: bare.tests[name].rows]
    return record_of(
        {name: replace(test, channels=(noisy(READING[name], value(name)),)) for name, test in bare.tests.items()}
    )


@pytest.fixture(scope="module")
def moving_record(library) -> BenchRecord:
    """Two large steps of the setpoint, up and down from rest, 60 rows each; the load drags."""
    time = np.linspace(0.0, 0.3, 60)
    up = np.where(time > 0.01, 15e-3, 0.0)
    both = lambda value: np.full(2 * len(time), value)
    step = DynamicTest(
        name="step", path=Path("step.csv"), spool_position=both(0.0), supply_pressure=both(210e5),
        return_pressure=both(2e5), temperature=both(313.15), channels=(), run=np.repeat([0, 1], len(time)),
        run_names=("up", "down"), direction=both(1.0), time=np.tile(time, 2), command=np.concatenate([up, -up]),
    )  # fmt: skip
    bare = record_of({}, **{name: StartValue(value) for name, value in PARAMETERS.items()})
    machine = base_valve(bare, PARAMETERS), actuator_of(JACK, bare.valve.rated_current)
    simulator = DynamicSimulator({"step": step}, *machine, JACK.heat, bare.valve.polarity)
    # The vector of the diagnosis's own program, so that it is compiled once for both.
    names, effects = (*IN_MOTION, "null_bias"), (*MOVING, "load_drag")
    vector = [*(getattr(JACK, name, 1.0) for name in IN_MOTION), PARAMETERS["null_bias"], 0.0, DRAG]
    read = simulator.read(names, effects, np.array(vector))
    assert not read.failure
    channels = tuple(noisy(name, read.values["step", name]) for name in NOISE if ("step", name) in read.values)
    return replace(bare, tests={**bare.tests, "step": replace(step, channels=channels)}, actuator=JACK)


@pytest.fixture(scope="module")
def results(static_record, moving_record) -> dict[str, DiagnosisResult]:
    return {"meter_tare": diagnose(static_record), "load_drag": diagnose(moving_record)}


@pytest.mark.nightly  # whole diagnoses
@pytest.mark.parametrize(("name", "amount"), [("meter_tare", TARE), ("load_drag", DRAG)])
def test_what_was_hidden_is_named_with_its_amount(results, name, amount):
    found = results[name]
    assert found.verdict == "named", found.headline
    [effect] = found.effects
    assert effect.name == name
    assert abs(effect.value - amount) < 4.0 * effect.std < 0.5 * amount
    assert found.gap_after < 1.25 < 2.0 < found.gap_before


@pytest.mark.nightly  # whole diagnoses
@pytest.mark.parametrize("name", ["meter_tare", "load_drag"])
def test_the_fit_with_it_finds_the_parameters(results, name):
    free = results[name].after.free
    assert name in free
    truth = {**PARAMETERS, **{n: getattr(JACK, n, 1.0) for n in IN_MOTION}}  # a factor is 1
    for other in free:
        estimate = results[name].after.parameters[other]
        assert other == name or abs(estimate.value - truth[other]) < 4.0 * estimate.std, other


@pytest.mark.nightly  # whole diagnoses
def test_the_reports_speak_of_them(results):
    assert results["meter_tare"].sentences[0] == (
        "meter_tare: the leakage meter's zero moves with the supply pressure; a look at the meter with its valve shut tells."
    )
    for name, unit, shown in (("meter_tare", "m3/(s Pa)", "l/min/bar"), ("load_drag", "N s2/m2", "kN/(m/s)^2")):
        out = io.StringIO()
        print_summary(results[name], Console(file=out, width=120, no_color=True))
        assert name in out.getvalue()
        assert shown in out.getvalue()
        files = diagnosis_files(results[name], model_json(results[name].after, results[name].learned))
        assert name in str(files["report.html"])
        [effect] = json.loads(str(files["diagnosis.json"]))["effects"]
        assert effect["parameter"]["unit"] == unit


@pytest.mark.nightly  # whole diagnoses
@pytest.mark.parametrize("name", ["meter_tare", "load_drag"])
def test_the_model_is_read_back_and_predicts_the_readings(results, static_record, moving_record, name, tmp_path):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(model_json(results[name].after, results[name].learned)))
    model = load_model(path)
    assert list(model.effects) == [name]
    record = static_record if name == "meter_tare" else moving_record
    tables = simulate(record, model).tables
    for test in record.tests.values():
        for channel in test.channels:
            [column] = [head for head in tables[test.name] if head.startswith(f"{channel.name}_predicted [")]
            size = UNITS[column.split("[")[1].rstrip("]")]
            miss = (np.asarray(tables[test.name][column]) * size - channel.value) / channel.std
            assert np.sqrt(np.mean(miss**2)) < 1.15, (test.name, channel.name)


@pytest.mark.nightly  # whole diagnoses
def test_a_model_with_an_effect_that_nobody_registered(results, tmp_path):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(model_json(results["meter_tare"].after, results["meter_tare"].learned)))
    with patch.dict(EFFECTS):
        EFFECTS.pop("meter_tare")
        with pytest.raises(BenchInputError) as caught:
            load_model(path)
    assert '"effects" has no "meter_tare"' in str(caught.value)
    assert "must be registered before its model is read (thermohyd.register_effect)" in str(caught.value)
    assert "\n" not in str(caught.value)
