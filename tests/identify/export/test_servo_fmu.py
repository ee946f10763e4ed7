"""The servo as C sources: rates and runs of a separately written model and of the library, in a C host and in FMPy."""

import ctypes
import shutil
from dataclasses import asdict, fields, replace
from typing import Any

import fmpy
import fmpy.fmi2
import fmpy.validation
import numpy as np
import pytest
from helpers.commands import command
from helpers.fmus import run_in, table_of, unpacked
from helpers.machines import apart, as_table, simulated
from reference.actuator import STATES, Dynamic, Machine
from reference.conformance_dynamic import DYNAMIC, UNEQUAL, machine_of, readings_of
from reference.step_test import READINGS
from reference.valve import Effects

from thermohyd.effects.library import DYNAMIC_EFFECTS, EFFECTS
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import ActuatorData, ValveData
from thermohyd.identify.export.fmu import make_fmu
from thermohyd.identify.export.servo_numbers import servo_numbers
from thermohyd.identify.model.learned_terms import LearnedTerm
from thermohyd.identify.model.model import Model
from thermohyd.identify.model.model_file import save_model
from thermohyd.oil_definition import OilDefinition


needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")


def model_of(machine: Machine) -> Model:
    """The machine of a conformance record, as model.json would hold it."""
    v, j = machine.valve, machine.jack
    o: Any = machine.oil
    given = asdict(v)
    body = ValveData(
        "servo 1", j.stroke, given.pop("slot_width"), rated_current=j.rated_current, polarity=j.polarity,
        null_pressure=given.pop("null_pressure"), edge_law=given.pop("edge_law"),
    )  # fmt: skip
    oil = OilDefinition(
        o.walther_a, o.walther_b, o.density, o.expansion, o.bulk_modulus, o.tait_slope, o.bulk_modulus_decay,
        o.specific_heat, o.specific_heat_slope,
    )  # fmt: skip
    named = {field.name for field in fields(ActuatorData)}
    jack = ActuatorData(
        **{name: value for name, value in asdict(j).items() if name in named},
        heat="adiabatic" if machine.adiabatic else "isothermal",
    )
    effects = {**asdict(machine.static), **asdict(machine.dynamic)}
    effects = {name: float(amount) for name, amount in effects.items() if amount}
    dynamics = {"bulk_modulus_factor": j.bulk_modulus_factor}
    return Model(body, oil, given, effects=effects, actuator=jack, dynamics=dynamics)


def rows_of(machine: Machine, parts: int = 1) -> np.ndarray:
    """Lines for the C host: inputs, their slopes and the time until the next row; each row cut into so many."""
    r = machine.run
    columns = np.stack([r.command, r.supply_pressure, r.return_pressure, r.temperature, r.external_force], axis=1)
    length = np.diff(r.time)[:, None]
    slopes = np.vstack([np.diff(columns, axis=0) / length, np.zeros(5)])
    length = np.vstack([length, 1e-4]) / parts
    cut = [np.hstack([columns + k * length * slopes, slopes, length]) for k in range(parts)]
    return np.stack(cut, axis=1).reshape(-1, cut[0].shape[1])


def rows_from_rest(machine: Machine) -> np.ndarray:
    """`rows_of` in four parts each, behind 200 of the first instant: seconds in which a loop finds its rest."""
    rows = rows_of(machine, parts=4)
    before = np.repeat(rows[:1] * np.array([*[1.0] * 5, *[0.0] * 5, 1.0]), 200, axis=0)
    before[:, -1] = 8e-3
    return np.vstack([before, rows])


def readings(table: dict[str, np.ndarray]) -> np.ndarray:
    return np.stack([table[name] for name in READINGS], axis=1)


# (record, of which set, largest error as a share of a reading's range)
RUNS = [
    ("closed_isothermal", DYNAMIC, 1e-6),
    ("current_adiabatic", DYNAMIC, 1e-6),
    ("stribeck_friction", DYNAMIC, 1e-5),
    ("backlash", DYNAMIC, 1e-6),
    ("open_adiabatic", UNEQUAL, 1e-6),
]


