"""The program as a process: what it says while it runs, how it ends, that it can be stopped, and that nothing of it stays."""

import gc
import os
import subprocess
import sys
import time

import pytest
from helpers.bench_folder import TOML

from thermohyd.identify.app import command_run
from thermohyd.identify.app.closing import Watch
from thermohyd.identify.app.command_run import CommandRun
from thermohyd.identify.app.upload import TemporaryHome
from thermohyd.identify.app.work import Work
from thermohyd.identify.bench.errors import BenchInputError


SAYS = """
import sys, time
say = lambda words: print(words, file=sys.stderr, flush=True)
say("    0.0 s  reading x")
say("thermohyd: warning: one")
say("    1.2 s  fitting [b]")
"""
WAITS = SAYS + "time.sleep(60)\n"


@pytest.fixture
def run(monkeypatch):
    """A function that runs code in the place of the program, as soon as it has said something."""

    def started(code: str, home: TemporaryHome) -> CommandRun:
        monkeypatch.setattr(command_run, "PROGRAM", (sys.executable, "-P", "-c", code))
        made = CommandRun(["fit", "x"], home)
        end = time.monotonic() + 30
        while len(made.steps()) < 2 and made.status is None and time.monotonic() < end:
            time.sleep(0.01)
        return made

    return started


def ended(run: CommandRun) -> int:
    end = time.monotonic() + 30
    while run.status is None and time.monotonic() < end:
        time.sleep(0.01)
    assert run.status is not None
    return run.status


@pytest.mark.parametrize(
    ("code", "status", "failure"),
    [
        (SAYS, 0, ""),
        (SAYS + "say('thermohyd: no such thing')\nsys.exit(2)", 2, "no such thing"),
        (SAYS + "sys.exit(1)", 1, "ended with status 1 and said nothing"),
    ],
)
def test_how_it_ends(code, status, failure, run):
    found = run(code, TemporaryHome())
    assert ended(found) == status
    assert (found.step(), found.failure()) == ("fitting [b]", failure)
    assert found.steps() == ["0.0 s  reading x", "1.2 s  fitting [b]"]
    took = found.seconds
    time.sleep(0.02)
    assert found.seconds == took
    found.stop()
    assert not found.stopped


def test_it_is_stopped(run):
    found = run(WAITS, TemporaryHome())
    assert found.status is None
    assert found.failure() == ""
    found.stop()
    assert found.stopped
    assert found.status != 0


def test_it_goes_with_its_object_and_the_folder_after_it(run):
    home = TemporaryHome()
    found, folder = run(WAITS, home), home.folder
    process = found._process
    del home, found
    gc.collect()
    assert process.poll() is not None
    assert not folder.exists()


def test_a_closed_page_closes_its_work(run, monkeypatch):
    work = Work([("v/leakage.csv", b"a\n1\n")])
    monkeypatch.setattr(command_run, "PROGRAM", (sys.executable, "-P", "-c", WAITS))
    work.start("fit")
    watch = Watch(grace=10.0)
    watch.add("session", work)
    begin = time.monotonic()
    watch.look(lambda session: True, begin + 100.0)
    watch.look(lambda session: False, begin + 109.0)
    assert work.home.folder.exists()
    assert work.run is not None
    assert work.run.status is None
    watch.look(lambda session: False, begin + 111.0)
    assert not work.home.folder.exists()
    assert work.run.status is not None
    watch.look(lambda session: False, begin + 200.0)


def test_a_result_names_no_temporary_folder():
    work = Work([("v/leakage.csv", b"a\n1\n")])
    folder = work.home.own / "results"
    folder.mkdir()
    (folder / "fit.json").write_text(f"{work.record}, --out ../own/results, {folder}, {work.home.folder}")
    assert work.result("fit.json") == b"v, --out results, results, a temporary folder"
    assert work.result("report.html") is None


WRITES = """
import pathlib, sys
_, job, record, _, out, _ = sys.argv
assert pathlib.Path(record, "leakage.csv").is_file()
pathlib.Path(out).mkdir()
pathlib.Path(out, "fit.json").write_text("{}")
print("a table")
"""


@pytest.mark.parametrize("name", ["results", "stdout.txt", "stderr.txt", "own", "dropped", "fit.json"])
def test_no_dropped_name_meets_a_file_of_the_programs_own(name, monkeypatch):
    sent = {
        f"{name}/{inside}": inside.encode()
        for inside in ("leakage.csv", "results/fit.json", "own/stdout.txt", "stderr.txt")
    }
    work = Work([*sent.items(), (f"{name}/bench.toml", TOML.encode())])
    monkeypatch.setattr(command_run, "PROGRAM", (sys.executable, "-P", "-c", WRITES))
    for _ in range(2):  # what the first wrote goes before the second
        work.start("fit")
        assert work.run is not None
        assert ended(work.run) == 0, work.run.lines()
        assert work.result("fit.json") == b"{}"
    there = {
        file.relative_to(work.home.dropped).as_posix(): file.read_bytes()
        for file in work.home.dropped.rglob("*.*")
        if file.is_file()
    }
    assert there == {**sent, f"{name}/bench.toml": TOML.encode()}


def test_a_greyed_button_that_is_pressed_starts_nothing():
    work = Work([("v/bench.toml", TOML.replace("leakage.csv", "/etc/hosts").encode()), ("v/leakage.csv", b"a\n1\n")])
    with pytest.raises(BenchInputError, match="lies outside the folder that was dropped"):
        work.start("fit")
    assert work.run is None


def test_what_a_command_reads_does_not_change_under_it(monkeypatch):
    work = Work([("v/bench.toml", TOML.encode()), ("v/leakage.csv", b"a\n1\n")])
    monkeypatch.setattr(command_run, "PROGRAM", (sys.executable, "-P", "-c", WAITS))
    work.start("fit")
    work.change("file = '/etc/hosts'")
    assert (work.text, (work.record / "bench.toml").read_text()) == (TOML, TOML)
    assert work.run is not None
    work.run.stop()
    work.change("x = 1")
    assert work.text == "x = 1"


WAITS_ON_ITS_OWN = """
import os, pathlib, signal, sys, time
def asked(*_):
    pathlib.Path(os.environ["ENDED"]).write_text(f"its input was {'full' if said else 'empty'}, and it was asked to end")
    os._exit(0)
said = sys.stdin.read()
signal.signal(signal.SIGTERM, asked)
print("waiting", file=sys.stderr, flush=True)
time.sleep(60)
"""
STARTS = """
import os, signal, time
from thermohyd.identify.app import command_run
from thermohyd.identify.app.upload import TemporaryHome
command_run.PROGRAM = (*command_run.CHILD, "waits")
run = command_run.CommandRun([], TemporaryHome())
while "waiting" not in run.lines():
    assert run.status is None, run.lines()
    time.sleep(0.01)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
def test_it_ends_with_a_starter_that_was_killed(tmp_path):
    (tmp_path / "waits.py").write_text(WAITS_ON_ITS_OWN)
    # An empty entry would be the working folder, which has the bare source tree.
    path = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"PYTHONPATH": path, "TMPDIR": str(tmp_path), "ENDED": str(tmp_path / "ended")}
    subprocess.run([sys.executable, "-P", "-c", STARTS], env=environment, timeout=60, check=False)
    end = time.monotonic() + 30
    while not (tmp_path / "ended").exists() and time.monotonic() < end:
        time.sleep(0.01)
    assert (tmp_path / "ended").read_text() == "its input was empty, and it was asked to end"
