"""Leakage alone, noise not stated: what the record does not determine is held near what is usual, and said; what it does stays."""

from dataclasses import replace
from pathlib import Path

import pytest
from reference.raw_log_records import Log, Setting, any_setting, write
from reference.valve import Valve

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.record import BenchRecord, StartValue
from thermohyd.identify.fitting.fit import fit, fit_and_fitted, with_intervals
from thermohyd.identify.fitting.outcome import fit_result
from thermohyd.identify.report.fit_json import fit_json
from thermohyd.identify.report.fit_report import parameter_remarks


NAMES = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
COLD = replace(any_setting(1), grade=68, supply=70e5, temperature=298.15, noise=2.0)  # laminar everywhere


def record_of(folder: Path, setting: Setting) -> BenchRecord:
    write(folder, Log(4000, ("leakage",), 3), setting=setting)
    return read_record(folder)


@pytest.fixture(scope="module")
def cold(tmp_path_factory):
    record = record_of(tmp_path_factory.mktemp("cold"), COLD)
    return record, *fit_and_fitted(record)


def test_what_the_record_does_not_determine_is_held_near_what_is_usual(cold):
    _, result, _ = cold
    assert result.converged
    for name in NAMES:
        found, true = result.parameters[name], float(getattr(COLD.valve, name))
        assert found.std, name
        assert abs(found.value - true) < 3.0 * found.std, name
    found = result.parameters["discharge_coefficient"]
    assert (found.start, found.prior_std) == (0.675, 0.0375)
    assert found.ci95[0] == pytest.approx(0.60, abs=0.01)
    assert found.ci95[1] == pytest.approx(0.75, abs=0.01)


def test_it_is_said_with_the_line_that_changes_it(cold):
    _, result, _ = cold
    (line,) = [line for line in parameter_remarks(result) if line.startswith("discharge_coefficient")]
    assert line.startswith("discharge_coefficient and transition_number: ")
    assert "0.60 to 0.75 and up to 300" in line
    assert '"discharge_coefficient = { value = 0.7, std = 0.2 }" in [start] of bench.toml' in line
    assert fit_json(result)["parameters"]["discharge_coefficient"]["prior_because"] in line


@pytest.mark.parametrize("given", [StartValue(0.7), StartValue(0.8, prior_std=0.1)])
def test_the_users_word_stands(cold, given):
    record, *_ = cold
    found = fit(replace(record, start={"discharge_coefficient": given}), starts=1).parameters["discharge_coefficient"]
    assert (found.prior_std, found.prior_because) == (given.prior_std, "")


@pytest.mark.parametrize("coefficient", [0.7, 0.95])
def test_readings_that_know_better_are_left_alone(tmp_path, coefficient):
    result = fit(record_of(tmp_path, Setting(Valve(discharge_coefficient=coefficient), supply=210e5, noise=0.2)))
    assert not any(p.prior_because or p.prior_std for p in result.parameters.values())
    found = result.parameters["discharge_coefficient"]
    assert found.std is not None
    assert found.std < 0.0375
    assert found.value == pytest.approx(coefficient, abs=4.0 * found.std)


def test_an_end_near_an_optimum_keeps_its_error_bars_and_says_how_near(cold):
    _, result, fitted = cold
    message = (
        "the limit of 500 steps was reached, yet the slope is not zero (still 0.12 standard errors from an optimum)"
    )
    short = replace(fitted.solution, converged=False, nearly=True, relative_offset=0.12, message=message)
    found = fit_result(replace(fitted, solution=short))
    assert found.converged
    assert found.message.startswith("converged to 0.12 standard errors")
    assert any("0.12 standard errors" in note for note in found.notes)
    assert all(p.std for p in found.parameters.values())
    assert not any("0.12" in note for note in result.notes)
    # The search for intervals takes it for an optimum too.
    assert with_intervals(replace(fitted, solution=short), None)[1].converged
    far = fit_result(replace(fitted, solution=replace(short, nearly=False, relative_offset=0.4)))
    assert not far.converged
    assert not any(p.std for p in far.parameters.values())


def test_the_benchmark_counts_what_holds_the_truth(cold, of_benchmarks, monkeypatch):
    module = of_benchmarks("hidden_raw_logs")
    monkeypatch.setattr(module, "fit", lambda record: cold[1])
    monkeypatch.setattr(module, "any_setting", lambda seed, coefficient: COLD)
    lines = module.leakage_alone(1, 1, rows=400)
    assert "converged: 1 of 1; flow coefficients held near the usual in 1" in lines
    assert sum("interval given 1" in line for line in lines) == len(NAMES)
    assert lines[-1].startswith("intervals that hold the truth: ")