@needs_compiler
@pytest.mark.parametrize(("name", "of", "most"), RUNS)
def test_runs_are_those_of_the_reference(name, of, most, host, tmp_path):
    machine = machine_of(name, of)
    fmu = unpacked(model_of(machine), tmp_path, servo=machine.run.kind)
    found = readings(table_of(host, fmu, rows_of(machine), 1))
    share = apart(found, readings_of(name, of))
    print(f"{name}: {np.max(share):.1e} of the range")
    assert np.max(share) < most


@needs_compiler
def test_a_loop_that_the_host_closes_is_the_library_s(host, tmp_path):
    """The first seconds let the loop find its rest; then the host hands over a current and its slope every 50 us."""
    machine = machine_of("closed_isothermal")
    fmu = unpacked(model_of(machine), tmp_path, servo="current")
    rows = rows_from_rest(machine)
    gain = machine.jack.amplifier_gain * machine.jack.sensor_gain
    found = table_of(host, fmu, rows, 40, gain, 2, 3)
    own = readings({name: column[200::4] for name, column in found.items()})
    share = apart(own, as_table(simulated(machine)))
    print(f"served loop: {np.max(share):.1e} of the range")
    assert np.max(share) < 1e-5


@needs_compiler
def test_fmi_3_gives_the_same_numbers_without_python(host, tmp_path):
    """Of FMI 3.0 inputs have no slopes: they stand over a step, as those of 2.0 do where they are given none."""
    machine = machine_of("current_adiabatic")
    rows = rows_of(machine)
    rows[:, 5:10] = 0.0
    two, three = (
        table_of(host, unpacked(model_of(machine), tmp_path / f"{fmi}", servo="current", fmi=fmi), rows, 1)
        for fmi in (2, 3)
    )
    assert two.keys() == three.keys()
    for name, found in three.items():
        np.testing.assert_array_equal(found, two[name])


@needs_compiler
def test_a_loop_that_the_host_closes_over_fmi_3_is_the_library_s(host, tmp_path):
    machine = machine_of("closed_isothermal")
    fmu = unpacked(model_of(machine), tmp_path, servo="current", fmi=3)
    rows = rows_from_rest(machine)
    gain = machine.jack.amplifier_gain * machine.jack.sensor_gain
    apart_by = []
    for steps in (20, 40):
        found = table_of(host, fmu, rows, steps, gain, 2, 3)
        own = readings({name: column[200::4] for name, column in found.items()})
        apart_by.append(float(np.max(apart(own, as_table(simulated(machine))))))
    print(f"served loop: {apart_by} of the range")
    assert apart_by[1] < 0.01
    assert 0.4 < apart_by[1] / apart_by[0] < 0.6  # the currents that stand over a step are late by half of it


ALL_STATIC = Effects(
    supply_edge_wear=3e-6, return_edge_wear=1e-6, edge_wear_pa=1e-6, edge_wear_bt=2e-6, unequal_underlap=2e-6, eccentricity=0.6,
    land_leakage=8.0, thermal_clearance=4e-9, pressure_clearance=2e-14, null_shift_temperature=5e-9, null_shift_pressure=1e-13,
    pressure_viscosity=1.6e-8, viscosity_shift=0.1, flow_saturation=2e13, supply_droop=2e9, return_back_pressure=3e13,
    cross_port_leakage=4e-13,
)  # fmt: skip
ALL_DYNAMIC = Dynamic(300.0, 200.0, 4e-6, 0.01, 1e-12, 4e-7, 0.0, 20.0)


