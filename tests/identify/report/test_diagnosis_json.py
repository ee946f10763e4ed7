"""`diagnosis.json` holds the keys of docs/bench_format.md section 8.3, in SI, as JSON that any reader accepts."""

import json
from dataclasses import replace

import pytest
from helpers.fake_diagnosis import ABSORBED, KINDS, fake_diagnosis, shared_diagnosis
from helpers.fake_fit import with_files

from thermohyd.identify.cli.several_records import Outcome
from thermohyd.identify.cli.several_results import json_of_several
from thermohyd.identify.diagnosis.result import Suspect
from thermohyd.identify.report.diagnosis_json import diagnosis_json
from thermohyd.identify.report.fit_json import json_text


def written(result) -> dict:
    text = json_text(diagnosis_json(result))
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} in the JSON"))


PROMISED = {
    "verdict",
    "where",
    "effects",
    "rejected",
    "absorbed",
    "gap_before",
    "gap_after",
    "held_out",
    "next_test",
    "fit",
}


@pytest.mark.parametrize("kind", KINDS)
def test_promised_keys(kind):
    content = written(fake_diagnosis(kind))
    assert set(content) >= PROMISED
    for region in content["where"]:
        assert set(region) >= {"test", "region", "excess_chi2", "share"}
        assert all(len(limits) == 2 for limits in region["region"].values())
    for effect in content["effects"]:
        assert set(effect) >= {"name", "parameter", "p_value", "gap_closed", "alternatives"}
        assert set(effect["parameter"]) == {"value", "unit", "std", "ci95"}
    assert all(set(entry) == {"name", "p_value", "gap_closed"} for entry in content["rejected"])
    assert set(content["held_out"]) >= {"before", "after"}
    assert set(content["fit"]) >= {"parameters", "correlation", "reduced_chi2", "residual_rms", "noise", "rows"}


def test_values_are_si():
    content = written(fake_diagnosis("named"))
    (effect,) = content["effects"]
    assert effect["parameter"]["value"] == pytest.approx(2.377e-9)
    assert effect["parameter"]["unit"] == "m3/s/sqrt(Pa)"
    assert content["where"][0]["region"] == {"spool_position": [pytest.approx(-203e-6), pytest.approx(203e-6)]}
    assert content["absorbed"] == list(ABSORBED)
    assert content["next_test"] is None


def test_a_rival_is_not_rejected():
    content = written(fake_diagnosis("ambiguous"))
    rivals = content["effects"][0]["alternatives"]
    assert rivals == ["bushing_leakage", "flowmeter_offset"]
    assert not set(rivals) & {entry["name"] for entry in content["rejected"]}
    assert content["next_test"].startswith("Repeat the leakage test at 210 bar")
    first, *_, last = content["next_tests_considered"]
    assert first == {"test": "leakage at 210 bar", "evidence": 64.0, "rows": 96, "seconds": 240.0}
    assert last["seconds"] is None


def test_who_closed_the_gap_and_what_is_handed_over():
    shared = shared_diagnosis()
    content = written(replace(shared, suspects=(Suspect("hysteresis", 1e-6, "m", 3.0, 0.2, 4.0, closes=(0.5, 0.02)),)))
    assert content["credit"][0] == {"group": "names", "first_in": 0.04, "last_in": 0.0, "share": 0.02}
    assert [credit["group"] for credit in content["credit"]] == ["names", "faults", "weights"]
    assert [fault["gap_closed"] for fault in content["faults"]] == [0.93, 0.05]
    assert content["handed_over"] == "ideal valve"
    assert content["suspects"][0]["closes"] == [0.5, 0.02]
    plain = written(fake_diagnosis("named", held_out=None))
    assert plain["credit"] == []
    assert plain["handed_over"] == "final model"


def test_nothing_held_out_and_nothing_known():
    result = fake_diagnosis("unexplained", held_out=None, left_over_p=float("nan"), gap_after=float("inf"))
    content = written(replace(result, critical_level=None))
    assert content["held_out"] is None
    assert content["left_over_p"] is None
    assert content["gap_after"] is None


def test_a_learned_term_is_marked_as_empirical():
    content = written(fake_diagnosis("learned"))
    assert content["variations"][0]["learned"] is True
    assert all(variation["empirical"] is True for variation in content["variations"])


def test_several_records():
    results = {"a": fake_diagnosis("named"), "b": fake_diagnosis("consistent")}
    content = json_of_several(Outcome(results, {"c": "no time"}))
    assert [record["folder"] for record in content["records"]] == ["a", "b"]
    assert content["records"][1]["verdict"] == "consistent"
    assert content["failed"] == [{"folder": "c", "reason": "no time"}]


def test_names_the_record():
    result = fake_diagnosis()
    content = written(replace(result, record=with_files(result.record)))
    assert content["record"]["path"] == "/bench/mine"
    assert content["record"]["files"][1] == {"name": "leakage.csv", "sha256": "cd" * 32, "rows": 800, "used": 790}
    assert content["geometry"]["slot_width"] == pytest.approx(12e-3)
    assert content["oil"]["name"] == "seed oil"
    assert content["conditions"] == {}
    assert content["fit"]["record"]["name"] == content["record"]["name"]
