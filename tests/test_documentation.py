"""The site: every page is reachable, every link leads somewhere, and the tutorial is typed as it stands, from an empty folder.

Its diagnosis takes minutes of computing: that step and those behind it run where THERMOHYD_TUTORIAL=1 asks for it (`make tutorial`).
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from thermohyd.identify.cli.commands import app


ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("**/*.md"))
BLOCK = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")
TUTORIAL = BLOCK.findall((DOCS / "tutorial.md").read_text(encoding="utf-8"))
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
    program: Any = typer.main.get_command(app)
    lines = [line for kind, _, body in TUTORIAL if kind == "sh" for line in body.strip().splitlines()]
    assert len(lines) == 6
    for line in lines:
        name, *arguments = shlex.split(line)[1:]
        chosen = program.commands[name]
        if hasattr(chosen, "commands"):
            chosen, arguments = chosen.commands[arguments[0]], arguments[1:]
        chosen.make_context(name, list(arguments))