@needs_compiler
@pytest.mark.parametrize("law", ["orifice", "lubrication"])
def test_rates_with_every_effect_at_once(law, tmp_path):
    """At states all over, with flows in any direction and a piston in its stop; FMPy asks for them."""
    base = machine_of("closed_adiabatic")
    machine = replace(
        base, static=ALL_STATIC, dynamic=ALL_DYNAMIC, valve=replace(base.valve, edge_law=law, null_pressure=140e5)
    )
    at = machine.run
    inside = unpacked(model_of(machine), tmp_path, servo=at.kind)
    about: Any = fmpy.read_model_description(str(inside))
    fmu: Any = fmpy.fmi2.FMU2Model(
        guid=about.guid, modelIdentifier=about.modelExchange.modelIdentifier, unzipDirectory=str(inside), instanceName="servo"
    )  # fmt: skip
    fmu.instantiate()
    fmu.setupExperiment()
    columns = (at.command, at.supply_pressure, at.return_pressure, at.temperature, at.external_force)
    fmu.setReal([1000, 1001, 1002, 1003, 1004], [column[0] for column in columns])
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    rng = np.random.default_rng(0)
    places = [STATES.index(name) for name in ("x", "vx", "z", "v", "pa", "pb", "ta", "tb", "y")]
    pointer = lambda values: values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
    for k in range(12):
        x = rng.choice([1.0, 0.05]) * rng.uniform(-213e-6, 213e-6)
        z = 25.003e-3 if k == 3 else rng.uniform(-0.02, 0.02)
        pressures, warm = rng.uniform(0.001, 1.1, 2) * 210e5, rng.uniform(293.0, 333.0, 2)
        state = np.array([x, 0.02 * rng.normal(), *pressures, *warm, z, 0.05 * rng.normal(), x + 1e-6 * rng.normal()])
        given, found = state[places], np.empty(9)
        fmu.setContinuousStates(pointer(given), 9)
        fmu.getDerivatives(pointer(found), 9)
        np.testing.assert_allclose(found, machine.rates(at.time[0], state)[places], rtol=1e-7, atol=1e-9)
    fmu.freeInstance()


@needs_compiler
@pytest.mark.parametrize("fmi", [2, 3])
def test_fmpy_runs_and_validates_it(fmi, host, tmp_path):
    """A setpoint that jumps: FMPy holds its inputs over a step, which makes other inputs late by half of one."""
    machine = machine_of("closed_adiabatic")
    inside = unpacked(model_of(machine), tmp_path / "2", servo="setpoint")
    unpacked(model_of(machine), tmp_path / "tried", servo="setpoint", fmi=fmi)
    path, names = str(tmp_path / "tried" / "model.fmu"), ("setpoint", "supply_pressure", "external_force")
    assert fmpy.validation.validate_fmu(path) == []
    signals = np.array(
        [(0.0, 0.0, 180e5, 500.0), (0.02, 0.0, 180e5, 500.0), (0.02, 2e-3, 180e5, 500.0), (0.1, 2e-3, 180e5, 500.0)],
        dtype=[("time", float), *((name, float) for name in names)],
    )
    rows = np.zeros((11, 11))
    rows[:, :5] = np.array([0.0, 180e5, 0.0, 313.15, 500.0])
    rows[2:, 0], rows[:, -1] = 2e-3, 1e-2
    direct = table_of(host, inside, rows, 1)
    for kind, most in (("CoSimulation", 1e-6), ("ModelExchange", 1e-5)):
        found: Any = fmpy.simulate_fmu(
            path, fmi_type=kind, start_time=0.0, stop_time=0.1, output_interval=1e-2, input=signals, relative_tolerance=1e-9
        )  # fmt: skip
        at = [int(np.flatnonzero(np.abs(found["time"] - t) < 1e-9)[-1]) for t in 1e-2 * np.arange(11)]
        own = readings({name: found[name][at] for name in READINGS})
        share = apart(own, readings(direct))
        print(f"{kind}: {np.max(share):.1e} of the range")
        assert np.max(share) < most


