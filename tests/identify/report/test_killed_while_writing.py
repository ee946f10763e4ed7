"""Killed at any step of writing, a folder holds old results or new ones, never one beside the other; the next call leaves nothing over."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from thermohyd.identify.report.files import MANIFEST, PLAN, Writer, write_all


pytestmark = pytest.mark.skipif(os.name != "posix", reason="kills children of its own")

OLD = {"fit.json": "old", "model.json": "old", "report.html": "old", "plots/gone.png": "old"}
NEW = {"fit.json": "new", "model.json": "new", "report.html": "new", "plots/added.png": "new"}
MINE = {"mine.txt": "mine", "plots/mine.png": "mine"}
# Writes into the folder N of each kind and is killed at its Nth operation on files, for every N until it comes to its end.
KILLED = """
import json, os, sys
from pathlib import Path
from thermohyd.identify.report.files import Writer, write_all
place, new, fails = Path(sys.argv[1]), json.loads(sys.argv[2]), sys.argv[3] == "fails"
replace, replaced = os.replace, 0
def failing(source, target):
    global replaced
    replaced += 1
    if replaced == 6:
        raise OSError("disk full")
    replace(source, target)
for number in range(1, 1000):
    child = os.fork()
    if not child:
        left = number
        def count(event, arguments):
            global left
            if event in ("os.rename", "os.mkdir", "os.rmdir", "os.remove", "shutil.rmtree") or event == "open":
                left -= 1
                if not left:
                    os._exit(9)
        folder = place / str(number) / "out"
        if fails:
            os.replace = failing
        sys.addaudithook(count)
        try:
            write_all(folder, new, Writer("fit", "/a"))
        except OSError:
            os._exit(1)
        os._exit(0)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status != 9:
        break
print(number, status)
"""


def held(folder: Path) -> dict[str, str]:
    """Everything but what is not whole yet."""
    paths = [
        path
        for path in folder.rglob("*")
        if path.is_file() and not path.relative_to(folder).parts[0].startswith(".writing-")
    ]
    return {path.relative_to(folder).as_posix(): path.read_text() for path in paths if path.name != MANIFEST}


def killed_everywhere(
    place: Path, start: dict[str, str] | None, mine: dict[str, str], fails: bool = False
) -> list[Path]:
    """A folder for each step at which the writing of NEW was killed. start: what a whole run wrote there before."""
    template = place / "template"
    template.mkdir(parents=True)
    if start is not None:
        write_all(template / "out", start, Writer("fit", "/a"))
        for name, text in mine.items():
            (template / "out" / name).write_text(text)
    for number in range(1, 150):
        shutil.copytree(template, place / str(number))
    arguments = [sys.executable, "-P", "-c", KILLED, str(place), json.dumps(NEW), "fails" if fails else ""]
    done = subprocess.run(arguments, capture_output=True, text=True, check=True)
    count, status = map(int, done.stdout.split())
    assert status == (1 if fails else 0)
    assert 15 < count < 150
    return [place / str(number) / "out" for number in range(1, count)]


def test_a_new_folder_is_there_whole_or_not_at_all(tmp_path):
    for folder in killed_everywhere(tmp_path, None, {}):
        assert held(folder) in ({}, NEW)
        assert folder.exists() == bool(held(folder))
        write_all(folder, NEW, Writer("fit", "/a"))
        assert held(folder) == NEW
        assert [path.name for path in folder.parent.iterdir()] == ["out"]


@pytest.mark.parametrize("fails", [False, True])
def test_old_results_or_new_ones_never_both(tmp_path, fails):
    """fails: a full disk makes the program put everything back, and that is killed, too."""
    states = set()
    for folder in killed_everywhere(tmp_path, OLD, MINE, fails):
        found = held(folder)
        assert MINE.items() <= found.items()
        ours = {name: text for name, text in found.items() if name not in MINE}
        assert len(set(ours.values())) <= 1
        assert ours.items() <= OLD.items() or ours.items() <= NEW.items()
        states.add(tuple(sorted(ours.values())))
        write_all(folder, {"note.txt": "of another"}, Writer("simulate", "/a"))
        # What was begun has come to an end, the one or the other.
        assert held(folder) in (OLD | MINE | {"note.txt": "of another"}, NEW | MINE | {"note.txt": "of another"})
        assert not [path for path in folder.rglob("*") if ".writing-" in path.name]
    assert {("old",) * 4, ("new",) * 4} - ({("new",) * 4} if fails else set()) <= states


def leftover(folder: Path, name: str, plan: object) -> Path:
    left = folder / name
    left.mkdir()
    (left / PLAN).write_text(json.dumps(plan))
    (left / "0.new").write_text("planted")
    return left


def dead() -> str:
    """The name of what a process left that is no more."""
    script = "from thermohyd.identify.report import files as f; import os; print(f'{f.STAGING}{f._machine()}-{os.getpid()}-0')"
    return subprocess.run(
        [sys.executable, "-P", "-c", script], capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.mark.parametrize("name", ["../outside.txt", "/outside.txt", "link/outside.txt", 5])
def test_a_plan_of_a_stranger_reaches_nothing_outside(tmp_path, name):
    folder = tmp_path / "out"
    folder.mkdir()
    (tmp_path / "other").mkdir()
    (folder / "link").symlink_to(tmp_path / "other")
    leftover(folder, dead(), [{"name": name, "former": None, "new": "0"}])
    write_all(folder, {"fit.json": "1"})
    assert not (tmp_path / "outside.txt").exists()
    assert not list((tmp_path / "other").iterdir())
    assert (folder / "fit.json").read_text() == "1"


def test_what_others_changed_meanwhile_stays(tmp_path):
    (tmp_path / "model.json").write_text("edited by hand")
    leftover(tmp_path, dead(), [{"name": "model.json", "former": "another hash", "new": "0"}])
    write_all(tmp_path, {"fit.json": "1"})
    assert held(tmp_path) == {"model.json": "edited by hand", "fit.json": "1"}
    assert not list(tmp_path.glob(".writing-*"))


def test_what_may_still_be_written_or_is_not_ours_stays(tmp_path):
    other = tmp_path / dead()
    alive = tmp_path / "-".join([*other.name.split("-")[:2], str(os.getppid()), "0"])
    for folder, file in ((alive, "0.new"), (other, "thesis.doc")):
        folder.mkdir(exist_ok=True)
        (folder / file).write_text("x")
    write_all(tmp_path, {"fit.json": "1"})
    assert (other / "thesis.doc").exists()
    assert (alive / "0.new").exists()
