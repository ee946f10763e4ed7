"""A diagnosis as a model space: petab_select reads it, lists its models and searches them."""

import json
import warnings
from pathlib import Path
from typing import Any

import pytest
from helpers.commands import command
from helpers.fake_diagnosis import ABSORBED, fake_diagnosis

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.export.model_space import model_space
from thermohyd.identify.report.diagnosis_json import diagnosis_json
from thermohyd.identify.report.fit_json import json_text


with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of what petab_select imports
    import petab_select

ui: Any = petab_select.ui  # its types say less than its words
RIVALS = ("pilot_leakage", "bushing_leakage", "flowmeter_offset")


def content(kind: str = "ambiguous", tried: int | None = None) -> dict[str, Any]:
    """A diagnosis.json; tried: of so many effects that the record can show."""
    found = diagnosis_json(fake_diagnosis(kind))
    if tried is not None:
        testable = [c for c in found["candidates"] if c["state"] == "testable" and c["name"] not in RIVALS]
        found["candidates"] = testable[:tried]
    return found


def problem_of(made: Any, folder: Path) -> Any:
    for name, text in made.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return petab_select.Problem.from_yaml(folder / "petab_select_problem.yaml")


def chosen_by(model: Any) -> frozenset[str]:
    return frozenset(name for name, value in model.parameters.items() if value == "estimate")


@pytest.mark.filterwarnings("default")
def test_petab_select_lists_every_model_once(tmp_path):
    """Of three rivals no model has two, and each stands beside every choice of the others."""
    made = model_space(content(tried=3), method="brute_force")
    problem = problem_of(made, tmp_path)
    begun = ui.start_iteration(problem=problem)
    models = [chosen_by(model) for model in begun["uncalibrated_models"]]
    assert made.rivals == (RIVALS,)
    assert (len(made.effects), made.subspaces) == (6, 3)
    assert len(models) == len(set(models)) == (1 + len(RIVALS)) * 2**3
    assert all(len(model & set(RIVALS)) <= 1 for model in models)


@pytest.mark.filterwarnings("default")
def test_a_search_over_it_ends_at_the_best_model(tmp_path):
    made = model_space(content("two", tried=6), criterion="BIC")
    problem = problem_of(made, tmp_path)
    gains, candidates, asked = {"pilot_leakage": 300.0, made.effects[3]: 40.0}, None, 0
    while True:
        begun = ui.start_iteration(problem=problem, candidate_space=candidates)
        for model in begun["uncalibrated_models"]:
            misfit = 5000.0 - sum(gains.get(name, 0.5) for name in chosen_by(model))
            model.set_criterion(petab_select.Criterion.NLLH, 0.5 * misfit)
            model.compute_criterion(criterion=problem.criterion)
            asked += 1
        ended = ui.end_iteration(
            problem=problem, candidate_space=begun["candidate_space"], calibrated_models=begun["uncalibrated_models"]
        )
        if ended["terminate"]:
            break
        candidates = ended["candidate_space"]
    best = ui.get_best(problem=problem, models=problem.state.models)
    assert chosen_by(best) == set(gains)
    assert asked < 2 ** len(made.effects)


def test_limits_values_and_priors_stand_in_the_parameter_table():
    found = content("named")
    found["fit"]["parameters"]["null_bias"] |= {"prior_std": 1e-6, "start": 0.0}
    lines = model_space(found).files["parameters.tsv"].splitlines()
    rows = {line.split("\t")[0]: dict(zip(lines[0].split("\t"), line.split("\t"), strict=True)) for line in lines[1:]}
    clearance, about = rows["clearance"], found["fit"]["parameters"]["clearance"]
    assert [float(clearance[key]) for key in ("lowerBound", "upperBound", "nominalValue")] == [
        *about["bounds"],
        about["value"],
    ]
    assert rows["null_bias"]["objectivePriorParameters"] == "0.0;1e-06"
    assert float(rows["pilot_leakage"]["nominalValue"]) == found["effects"][0]["parameter"]["value"]
    assert not set(ABSORBED) & set(rows)
    held = {name for name, given in found["fit"]["parameters"].items() if given["fixed"]}
    assert {name for name, row in rows.items() if row["estimate"] == "0"} == held
    points = sum(c["points"] for test in found["fit"]["channels"].values() for c in test.values())
    assert len(model_space(found).files["measurements.tsv"].splitlines()) == points + 1


def test_what_is_no_diagnosis_is_refused():
    for given, options, words in (
        (content()["fit"], {}, "give the diagnosis.json"),
        (content(), {"criterion": "R2"}, "--criterion: unknown"),
        (content(), {"method": "guess"}, "--method: unknown"),
        (content("consistent") | {"candidates": []}, {}, "nothing to choose from"),
    ):
        with pytest.raises(BenchInputError, match=words):
            model_space(given, **options)


def test_the_command_writes_it(monkeypatch, tmp_path):
    (tmp_path / "diagnosis.json").write_text(json_text(content()), encoding="utf-8")
    run = command(monkeypatch, "export", 120)
    ran = run("select", tmp_path / "diagnosis.json", "--out", tmp_path / "out", "--json")
    assert ran.exit_code == 0, ran.stderr
    said = json.loads(ran.stdout)
    assert (said["rivals"], said["subspaces"]) == ([list(RIVALS)], 3)
    assert {path.name for path in (tmp_path / "out").iterdir()} > set(said["files"])
    assert run("select", tmp_path / "none.json", "--out", tmp_path / "bad").exit_code == 2
