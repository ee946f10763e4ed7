"""One record with every kind of test, all the way: fit, diagnose, simulate, and all that they print, write and draw."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from helpers.commands import command
from reference.sample_whole_servo import JACK, SERVO, VALVE

from thermohyd.data import sample_record
from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting.fit import fit, run_fit, static_values
from thermohyd.identify.fitting.fit_motion import run_fit_motion
from thermohyd.identify.fitting.parameters import IN_MOTION
from thermohyd.identify.report.fit_figures import parameter_figure, test_figures as draw_tests
from thermohyd.identify.report.picture import address


pytestmark = pytest.mark.nightly  # a whole record with both kinds of tests, fitted and diagnosed


FOLDER = sample_record("whole_servo")
TESTS = ("leakage", "pressure_gain", "flow_gain", "step_fast", "step_slow", "frequency")
VALVES_OWN = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
TRUTH = {n: getattr(VALVE, n) for n in VALVES_OWN} | {n: getattr(JACK, n) for n in IN_MOTION}
READINGS = {
    "leakage": ["leakage_flow"],
    "pressure_gain": ["load_pressure"],
    "flow_gain": ["flow"],
    "step_fast": ["spool_position", "pressure_a", "pressure_b", "piston_position"],
    "step_slow": ["pressure_a", "pressure_b", "piston_position"],
    "frequency": ["amplitude_ratio", "phase"],
}
UNITS = {
    "leakage_flow": "l/min", "flow": "l/min", "load_pressure": "bar", "pressure_a": "bar", "pressure_b": "bar",
    "spool_position": "um", "piston_position": "mm", "amplitude_ratio": "1", "phase": "deg",
}  # fmt: skip


class Run:
    """A command that ran with --out and --json: what it said and what it wrote."""

    def __init__(self, name: str, out: Path) -> None:
        with pytest.MonkeyPatch.context() as patch:
            self.ran = command(patch, name, 140)(FOLDER, "--out", out, "--json")
        assert self.ran.exit_code == 0, self.ran.stderr
        self.out = out
        self.content = json.loads(self.ran.stdout)
        self.files = {file.name for file in out.iterdir()}
        self.page = (out / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def record():
    return read_record(FOLDER)


@pytest.fixture(scope="module")
def fitted(record):
    return fit(record)


@pytest.fixture(scope="module")
def fit_run(tmp_path_factory):
    return Run("fit", tmp_path_factory.mktemp("fit"))


@pytest.fixture(scope="module")
def diagnose_run(tmp_path_factory):
    return Run("diagnose", tmp_path_factory.mktemp("diagnosis"))


def test_the_record_has_two_step_tests_of_different_rates(record):
    assert tuple(record.tests) == TESTS
    assert not record.warnings
    steps = [test for test in record.tests.values() if test.name.startswith("step")]
    assert [np.diff(test.place[:2])[0] for test in steps] == pytest.approx([1e-3, 6e-3])
    assert [len(test.run_names) for test in steps] == [len(plan.steps) for plan in SERVO.steps.values()]
    assert {name: [c.name for c in test.channels] for name, test in record.tests.items()} == READINGS


def test_the_truth_lies_inside_the_intervals(fitted):
    assert fitted.converged, fitted.message
    assert set(fitted.free) == set(TRUTH)
    for name, truth in TRUTH.items():
        estimate = fitted.parameters[name]
        assert estimate.ci95 is not None
        assert estimate.std is not None
        assert estimate.ci95[0] <= truth <= estimate.ci95[1], name
        assert estimate.std < 0.05 * truth, name
    assert 0.9 < fitted.reduced_chi2 < 1.1
    assert not fitted.warnings


def test_error_bars_are_joint(fitted):
    """What the valve's parameters may be is passed on to those of motion, and back."""
    i, j = fitted.free.index("discharge_coefficient"), fitted.free.index("viscous_friction")
    assert fitted.covariance[i, j] != 0.0
    assert np.linalg.eigvalsh(fitted.correlation).min() > 0.0


def test_holding_the_valve_claims_too_much(record, fitted):
    """The same fit of motion with the valve's parameters held at what the static tests gave has narrower error bars."""
    static = run_fit(record)
    alone = run_fit_motion(record, None, static_values(static), static.free)
    jacobian = alone.solution.jacobian
    for i, name in enumerate(alone.free):
        others = np.delete(jacobian, i, axis=1)
        left = jacobian[:, i] - others @ np.linalg.lstsq(others, jacobian[:, i], rcond=None)[0]
        assert 1.0 / np.linalg.norm(left) < 1.001 * fitted.parameters[name].std, name


def test_all_tests_are_in_the_result(record, fitted):
    assert {c.test for c in fitted.channels} == {*record.tests}
    assert fitted.rows == sum(t.rows for t in record.tests.values())
    assert "ideal valve" in fitted.verdict[0]
    assert any("actuator's model" in line for line in fitted.verdict)


def test_the_command_tells_the_same_test_by_test(fitted, fit_run):
    content = fit_run.content
    assert content == json.loads((fit_run.out / "fit.json").read_text(encoding="utf-8"))
    for name, estimate in fitted.parameters.items():
        assert content["parameters"][name]["value"] == pytest.approx(estimate.value, rel=1e-9)
    assert {test: list(channels) for test, channels in content["channels"].items()} == READINGS
    assert tuple(content["residual_rms"]) == tuple(content["noise"]) == TESTS
    assert content["rows"] == sum(test.rows for test in fitted.record.tests.values())
    assert set(content["parameters"]) == set(content["correlation"]) == set(content["covariance"]["of"]) == set(TRUTH)
    words = " ".join(fit_run.ran.stderr.split())
    for test, channels in READINGS.items():
        for channel in channels:
            assert f"{test}: {channel} is met to" in words
    for name in TRUTH:
        assert name in words
    assert "does not explain" not in words


