"""The shell around the commands: what goes to which stream, exit statuses, files whole or none, no needless imports."""

import io
import json
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import jax
import pytest
from helpers.fake_diagnosis import fake_diagnosis
from helpers.fake_fit import fake_fit
from typer.testing import CliRunner

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.cli import jax_setup
from thermohyd.identify.cli.commands import app
from thermohyd.identify.cli.process import consoles
from thermohyd.identify.report import style
from thermohyd.numerics import known_options


def stand_in(monkeypatch, name: str, **functions) -> None:
    """Put a module of our own in the place of `thermohyd.identify.<name>`."""
    module = ModuleType(f"thermohyd.identify.{name}")
    vars(module).update(functions)
    monkeypatch.setitem(sys.modules, module.__name__, module)


def reader(monkeypatch, read) -> None:
    """Records come from `read`."""
    # In this order: the first use of several_records imports it, and must not find a replacement to keep.
    monkeypatch.setattr("thermohyd.identify.cli.several_records.read_record", read)
    monkeypatch.setattr("thermohyd.identify.bench.read.read_record", read)


def raising(error: BaseException):
    def function(*args, **kwargs):
        raise error

    return function


@pytest.fixture
def drawing_bench(monkeypatch):
    """A bench whose reader and fit are stand-ins; returns a function that runs `thermohyd` with arguments."""
    monkeypatch.setattr(jax_setup, "set_up_jax", lambda: None)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.delenv("THERMOHYD_DEBUG", raising=False)
    result = fake_fit()
    reader(monkeypatch, lambda folder, readings_required=True: result.record)
    stand_in(monkeypatch, "fitting.fit", fit=lambda record, progress=None, model_form=True: result)
    return lambda *arguments: CliRunner().invoke(app, [str(a) for a in arguments])


@pytest.fixture
def bench(drawing_bench, monkeypatch):
    """The same with blank pictures: where it is no matter what is on them, as they take seconds to draw."""
    monkeypatch.setattr(style, "svg", lambda figure: b"<svg xmlns='http://www.w3.org/2000/svg'/>")
    monkeypatch.setattr(style, "png", lambda figure: b"blank")
    return drawing_bench


def test_fit_writes_every_file(drawing_bench, tmp_path):
    ran = drawing_bench("fit", "bench", "--out", tmp_path / "out")
    assert ran.exit_code == 0, ran.stderr
    tests = ("leakage", "pressure_gain", "flow_gain", "parameters")
    expected = {".thermohyd.json", "fit.json", "model.json", "report.html"} | {
        f"{t}.{kind}" for t in tests for kind in ("png", "svg")
    }
    assert {file.name for file in (tmp_path / "out").iterdir()} == expected
    assert json.loads((tmp_path / "out" / "fit.json").read_text())["converged"] is True
    assert "data:image/svg+xml" in (tmp_path / "out" / "report.html").read_text()


def test_report_goes_to_stdout_and_warnings_to_both(bench, tmp_path):
    ran = bench("fit", "bench", "--out", tmp_path)
    for words in ("edge_radius", "Fit statistics", "readings above 4 l/min are rounded", f"written: {tmp_path}"):
        assert words in ran.stdout
    warning = "flow_gain: readings above 4 l/min are rounded to 0.4 l/min; they are believed to that step only."
    assert ran.stderr == f"thermohyd: warning: {warning}\n"


def test_effects_are_freed_by_name(bench, monkeypatch):
    asked = []
    found = fake_fit()

    def fit(record, effects=(), model_form=True, progress=None):
        asked.append((tuple(effects), model_form))
        return found

    stand_in(monkeypatch, "fitting.fit", fit=fit)
    assert bench("fit", "bench", "--effect", "hysteresis", "--effect", "pilot_leakage").exit_code == 0
    assert bench("fit", "bench", "--no-model-form").exit_code == 0
    assert asked == [(("hysteresis", "pilot_leakage"), True), ((), False)]


def test_json_alone_on_stdout(bench):
    ran = bench("fit", "bench", "--json")
    assert json.loads(ran.stdout)["rows"] == 146_220
    assert "edge_radius" in ran.stderr
    assert "thermohyd: warning" not in ran.stderr


def test_a_file_gets_wide_tables_and_no_escape_codes(bench, monkeypatch):
    """Whatever the terminal beside it is like; COLUMNS is the user's own wish."""
    monkeypatch.delenv("COLUMNS")
    ran = bench("fit", "bench")
    assert "\x1b" not in ran.stdout
    assert "…" not in ran.stdout
    (heading,) = [line for line in ran.stdout.splitlines() if "95 % interval" in line]
    assert "rel" in heading.split()
    assert max(map(len, ran.stdout.splitlines())) <= 120


