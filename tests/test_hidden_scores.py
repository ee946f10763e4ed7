"""The scores of the hidden-effect records: what counts as found, on answers made up for the purpose."""

import importlib
from typing import Any

import pytest


PARAMETERS = {
    "edge_radius": 1e-5,
    "clearance": 3e-6,
    "underlap": 5e-6,
    "discharge_coefficient": 0.7,
    "transition_number": 100.0,
    "null_bias": 0.0,
}


@pytest.fixture
def scores(of_benchmarks):
    return of_benchmarks("_hidden_scores")


def named(name, *alternatives, value=1.0, strength=10.0):
    others = [{"name": a, "value": value, "chi2_more": 0.1} for a in alternatives]
    return {
        "name": name,
        "value": value,
        "ci95": [value - 0.5, value + 0.5],
        "strength": strength,
        "alternatives": others,
    }


def made(scores, effects, hidden, *, kind="single", verdict="named", ports=False, gap=1.3, shift=0.0, held=None):
    truth = {
        "kind": kind,
        "effects": hidden,
        "outside": {"name": "slot_narrows"} if kind == "outside" else None,
        "parameters": PARAMETERS,
        "ports_measured": ports,
        "noise": "white",
        "noise_declared": True,
        "strength": "weak" if kind == "single" else "",
        "delta": 10.0,
    }
    width = {n: 0.1 * (abs(v) or 1e-6) for n, v in PARAMETERS.items()}
    parameters = {n: {"value": v, "ci95": [v + shift - width[n], v + shift + width[n]]} for n, v in PARAMETERS.items()}
    answer = {
        "record": "bench_01",
        "verdict": verdict,
        "effects": effects,
        "gap_before": gap,
        "gap_after": 1.0,
        "held_out": held or {"rows": 800, "before": 0.3, "after": 0.0, "reduced_chi2_after": 1.0},
        "parameters": parameters,
        "seconds": 1.0,
    }
    return scores.Case(truth, answer)


def test_the_true_name_is_right(scores):
    case = made(scores, [named("hysteresis")], {"hysteresis": 1.0})
    assert case.first_right
    assert case.inside
    assert case.names == 1
    assert case.model_right
    assert case.left_over == 0.0
    assert case.covered() == [True] * 7


def test_a_wrong_name_is_wrong_even_beside_the_truth(scores):
    case = made(scores, [named("flowmeter_lag", "hysteresis")], {"hysteresis": 1.0})
    assert not case.first_right
    assert case.inside
    assert case.names == 2


def test_an_exact_rival_counts_only_with_the_truth_among_its_alternatives(scores):
    truth = {"flow_saturation": 1.0}
    assert made(scores, [named("return_back_pressure", "flow_saturation")], truth).first_right
    assert not made(scores, [named("return_back_pressure")], truth).first_right


def test_worn_edges_are_no_rivals_where_both_ports_are_measured(scores):
    effects, truth = [named("return_edge_wear", "supply_edge_wear")], {"supply_edge_wear": 1.0}
    assert made(scores, effects, truth).first_right
    assert not made(scores, effects, truth, ports=True).first_right


def test_two_hidden_effects_need_two_names(scores):
    hidden = {"flow_saturation": 1.0, "viscosity_shift": 1.0}
    both = [named("viscosity_shift"), named("return_back_pressure", "flow_saturation")]
    assert made(scores, both, hidden, kind="pair").both_found
    one = [named("viscosity_shift", "flow_saturation")]
    assert not made(scores, one, hidden, kind="pair").both_found
    assert made(scores, one, hidden, kind="pair").inside


def test_nothing_named_leaves_the_whole_gap(scores):
    case = made(scores, [], {"hysteresis": 1.0}, verdict="consistent")
    assert not case.first_right
    assert not case.inside
    assert case.left_over == 1.0


def test_closed_means_down_to_the_noise_of_the_held_out_rows(scores):
    outside: dict[str, Any] = {"kind": "outside", "verdict": "named"}
    for left, closed in ((1.05, True), (1.2, False)):
        held = {"rows": 800, "before": 5.0, "after": left - 1.0, "reduced_chi2_after": left}
        assert made(scores, [named("hysteresis")], {}, held=held, **outside).really_closed is closed
    assert not made(scores, [], {}, **outside).really_closed


def test_the_mirror_image_of_unequal_laps_is_the_same_valve(scores):
    case = made(scores, [named("unequal_underlap", value=-2e-6)], {"unequal_underlap": 2e-6})
    assert case.mirrored().truth["effects"] == {"unequal_underlap": -2e-6}
    assert case.mirrored().truth["parameters"]["underlap"] == pytest.approx(7e-6)
    measured = made(scores, [named("unequal_underlap", value=-2e-6)], {"unequal_underlap": 2e-6}, ports=True)
    assert measured.mirrored() is measured


def test_the_tables_take_every_kind_of_case(scores):
    tables = importlib.import_module("_hidden_tables")
    cases = [
        made(scores, [], {}, kind="none", verdict="consistent", gap=1.0),
        made(scores, [named("hysteresis")], {"hysteresis": 1.0}),
        made(scores, [named("flowmeter_lag")], {"hysteresis": 1.0}, shift=1.0),
        made(scores, [named("hysteresis"), named("pilot_leakage")], {"hysteresis": 1.0, "pilot_leakage": 1.0}, kind="pair"),
        made(scores, [named("flow_saturation")], {}, kind="outside", verdict="unexplained"),
    ]  # fmt: skip
    text = tables.table(cases, {"bench_09": "ValueError: no"})
    assert "| detectable singles named first | 1/2 (50 %) |" in text
    assert "| no effect, named all the same | 0/1 (0 %) |" in text
    assert "| both of two found | 1/1 (100 %) |" in text
    assert "bench_09: ValueError: no" in text
    assert "hysteresis (10.0)" in text.split("not exactly what was hidden")[1]
