"""What was wrong with the bench is named as that: zeros, drifts and labels, of a test, a run or a condition, beside effects too."""

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers.small_bench import CONDITIONS, VALVE, small_record
from helpers.small_diagnosis import LIBRARY, opened, small_case

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.diagnosis.confirmation import fit_of_rows_left
from thermohyd.identify.diagnosis.diagnose import diagnose_case
from thermohyd.identify.diagnosis.result import DiagnosisResult
from thermohyd.identify.diagnosis.screening_faults import fault_columns
from thermohyd.identify.fitting.bench_faults import corrected, faults_of, is_fault
from thermohyd.identify.reduction.bad_rows import without_rows
from thermohyd.identify.report.diagnosis_words import fault_lines


def changed(record: BenchRecord, *names: str, by: Callable[[TestRecord], TestRecord]) -> BenchRecord:
    return replace(record, tests={n: by(t) if n in names else t for n, t in record.tests.items()})


def read_more(test: TestRecord, more: np.ndarray | float) -> TestRecord:
    return replace(test, channels=tuple(replace(c, value=c.value + more) for c in test.channels))


def zeroed_anew(record: BenchRecord) -> BenchRecord:
    return changed(record, "pressure_gain", by=lambda t: replace(t, spool_position=t.spool_position + 1e-6))


def drifting(record: BenchRecord) -> BenchRecord:
    def drift(test: TestRecord) -> TestRecord:
        # Every run of this bench starts its clock anew: the time is that of the runs, one after the other.
        assert test.time is not None
        spans = np.array([test.time[test.run == run].max() for run in np.unique(test.run)])
        elapsed = test.time + np.append(0.0, np.cumsum(spans)[:-1])[test.run]
        return read_more(test, 0.05 / 6e4 * elapsed / elapsed.max())

    return changed(record, "leakage", by=drift)


def labelled_wrong(record: BenchRecord) -> BenchRecord:
    cold, low = CONDITIONS[0]
    wrong = lambda t: t.temperature + 8.0 * ((t.temperature == cold) & (t.supply_pressure == low))
    return changed(record, *record.tests, by=lambda t: replace(t, temperature=wrong(t)))


def gauge_wrong(record: BenchRecord) -> BenchRecord:
    wrong = lambda t: t.supply_pressure * np.where(t.run == 1, 1.03, 1.0)
    return changed(record, "flow_gain", by=lambda t: replace(t, supply_pressure=wrong(t)))


def one_run_off(record: BenchRecord) -> BenchRecord:
    return changed(record, "leakage", by=lambda t: read_more(t, 0.03 / 6e4 * (t.run == 3)))


BENCHES: dict[str, tuple[Callable[[BenchRecord], BenchRecord], dict[str, object], float]] = {
    "zeroed anew": (zeroed_anew, {"name": "position_zero", "test": "pressure_gain", "run": None}, 1e-6),
    "drifting": (drifting, {"name": "reading_drift", "test": "leakage", "channel": "leakage_flow"}, 0.05 / 6e4),
    "labelled wrong": (labelled_wrong, {"name": "wrong_temperature", "test": "", "run": "8 degC"}, 8.0),
    "gauge wrong": (gauge_wrong, {"name": "wrong_supply", "test": "flow_gain", "channel": ""}, 0.03 * 216.3e5),
    "one run off": (one_run_off, {"name": "reading_zero", "test": "leakage", "run": "3"}, 0.03 / 6e4),
}


def diagnosed(spoil: Callable[[BenchRecord], BenchRecord], **made: object) -> DiagnosisResult:
    return diagnose_case(opened(spoil(small_record(**made))))  # pyright: ignore[reportArgumentType]


BY_NIGHT = [pytest.param(name, marks=pytest.mark.nightly) for name in [*BENCHES][1:]]


@pytest.mark.parametrize("name", [next(iter(BENCHES)), *BY_NIGHT])
def test_a_fault_is_no_effect_of_the_valve(name):
    spoil, expected, amount = BENCHES[name]
    result = diagnosed(spoil)
    assert result.verdict == "consistent"
    assert result.effects == ()
    [fault] = result.to_dict()["faults"]
    assert {key: fault[key] for key in expected} == expected
    assert fault["value"] == pytest.approx(amount, rel=0.15)
    assert abs(fault["value"] - amount) < 4.0 * fault["std"]
    assert fault["p_value"] < 1e-4
    assert fault["rows"] == []
    assert result.headline.lower().startswith(f"{fault['sentence'].lower()}; with it nothing remains")
    assert fault["gap_closed"] > 0.5
    held = result.held_out
    assert held is not None
    assert [credit.group for credit in held.credit] in ([], ["faults"])
    assert result.instead is None
    # What is no property of the valve stays out of it.
    assert not any(map(is_fault, result.after.parameters))
    assert not any(map(is_fault, result.after.free))
    assert len(result.after.covariance) == len(result.after.free)
    assert "|" not in json.dumps(result.model.__dict__, default=str)