def test_new_says_where_on_stdout(bench, tmp_path):
    ran = bench("new", tmp_path / "mine")
    assert (ran.exit_code, ran.stdout, ran.stderr) == (0, f"written: {tmp_path / 'mine' / 'bench.toml'}\n", "")


def test_several_records_get_a_folder_each_and_a_table(bench, tmp_path):
    ran = bench("fit", tmp_path / "a", "x/b/bench.toml", "--out", tmp_path / "out", "--json")
    assert ran.exit_code == 0, ran.stderr
    assert {folder.name for folder in (tmp_path / "out").iterdir()} == {"a", "b"}
    assert (tmp_path / "out" / "b" / "fit.json").exists()
    content = json.loads(ran.stdout)
    assert [record["folder"] for record in content["records"]] == ["a", "b"]
    assert content["failed"] == []
    lines = [" ".join(line.split()) for line in ran.stderr.splitlines()]
    assert "parameter unit a b" in lines
    assert "edge_radius um 14.93 +/- 0.12 14.93 +/- 0.12" in lines
    assert "heat_retention - 0 fixed 0 fixed" in lines
    assert "reduced chi-square - 1.17 1.17" in lines
    assert f"written: {tmp_path / 'out' / 'a' / 'report.html'}" in lines


def test_one_failing_record_does_not_stop_the_others(bench, monkeypatch, tmp_path):
    calls = iter([fake_fit(), ValueError("singular"), fake_fit(converged=False, message="100 steps were not enough")])

    def fit(record, progress, model_form):
        found = next(calls)
        if isinstance(found, Exception):
            raise found
        return found

    stand_in(monkeypatch, "fitting.fit", fit=fit)
    ran = bench("fit", "a", "b", "c", "--out", tmp_path / "out", "--json")
    assert ran.exit_code == 1
    assert {folder.name for folder in (tmp_path / "out").iterdir()} == {"a", "c"}
    content = json.loads(ran.stdout)
    assert [(r["folder"], r["converged"]) for r in content["records"]] == [("a", True), ("c", False)]
    assert content["failed"][0]["folder"] == "b"
    said = ran.stderr.splitlines()[-1]
    assert said.startswith("thermohyd: 2 of 3 records failed: b: the computation failed: ValueError: singular")
    assert said.endswith("c: the fit did not converge: 100 steps were not enough")


def test_out_is_checked_before_any_work(bench, monkeypatch, tmp_path):
    reader(monkeypatch, raising(AssertionError("it began")))
    (tmp_path / "file").write_text("mine")
    monkeypatch.chdir(tmp_path)
    for out, words in (
        ("", "--out is empty; name a folder for the results"),
        ("file", "file: is a file; --out takes a folder"),
        ("file/below", "file: is a file; --out lies in a folder"),
        ("x" * 256, f"{'x' * 256}: --out cannot be written (File name too long)"),
    ):
        ran = bench("fit", "bench", "--out", out)
        assert (ran.exit_code, ran.stdout, ran.stderr) == (2, "", f"thermohyd: {words}\n")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("command", ["fit", "diagnose", "simulate", "sensitivity", "servo", "seed"])
def test_a_read_only_folder_is_refused_by_every_command(bench, monkeypatch, tmp_path, command):
    def mkdir(self, *args, **kwargs):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("pathlib.Path.mkdir", mkdir)
    out = tmp_path / "not yet there"
    ran = bench(command, *(["bench"] if command not in ("seed", "servo", "sensitivity") else []), "--out", out)
    assert (ran.exit_code, ran.stdout) == (2, "")
    assert ran.stderr == f"thermohyd: {out}: --out cannot be written (Read-only file system)\n"


def test_predictions_do_not_overwrite_the_record(tmp_path):
    record = tmp_path / "mine"
    assert CliRunner().invoke(app, ["new", str(record)]).exit_code == 0
    before = (record / "leakage.csv").read_bytes()
    ran = CliRunner().invoke(app, ["simulate", str(record), "--out", str(record)])
    assert ran.exit_code == 2
    assert (
        ran.stderr == f"thermohyd: {record}: --out would overwrite the record's own leakage.csv; name another folder\n"
    )
    assert (record / "leakage.csv").read_bytes() == before


def test_not_converged_is_a_failure_that_still_reports(bench, monkeypatch, tmp_path):
    result = fake_fit(converged=False, message="100 steps were not enough")
    stand_in(monkeypatch, "fitting.fit", fit=lambda record, progress=None, model_form=True: result)
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
    if module == "read_record":
        reader(monkeypatch, raising(error))
    else:
        stand_in(monkeypatch, "fitting.fit", fit=raising(error))
    ran = bench(command, "bench", "--out", tmp_path / "out", "--json")
    assert ran.exit_code == status
    assert ran.stderr.strip() == line
    assert ran.stdout == ""
    assert not (tmp_path / "out").exists()


