"""The scores of the real-bench records: which fault counts as right, and what a name is worth."""

import importlib

import pytest


PARAMETERS = dict.fromkeys(
    ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias"), 1.0
)
DRIFT = {"name": "reading_drift", "test": "flow_gain", "tests": ["flow_gain"], "runs": ["R7", "R8"], "channel": "flow",
         "amount": 1e-9, "conditions": [[40.0, 70.0], [40.0, 210.0]], "lines": []}  # fmt: skip
LABEL = {"name": "wrong_supply", "test": "", "tests": ["leakage", "flow_gain"], "runs": ["R2", "R8"], "channel": "",
         "amount": 2e5, "conditions": [[40.0, 210.0]], "lines": []}  # fmt: skip


@pytest.fixture
def scores(of_benchmarks):
    return of_benchmarks("_hidden_bench_scores")


def said(name, test="", run=None, channel=""):
    return {"name": name, "test": test, "run": run, "channel": channel}


def made(scores, *, kind="fault", verdict="named", named=(), hidden=None, faults=(), true=()):
    hidden = hidden or {}
    truth = {
        "kind": kind,
        "effects": hidden,
        "faults": list(true),
        "outside": None,
        "delta": 12.0,
        "delta_of": dict.fromkeys([*hidden, *(f["name"] for f in true)], 12.0),
        "parameters": PARAMETERS,
        "ports_measured": False,
        "noise": "white",
        "noise_declared": False,
        "raw_log": False,
        "rows": 800,
    }
    effects = [{"name": n, "value": 1.0, "ci95": [0.5, 1.5], "strength": 9.0, "alternatives": []} for n in named]
    answer = {
        "record": "bench_01",
        "verdict": verdict,
        "effects": effects,
        "faults": list(faults),
        "gap_before": 1.4,
        "gap_after": 1.0,
        "held_out": {"rows": 200, "before": 0.4, "after": 0.01, "reduced_chi2_after": 1.0},
        "parameters": {n: {"value": 1.0, "ci95": [0.8, 1.2]} for n in PARAMETERS},
        "seconds": 10.0,
    }
    return scores.BenchCase(truth, answer)


@pytest.mark.parametrize(
    ("answer", "true", "right"),
    [
        (said("reading_drift", "flow_gain", channel="flow"), DRIFT, True),
        (said("reading_drift", "flow_gain"), DRIFT, True),
        (said("reading_drift", "leakage", channel="leakage_flow"), DRIFT, False),
        (said("reading_zero", "flow_gain", channel="flow"), DRIFT, False),
        (said("wrong_supply", run="R8"), LABEL, True),
        (said("wrong_supply", "leakage", "R2, R3"), LABEL, True),
        (said("wrong_supply", "leakage", "R3"), LABEL, False),
        (said("wrong_supply", "pressure_gain", "R8"), LABEL, False),
        (said("wrong_supply", run="40 degC, 210 bar"), LABEL, True),
    ],
)
def test_a_right_fault_has_the_name_and_the_place(scores, answer, true, right):
    assert scores.is_right(answer, true) == right
    case = made(scores, faults=[answer], true=[true], verdict="consistent")
    assert case.fault_right == case.right == right
    assert len(case.false_faults) == (not right)


def test_what_unexplained_lists_is_a_suspect(scores):
    case = made(scores, kind="single", verdict="unexplained", named=["hysteresis"], hidden={"hysteresis": 1.0})
    assert not case.effects
    assert not case.first_right
    assert case.with_suspects.first_right
    assert not case.right


def test_an_effect_in_a_pure_fault_is_false(scores):
    case = made(scores, named=["hysteresis"], faults=[said("wrong_supply", run="R8")], true=[LABEL])
    assert case.fault_right
    assert case.false_names == 1
    assert not case.right


def test_the_table_has_every_rate_with_its_interval(scores):
    tables = importlib.import_module("_hidden_bench_tables")
    none = made(scores, kind="none", verdict="consistent")
    both = {"kind": "fault_with_effect", "hidden": {"hysteresis": 1.0}, "true": [LABEL]}
    right = made(scores, named=["hysteresis"], faults=[said("wrong_supply", run="R8")], **both)
    wrong = made(scores, named=["position_lag"], faults=[], **both)
    text = tables.table([none, right, wrong], {"bench_09": "TimeoutError"})
    assert "| nothing wrong: an effect named, or unexplained | 0/1 = 0 % (0 to 98) |" in text
    assert "| fault with effect: both right | 1/2 = 50 % (1 to 99) |" in text
    assert "| wrong_supply | 1/2 = 50 % (1 to 99) |" in text
    assert "position_lag (9.0)" in text.split("not exactly what is wrong")[1]
    assert "bench_09: TimeoutError" in text
