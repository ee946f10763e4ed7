"""The site: every page is reachable, every link leads somewhere, every command is one, and tutorial and how-tos are typed as they stand.

What computes for minutes runs where THERMOHYD_TUTORIAL=1 asks for it (`make tutorial`); "1 write" puts what commands print today
into the pages.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import textwrap
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from helpers.fleet_records import stored_row
from helpers.page_session import agrees, python_blocks, run_block
from helpers.shown_outputs import LEFT_OUT, as_shown, where_it_differs
from typer.testing import CliRunner

import thermohyd as th
from thermohyd.identify.cli.commands import app
from thermohyd.identify.fleet.store import Store


ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("**/*.md"))
BLOCK = re.compile(r"^( *)```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")


def blocks(page: Path) -> list[tuple[str, str, str]]:
    """(kind, title, text) of each block of code."""
    found = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [(kind, title, textwrap.dedent(body)) for _, kind, title, body in found]


# "1": commands that compute for long run, too. "write": pages that show what is printed no more are written again; "1 write": both.
ASKED = os.environ.get("THERMOHYD_TUTORIAL", "")


def nav_files(entry: Any) -> list[str]:
    if isinstance(entry, str):
        return [entry]
    return [file for part in (entry.values() if isinstance(entry, dict) else entry) for file in nav_files(part)]


def test_every_page_is_in_the_menu():
    site = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    assert sorted(nav_files(site["nav"])) == [page.relative_to(DOCS).as_posix() for page in PAGES]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in LINK.findall(re.sub(r"`[^`]*`", "", text)):
        if not target.startswith(("http://", "https://", "#")):
            assert (page.parent / target.split("#")[0]).is_file(), target


def takes(line: str) -> None:
    """The program knows this command and its options."""
    program: Any = typer.main.get_command(app)
    name, *arguments = shlex.split(line, comments=True)[1:]
    chosen = program.commands[name]
    if hasattr(chosen, "commands"):
        chosen, arguments = chosen.commands[arguments[0]], arguments[1:]
    chosen.make_context(name, list(arguments))


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.name)
def test_every_command_is_one_that_the_program_takes(page):
    text = page.read_text(encoding="utf-8")
    for line in re.findall(r"^(?: {4})?(?:\.venv/bin/)?(thermohyd [a-z]+ .*)$", text, flags=re.MULTILINE):
        if line.count('"') % 2 == 0:  # an SQL query goes on in the next line
            takes(line)


TYPED = [DOCS / "tutorial.md", *sorted((DOCS / "howto").glob("*.md")), DOCS / "concepts.md"]
STATUS = "(exit status"
AT_ONCE = ("check", "new")  # of the commands; the others where THERMOHYD_TUTORIAL asks for them


# Where a terminal's lines end hangs on how long the folder's name is: as long as that of the pages' last writing.
LENGTH = 61


@pytest.fixture
def folder() -> Iterator[Path]:
    name = tempfile.gettempdir()
    made = Path(tempfile.mkdtemp(prefix="p" * max(1, LENGTH - len(name) - 9), dir=name))
    yield made
    shutil.rmtree(made, ignore_errors=True)


@pytest.mark.parametrize("page", TYPED, ids=lambda page: page.stem)
def test_a_page_is_typed_as_it_stands(page, folder, monkeypatch):
    """From an empty folder, block by block. One with a title is a file; one of text is all that was printed by the commands, or the
    Python, before it: output, and where the exit status is not 0 that status and what went to stderr. Only of what computes for long a
    page need not show it; then it ends with status 0."""
    monkeypatch.chdir(folder)
    before, said, at_once, wrong = set(th.EFFECTS), "", True, []
    session: dict[str, Any] = {}
    try:
        for kind, title, body in blocks(page):
            if said and (kind != "text" or title) and (at_once or STATUS in said):
                wrong.append(f"the page does not show {said!r}")
            if title:
                Path(title).parent.mkdir(parents=True, exist_ok=True)
                Path(title).write_text(body, encoding="utf-8")
            elif kind == "text" and said is not None and (differs := where_it_differs(body, said, folder)):
                wrong.append(differs)
                written_again(page, body, as_shown(said, folder))
            said = "" if title or kind == "text" else said
            if kind == "python" and not title:
                ran = run_block(body, session)
                wrong += [
                    str(e) for e in ran if e["comment"] and e["printed"] and not agrees(e["printed"], e["comment"])
                ]
                said, at_once = "".join(entry["printed"] for entry in ran if not entry["comment"]), True
            elif kind == "sh":
                printed = [typed(line) for line in body.strip().splitlines()]
                at_once = all(shlex.split(line)[1] in AT_ONCE for line in body.strip().splitlines())
                said = None if None in printed else "".join(map(str, printed))
    finally:
        for name in set(th.EFFECTS) - before:
            th.unregister_effect(name)
    assert not wrong


def typed(line: str) -> str | None:
    """What a command printed; None of one that computes for long where nobody asked for it."""
    takes(line)
    arguments = shlex.split(line)[1:]
    if arguments[0] == "app" or not ("1" in ASKED or arguments[0] in AT_ONCE):  # the app serves until it is interrupted
        return None
    if arguments[0] in AT_ONCE:
        ran = CliRunner().invoke(app, arguments)
        status, out, err = ran.exit_code, ran.stdout, ran.stderr
    else:
        script = str(Path(sys.executable).parent / "thermohyd")
        done = subprocess.run([script, *arguments], capture_output=True, text=True, check=False)
        status, out, err = done.returncode, done.stdout, done.stderr
    return out if status == 0 else f"{out}{err}{STATUS} {status})\n"


def written_again(page: Path, old: str, new: str) -> None:
    """Where it is asked for, the page with what its command prints today; a block that leaves out lines is for a human."""
    text = page.read_text(encoding="utf-8")
    if "write" in ASKED and f"\n{LEFT_OUT}\n" not in f"\n{old}" and text.count(old) == 1:
        page.write_text(text.replace(old, new), encoding="utf-8")


def test_what_a_page_shows_is_compared_word_by_word(tmp_path):
    printed = f"record {tmp_path}/a, read 2026-01-02 03:04; thermohyd 0.2\n  ────\nclearance  1.9956 um\nend\n"
    shown = "record /home/you/a, read 2025-12-31 23:59; thermohyd 0.1.0\n──────\nclearance 1.9958 um\nend\n"
    assert where_it_differs(shown, printed, tmp_path) == ""
    assert where_it_differs(as_shown(printed, tmp_path), printed, tmp_path) == ""
    assert where_it_differs("record\n...\nclearance 1.9957 um\n...\n", printed, tmp_path) == ""
    for other in ("clearance 2.0956 um", "clearance 1.9956 mm", "underlap 1.9956 um", ""):
        assert where_it_differs(shown.replace("clearance 1.9958 um", other), printed, tmp_path)
    assert where_it_differs(shown.replace("end", ""), printed, tmp_path) == "printed was also 'end'"
    assert where_it_differs("...\nclearance 1.9956 um\n", printed, tmp_path)


def test_the_other_pages_blocks_are_read(tmp_path, monkeypatch):
    """TOML parses; the Python of the page on fleets runs on a store. The session of three pages is tests/test_readme.py's."""
    monkeypatch.chdir(tmp_path)
    known = {"using", "why", "studies", *(page.stem for page in TYPED)}
    for page in PAGES:
        kinds = [(kind, body) for kind, _, body in blocks(page) if page.stem not in known]
        for kind, body in kinds:
            assert kind in ("toml", "bash", "yaml") or page.stem in ("fleet", "api"), (page.name, kind)
            if kind == "toml":
                tomllib.loads(body)
            elif kind == "yaml":
                yaml.safe_load(body)
            elif kind == "bash":
                subprocess.run(["bash", "-n", "-c", body], check=True)
    store = Store("STORE")
    for number in range(3):
        store.write_result(stored_row(number))
    (code,) = python_blocks((DOCS / "fleet.md").read_text(encoding="utf-8"))
    run_block(code, {})