def test_debugging_shows_the_story(bench, monkeypatch):
    monkeypatch.setenv("THERMOHYD_DEBUG", "1")
    stand_in(monkeypatch, "fitting.fit", fit=raising(ValueError("the cause")))
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
        "from thermohyd.identify.cli.commands import main\n"
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
        "from thermohyd.identify.cli.jax_setup import set_up_jax\n"
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


@pytest.mark.skipif(sys.platform != "linux", reason="the place of the cache is set by XDG_CACHE_HOME")
@pytest.mark.parametrize("chosen", [False, True])
def test_a_cache_that_others_may_write_to_is_not_used(tmp_path, chosen):
    """With one line for both folders; JAX's own variable is asked the same."""
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    code = (
        "from thermohyd.identify.cli.jax_setup import set_up_jax\n"
        "set_up_jax()\n"
        "import jax, thermohyd.kept_programs\n"
        "print(jax.config.jax_compilation_cache_dir, thermohyd.kept_programs._folder)"
    )
    variables = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    variables |= {"XDG_CACHE_HOME": str(shared)} | ({"JAX_COMPILATION_CACHE_DIR": str(shared)} if chosen else {})
    command = [sys.executable, "-P", "-c", code]
    ran = subprocess.run(command, check=True, capture_output=True, text=True, env=variables)
    assert ran.stdout == "None None\n"
    assert list(shared.iterdir()) == []
    said = "thermohyd: warning: compiled programs are neither kept nor read: others may write to"
    assert ran.stderr == f"{said} {shared}; if they did not, `chmod go-w {shared}`\n"


@pytest.mark.parametrize("kind", ["jax", "programs"])
def test_folders_of_the_cache_are_the_users_alone_under_any_umask(monkeypatch, tmp_path, kind):
    monkeypatch.setattr(jax_setup, "user_cache_dir", lambda name: str(tmp_path / "cache" / name))
    before = os.umask(0)
    try:
        folder = jax_setup.compilation_cache(kind)
    finally:
        os.umask(before)
    assert folder is not None
    assert folder == tmp_path / "cache" / "thermohyd" / kind
    assert {one.stat().st_mode & 0o777 for one in (folder, *folder.parents[:2])} == {0o700}


def test_the_user_s_own_xla_flags_go_before_ours(monkeypatch):
    ours = {"xla_backend_optimization_level": 1, "xla_llvm_disable_expensive_passes": True}
    monkeypatch.setenv("XLA_FLAGS", "--xla_backend_optimization_level=3")
    assert known_options(ours) == {"xla_llvm_disable_expensive_passes": True}
    monkeypatch.delenv("XLA_FLAGS")
    assert known_options(ours) == ours
    assert known_options({"xla_no_such_option": True}) == {}


def test_programs_go_between_records_once_the_process_holds_much(monkeypatch):
    cleared = []
    monkeypatch.setattr(jax, "clear_caches", lambda: cleared.append(True))
    assert 1e7 < jax_setup.resident_memory() < 1e12
    for held in (0.5, 2.0):
        monkeypatch.setattr(jax_setup, "resident_memory", lambda held=held: held * jax_setup.MOST_MEMORY)
        jax_setup.keep_memory_flat()
        assert len(cleared) == int(held > 1.0)


def test_cache_does_not_grow_for_ever(monkeypatch, tmp_path):
    monkeypatch.setattr(jax_setup, "user_cache_dir", lambda name: str(tmp_path))
    monkeypatch.setattr(jax_setup, "LARGEST_CACHE", 250)
    folder = tmp_path / "jax"
    folder.mkdir()
    for age, name in enumerate(("newest", "middle", "oldest")):
        (folder / name).write_bytes(b"x" * 100)
        os.utime(folder / name, (1e9 - age, 1e9 - age))
    assert jax_setup.compilation_cache("jax") == folder
    assert sorted(file.name for file in folder.iterdir()) == ["middle", "newest"]


def test_a_narrow_stream_without_an_ellipsis_gets_the_report(monkeypatch):
    """A log of ASCII, narrower than the tables: cells are cut, nothing fails."""
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii"))
    monkeypatch.setenv("COLUMNS", "60")
    console = consoles(json=False).results
    fake_diagnosis("named", points=12).print_on(console)
    fake_fit().print_on(console)
    sys.stdout.flush()
    assert "?" in written.getvalue().decode("ascii")
