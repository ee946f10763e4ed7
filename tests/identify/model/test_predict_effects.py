"""`simulate` with effects and learned terms in the model: against the reference, in pieces, with standard deviations."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from reference import static_tests as reference
from reference.oil import Oil, walther
from reference.valve import Effects, Rows, Valve

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord, ValveData
from thermohyd.identify.bench.sweeps import sweep_direction, sweep_rate
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.model import pieces, predict
from thermohyd.identify.model.learned_terms import LearnedTerm
from thermohyd.identify.model.model import Model
from thermohyd.identify.model.predict import as_static, predict_test
from thermohyd.identify.model.term_variables import of_the_oil, thinning
from thermohyd.identify.model.typed_term_file import typed_json, typed_term
from thermohyd.identify.model.typed_terms import KNOTS, TypedTerm, basis, entry_shifts, reading_shifts, slope_of_law
from thermohyd.identify.reduction.reduce import smooth_sweep
from thermohyd.oil_definition import OilDefinition


A, B = walther([[-40.0, 368.28], [100.0, 5.2244]])
BODY = ValveData("bench", 213e-6, 12e-3)
PARAMETERS = {
    "edge_radius": 8e-6,
    "clearance": 2.5e-6,
    "underlap": 6e-6,
    "discharge_coefficient": 0.68,
    "transition_number": 90.0,
    "null_bias": 1.2e-6,
}
EFFECTS = {
    "hysteresis": 2e-6,
    "position_lag": 0.3,
    "pilot_leakage": 1e-9,
    "flowmeter_scale": 0.03,
    "flowmeter_offset": 2e-7,
    "flowmeter_lag": 0.8,
}
ROWS = 44


def sweep(name: str = "leakage", rows: int = ROWS, time: bool = True) -> TestRecord:
    """Two cycles, two temperatures, two supply pressures; rates that differ."""
    s = np.resize(np.concatenate([np.linspace(-1, 1, 11), np.linspace(1, -1, 11)]), rows)
    run = (np.arange(rows) // 22).astype(int)
    clock = np.arange(rows) * 0.5 + 0.3 * np.sin(np.arange(rows))
    x = 60e-6 * s**3
    return TestRecord(
        name,
        Path(f"{name}.csv"),
        x,
        np.where(run % 2 == 0, 70e5, 140e5),
        np.full(rows, 2e5),
        np.where(run % 4 < 2, 293.15, 318.15) + np.linspace(0.0, 5.0, rows),
        (),
        run,
        tuple(str(r) for r in np.unique(run)),
        np.where(np.arange(rows) % 22 < 11, 1.0, -1.0),
        time=clock if time else None,
        rate=np.gradient(x, clock) if time else None,
    )


def model_of(**changes) -> Model:
    return Model(BODY, OilDefinition(A, B), PARAMETERS, **changes)


def record_of(test: TestRecord) -> BenchRecord:
    return BenchRecord(Path("bench"), "bench", BODY, OilDefinition(A, B), {test.name: test})


def by_reference(test: TestRecord, effects: dict[str, float], **valve) -> np.ndarray:
    rows = Rows(
        test.spool_position, test.supply_pressure, test.return_pressure, test.temperature, test.direction, test.time,
        test.run, rate=test.rate,
    )  # fmt: skip
    found = reference.TESTS[test.name](Valve(12e-3, **(PARAMETERS | valve)), Oil(A, B), rows, Effects(**effects))  # pyright: ignore[reportArgumentType]
    return found[reference.READING[test.name]]


def leakage(model: Model, test: TestRecord) -> tuple[np.ndarray, np.ndarray]:
    return predict_test(model, record_of(test), test)["leakage_flow"]


def test_effects_as_in_the_reference():
    test = sweep()
    found, std = leakage(model_of(effects=EFFECTS), test)
    np.testing.assert_allclose(found, by_reference(test, EFFECTS), rtol=1e-9)
    assert np.all(np.isnan(std))


def test_pieces_do_not_break_the_sweep(monkeypatch):
    test = sweep(rows=150)
    model = model_of(effects=EFFECTS, free=("flowmeter_lag", "hysteresis"), covariance=np.diag([1e-4, 1e-14]))
    whole = leakage(model, test)
    monkeypatch.setattr(pieces, "CHUNK", 64)
    for one, other in zip(whole, leakage(model, test), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    first = replace(
        test, **{f: getattr(test, f)[:66] for f in ("spool_position", "supply_pressure", "return_pressure", "temperature")},
        **{f: getattr(test, f)[:66] for f in ("run", "direction", "time", "rate")},
    )  # fmt: skip
    np.testing.assert_allclose(
        leakage(model, first)[0], whole[0][:66], rtol=1e-12
    )  # neither rows behind nor pads matter


def test_pieces_go_on_with_the_oil_stored_at_the_ports(monkeypatch):
    """A piece that started steady would miss the flow by 2e-4 of the largest behind its first row. Where a sweep is cut, its
    steps fall otherwise: of 40,000 rows in pieces of 16,384, readings lie 2e-10 apart, of these fewer rows 3e-9."""
    rows, chunk = 4000, 1500
    time, run = np.linspace(0.0, 400.0, rows), (np.arange(rows) >= 2200).astype(int)
    x = 60e-6 * np.sin(2.0 * np.pi * time / 333.0)
    test = TestRecord(
        "leakage", Path("leakage.csv"), x, np.full(rows, 140e5), np.full(rows, 2e5), np.full(rows, 313.15), (), run,
        ("1", "2"), sweep_direction(x, run), time=time, rate=sweep_rate(x, time, run),
    )  # fmt: skip
    model = model_of(
        effects={"port_compliance_a": 6e-13, "port_compliance_b": 5e-13, "hysteresis": 2e-6},
        free=("clearance", "port_compliance_a"),
        covariance=np.diag([1e-16, 1e-28]),
    )
    with quick_compile():
        whole = leakage(model, test)
        monkeypatch.setattr(pieces, "CHUNK", chunk)
        found = leakage(model, test)
    for one, other in zip(whole, found, strict=True):
        np.testing.assert_allclose(other, one, atol=2e-8 * np.max(np.abs(one)))


def test_standard_deviation_of_effects_and_parameters_together():
    names = ("flowmeter_lag", "clearance", "hysteresis", "flowmeter_scale")
    steps = np.array([1e-4, 1e-10, 1e-9, 1e-4])
    rng = np.random.default_rng(4)
    mix = rng.standard_normal((4, 4))
    covariance = (mix @ mix.T) * np.outer(steps, steps) * 100
    test = sweep()
    _, std = leakage(model_of(effects=EFFECTS, free=names, covariance=covariance), test)
    slopes = []
    for name, step in zip(names, steps, strict=True):
        ends = []
        for sign in (1.0, -1.0):
            moved = {name: (EFFECTS | PARAMETERS)[name] + sign * step}
            parts = {k: moved.get(k, v) for k, v in EFFECTS.items()}
            own = {k: v for k, v in moved.items() if k in PARAMETERS}
            ends.append(by_reference(test, parts, **own))
        slopes.append((ends[0] - ends[1]) / (2 * step))
    expected = np.sqrt(np.einsum("ir,ij,jr->r", np.array(slopes), covariance, np.array(slopes)))
    np.testing.assert_allclose(std, expected, rtol=1e-4)


def test_an_effect_that_does_nothing_needs_nothing():
    test = sweep(time=False)
    found, _ = leakage(model_of(effects={"flowmeter_lag": 0.0, "position_lag": 0.0}), test)
    np.testing.assert_allclose(found, by_reference(test, {}), rtol=1e-10)


@pytest.mark.parametrize("name", ["flowmeter_lag", "position_lag"])
def test_without_time_one_sentence(name):
    test = sweep(time=False)
    with pytest.raises(BenchInputError, match=f'leakage.csv: the model has a {name}, .* add the column "time"'):
        leakage(model_of(effects={name: 0.3}), test)


def test_pressures_know_no_flowmeter():
    test = sweep("pressure_gain", time=False)
    found, _ = predict_test(model_of(effects={"flowmeter_lag": 0.5}), record_of(test), test)["load_pressure"]
    np.testing.assert_allclose(found, by_reference(test, {}), rtol=1e-9)


TERMS = (
    LearnedTerm("discharge_coefficient", "temperature", 303.15, 15.0, (0.0, 0.1, 0.03)),
    LearnedTerm("discharge_coefficient", "direction", 0.0, 1.0, (0.0, 0.02)),
    LearnedTerm("viscosity", "supply_pressure", 105e5, 35e5, (0.0, 0.05)),
    LearnedTerm("null_bias", "temperature", 303.15, 15.0, (0.0, 1e-6)),
    LearnedTerm("clearance", "elapsed", 5.0, 5.0, (0.0, 0.05)),
)


def test_learned_terms_change_their_quantity_row_by_row():
    test = sweep()
    found, _ = leakage(model_of(learned=TERMS, effects={"viscosity_shift": 0.1}), test)
    s = np.clip((test.temperature - 303.15) / 15.0, -1.0, 1.0)
    assert test.time is not None
    elapsed = test.time - test.time[22 * test.run]
    expected = by_reference(
        test,
        {"viscosity_shift": 1.1 * (1.0 + 0.05 * (test.supply_pressure - 105e5) / 35e5) - 1.0},  # pyright: ignore
        discharge_coefficient=0.68 * (1.0 + 0.1 * s + 0.03 * (1.5 * s**2 - 0.5)) * (1.0 + 0.02 * test.direction),
        null_bias=1.2e-6 + 1e-6 * s,
        clearance=2.5e-6 * (1.0 + 0.05 * np.clip(elapsed / 5.0 - 1.0, -1.0, 1.0)),
    )
    np.testing.assert_allclose(found, expected, rtol=1e-9)


WOUND = TypedTerm(
    "position", "position", "local",
    tuple((1e-6 * np.random.default_rng(4).standard_normal(KNOTS)).tolist()), -90e-6, 90e-6, null_bias=1.2e-6,
)  # fmt: skip


def test_a_local_term_shifts_the_position_from_spot_to_spot():
    test = sweep()
    found, _ = leakage(model_of(learned=(WOUND,)), test)
    shift = np.interp(test.spool_position - 1.2e-6, np.linspace(WOUND.low, WOUND.high, KNOTS), WOUND.coefficients)
    np.testing.assert_allclose(found, by_reference(test, {}, null_bias=1.2e-6 - shift), rtol=1e-9)
    at, step = np.linspace(-94.7e-6, 95.1e-6, 37), 1e-10  # no knot among them
    law = lambda values: basis("local", values, WOUND.low, WOUND.high) @ np.asarray(WOUND.coefficients)
    np.testing.assert_allclose(
        slope_of_law(WOUND, at), (law(at + step) - law(at - step)) / (2 * step), rtol=1e-5, atol=1e-12
    )


def test_warmer_oil_in_the_valve_is_what_a_thermometer_that_is_off_does():
    test = sweep()
    term = TypedTerm("oil_temperature", "constant", "constant", (3.0,), 1.0, 1.0)
    found, _ = leakage(model_of(learned=(term,)), test)
    np.testing.assert_allclose(found, by_reference(test, {"temperature_offset": 3.0}), rtol=1e-9)


def test_a_clearance_that_each_edges_pressure_widens_is_what_pressure_clearance_is():
    """The variable is that of the last round, the library's law is solved with the ports: equal where the ports hardly move."""
    test, wider = sweep(), 1e-15
    term = TypedTerm("clearance", "pressure", "proportional", (wider,), 0.0, 210e5)
    plain, _ = leakage(model_of(), test)
    found, _ = leakage(model_of(learned=(term,)), test)
    known = by_reference(test, {"pressure_clearance": wider})
    np.testing.assert_allclose(found - plain, known - plain, atol=0.02 * np.abs(known - plain).max())