@needs_compiler
def test_a_state_is_kept_and_taken_up_again(tmp_path):
    inside = unpacked(model_of(machine_of("backlash")), tmp_path, servo="setpoint")
    about: Any = fmpy.read_model_description(str(inside))
    fmu: Any = fmpy.fmi2.FMU2Slave(
        guid=about.guid, modelIdentifier=about.coSimulation.modelIdentifier, unzipDirectory=str(inside), instanceName="servo"
    )  # fmt: skip
    fmu.instantiate()
    fmu.setupExperiment()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    fmu.setReal([1000], [1e-3])

    def on(begin: int) -> list[list[float]]:
        found = []
        for k in range(begin, begin + 10):
            fmu.doStep(currentCommunicationPoint=1e-3 * k, communicationStepSize=1e-3)
            found.append(fmu.getReal([2000 + i for i in range(9)]))
        return found

    on(0)
    kept = fmu.getFMUstate()
    first = on(10)
    fmu.setFMUstate(kept)
    assert on(10) == first
    fmu.freeInstance()


@needs_compiler
def test_what_no_run_can_do_ends_it_with_a_sentence(host, tmp_path):
    machine = machine_of("closed_isothermal")
    fmu = unpacked(model_of(machine), tmp_path, servo="setpoint")
    guid = str(fmpy.read_model_description(str(fmu)).guid)
    first = rows_of(machine)[0]
    pressed, pulled = first.copy(), first.copy()
    pressed[4] = 40e3
    pulled[9], pulled[-1] = -40e3 / 0.1, 0.3  # N/s, s
    for row, words, code in ((pressed, "no equilibrium under the first inputs", 2), (pulled, "absolute vacuum", 3)):
        ran = run_in(host, fmu, guid, " ".join(map(repr, map(float, row))), 5, 8, 30)
        assert ran.returncode == code
        assert words in ran.stderr


SERVO = model_of(machine_of("closed_adiabatic"))
TERM = LearnedTerm("viscosity", "temperature", 300.0, 40.0, (0.1,), 0.0, 0.0)
REFUSED = {
    "no actuator": (replace(SERVO, actuator=None), "setpoint", "has no actuator"),
    "no controller": (replace(SERVO, actuator=ActuatorData()), "setpoint", "has no controller"),
    "no rated current": (replace(SERVO, valve=replace(SERVO.valve, rated_current=None)), "current", "no rated_current"),
    "a delay": (replace(SERVO, effects={"spool_delay": 1e-3}), "setpoint", "delay the command in the other program"),
    "a learned term": (replace(SERVO, learned=(TERM,)), "setpoint", "learned term"),
    "another command": (SERVO, "force", "setpoint, current, spool_position"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_expressed_is_refused(case):
    given, kind, words = REFUSED[case]
    with pytest.raises(BenchInputError, match=words):
        make_fmu(given, servo=kind, compiler=None)


def test_every_effect_of_motion_is_expressed_or_refused():
    names = {number.name for number in servo_numbers(replace(SERVO, effects={"backlash": 1e-6}), "setpoint").numbers}
    assert {name for name in DYNAMIC_EFFECTS if name not in names} == {"spool_delay"}
    for info in EFFECTS.values():
        if info.elsewhere != "bench":
            assert (info.elsewhere == "valve") == bool({"heat", "conditions"} & set(info.stages)), info.name
    left = servo_numbers(replace(SERVO, effects={"hysteresis": 1e-6, "flowmeter_offset": 1e-8}), "setpoint").left_out
    assert left == ("flowmeter_offset", "hysteresis")


def test_the_command_writes_a_servo(monkeypatch, tmp_path):
    save_model(SERVO, tmp_path / "model.json")
    ran = command(monkeypatch, "export", 120)(
        "fmu", tmp_path / "model.json", "--servo", "setpoint", "--out", tmp_path / "out", "--compiler", "none"
    )
    assert ran.exit_code == 0, ran.stderr
    assert (tmp_path / "out" / "servo_1_servo.fmu").exists()
