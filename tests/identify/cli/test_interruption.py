"""Ctrl-C at several moments of a real process: status 130, one line that is true, files whole or not there, at once.

A process says on stderr where it is; then it gets its signal. What takes long is XLA's compiler, in native code.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from thermohyd.identify.cli.new_record import write_template


pytestmark = pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")

TESTS = Path(__file__).resolve().parents[2]
# A process that a shell started with & ignores SIGINT, and so would its children: the test's own shell does not matter.
PRELUDE = f"""
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, {str(TESTS)!r})
from thermohyd.identify.cli import several_records
several_records.SILENT_SECONDS = -1.0
def say(words):
    print(words, file=sys.stderr, flush=True)
"""
MAIN = """
from thermohyd.identify.__main__ import main
main()
"""
# A fit that is ready at once for the first record and never for the second, like a compiler that hears no signals.
FAKE = """
import ctypes
from types import ModuleType
from helpers.fake_fit import fake_fit
from dataclasses import replace
from thermohyd.identify.cli import jax_setup
jax_setup.set_up_jax = lambda: None
module = ModuleType("thermohyd.identify.fitting.fit")
seen = []
def fit(record, progress, model_form):
    seen.append(record)
    if len(seen) > 1:
        say("second record")
        while True:
            ctypes.CDLL(None).sleep(1)
    return replace(fake_fit(), record=record)
module.fit = fit
sys.modules[module.__name__] = module
"""
SLOW_WRITING = """
import os
replace_file = os.replace
def slowly(source, target):
    say(f"writing {os.path.basename(target)}")
    time.sleep(0.1)
    replace_file(source, target)
os.replace = slowly
"""


def interrupted(
    tmp_path: Path, at: str, arguments: list, extra: str = "", number: int = signal.SIGINT, wait: float = 0.0
) -> tuple[int, str, str]:
    """(status, stdout, the last line of stderr) of a command that is sent a signal when it says `at` on stderr."""
    code = f"{PRELUDE}{extra}\nsys.argv[1:] = {[str(a) for a in arguments]!r}\n{MAIN}"
    environment = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    environment |= {"XDG_CACHE_HOME": str(tmp_path / "cold"), "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(
        [sys.executable, "-P", "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stderr is not None
        try:
            for line in process.stderr:
                if line.startswith(at):
                    break
            else:
                raise AssertionError(f"it never said {at!r}")
            if wait:
                with pytest.raises(subprocess.TimeoutExpired):
                    process.wait(wait)
            process.send_signal(number)
            out, errors = process.communicate(timeout=60)
        finally:
            process.kill()
        return process.returncode, out, errors


@pytest.fixture
def bench(tmp_path):
    write_template(tmp_path / "bench")
    return tmp_path / "bench"


@pytest.mark.parametrize(
    ("at", "wait"), [("reading", 0.0), ("starting JAX", 0.0), ("starting JAX", 0.3), ("start 1 of 4", 0.5)]
)
def test_before_anything_is_written(tmp_path, bench, at, wait):
    """While reading, while importing JAX, and while XLA compiles with an empty cache."""
    status, out, errors = interrupted(tmp_path, at, ["fit", bench, "--out", tmp_path / "out"], wait=wait)
    assert status == 130
    assert out == ""
    assert errors.splitlines()[-1] == "thermohyd: interrupted; nothing was written"
    assert "Traceback" not in errors
    assert not (tmp_path / "out").exists()


def test_while_the_help_is_imported(tmp_path):
    extra = "import typing\nimport thermohyd.identify.interruption as i\nstart = i.leave_at_once_on_signals\n"
    extra += "def start_and_say():\n    start()\n    say('listening')\ni.leave_at_once_on_signals = start_and_say\n"
    extra += "sys.meta_path.insert(0, type('Slow', (), {'find_spec': lambda *a: time.sleep(0.05)})())\n"
    status, out, errors = interrupted(tmp_path, "listening", ["--help"], extra)
    assert (status, out, errors) == (130, "", "thermohyd: interrupted; nothing was written\n")


def test_between_two_records(tmp_path, bench):
    write_template(tmp_path / "other")
    arguments = ["fit", bench, tmp_path / "other", "--out", tmp_path / "out"]
    status, out, errors = interrupted(tmp_path, "second record", arguments, FAKE)
    assert status == 130
    assert out == ""
    done = tmp_path / "out" / "bench"
    assert errors == f"thermohyd: interrupted; the files in {done} are complete, nothing else was written\n"
    assert [folder.name for folder in (tmp_path / "out").iterdir()] == ["bench"]
    assert (done / "report.html").read_text().endswith("</html>")
    assert not list(done.glob(".writing*"))


def test_while_drawing(tmp_path, bench):
    status, _, errors = interrupted(tmp_path, "drawing", ["fit", bench, "--out", tmp_path / "out"], FAKE)
    assert (status, errors) == (130, "thermohyd: interrupted; nothing was written\n")
    assert not (tmp_path / "out").exists()


def test_while_files_are_put_in_place(tmp_path, bench):
    """The first of a dozen files is there: all the others come before the process leaves."""
    out = tmp_path / "out"
    out.mkdir()
    arguments = ["fit", bench, "--out", out]
    status, _, errors = interrupted(tmp_path, "writing fit.json", arguments, FAKE + SLOW_WRITING)
    assert status == 130
    assert (
        errors.splitlines()[-1] == f"thermohyd: interrupted; the files in {out} are complete, nothing else was written"
    )
    assert {"fit.json", "model.json", "report.html", "leakage.png", "parameters.svg"} < {p.name for p in out.iterdir()}
    assert not list(out.glob(".writing*"))


def test_terminated(tmp_path, bench):
    status, _, errors = interrupted(tmp_path, "starting JAX", ["fit", bench], number=signal.SIGTERM, wait=0.2)
    assert (status, errors) == (143, "thermohyd: terminated; nothing was written\n")
