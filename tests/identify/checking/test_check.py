"""`thermohyd check`: what it says of good, bad and bare records, what it writes, and that it never imports JAX."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.bench_folder import LEAKAGE, TOML, write_record
from helpers.commands import command
from helpers.pictures import is_drawn
from helpers.short_servo import HIDDEN

from thermohyd.data import sample_record
from thermohyd.identify import check
from thermohyd.identify.bench.errors import BenchInputError


GAIN = """spool_position [um],load_pressure [bar]
-20,-60
0,0
20,60
"""


@pytest.fixture(scope="module")
def seed():
    return check(sample_record("seed_valve"))


@pytest.fixture(scope="module")
def log():
    return check(sample_record("raw_log"))


@pytest.fixture
def run(monkeypatch):
    return command(monkeypatch, "check", 120)


def test_without_jax_from_the_command_to_the_picture(tmp_path):
    code = (
        "import sys\n"
        "from thermohyd.identify.cli.commands import app\n"
        "try:\n    app(sys.argv[1:])\nexcept SystemExit as end:\n    assert not end.code, end.code\n"
        "assert not {'jax', 'equinox', 'jaxtyping'} & set(sys.modules)\n"
    )
    arguments = ["check", str(sample_record("seed_valve")), "--out", str(tmp_path / "out"), "--quiet"]
    ran = subprocess.run([sys.executable, "-P", "-c", code, *arguments], capture_output=True, text=True)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"check.json", "check.png", ".thermohyd.json"}


def test_columns_with_units_and_ranges(seed):
    columns = {column.standard: column for column in seed.tests["leakage"].columns}
    assert columns["spool_position"].header == "spool_position [um]"
    assert (columns["spool_position"].unit, columns["spool_position"].least) == ("um", pytest.approx(-213.0))
    assert columns["temperature"].greatest == pytest.approx(70.13)
    assert columns["run"].least is None
    assert seed.tests["leakage"].conditions == {
        "return_pressure": "0 bar in all rows, as [conditions] or the default has it"
    }
    assert list(seed.to_dataframe().columns) == ["test", "header", "standard", "unit", "least", "greatest"]


def test_what_a_fit_sees_is_what_the_fit_makes(log):
    from thermohyd.identify import read_record
    from thermohyd.identify.reduction.limits import without_limits
    from thermohyd.identify.reduction.reduce import reduce_test

    leakage = reduce_test(without_limits(read_record(sample_record("raw_log")).tests["leakage"]))
    np.testing.assert_array_equal(log.tests["leakage"].seen.channels[0].value, leakage.channels[0].value)
    assert log.tests["leakage"].reduced
    assert f"reduced to {leakage.rows} points" in log.summary()
    assert "scatter of the log's rows" in log.summary()


def test_what_is_missing_says_what_to_do(tmp_path):
    found = check(write_record(tmp_path, TOML, leakage=LEAKAGE + "2,down,-10,0.1\n3,down,-20,0.05\n"))
    said = {lacking.key: lacking.sentence for lacking in found.missing}
    assert "Add [tests.flow_gain]" in said["test"]
    assert 'noise = "..." in [tests.leakage]' in said["noise"]
    assert {lacking.key for lacking in found.missing} == {"test", "noise", "condition", "effects"}
    assert any("no pressure_gain test" in lacking.sentence.lower() for lacking in found.missing)


def test_every_test_is_read_by_itself(tmp_path, run):
    toml = TOML + '[tests.pressure_gain]\nfile = "gain.csv"\n[tests.flow_gain]\nfile = "flow.csv"\n'
    write_record(tmp_path / "r", toml, leakage=LEAKAGE.replace("0.3", "abc"), gain=GAIN, flow="x\n1\n")
    ran = run(tmp_path / "r", "--out", tmp_path / "out")
    assert ran.exit_code == 2
    assert "leakage.csv: 2 bad cells: line 4" in ran.stdout
    assert 'flow.csv, line 1, column "x"' in ran.stdout.replace("\n  ", " ")
    assert "pressure_gain: 3 rows" in ran.stdout
    assert ran.stderr.endswith(
        "2 of 3 tests would be refused (leakage, flow_gain): correct what is named there, and check again\n"
    )
    assert not (tmp_path / "out").exists()


def test_a_whole_that_holds_too_little_is_refused(tmp_path, run):
    found = check(
        write_record(tmp_path, TOML.replace("polarity", "# polarity"), leakage=LEAKAGE[: LEAKAGE.index("# another")])
    )
    assert list(found.refused) == [""]
    assert "2 readings cannot determine" in found.refused[""]
    ran = run(tmp_path)
    assert ran.exit_code == 2
    assert "its tests can be read, but the record would be refused" in ran.stderr


def test_a_record_for_predictions_only(tmp_path, run):
    write_record(tmp_path, leakage=LEAKAGE.replace(",leakage_flow [l/min]", "").replace(",0.1", "").replace(",0.3", ""))
    ran = run(tmp_path)
    assert ran.exit_code == 0
    assert "a record for simulate and plan, not for a fit" in ran.stdout
    assert f"thermohyd simulate {tmp_path}" in ran.stdout


def test_a_planned_test_beside_one_that_was_run(tmp_path, run):
    plan = "[tests.flow_gain]\nplan = { points = 11 }\n"
    log = LEAKAGE + "2,down,-10,0.1\n3,down,-20,0.05\n"
    mixed = run(write_record(tmp_path / "mixed", TOML + plan, leakage=log))
    assert mixed.exit_code == 2
    assert "1 of 2 tests would be refused (flow_gain)" in mixed.stderr
    alone = run(write_record(tmp_path / "planned", TOML.replace('[tests.leakage]\nfile = "leakage.csv"\n', plan)))
    assert alone.exit_code == 0
    assert "thermohyd plan" in alone.stdout


def test_readings_of_the_wrong_sign_are_named(tmp_path):
    many = "spool_position [um],flow [l/min]\n" + "".join(
        f"{x},{-0.03 * x + 0.001 * (x % 3)}\n" for x in range(-200, 201, 20)
    )
    found = check(write_record(tmp_path, TOML + '[tests.flow_gain]\nfile = "flow.csv"\n', flow=many))
    assert found.tests["flow_gain"].turned == ("flow",)
    assert any("its sign was turned" in warning for warning in found.warnings)


def test_json_on_stdout_alone(run):
    ran = run(sample_record("seed_valve"), "--json")
    content = json.loads(ran.stdout)
    assert (content["schema"], content["usable"], content["refused"]) == ("thermohyd-check/1", True, {})
    assert content["tests"]["leakage"]["rows"] == 800
    assert content["record"]["files"][0]["name"] == "bench.toml"
    assert content["free_parameters"][0] == "edge_radius"


def test_the_picture_has_a_panel_for_every_reading(log, seed):
    assert [len(result.figures()["check"].axes) for result in (log, seed)] == [
        4,
        4,
    ]  # two columns: the last stays empty
    (axes, *_) = log.figures()["check"].axes
    assert [line.get_label() for line in axes.lines] == ["as read", "points of a fit"]
    assert is_drawn(log._files()["check.png"])


def test_a_folder_without_a_record_is_refused(tmp_path):
    with pytest.raises(BenchInputError, match="holds no bench"):
        check(tmp_path)


def test_each_page_of_help_has_quiet_and_verbose(monkeypatch):
    for name in ("fit", "check", "new"):
        ran = command(monkeypatch, name, 120)("--help")
        assert "--quiet" in ran.stdout
        assert "--verbose" in ran.stdout


def test_verbose_says_every_step_and_quiet_says_nothing(run, tmp_path):
    small = write_record(tmp_path, leakage=LEAKAGE + "2,down,-10,0.1\n3,down,-20,0.05\n")
    loud = run(sample_record("raw_log"), "--verbose")
    assert "s  reducing leakage: 10,500 rows" in loud.stderr
    silent = run(small, "-q")
    assert (silent.stdout, silent.stderr) == ("", "")
    usual = run(small)
    assert usual.stderr == ""
    assert "taken row by row" in usual.stdout
    assert run(small, "-q", "-v").exit_code == 2


def test_completion_knows_the_commands():
    script = Path(sys.executable).parent / "thermohyd"
    asked = {
        "_THERMOHYD_COMPLETE": "complete_bash",
        "COMP_WORDS": "thermohyd che",
        "COMP_CWORD": "1",
        "PATH": "/usr/bin",
    }
    ran = subprocess.run([script], env=asked, capture_output=True, text=True)
    assert ran.stdout.split() == ["check"]


def test_a_supply_in_motion_that_scatters_is_said(tmp_path):
    shutil.copytree(HIDDEN / "servo_2", tmp_path / "servo")
    path = tmp_path / "servo" / "step.csv"
    comment, head, *rows = path.read_text().splitlines()
    supply = np.round((210.0 + 0.05 * np.random.default_rng(1).standard_normal(len(rows))) / 0.1) * 0.1
    logged = [f"{row},{value:.1f}" for row, value in zip(rows, supply, strict=True)]
    path.write_text("\n".join([comment, f"{head},supply_pressure [bar]", *logged]) + "\n")
    (note,) = check(tmp_path / "servo").tests["step"].notes
    assert note.startswith("step: supply pressure scatters by 0.05")
    assert note.endswith("bar about a smooth course, which readings in motion hardly show: taken for the gauge's noise")
    assert check(HIDDEN / "servo_2").tests["step"].notes == ()
