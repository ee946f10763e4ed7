"""The shell around the commands: what goes to which stream, exit statuses, files whole or none, no needless imports."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from helpers.fake_fit import fake_fit
from typer.testing import CliRunner

from thermohyd.identify import jax_setup
from thermohyd.identify.command_line import app
from thermohyd.identify.errors import BenchInputError


def stand_in(monkeypatch, name: str, **functions) -> None:
    """Put a module of our own in the place of `thermohyd.identify.<name>`."""
    module = ModuleType(f"thermohyd.identify.{name}")
    vars(module).update(functions)
    monkeypatch.setitem(sys.modules, module.__name__, module)


def raising(error: BaseException):
    def function(*args, **kwargs):
        raise error

    return function


@pytest.fixture
def bench(monkeypatch):
    """A bench whose reader and fit are stand-ins; returns a function that runs `thermohyd` with arguments."""
    monkeypatch.setattr(jax_setup, "set_up_jax", lambda: None)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.delenv("THERMOHYD_DEBUG", raising=False)
    result = fake_fit()
    stand_in(monkeypatch, "read_record", read_record=lambda folder, readings_required=True: result.record)
    stand_in(monkeypatch, "fit", fit=lambda record, progress=None: result)
    return lambda *arguments: CliRunner().invoke(app, [str(a) for a in arguments])


def test_fit_writes_every_file(bench, tmp_path):
    ran = bench("fit", "bench", "--out", tmp_path / "out")
    assert ran.exit_code == 0, ran.stderr
    tests = ("leakage", "pressure_gain", "flow_gain", "parameters")
    expected = {"fit.json", "model.json", "report.html"} | {f"{t}.{kind}" for t in tests for kind in ("png", "svg")}
    assert {file.name for file in (tmp_path / "out").iterdir()} == expected
    assert json.loads((tmp_path / "out" / "fit.json").read_text())["converged"] is True
    assert "data:image/svg+xml" in (tmp_path / "out" / "report.html").read_text()


def test_report_goes_to_stderr_and_nothing_to_stdout(bench):
    ran = bench("fit", "bench")
    assert ran.stdout == ""
    assert "edge_radius" in ran.stderr


def test_json_alone_on_stdout(bench):
    ran = bench("fit", "bench", "--json")
    assert json.loads(ran.stdout)["rows"] == 146_220
    assert "edge_radius" in ran.stderr


def test_not_converged_is_a_failure_that_still_reports(bench, monkeypatch, tmp_path):
    result = fake_fit(converged=False, message="100 steps were not enough")
    stand_in(monkeypatch, "fit", fit=lambda record, progress=None: result)
    ran = bench("fit", "bench", "--out", tmp_path, "--json")
    assert ran.exit_code == 1
    assert "thermohyd: the fit did not converge: 100 steps were not enough" in ran.stderr
    assert json.loads(ran.stdout)["converged"] is False
    assert "DID NOT CONVERGE" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (BenchInputError("no such column", file="a.csv", line=3), 2, "thermohyd: a.csv, line 3: no such column"),
        (KeyboardInterrupt(), 130, "thermohyd: interrupted; nothing was written"),
        (PermissionError(13, "Permission denied", "x/fit.json"), 1, "thermohyd: Permission denied: x/fit.json"),
        (MemoryError(), 1, "thermohyd: not enough memory for this record"),
        (
            ValueError("a\nb"),
            1,
            "thermohyd: the computation failed: ValueError: a (set THERMOHYD_DEBUG=1 for the whole story)",
        ),
    ],
)
@pytest.mark.parametrize(("module", "command"), [("fit", "fit"), ("read_record", "fit"), ("read_record", "simulate")])
def test_failures_are_one_line(bench, monkeypatch, tmp_path, module, command, error, status, line):
    stand_in(monkeypatch, module, **{module: raising(error)})
    ran = bench(command, "bench", "--out", tmp_path / "out", "--json")
    assert ran.exit_code == status
    assert ran.stderr.strip() == line
    assert ran.stdout == ""
    assert not (tmp_path / "out").exists()


def test_debugging_shows_the_story(bench, monkeypatch):
    monkeypatch.setenv("THERMOHYD_DEBUG", "1")
    stand_in(monkeypatch, "fit", fit=raising(ValueError("the cause")))
    ran = bench("fit", "bench")
    assert isinstance(ran.exception, ValueError)


@pytest.mark.parametrize("arguments", [("fit",), ("frobnicate",), ("fit", "bench", "--nonsense")])
def test_wrong_usage_is_bad_input(bench, arguments):
    ran = bench(*arguments)
    assert ran.exit_code == 2
    assert ran.stdout == ""
    assert "Traceback" not in ran.stderr


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["fit", "--help"], ["diagnose", "--help"], ["simulate", "-h"], ["new", "--help"], ["--version"]],
)
def test_help_imports_nothing_heavy(arguments):
    code = (
        "import sys\n"
        "from thermohyd.identify.command_line import main\n"
        f"sys.argv[1:] = {arguments!r}\n"
        "try:\n    main()\n"
        "except SystemExit as end:\n    assert not end.code\n"
        "print(sorted({'jax', 'numpy', 'pandas', 'pint', 'matplotlib', 'scipy'} & set(sys.modules)))"
    )
    ran = subprocess.run([sys.executable, "-P", "-c", code], check=True, capture_output=True, text=True)
    assert ran.stdout.splitlines()[-1] == "[]"
    assert "thermohyd" in ran.stdout


def cache_seen_by_jax(cache_home: Path, **environment: str) -> list[str]:
    code = (
        "from thermohyd.identify.jax_setup import set_up_jax\n"
        "set_up_jax()\n"
        "import jax, equinox, os\n"
        "assert jax.config.jax_enable_x64 and os.environ['EQX_ON_ERROR'] == 'off'\n"
        "print(jax.config.jax_compilation_cache_dir)"
    )
    variables = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    variables |= {"XDG_CACHE_HOME": str(cache_home), **environment}
    command = [sys.executable, "-P", "-W", "error", "-c", code]
    ran = subprocess.run(command, check=True, capture_output=True, text=True, env=variables)
    assert ran.stderr == ""
    return ran.stdout.split()


@pytest.mark.skipif(sys.platform != "linux", reason="the place of the cache is set by XDG_CACHE_HOME")
def test_cache_is_the_users_own_and_optional(tmp_path):
    assert cache_seen_by_jax(tmp_path / "home") == [str(tmp_path / "home" / "thermohyd" / "jax")]
    assert (tmp_path / "home" / "thermohyd" / "jax").stat().st_mode & 0o077 == 0
    (tmp_path / "file").write_text("not a folder")
    assert cache_seen_by_jax(tmp_path / "file") == ["None"]
    own = str(tmp_path / "own")
    assert cache_seen_by_jax(tmp_path / "unused", JAX_COMPILATION_CACHE_DIR=own) == [own]


def test_cache_does_not_grow_for_ever(monkeypatch, tmp_path):
    monkeypatch.setattr(jax_setup, "user_cache_dir", lambda name: str(tmp_path))
    monkeypatch.setattr(jax_setup, "LARGEST_CACHE", 250)
    folder = tmp_path / "jax"
    folder.mkdir()
    for age, name in enumerate(("newest", "middle", "oldest")):
        (folder / name).write_bytes(b"x" * 100)
        os.utime(folder / name, (1e9 - age, 1e9 - age))
    assert jax_setup.compilation_cache() == folder
    assert sorted(file.name for file in folder.iterdir()) == ["middle", "newest"]
