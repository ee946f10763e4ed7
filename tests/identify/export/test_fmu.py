"""The valve as C sources: the library's numbers to 1e-9 in three hosts, what FMPy says of the archive, and what is refused."""

import io
import shutil
import subprocess
import zipfile
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import fmpy
import fmpy.validation
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.commands import command
from helpers.fmus import run_in, table_of, unpacked
from reference import static_tests as reference
from reference.oil import Oil
from reference.valve import Effects, Rows, Valve as ReferenceValve

from thermohyd import oil_from_definition, with_effects
from thermohyd.conditions import Conditions
from thermohyd.edge import at_opening, mass_flow
from thermohyd.effects.library import EFFECTS
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import ActuatorData, ValveData
from thermohyd.identify.export.fmu import identifier, make_fmu
from thermohyd.identify.export.interface import INPUTS, OUTPUTS
from thermohyd.identify.export.valve_numbers import valve_numbers
from thermohyd.identify.model.learned_terms import LearnedTerm
from thermohyd.identify.model.model import Model
from thermohyd.identify.model.model_file import save_model
from thermohyd.oil import at_temperature, density
from thermohyd.oil_definition import OilDefinition, walther_coefficients
from thermohyd.ports import openings
from thermohyd.static_tests import blocked_port_readings, load_flow
from thermohyd.valve import Valve, metering_edges, true_conditions, true_oil


POINTS = ([233.15, 343.15], [4000e-6, 30e-6])
PARAMETERS = {
    "edge_radius": 9e-6,
    "clearance": 2.4e-6,
    "underlap": 7e-6,
    "discharge_coefficient": 0.69,
    "transition_number": 95.0,
    "null_bias": 1.5e-6,
}
EDGES = {
    "supply_edge_wear": 3e-6, "return_edge_wear": 1e-6, "edge_wear_pa": 1e-6, "edge_wear_bt": 2e-6, "unequal_underlap": 2e-6,
    "eccentricity": 0.6, "land_leakage": 8.0, "thermal_clearance": 4e-9, "pressure_clearance": 2e-14,
    "null_shift_temperature": 5e-9, "null_shift_pressure": 1e-13, "pressure_viscosity": 1.6e-8, "viscosity_shift": 0.1,
    "hysteresis": 1.5e-6,
}  # fmt: skip
BESIDE = {"pilot_leakage": 1e-9, "bushing_leakage": 3e-13}
LINES = {"flow_saturation": 2e13, "supply_droop": 2e9, "return_back_pressure": 3e13}
CROSS = {"cross_port_leakage": 4e-13}
CASES: dict[str, tuple[str, dict[str, float]]] = {
    "orifice law": ("orifice", {}),
    "film": ("lubrication", {}),
    "edges and leaks, orifice law": ("orifice", {**EDGES, **BESIDE}),
    "edges and leaks, film": ("lubrication", {**EDGES, **BESIDE}),
    "lines": ("orifice", {**EDGES, **LINES}),
    "between the ports": ("orifice", CROSS),
    "everything cold": ("lubrication", {**EDGES, **BESIDE, **LINES, **CROSS}),
    "heat": ("orifice", {**EDGES, "edge_wear_pb": 1e-6, "edge_wear_at": 1e-6, "throttle_heating": 0.7}),
}
ROWS = 150
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")


def model(law: str = "orifice", effects: dict[str, float] | None = None, **valve: Any) -> Model:
    body = ValveData("valve 7/b", 213e-6, 12e-3, rated_current=25e-3, polarity=-1, null_pressure=140e5, edge_law=law)
    return Model(
        replace(body, **valve), OilDefinition(*walther_coefficients(*POINTS)), PARAMETERS, effects=effects or {}
    )


def points(count: int = ROWS, seed: int = 0) -> dict[str, np.ndarray]:
    """Inputs of the FMU, all over its range; port pressures beyond supply and return too."""
    rng = np.random.default_rng(seed)
    supply, back = rng.uniform(50e5, 210e5, count), rng.uniform(0.0, 8e5, count)
    load, share = rng.uniform(-1.2, 1.2, count) * (supply - back), rng.uniform(0.0, 1.0, count)
    mean = back + share * (supply - back)
    return {
        "spool_position": rng.choice([1.0, 0.1, 0.02], count) * rng.uniform(-213e-6, 213e-6, count),
        "spool_direction": rng.choice([-1.0, 1.0], count),
        "supply_pressure": supply,
        "return_pressure": back,
        "temperature": rng.uniform(253.15, 353.15, count),
        "pressure_a": mean + 0.5 * load,
        "pressure_b": mean - 0.5 * load,
    }


