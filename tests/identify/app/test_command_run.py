"""The program as a process: what it says while it runs, how it ends, that it can be stopped, and that nothing of it stays."""

import gc
import sys
import time
from pathlib import Path

import pytest

from thermohyd.identify.app import command_run
from thermohyd.identify.app.closing import Watch
from thermohyd.identify.app.command_run import CommandRun
from thermohyd.identify.app.upload import TemporaryHome
from thermohyd.identify.app.work import Work


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
    folder = Path(work.home.folder, "results")
    folder.mkdir()
    (folder / "fit.json").write_text(f"{work.record}, {work.home.folder}")
    assert work.result("fit.json") == b"v, a temporary folder"
    assert work.result("report.html") is None
