"""What a terminal shows is what was written, brackets included, and every command to install something is one that works."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from helpers.bench_folder import LEAKAGE, TOML
from typer.core import TyperGroup
from typer.testing import CliRunner

from thermohyd.identify.cli.commands import app
from thermohyd.identify.cli.loudness import Commands
from thermohyd.identify.cli.process import consoles
from thermohyd.identify.optional_parts import PARTS, install


ROOT = Path(__file__).parents[3]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
PAGES = [*(ROOT / "docs").glob("**/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
SOURCES = [file for folder in ("thermohyd", "identify", "data") for file in (ROOT / folder).glob("**/*.py")]
WIDE = {"COLUMNS": "1500", "TERMINAL_WIDTH": "1500"}


def commands(group: Any, *names: str) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command by the words that call it, with its texts as they stand in the source: not asked for by `get_command`."""
    for name, command in group.commands.items():
        yield (*names, name), command
        if isinstance(command, TyperGroup):
            yield from commands(command, *names, name)


PROGRAM: Any = typer.main.get_command(app)
COMMANDS = dict(commands(PROGRAM))


def words(text: str) -> str:
    """Without frames and line breaks."""
    return re.sub(r"[\s│]+", " ", text).strip()


def help_of(*names: str) -> str:
    ran = CliRunner().invoke(app, [*names, "--help"], env=WIDE)
    assert ran.exit_code == 0
    return words(ran.output)


@pytest.mark.parametrize("names", COMMANDS, ids=" ".join)
def test_help_is_shown_as_it_was_written(names):
    shown, command = help_of(*names), COMMANDS[names]
    for part in (command, *command.params):
        if part.help:
            assert words(part.help).replace("\\[", "[") in shown


def test_the_list_of_commands():
    shown = help_of()
    for names, command in COMMANDS.items():
        if len(names) == 1:
            assert words((command.help or "").partition("\n\n")[0]) in shown


def test_a_bracket_in_any_text_is_shown():
    """Of the group itself, of a command in it, and of an option."""
    made = typer.Typer(cls=Commands, help="Group of [start].")

    @made.callback()
    def _(one: bool = typer.Option(False, "--one", help="Else [red]. ")) -> None: ...

    @made.command("fit")
    def _(two: bool = typer.Option(False, "--two", help="pip install '.[app]', [/b] and [um]")) -> None:
        """In [conditions]."""

    asked = [CliRunner().invoke(made, arguments, env=WIDE).output for arguments in (["--help"], ["fit", "--help"])]
    for text in ("Group of [start].", "Else [red].", "In [conditions]."):
        assert text in asked[0]
    for text in ("In [conditions].", "pip install '.[app]', [/b] and [um]"):
        assert text in asked[1]


@pytest.mark.parametrize("name", ["my[red]record", "a [bold]b[/] :gear:", "[/um]"])
def test_names_and_headers_are_shown_as_they_are(name, tmp_path, monkeypatch):
    """Of a folder, of a valve, of a column; as results, as files that were written, in failures and in wrong usage."""
    monkeypatch.chdir(tmp_path)
    folder = Path(name.replace("/", "|"))
    said = lambda *arguments: words(CliRunner().invoke(app, arguments, env=WIDE).output)
    assert f"written: {folder}/bench.toml" in said("new", str(folder))
    text = TOML.replace("test valve", name)
    (folder / "bench.toml").write_text(text)
    (folder / "leakage.csv").write_text(LEAKAGE)
    shown = said("check", str(folder))
    assert shown.startswith(f"{name}: ")
    assert f"{folder}, 2 files" in shown
    assert "spool_position [um]" in shown
    (folder / "bench.toml").write_text(f"{text}columns = {{time = '{name}'}}\n")
    assert f'"{name}"' in said("check", str(folder))
    assert f"No such option: --{name}" in said("check", f"--{name}")
    assert f"{folder} lost: no such folder" in said("check", f"{folder} lost")


def test_the_consoles_show_text_as_it_is(capsys):
    shown = consoles(False)
    for console in (shown.results, shown.notes):
        console.print("FMU of a [bold]b[/] :gear: [um]")
    captured = capsys.readouterr()
    assert captured.out == captured.err == "FMU of a [bold]b[/] :gear: [um]\n"


def test_the_table_of_parts_is_that_of_the_package():
    said = {part: [re.split("[<>=]", need)[0] for need in needs] for part, needs in EXTRAS.items() if part != "dev"}
    assert {part: {name.replace("_", "-") for name in names} for part, names in PARTS.items()} == {
        part: {name.lower() for name in names} for part, names in said.items()
    }
    with pytest.raises(KeyError):
        install("apps")


# `pip install thermohyd` and "thermohyd[app]" ask an index of packages, and none has it.
INSTALLS = re.compile(r"pip install\s+([^`\n]*)")
PART = re.compile(r"'\.\[([\w,]+)\]'")


def test_what_pages_and_sources_say_to_install_can_be_installed():
    for file in (*PAGES, *SOURCES):
        text = re.sub(r"\s+", " ", file.read_text(encoding="utf-8"))
        asked_of_an_index = re.findall(r"thermohyd\[[a-z]+\]|pip install [\"']?thermohyd", text)
        unknown = {part for parts in PART.findall(text) for part in parts.split(",")} - set(EXTRAS)
        assert (file, asked_of_an_index, unknown) == (file, [], set())


@pytest.mark.parametrize("names", COMMANDS, ids=" ".join)
def test_what_help_says_to_install_can_be_installed(names):
    for said in INSTALLS.findall(help_of(*names)):
        found = re.match(r"-c constraints.txt '\.\[(\w+)\]' in the source folder of thermohyd", said)
        assert found is not None, said
        assert found[1] in PARTS