def outputs(host, tmp_path, given: Model, at: dict[str, np.ndarray], **options: Any) -> dict[str, np.ndarray]:
    """What a C program reads of the FMU, at every point."""
    return table_of(host, unpacked(given, tmp_path, **options), np.stack(list(at.values()), axis=1))


@needs_compiler
@pytest.mark.parametrize("case", CASES)
def test_the_c_sources_give_the_numbers_of_the_reference(case, host, tmp_path):
    law, effects = CASES[case]
    at = points(30)
    found = outputs(host, tmp_path, model(law, effects), at)
    valve = ReferenceValve(slot_width=12e-3, null_pressure=140e5, edge_law=law, **PARAMETERS)
    load = at["pressure_a"] - at["pressure_b"]
    rows = Rows(
        at["spool_position"], at["supply_pressure"], at["return_pressure"], at["temperature"], at["spool_direction"],
        load_pressure=load,
    )  # fmt: skip
    oil, span = Oil(*walther_coefficients(*POINTS)), at["supply_pressure"] - at["return_pressure"]
    gain = reference.pressure_gain(valve, oil, rows, Effects(**effects))
    for port in ("a", "b"):
        assert np.max(np.abs(found[f"blocked_pressure_{port}"] - gain[f"pressure_{port}"]) / span) < 1e-9
    leakage = reference.leakage(valve, oil, rows, Effects(**effects))["leakage_flow"]
    np.testing.assert_allclose(found["leakage_flow"], leakage, rtol=1e-9)
    flow = reference.load_flow(valve, oil, rows, Effects(**effects))["flow"]
    np.testing.assert_allclose(found["load_flow"], flow, rtol=1e-9, atol=1e-15)


def library_valve(given: Model) -> Valve:
    body = given.valve
    valve = Valve(
        oil=oil_from_definition(given.oil), stroke=body.stroke, slot_width=body.slot_width, null_pressure=body.null_pressure,
        edge_law=body.edge_law, **given.parameters,
    )  # fmt: skip
    return with_effects(valve, given.effects)


