"""The site: every page is reachable, every link leads somewhere, and the tutorial is typed as it stands, from an empty folder.

Its diagnosis takes minutes of computing: that step and those behind it run where THERMOHYD_TUTORIAL=1 asks for it (`make tutorial`).
"""

import os
import re
import shlex
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from helpers.fleet_records import stored_row
from helpers.page_session import agrees, python_blocks, run_block
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


TUTORIAL = blocks(DOCS / "tutorial.md")
WHOLE = os.environ.get("THERMOHYD_TUTORIAL") == "1"


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


def squeezed(text: str) -> str:
    return re.sub(r"\s+", " ", text)


def runs_long(command: str) -> bool:
    return shlex.split(command)[1] in ("diagnose", "simulate", "export")


def test_the_tutorial_is_typed_as_it_stands(tmp_path):
    """Each text block quotes, line by line, what the command before it printed."""
    said, typed = "", 0
    script = str(Path(sys.executable).parent / "thermohyd")
    for kind, title, body in TUTORIAL:
        if kind == "toml":
            (tmp_path / title).write_text(body, encoding="utf-8")
        elif kind == "python":
            subprocess.run([sys.executable, "-P", "-c", body], cwd=tmp_path, check=True)
        elif kind == "sh":
            said = ""
            for command in body.strip().splitlines():
                if runs_long(command) and not WHOLE:
                    continue
                ran = subprocess.run([script, *shlex.split(command)[1:]], cwd=tmp_path, capture_output=True, text=True)
                assert ran.returncode in (0, 2), ran.stderr
                said += ran.stdout
                typed += 1
        elif said:
            for line in body.strip().splitlines():
                assert squeezed(line) in squeezed(said), line
    assert typed == (6 if WHOLE else 2)
    assert (tmp_path / "seen" / "check.png").is_file()


def test_the_tutorials_commands_are_ones_that_the_program_takes():
    lines = [line for kind, _, body in TUTORIAL if kind == "sh" for line in body.strip().splitlines()]
    assert len(lines) == 6
    for line in lines:
        takes(line)


def takes(line: str) -> None:
    """The program knows this command and its options."""
    program: Any = typer.main.get_command(app)
    name, *arguments = shlex.split(line)[1:]
    chosen = program.commands[name]
    if hasattr(chosen, "commands"):
        chosen, arguments = chosen.commands[arguments[0]], arguments[1:]
    chosen.make_context(name, list(arguments))


TYPED = [*sorted((DOCS / "howto").glob("*.md")), DOCS / "concepts.md"]
AT_ONCE = ("check", "new")  # of the commands; the others where THERMOHYD_TUTORIAL=1 asks for them


@pytest.mark.parametrize("page", TYPED, ids=lambda page: page.stem)
def test_a_page_is_typed_as_it_stands(page, tmp_path, monkeypatch):
    """A block with a title is a file; one of text quotes, line by line, what the commands before it printed."""
    monkeypatch.chdir(tmp_path)
    before, said = set(th.EFFECTS), ""
    session: dict[str, Any] = {}
    try:
        for kind, title, body in blocks(page):
            if title:
                Path(title).parent.mkdir(parents=True, exist_ok=True)
                Path(title).write_text(body, encoding="utf-8")
            elif kind == "python":
                for entry in run_block(body, session):
                    assert agrees(entry["printed"], entry["comment"]) or not entry["printed"], entry
            elif kind == "sh":
                said = "".join(typed(line) for line in body.strip().splitlines())
            elif said:
                assert kind == "text"
                for line in body.strip().splitlines():
                    assert squeezed(line) in squeezed(said), line
    finally:
        for name in set(th.EFFECTS) - before:
            th.unregister_effect(name)


def typed(line: str) -> str:
    """What a command printed; of one that computes for long only whether it would be taken."""
    takes(line)
    arguments = shlex.split(line)[1:]
    if arguments[0] == "app":  # serves until it is interrupted
        return ""
    if WHOLE:
        script = str(Path(sys.executable).parent / "thermohyd")
        ran = subprocess.run([script, *arguments], capture_output=True, text=True, check=False)
        assert ran.returncode in (0, 1, 2), ran.stderr
        assert "Traceback" not in ran.stderr
        return ran.stdout + ran.stderr
    return CliRunner().invoke(app, arguments).output if arguments[0] in AT_ONCE else ""


def test_the_other_pages_blocks_are_read(tmp_path, monkeypatch):
    """TOML parses; the Python of the page on fleets runs on a store. The session of three pages is tests/test_readme.py's."""
    monkeypatch.chdir(tmp_path)
    known = {"tutorial", "using", "why", "studies", *(page.stem for page in TYPED)}
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