def test_the_clock_of_a_drift_is_the_bench_s_where_it_goes_on_from_run_to_run():
    """A bench that reads several tests in a row starts none of their clocks at zero."""
    test = small_record().tests["leakage"]
    assert test.time is not None
    going_on = replace(test, time=1000.0 + 40.0 * test.run + test.time / 100.0)
    fault = next(f for f in faults_of({"leakage": going_on}).values() if f.kind == "reading_drift")
    time = np.asarray(going_on.time)
    np.testing.assert_allclose(fault.shapes["leakage"], fault.size * (time - time[0]) / np.ptp(time), rtol=1e-12)


@pytest.mark.nightly  # a whole diagnosis
def test_a_fault_and_an_effect_are_both_found():
    result = diagnosed(zeroed_anew, effects={"hysteresis": 1e-6, "flowmeter_offset": 2e-7}, seed=2)
    assert result.verdict == "named"
    assert {effect.name for effect in result.effects} == {"hysteresis", "flowmeter_offset"}
    [fault] = result.after.faults
    assert (fault.name, fault.test) == ("position_zero", "pressure_gain")
    assert fault.value == pytest.approx(1e-6, rel=0.1)
    assert any(fault.sentence in sentence for sentence in result.sentences)
    assert result.proof is not None
    assert result.proof > 100.0
    held = result.held_out
    assert held is not None
    names, faults = held.credit
    assert (names.group, faults.group) == ("names", "faults")
    assert names.share + faults.share == pytest.approx(held.gap_closed)
    assert 0.0 < names.share < held.gap_closed
    assert f"{100.0 * names.share:.0f} % of the gap on rows held out" in result.headline
    assert result.instead is None


@pytest.mark.nightly  # a whole diagnosis
def test_a_zero_that_is_the_same_curve_as_a_leak_is_its_rival():
    """At one supply pressure the first stage's leakage is a constant, and so is a meter's zero: a hidden record of the one was named as
    the other, for certain."""

    def at_one_pressure(record: BenchRecord) -> BenchRecord:
        others = lambda t: np.flatnonzero(t.supply_pressure != CONDITIONS[1][1]).tolist()
        return changed(record, *record.tests, by=lambda t: without_rows(t, others(t)))

    # These flow gains cannot tell flowmeter_offset from it either.
    names = tuple(name for name in LIBRARY if name != "flowmeter_offset")
    for spoil, effects in (
        (at_one_pressure, {"pilot_leakage": 1e-11}),
        (lambda record: at_one_pressure(changed(record, "leakage", by=lambda t: read_more(t, 4.6e-8))), {}),
    ):
        result = diagnose_case(opened(spoil(small_record(effects, seed=1)), names))
        assert result.verdict == "ambiguous"
        [effect] = result.effects
        assert effect.name == "pilot_leakage"
        assert any(a.name == "reading_zero" and a.where.startswith("leakage") for a in effect.alternatives)


@pytest.mark.nightly  # a whole diagnosis
def test_several_runs_with_a_fault_each_are_a_misfit_that_nothing_explains():
    shifts = lambda t: 0.03 / 6e4 * (t.run == 3) - 0.04 / 6e4 * (t.run == 6)
    result = diagnosed(lambda record: changed(record, "leakage", by=lambda t: read_more(t, shifts(t))))
    assert {(fault.name, fault.run) for fault in result.after.faults} == {("reading_zero", "3"), ("reading_zero", "6")}
    assert all(fault.sentence in line for fault, line in zip(result.after.faults, fault_lines(result), strict=True))
    assert result.effects == ()
    assert result.verdict == "unexplained"
    assert all(any(f.sentence in sentence for sentence in result.sentences) for f in result.after.faults)


def test_columns_of_faults_are_those_of_the_model():
    """Each against a difference of two whole models."""
    case = small_case("nothing")
    problem, base = case.problem, case.base
    names = [next(n for n, f in problem.faults.items() if f.kind == kind) for kind in
             ("position_zero", "reading_zero", "reading_drift", "wrong_temperature", "wrong_supply")]  # fmt: skip
    columns = fault_columns(problem, base, names)
    for name in names:
        step = 0.01 * problem.faults[name].info.scale
        more, less = (
            problem.evaluate({**base.values, name: sign * step}, (name,)).residual[: len(base.residual)]
            for sign in (1.0, -1.0)
        )
        slope = (more - less) / (2.0 * step)
        np.testing.assert_allclose(columns[name], slope, atol=2e-3 * np.abs(slope).max(), rtol=0.0)
        fitted = problem.fit([name], base.values)
        np.testing.assert_allclose(fitted.column(name), slope, atol=1e-2 * np.abs(slope).max(), rtol=0.0)