def test_oil_that_is_warmer_at_an_edge_is_thinner_there_by_its_own_law():
    test = sweep("pressure_gain")
    term = TypedTerm("oil_temperature:return", "pressure_drop", "proportional", (2e-7,), 0.0, 210e5)
    ports = {port: np.linspace(0.0, 60e5, test.rows) for port in ("pressure_a", "pressure_b")}
    ports["pressure_b"] = ports["pressure_b"][::-1]
    oil = of_the_oil(model_of().oil, test.temperature)
    found = entry_shifts(term, test, {"pressure_gain": ports | oil})
    assert set(found) == {"viscosity_at", "viscosity_bt"}
    for entry, port in (("viscosity_at", "pressure_a"), ("viscosity_bt", "pressure_b")):
        warmer = 2e-7 * (test.supply_pressure - ports[port])  # K, up to 2
        thin = lambda temperature: 1.0 / thinning(model_of().oil, temperature)
        wanted = thin(test.temperature + warmer) / thin(test.temperature) - 1.0
        assert wanted.min() < -0.03
        np.testing.assert_allclose(found[entry], wanted, rtol=0.05)  # the oil's own slope falls as it warms


def test_gauges_at_both_ports_go_each_with_its_own_pressure():
    test = sweep("pressure_gain")
    ports = {port: np.linspace(0.0, 60e5, test.rows) for port in ("pressure_a", "pressure_b")}
    ports["pressure_b"] = ports["pressure_b"][::-1]
    term = TypedTerm("reading:pressures", "pressure", "proportional", (0.01,), 0.0, 210e5)
    found = reading_shifts(term, test, {"pressure_gain": ports})
    assert set(found) == set(ports)
    for port, value in ports.items():
        np.testing.assert_allclose(found[port], 0.01 * value)
    alone = reading_shifts(replace(term, place="reading:pressure_a"), test, {"pressure_gain": ports})
    np.testing.assert_allclose(alone["pressure_a"], found["pressure_a"])


