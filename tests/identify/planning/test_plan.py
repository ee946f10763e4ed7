"""Planned sweeps are read, a small bench is planned with the short library, and the command says what it must."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import command
from helpers.html_page import Tags
from helpers.records import NOISE
from helpers.small_bench import small_record
from helpers.small_diagnosis import LIBRARY

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting.library import Library
from thermohyd.identify.planning import planned_problem, study
from thermohyd.identify.planning.planned_problem import prospect_of
from thermohyd.identify.planning.result import PlanResult


PLAN = """[valve]
name = "planned"
stroke = "213 um"
slot_width = "12 mm"
[oil]
preset = "mil-prf-5606"
[conditions]
return_pressure = "0 bar"
temperature = "40 degC"
[tests.leakage]
noise = "0.01 l/min"
zero = "0.5 %"
"""
SWEEPS = 'plan = { points = 9, supply_pressures = ["70 bar", "210 bar"], rates = ["5 um/s", "20 um/s"], repeats = 2 }\n'


def written(folder: Path, text: str) -> Path:
    (folder / "bench.toml").write_text(text)
    return folder


def test_planned_sweeps_are_rows_like_any_other(tmp_path: Path):
    record = read_record(written(tmp_path, PLAN + SWEEPS), readings_required=False)
    test = record.tests["leakage"]
    assert test.rows == 2 * 2 * 18
    assert len(test.runs) == 4
    assert test.spool_position.min() == pytest.approx(-213e-6)
    assert set(test.direction[test.run == 0]) == {-1.0, 1.0}
    assert test.rate is not None
    speed = lambda run: float(np.median(np.abs(test.rate[test.run == run])))  # pyright: ignore[reportOptionalSubscript]
    assert [speed(run) for run in range(4)] == pytest.approx([5e-6, 20e-6, 5e-6, 20e-6])
    assert set(test.temperature) == {313.15}
    assert test.channels == ()
    assert test.stated_noise == {"leakage_flow": pytest.approx(0.01 / 6e4)}
    with pytest.raises(BenchInputError, match="leakage_flow"):
        read_record(tmp_path)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('file = "a.csv"\n' + SWEEPS, "line 14, [tests.leakage] plan: stands beside a file; keep one"),
        ("plan = { point = 9 }", 'unknown key "point"; did you mean "points"?'),
        ("plan = { points = 3 }", "points: must be a whole number of 5 or more"),
        ('plan = { rates = ["0 um/s"] }', "rates: must all be positive"),
        ('plan = { supply_pressures = "70 bar" }', "supply_pressures: must be a list of quantities in brackets"),
        ('plan = { supply_pressures = ["70 l"] }', 'supply_pressures: "l" is a volume; expected a pressure'),
        ('plan = { supply_pressures = ["70 bar"], load_pressures = ["7 bar"] }', "is of load_flow only"),
        ('plan = { supply_pressures = ["70 bar"], points = 150000 }', "makes more than 200,000 rows"),
        ("plan = { points = 9 }", "supply_pressure"),
    ],
)
def test_what_is_wrong_with_a_plan(line: str, words: str, tmp_path: Path):
    with pytest.raises(BenchInputError) as caught:
        read_record(written(tmp_path, PLAN + line), readings_required=False)
    assert words in str(caught.value)


@pytest.fixture(scope="module")
def planned() -> PlanResult:
    """The small bench without its readings, stated noise, and a library of nine."""
    record = small_record()
    tests = {
        name: replace(
            test,
            channels=(),
            stated_noise={test.channels[0].name: NOISE[name]},
            stated_instrument=(0.01, None),
        )
        for name, test in record.tests.items()
    }
    tests["flow_gain"] = replace(tests["flow_gain"], stated_noise={})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planned_problem, "library_for", lambda tests: Library(LIBRARY, {"supply_droop": "not here"}))
        return study.plan(replace(record, tests=tests))


def test_what_a_small_bench_will_show(planned: PlanResult):
    for name in ("pilot_leakage", "hysteresis", "flowmeter_lag"):
        assert planned.effect(name).seen
        assert planned.effect(name).least > 0.0  # pyright: ignore[reportOptionalOperand]
    assert planned.effect("supply_droop").why == "not here"
    assert planned.effect("supply_droop").least is None
    assert planned.correlation.shape == (len(planned.order), len(planned.order))
    assert np.allclose(np.diag(planned.correlation), 1.0)
    assert planned.added[0].words
    assert all(a.per_hour >= b.per_hour for a, b in zip(planned.added, planned.added[1:], strict=False))
    known = {p.name: p for p in planned.parameters}
    assert known["leakage_flow_gain"].std <= 0.01  # pyright: ignore[reportOptionalOperand]
    assert known["clearance"].std < 0.1e-6  # pyright: ignore[reportOptionalOperand]
    sources = {r.test: r.source for r in planned.readings}
    assert sources["leakage"] == "stated in bench.toml"
    assert sources["flow_gain"] == "taken as 0.1 % of the largest reading"
    assert any("no noise is stated" in note for note in planned.notes)
    with pytest.raises(KeyError):
        planned.effect("nonsense")


def test_words_files_and_json(planned: PlanResult, tmp_path: Path):
    text = planned.summary()
    assert planned.headline.split(",")[0] in " ".join(text.split())
    assert max(map(len, text.splitlines())) <= 120
    written = {path.name for path in planned.save(tmp_path)}
    figures = {f"{name}.{kind}" for name in ("least", "confusion") for kind in ("png", "svg")}
    assert written == {"plan.json", "report.html"} | figures
    content = json.loads((tmp_path / "plan.json").read_text())
    assert content == planned.to_dict()
    assert content["effects"]["pilot_leakage"]["seen"] is True
    assert content["confusion"]["effects"] == list(planned.order)
    shown = (tmp_path / "report.html").read_text()
    assert shown.count("data:image/svg+xml") == 2
    assert "://" not in shown.replace("http://www.w3.org", "")
    assert "Planned tests" in " ".join(Tags(shown).words)
    assert planned.to_dataframe().loc["hysteresis", "seen"]


def test_records_without_a_static_test_are_refused():
    with pytest.raises(BenchInputError, match="has no static test to plan"):
        prospect_of(replace(small_record(), tests={}))


def test_both_ports_are_planned_where_their_noise_is_stated():
    record = small_record()
    test = replace(record.tests["pressure_gain"], channels=(), stated_noise={"pressure_a": 1e5, "pressure_b": 1e5})
    assert planned_problem._planned_channels(test) == ["pressure_a", "pressure_b"]
    assert planned_problem._planned_channels(replace(test, stated_noise={})) == ["load_pressure"]


def test_the_command(monkeypatch, planned: PlanResult, tmp_path: Path):
    bench = tmp_path / "bench"
    bench.mkdir()
    written(bench, PLAN + SWEEPS)
    monkeypatch.setattr(study, "plan", lambda record, model, progress: planned)
    ran = command(monkeypatch, "plan", 100)(bench, "--out", tmp_path / "out", "--json")
    assert ran.exit_code == 0
    assert json.loads(ran.stdout) == planned.to_dict()
    assert (tmp_path / "out" / "report.html").exists()
    ran = command(monkeypatch, "plan", 100)(tmp_path / "none", "--out", tmp_path / "other")
    assert ran.exit_code == 2
    assert "no such folder" in ran.stderr
    assert not (tmp_path / "other").exists()