def test_columns_of_many_faults_beside_each_other():
    """Several runs' zeros and a label in one model, noise with a memory."""
    case = small_case("correlated")
    problem = case.problem
    zeros = [name for name, fault in problem.faults.items() if fault.kind == "position_zero" and fault.place][:4]
    label = next(name for name, fault in problem.faults.items() if fault.kind == "wrong_temperature")
    values = case.base.values | {name: 0.5 * problem.faults[name].info.scale for name in (*zeros, label)}
    together = problem.evaluate(values, (*zeros, label))
    for name in (*zeros, label):
        others = {other: value for other, value in values.items() if other != name}
        step = 0.01 * problem.faults[name].info.scale
        more, less = (
            problem.evaluate({**others, name: values[name] + sign * step}, (*zeros, label)).residual
            for sign in (1.0, -1.0)
        )
        slope = (more - less) / (2.0 * step)
        np.testing.assert_allclose(together.column(name), slope, atol=1e-4 * np.abs(slope).max(), rtol=0.0)


def test_every_fault_is_of_rows_of_its_own():
    """Of a level that one run alone has, the level, the test and the run are one fault."""
    faults = faults_of(labelled_wrong(small_record()).tests)
    seen = set()
    for fault in faults.values():
        rows = tuple((test, (shape != 0.0).tobytes()) for test, shape in sorted(fault.shapes.items()))
        assert (fault.kind, fault.channel, rows) not in seen
        seen.add((fault.kind, fault.channel, rows))
        assert fault.among == sum(other.kind == fault.kind for other in faults.values())
    assert any(fault.place == "8 degC" and not fault.test for fault in faults.values())


def test_labels_that_several_faults_move_stay_possible():
    """Of a run, a level and a test together, each at its limit: a refit of rivals asked for oil at 138 K and ended in a traceback."""
    tests = labelled_wrong(small_record()).tests
    faults = faults_of(tests)
    for kind, most in (("wrong_temperature", 60.0), ("wrong_supply", 0.5)):
        of_kind = [fault for fault in faults.values() if fault.kind == kind]
        for side in (1.0, -1.0):
            moved = corrected(tests, dict.fromkeys(of_kind, side * most))
            for name, test in moved.items():
                assert np.all((test.temperature >= 150.0) & (test.temperature <= 700.0))
                assert np.all(test.supply_pressure > 0.0)
                assert np.all(test.supply_pressure >= 0.05 * tests[name].supply_pressure)
    one = next(fault for fault in faults.values() if fault.kind == "wrong_temperature")
    name, shape = next(iter(one.shapes.items()))
    np.testing.assert_allclose(
        corrected(tests, {one: 8.0})[name].temperature, tests[name].temperature - 8.0 * shape, rtol=0, atol=1e-12
    )


def test_one_temperature_cannot_be_labelled_wrong():
    """A thermometer that is wrong everywhere is an effect of the library."""
    record = changed(
        small_record(), *small_record().tests, by=lambda t: replace(t, temperature=0.0 * t.temperature + 303.15)
    )
    assert not any(fault.kind == "wrong_temperature" for fault in faults_of(record.tests).values())


def test_of_two_tests_whose_zeros_differ_either_may_be_off():
    """The null was told from the one that was off, 112 of its errors away."""
    whole = changed(small_record(), "flow_gain", by=lambda t: replace(t, spool_position=t.spool_position + 1e-6))
    record = replace(whole, tests={name: whole.tests[name] for name in ("leakage", "flow_gain")})
    result = diagnose_case(opened(record))
    [fault] = result.after.faults
    assert fault.name == "position_zero"
    [other] = {"leakage", "flow_gain"} - {fault.test}
    assert f"position_zero ({other.replace('_', ' ')})" in fault.alternatives
    assert "as much the other way: these data cannot say which" in fault.sentence
    null = result.after.parameters["null_bias"]
    assert null.ci95 is not None
    assert null.ci95[0] < VALVE.null_bias < null.ci95[1]
    assert null.ci95[1] - null.ci95[0] > 1e-6


def test_a_fault_of_the_only_run_that_is_left_is_left_out():
    """It says that a run differs from the others: of a real valve's two sweeps the one that was left took up half of the supply pressure,
    and the other was predicted worse than by the ideal valve."""
    case = opened(one_run_off(small_record()))
    [name] = [
        name
        for name, f in case.problem.faults.items()
        if f.kind == "reading_zero" and f.test == "leakage" and f.place == "3"
    ]
    found = case.problem.fit([name], case.base.values)
    leakage = case.problem.tests["leakage"].run
    rows = case.problem.rows()["leakage", "leakage_flow"]
    used = np.ones(sum(test.rows for test in case.problem.tests.values()), dtype=bool)
    used[rows] = leakage == 3
    alone = fit_of_rows_left(case.problem.with_rows(used), [name], found.values)
    assert alone.effects == ()
    used[rows] = leakage != 0
    beside = fit_of_rows_left(case.problem.with_rows(used), [name], found.values)
    assert beside.values[name] == pytest.approx(found.values[name], rel=0.2)