@needs_compiler
@pytest.mark.parametrize("case", ["film", "heat"])
def test_the_c_sources_give_the_numbers_of_the_library(case, host, tmp_path):
    given, at = model(*CASES[case]), points()
    found, valve = outputs(host, tmp_path, given, at), library_valve(given)
    load = at["pressure_a"] - at["pressure_b"]
    read = Conditions(
        *(jnp.asarray(at[name]) for name in ("spool_position", "supply_pressure", "return_pressure", "temperature")),
        load_pressure=jnp.asarray(load),
        direction=jnp.asarray(at["spool_direction"]),
    )
    readings = blocked_port_readings(valve, read)
    for name, channel in (
        ("blocked_pressure_a", "pressure_a"),
        ("blocked_pressure_b", "pressure_b"),
        ("leakage_flow",) * 2,
    ):
        np.testing.assert_allclose(found[name], readings[channel], rtol=1e-9)
    np.testing.assert_allclose(found["load_flow"], load_flow(valve, read), rtol=1e-9, atol=1e-15)
    if case == "heat":
        return
    # at imposed port pressures: the library's own edges
    true = true_conditions(valve, read)
    oil, edges = true_oil(valve, true), metering_edges(valve, true)
    fresh, pressure = at_temperature(oil, true.temperature), jnp.stack([at["pressure_a"], at["pressure_b"]])
    supply, back = openings(edges, true)
    into = mass_flow(
        at_opening(edges.supply, supply),
        fresh,
        true.supply_pressure - pressure,
        0.5 * (true.supply_pressure + pressure),
    )
    out = mass_flow(
        at_opening(edges.return_, back), fresh, pressure - true.return_pressure, 0.5 * (pressure + true.return_pressure)
    )
    net = np.asarray(into - out)
    np.testing.assert_allclose(found["mass_flow_a"], net[0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found["mass_flow_b"], -net[1], rtol=1e-9, atol=1e-12)
    volume = net / np.asarray(density(oil, pressure, true.temperature))
    np.testing.assert_allclose(found["flow_a"], volume[0], rtol=1e-9, atol=1e-15)


@needs_compiler
@pytest.mark.parametrize("case", ["everything cold", "heat"])
def test_imposed_pressures_meet_the_closed_ports(case, host, tmp_path):
    """At the pressures of closed ports nothing flows through them, and all that leaks reaches the return."""
    given, at = model(*CASES[case]), points(60)
    closed = outputs(host, tmp_path, given, at)
    at = {**at, "pressure_a": closed["blocked_pressure_a"], "pressure_b": closed["blocked_pressure_b"]}
    found = outputs(host, tmp_path, given, at)
    through = np.abs(closed["leakage_flow"])
    assert np.max(np.abs(found["flow_a"]) / through) < 1e-8
    assert np.max(np.abs(found["flow_b"]) / through) < 1e-8
    np.testing.assert_allclose(found["return_flow"], closed["leakage_flow"], rtol=1e-9)


@needs_compiler
def test_fmi_3_gives_the_same_numbers_without_python(host, tmp_path):
    given, at = model(*CASES["everything cold"]), points(40)
    (tmp_path / "two").mkdir()
    (tmp_path / "three").mkdir()
    two, three = (outputs(host, tmp_path / name, given, at, fmi=n) for name, n in (("two", 2), ("three", 3)))
    assert two.keys() == three.keys()
    for name, found in three.items():
        np.testing.assert_array_equal(found, two[name])


@needs_compiler
@pytest.mark.parametrize("fmi", [2, 3])
def test_fmpy_runs_and_validates_it(fmi, host, tmp_path):
    given, at = model(*CASES["everything cold"]), points(40)
    made = make_fmu(given, fmi=fmi)
    (tmp_path / "valve.fmu").write_bytes(made.content)
    assert fmpy.validation.validate_fmu(str(tmp_path / "valve.fmu")) == []
    direct = outputs(host, tmp_path, given, at)
    time = 1e-3 * np.arange(40)
    signals = np.empty(40, dtype=[("time", float), *((name, float) for name in at)])
    signals["time"] = time
    for name, value in at.items():
        signals[name] = value
    for kind in ("CoSimulation", "ModelExchange"):
        result = fmpy.simulate_fmu(
            str(tmp_path / "valve.fmu"), fmi_type=kind, start_time=0.0, stop_time=time[-1], output_interval=1e-3, input=signals,
            step_size=1e-3, solver="Euler",
        )  # fmt: skip
        for i in (0, 7, 39):
            row = int(np.argmin(np.abs(result["time"] - time[i])))
            seen = max(i - 1, 0) if kind == "CoSimulation" else i  # a step goes with the inputs of its beginning
            for name in OUTPUTS:
                assert result[row][name] == pytest.approx(direct[name][seen], rel=1e-9, abs=1e-16), (kind, i, name)


@needs_compiler
@pytest.mark.parametrize(("fmi", "servo"), [(2, None), (2, "setpoint"), (3, None), (3, "setpoint")])
def test_a_host_rebuilds_it_from_its_sources(fmi, servo, tmp_path):
    given = replace(
        model(effects={"backlash": 1e-6} if servo else {}),
        actuator=ActuatorData(amplifier_gain=0.03, sensor_gain=100.0),
    )
    inside = unpacked(given, tmp_path, servo=servo, fmi=fmi, compiler=None)
    assert not (inside / "binaries").exists()
    built = tmp_path / "built.so"
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"]
    sources = sorted((inside / "sources").glob("*.c"))
    subprocess.run(["cc", *strict, "-shared", "-fPIC", "-o", built, *sources, "-lm"], check=True)
    # linked into the host itself, its functions bear the model's name
    linked = [f"-DFMI{fmi}_FUNCTION_PREFIX=valve_", "-c", "-o", tmp_path / "linked.o"]
    subprocess.run(["cc", *strict, *linked, inside / "sources" / f"fmi{fmi}.c"], check=True)
    names = subprocess.run(["nm", tmp_path / "linked.o"], capture_output=True, text=True, check=True).stdout
    assert f"valve_fmi{fmi}DoStep" in names


@needs_compiler
def test_driven_by_a_current(host, tmp_path):
    at = points(20)
    direct = outputs(host, tmp_path / "x", model(), at) if (tmp_path / "x").mkdir() is None else {}
    driven = {
        "current": -25e-3 * at["spool_position"] / 213e-6,
        **{n: v for n, v in at.items() if n != "spool_position"},
    }
    (tmp_path / "i").mkdir()
    found = outputs(host, tmp_path / "i", model(), driven, current=True)
    np.testing.assert_allclose(found["load_flow"], direct["load_flow"], rtol=1e-9)


def test_the_same_model_gives_the_same_bytes():
    first, second = (make_fmu(model(effects={"hysteresis": 1e-6}), compiler=None) for _ in range(2))
    assert first.content == second.content
    assert first.name == "valve_7_b"
    other = make_fmu(model(effects={"hysteresis": 2e-6}), compiler=None)
    assert other.content != first.content


def test_every_static_effect_is_expressed_or_left_out_or_refused():
    assert {info.elsewhere for info in EFFECTS.values()} == {"sources", "valve", "bench"}
    fields = {number.name for number in valve_numbers(model()).numbers}
    assert {name for name, info in EFFECTS.items() if info.elsewhere != "bench"} <= fields
    bench = valve_numbers(model(effects={"temperature_offset": 2.0, "hysteresis": 1e-6}))
    assert bench.left_out == ("temperature_offset",)
    assert bench.value("hysteresis") == 1e-6


TERM = LearnedTerm("viscosity", "temperature", 300.0, 40.0, (0.1,), 0.0, 0.0)
REFUSED = {
    "a learned term": (replace(model(), learned=(TERM,)), "learned term"),
    "heat beside lines": (
        model(effects={"throttle_heating": 0.5, "supply_droop": 1e9}),
        "the oil keeps heat, and supply_droop ties",
    ),
    "an effect of the user's": (
        model(effects={"slot_wear": 0.1}),
        "the effect slot_wear, for which there are no C sources",
    ),
    "an effect of motion": (model(effects={"coulomb_friction": 90.0}), "coulomb_friction, which only motion shows"),
    "no null pressure": (model(effects={"null_shift_pressure": 1e-13}, null_pressure=None), "needs null_pressure"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_expressed_is_refused(case):
    given, words = REFUSED[case]
    with pytest.raises(BenchInputError, match=words):
        make_fmu(given, compiler=None)


def test_a_current_needs_its_full_value():
    with pytest.raises(BenchInputError, match="has no rated_current"):
        make_fmu(model(rated_current=None), current=True, compiler=None)


def test_names_of_valves_become_names_of_c():
    assert [identifier(name) for name in ("MOOG 76101", "7/b", "", "é")] == [
        "MOOG_76101",
        "valve_7_b",
        "valve",
        "valve",
    ]


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", ["a\x1b[31m\x00\x0bb", "a\ud800b", "a\ufffeb", "\"><b a='", "a\r\n\tb", "]]>&amp;"])
def test_any_name_of_a_valve_is_valid_xml(fmi, name):
    given = model()
    made = make_fmu(replace(given, valve=replace(given.valve, name=name)), fmi=fmi, compiler=None)
    with zipfile.ZipFile(io.BytesIO(made.content)) as archive:
        for file in archive.namelist():
            if file.endswith(".xml"):
                ElementTree.fromstring(archive.read(file))
        assert "<b a" not in archive.read("documentation/index.html").decode()


@needs_compiler
def test_a_compiler_that_fails_is_named(tmp_path):
    with pytest.raises(BenchInputError, match=r"the compiler .*false failed"):
        make_fmu(model(), compiler="false")
    assert make_fmu(model(), compiler="no such compiler").binary == ""


@needs_compiler
def test_inputs_that_are_no_numbers_end_a_step(host, tmp_path):
    about = fmpy.read_model_description(str(unpacked(model(), tmp_path)))
    line = " ".join(str(start) for _, start, _ in INPUTS.values())
    for wrong in (line.replace("313.15", "nan"), line.replace("313.15", "40")):  # 40 degC given as 40 K
        ran = run_in(host, tmp_path / "inside", str(about.guid), wrong, 7, 10)
        assert ran.returncode == 3
        assert "an input is no finite number, or the temperature is not between 150 and 700 K" in ran.stderr
    assert run_in(host, tmp_path / "inside", "{0}", line, 7, 10).returncode == 2


def test_the_command_writes_it_and_says_what_stays(monkeypatch, tmp_path):
    save_model(model(effects={"hysteresis": 1e-6, "flowmeter_offset": 1e-8}), tmp_path / "model.json")
    ran = command(monkeypatch, "export", 120)(
        "fmu", tmp_path / "model.json", "--out", tmp_path / "out", "--compiler", "none"
    )
    assert ran.exit_code == 0, ran.stderr
    assert "left on the bench, as the valve elsewhere has none of it: flowmeter_offset" in ran.stdout
    assert zipfile.is_zipfile(tmp_path / "out" / "valve_7_b.fmu")
    bad = command(monkeypatch, "export", 120)("fmu", tmp_path / "none.json", "--out", tmp_path / "bad")
    assert bad.exit_code == 2
    assert not (tmp_path / "bad").exists()