def test_every_test_has_its_files_and_its_picture_on_the_page(fit_run, diagnose_run):
    figures = {f"{name}.{kind}" for name in (*TESTS, "parameters") for kind in ("png", "svg")}
    assert fit_run.files == figures | {"fit.json", "model.json", "report.html", ".thermohyd.json"}
    figures = {f"{name}.{kind}" for name in (*TESTS, "residual_map", "candidates") for kind in ("png", "svg")}
    assert diagnose_run.files == figures | {"diagnosis.json", "model.json", "report.html", ".thermohyd.json"}
    for run in (fit_run, diagnose_run):
        for test in TESTS:
            assert address((run.out / f"{test}.svg").read_bytes()) in run.page, test
            assert test in run.page


def test_each_step_test_is_drawn_by_itself(fitted):
    """All rows of a test and none of another's: one panel per reading and run, each as long as its run."""
    figures = draw_tests(fitted)
    for test, plan in SERVO.steps.items():
        figure = figures[test]
        panels = figure.axes
        assert len(panels) == len(plan.measured) * len(plan.steps)
        rows = round(plan.seconds / plan.spacing) + 1
        for panel in panels:
            bench = next(line for line in panel.lines if line.get_label() == "bench")
            time = np.asarray(bench.get_xdata())
            assert len(time) == rows
            assert time.max() == pytest.approx(plan.seconds)
        assert test.removeprefix("step_") in figure.texts[0].get_text()
    titles = [figures[test].texts[0].get_text() for test in SERVO.steps]
    assert len(set(titles)) == len(titles)


def test_the_cells_of_ten_correlations_do_not_run_into_each_other(fitted):
    figure = parameter_figure(fitted)
    figure.canvas.draw()
    matrix = next(axes for axes in figure.axes if axes.images)
    cell = matrix.get_window_extent().width / len(TRUTH)
    assert len(matrix.texts) == len(TRUTH) * (len(TRUTH) - 1)
    assert max(text.get_window_extent().width for text in matrix.texts) < cell


def test_nothing_is_missing_and_the_diagnosis_says_so(diagnose_run):
    content = diagnose_run.content
    assert content == json.loads((diagnose_run.out / "diagnosis.json").read_text(encoding="utf-8"))
    assert content["verdict"] == "consistent"
    assert content["effects"] == content["where"] == content["where_after"] == content["warnings"] == []
    assert content["left_over_p"] > 0.01
    for name, truth in TRUTH.items():
        estimate = content["fit"]["parameters"][name]
        assert abs(estimate["value"] - truth) < 3.0 * estimate["std"], name
    assert {(n["test"], n["channel"]) for n in content["noise"]} == {(t, c) for t, cs in READINGS.items() for c in cs}
    assert {test: list(channels) for test, channels in content["fit"]["channels"].items()} == READINGS
    names = [candidate["name"] for candidate in content["candidates"]]
    assert {"supply_edge_wear", "coulomb_friction", "spool_delay"} <= set(names)
    assert len(set(names)) == len(names)
    words = " ".join(diagnose_run.ran.stderr.split())
    assert "no disagreement beyond noise" in words


@pytest.mark.parametrize("name", ["fit_run", "diagnose_run"])
def test_the_fitted_model_predicts_every_test(record, name, tmp_path, monkeypatch, request):
    run = request.getfixturevalue(name)
    simulate = command(monkeypatch, "simulate", 140)
    ran = simulate(FOLDER, "--model", run.out / "model.json", "--out", tmp_path, "--json")
    assert ran.exit_code == 0, ran.stderr
    assert {file.name for file in tmp_path.iterdir()} == {".thermohyd.json", *(f"{test}.csv" for test in TESTS)}
    content = json.loads(ran.stdout)
    assert tuple(content) == (*TESTS, "notes", "outside_fitted_range")
    assert not content["notes"]
    assert not content["outside_fitted_range"]
    told = run.content.get("fit", run.content)["channels"]
    for test, channels in READINGS.items():
        table = pd.read_csv(tmp_path / f"{test}.csv")
        assert len(table) == record.tests[test].rows
        for channel in channels:
            column = f"{channel}_predicted [{UNITS[channel]}]"
            np.testing.assert_allclose(content[test][column], table[column], rtol=1e-8, atol=1e-12)
            gap = table[column] - table[f"{channel} [{UNITS[channel]}]"]
            rms = told[test][channel]["residual_rms"] * column_unit(channel).factor
            assert np.sqrt(np.mean(gap**2)) == pytest.approx(rms, rel=1e-3)
            spread = table[f"{channel}_predicted_std [{UNITS[channel]}]"].to_numpy(dtype=float)
            assert np.mean(spread > 0.0) > 0.9


def test_the_record_is_not_overwritten(fit_run, monkeypatch):
    ran = command(monkeypatch, "simulate", 140)(FOLDER, "--model", fit_run.out / "model.json", "--out", FOLDER)
    assert ran.exit_code == 2
    assert "would overwrite the record's own" in ran.stderr
