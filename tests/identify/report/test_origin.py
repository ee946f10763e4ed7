"""What a page says of where it comes from, how to repeat it, and what to do next."""

import shlex
from dataclasses import replace

import pytest
from helpers.fake_comparison import fake_comparison
from helpers.fake_diagnosis import KINDS, fake_diagnosis
from helpers.fake_fit import fake_fit, with_files
from helpers.html_page import Tags
from typer.main import get_command

from thermohyd.data import sample_record
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.cli.commands import app
from thermohyd.identify.cli.loudness import Commands
from thermohyd.identify.comparison.report import next_steps
from thermohyd.identify.fleet.identity import look_at
from thermohyd.identify.report.next_steps import after_diagnosis, after_fit
from thermohyd.identify.report.origin import fingerprint, origin
from thermohyd.identify.report.page import html_report
from thermohyd.identify.typed_command import command, typed


def test_the_command_is_quoted_as_a_shell_needs_it():
    assert command() == ""
    with typed(["fit", "my bench", "--effect", "a;b"]):
        assert command() == "thermohyd fit 'my bench' --effect 'a;b'"
        assert shlex.split(command())[1:] == ["fit", "my bench", "--effect", "a;b"]
    assert command() == ""


def test_the_program_notes_what_was_typed(monkeypatch):
    seen = []
    find = Commands.resolve_command
    monkeypatch.setattr(Commands, "resolve_command", lambda self, *rest: (seen.append(command()), find(self, *rest))[1])
    get_command(app).main(["check", "--help"], standalone_mode=False)
    assert seen == ["thermohyd check --help"]
    assert command() == ""


def test_a_fingerprint_is_that_of_the_fleet_and_of_the_files_alone():
    folder = sample_record("seed_valve")
    record = read_record(folder)
    assert fingerprint(record) == look_at(folder).content
    assert fingerprint(replace(record, folder=folder / "elsewhere")) == fingerprint(record)
    made = record.provenance
    assert made is not None
    other = replace(made, files=(*made.files[:-1], replace(made.files[-1], sha256="0" * 64)))
    assert fingerprint(replace(record, provenance=other)) != fingerprint(record)


def test_a_study_s_inputs_are_the_files_that_its_command_names(tmp_path):
    (tmp_path / "model.json").write_text("{}")
    with typed(["servo", str(tmp_path / "model.json"), "--step", "5 mm", "--out", str(tmp_path)]):
        found = origin("servo")
    assert found.inputs == (
        (str(tmp_path / "model.json"), "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a"),
    )
    names = [name for name, _ in found.versions]
    assert names[:2] == ["thermohyd", "Python"]
    assert {"jax", "numpy"} <= set(names)


def test_the_page_says_all_of_it():
    fit = fake_fit(record=with_files(fake_fit().record))
    with typed(["fit", "/bench/mine", "--out", "my results"]):
        words = " ".join(" ".join(Tags(html_report(fit, {}, "0.1.0")).words).split())
    for expected in ("thermohyd fit /bench/mine --out 'my results'", fingerprint(fit.record), "Python 3.", "cd" * 32):
        assert expected in words
    assert "A program of your own made this page" in html_report(fit, {}, "0.1.0")


def commands(steps) -> list[str]:
    """Each checked to be one of the program's."""
    known = get_command(app)
    for line in (step.command for step in steps if step.command):
        words = shlex.split(line)
        assert words[0] == "thermohyd"
        assert known.get_command(None, words[1]) is not None, line  # pyright: ignore[reportAttributeAccessIssue]
    return [shlex.split(step.command)[1] for step in steps if step.command]


def test_a_fit_s_next_step_follows_from_what_it_found():
    fit = fake_fit()
    assert commands(after_fit(replace(fit, converged=False))) == ["check", "fit"]
    # a parameter ended at its bound, another two trade off
    assert commands(after_fit(fit)) == ["diagnose", "sensitivity"]
    missed = replace(fit, channels=tuple(replace(c, reduced_chi2=9.0) for c in fit.channels))
    assert "Model and bench disagree" in after_fit(missed)[0].words
    unknown = replace(fit, channels=(replace(fit.channels[0], noise_known=False),))
    assert "State the noise of leakage" in after_fit(unknown)[0].words
    free = {name: p for name, p in fit.parameters.items() if not p.at_bound}
    clear = replace(fit, parameters=free, identifiability=replace(fit.identifiability, weak_directions=()))
    assert commands(after_fit(clear)) == ["simulate", "export"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_diagnosis_always_asks_for_something(kind):
    result = fake_diagnosis(kind, points=6)
    steps = after_diagnosis(result)
    assert steps
    found = commands(steps)
    if kind == "ambiguous":
        assert steps[0].words == result.next_test.sentence  # pyright: ignore[reportOptionalMemberAccess]
    expected = {
        "consistent": "plan",
        "named": "compare",
        "two": "compare",
        "unexplained": "diagnose",
        "learned": "check",
    }
    assert kind not in expected or expected[kind] in found


def test_a_model_whose_agreement_cannot_be_judged_is_not_said_to_be_right():
    result = fake_diagnosis("consistent", points=6)
    assert "may be used as it is" in " ".join(step.words for step in after_diagnosis(result))
    after = replace(result.after, channels=tuple(replace(c, noise_known=False) for c in result.after.channels))
    said = " ".join(step.words for step in after_diagnosis(replace(result, after=after)))
    assert "may be used as it is" not in said
    assert "State the noise" in said


def test_the_test_that_decides_stays_where_the_last_fit_did_not_converge():
    result = fake_diagnosis("ambiguous", points=6)
    broken = replace(result, after=replace(result.after, converged=False, message="why"))
    assert commands(after_diagnosis(broken))[:2] == ["check", "fit"]
    assert after_diagnosis(broken)[-1].words == result.next_test.sentence  # pyright: ignore[reportOptionalMemberAccess]


def test_a_comparison_s_next_step():
    result = fake_comparison()
    assert "Ask what was done to the valve" in next_steps(result)[0].words
    assert commands(next_steps(replace(result, converged=False))) == ["diagnose", "diagnose"]
    assert commands(next_steps(replace(result, verdict="same", rows=result.rows[1:]))) == ["plan"]
    gain = replace(result.rows[0], name="flowmeter", kind="instrument")
    assert next_steps(replace(result, rows=(gain,)))[0].words.startswith("Calibrate first")