def test_a_local_term_reads_back_and_goes_with_the_position_alone():
    fail, number = BenchInputError, lambda value, words: float(value)
    entry = json.loads(json.dumps(typed_json(WOUND)))
    assert typed_term(entry, 1, (), fail, number) == WOUND
    with pytest.raises(BenchInputError, match="the law local is none of position with opening"):
        typed_term(entry | {"variable": "opening"}, 1, (), fail, number)
    with pytest.raises(BenchInputError, match="the law local is one of static tests"):
        typed_term(entry | {"moving": True}, 1, (), fail, number)


def test_a_term_that_follows_a_missing_column():
    with pytest.raises(BenchInputError, match=r'makes clearance follow elapsed, which needs the column "time"'):
        leakage(model_of(learned=TERMS), sweep(time=False))


def test_rows_without_a_steady_state_are_counted(monkeypatch):
    test = sweep()
    lost = np.where(np.arange(test.rows) < 3, np.nan, 1e-6)
    monkeypatch.setattr(predict, "predict_test", lambda *_: {"leakage_flow": (lost, np.zeros(test.rows))})
    found = predict.simulate(record_of(test), model_of())
    assert found.notes == ("leakage: 3 of 44 rows have no prediction: no steady state was found there",)


@pytest.mark.parametrize(
    ("name", "reading", "noise"), [("leakage", "leakage_flow", 3.3e-8), ("pressure_gain", "load_pressure", 3e4)]
)
def test_a_dithered_log_is_predicted_as_its_smooth_sweep(name, reading, noise):
    """Rounded to 0.2 um with as much dither, at 80 rows per second: to a tenth of a good bench's noise."""
    rows, step = 16_000, 0.2e-6
    x = 60e-6 * np.concatenate([np.linspace(-1.0, 1.0, rows // 2), np.linspace(1.0, -1.0, rows // 2)])
    rng = np.random.default_rng(1)
    logged = np.round((x + step * rng.normal(size=rows)) / step) * step
    time, run = np.arange(rows) / 80.0, np.zeros(rows, dtype=int)

    def log(position: np.ndarray) -> TestRecord:
        return TestRecord(
            name, Path(f"{name}.csv"), position, np.full(rows, 140e5), np.full(rows, 2e5), np.full(rows, 313.15), (), run,
            ("1",), sweep_direction(position, run), time=time, rate=sweep_rate(position, time, run),
        )  # fmt: skip

    effects = {"hysteresis": 2e-6, "position_lag": 0.3}
    model = as_static(model_of(effects=effects))
    smooth, exact = smooth_sweep(log(logged)), log(x)
    found = predict_test(model, record_of(smooth), smooth)[reading][0]
    wanted = predict_test(model, record_of(exact), exact)[reading][0]
    assert np.sqrt(np.mean((found - wanted) ** 2)) < 0.1 * noise


@pytest.mark.parametrize("test", ["leakage", "pressure_gain"])
def test_a_laminar_flow_between_the_ports_is_what_cross_port_leakage_is(test):
    """One that takes much of the load pressure: held at what the pressure was, the flow would overshoot the balance. The library counts
    its mass at the mean pressure, a term at each port."""
    leak = 5e-13
    term = TypedTerm("flow_from_a_to_b", "load", "laminar", (leak,), -150e5, 150e5)
    channel = {"leakage": "leakage_flow", "pressure_gain": "load_pressure"}[test]
    asked = lambda **changes: predict_test(model_of(**changes), record_of(sweep(test)), sweep(test))[channel][0]
    plain, known = asked(), asked(effects={"cross_port_leakage": leak})
    found = asked(learned=(term,))
    assert np.abs(known - plain).max() > (0.25 if test == "pressure_gain" else 0.01) * np.abs(plain).max()
    np.testing.assert_allclose(found, known, atol=5e-3 * np.abs(known - plain).max())
