"""The blocks of three pages as a reader types them: in the printed order, in one session, from an empty folder; outputs as they say.

Of README and of every page: what they import and name is public.
"""

import ast
import json
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer
from helpers.page_session import agrees, commands, comments, python_blocks

from thermohyd.identify import read_record
from thermohyd.identify.cli.commands import app


ROOT = Path(__file__).parents[1]
IN_ORDER = [ROOT / "docs" / f"{name}.md" for name in ("using", "why", "studies")]
PAGE = "\n".join(page.read_text(encoding="utf-8") for page in IN_ORDER)
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def session(tmp_path_factory) -> dict[str, Any]:
    """What happened when the pages were typed."""
    script = Path(__file__).parent / "helpers" / "page_session.py"
    ran = subprocess.run(
        [sys.executable, "-P", script, *IN_ORDER],
        cwd=tmp_path_factory.mktemp("reader"),
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr[-3000:]
    return json.loads(ran.stdout)


@pytest.mark.nightly  # diagnoses and studies among them
def test_every_block_runs_and_prints_what_its_comments_say(session):
    assert len(session["blocks"]) == len(python_blocks(PAGE))
    told = [entry for block in session["blocks"] for entry in block if entry["printed"] and entry["comment"]]
    for entry in told:
        assert agrees(entry["printed"], entry["comment"]), entry
    assert len(told) >= 10


@pytest.mark.nightly  # a whole diagnosis
def test_the_diagnosis_of_the_template_says_something(session):
    (headline,) = [e["printed"] for block in session["blocks"] for e in block if "headline" in e["code"]]
    assert headline.strip().endswith(".")


def test_every_comment_beside_a_print_was_compared(session):
    printing = [entry for block in session["blocks"] for entry in block if entry["code"].startswith("print(")]
    without = [entry["code"] for entry in printing if not entry["comment"]]
    assert without == ["print(diagnosis.headline)"]


def test_the_first_commands_leave_what_they_promise(session):
    assert set(session["commands"].values()) == {0}
    for name in ("my_valve/bench.toml", "my_report/report.html", "my_report/model.json", "my_prediction/leakage.csv"):
        assert name in session["files"]


PUBLIC = {"thermohyd", "thermohyd.identify", "thermohyd.data"}
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))]
# Of prose too: `thermohyd.identify.fitting.fit` names a module that may move.
DOTTED = re.compile(r"(?<![.\w])thermohyd(?:\.[a-z_]\w*)+")


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_pages_import_only_what_is_public(path):
    page = path.read_text(encoding="utf-8")
    for block in python_blocks(page):
        for node in ast.walk(ast.parse(block)):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                modules = [node.module]
                if node.module in PUBLIC:  # a public name, not a module beneath
                    found = {f"{node.module}.{a.name}": getattr(import_module(node.module), a.name) for a in node.names}
                    modules += [name for name, what in found.items() if isinstance(what, ModuleType)]
            assert {name for name in modules if name.split(".")[0] == "thermohyd"} <= PUBLIC


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_pages_name_only_what_is_public(path):
    prose = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for name in DOTTED.findall(prose):
        home, _, attribute = name.rpartition(".")
        assert name in PUBLIC or (home in PUBLIC and attribute in import_module(home).__all__), name


def test_every_command_is_one_that_the_program_takes():
    program: Any = typer.main.get_command(app)
    made = {"."}
    assert len(commands(PAGE)) >= 8
    for name, *arguments in (*commands(PAGE), *commands(README)):
        chosen = program.commands[name]
        given = chosen.make_context(name, list(arguments)).params
        for key in ("bench", "benches", "model"):
            for path in given.get(key) or () if key == "benches" else [given.get(key)]:
                assert path is None or (ROOT / path).exists() or path.parts[0] in made, (name, path)
        made |= {str(given[key]) for key in ("out", "folder") if given.get(key)}


def test_the_record_shown_reads(tmp_path):
    toml, log = re.findall(r"^```toml\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)
    (table,) = re.findall(r"^```\n(time \[s\].*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)
    (tmp_path / "bench.toml").write_text(toml, encoding="utf-8")
    (tmp_path / "leakage.csv").write_text(table, encoding="utf-8")
    (tmp_path / "flow_gain.csv").write_text(table.replace("leakage_flow", "flow"), encoding="utf-8")
    record = read_record(tmp_path)
    assert list(record.tests) == ["leakage", "flow_gain"]
    assert record.start["discharge_coefficient"].fixed
    assert record.tests["leakage"].temperature[0] == pytest.approx(313.25)
    # The table of a log that is read as it is: two lines above its own headers, a remark, a gap.
    (tmp_path / "bench.toml").write_text(re.sub(r"\[tests\.leakage\].*?(?=\[tests)", log, toml, flags=re.DOTALL))
    headers = "time [s],LVDT [um],supply_pressure [bar],temperature [degC],QL [l/min],remarks"
    body = f"logger 4\n17 May\nop 3\n{headers}\n0.00,-213.00,70.00,40.1,0.0012,up\n0.01,-212.00,70.00,40.1,,gap\n"
    (tmp_path / "log 17.csv").write_text(body)
    (leakage,) = read_record(tmp_path).tests["leakage"].channels
    assert leakage.value == pytest.approx([0.0012 / 6e4])


@pytest.mark.parametrize(
    ("printed", "comment", "right"),
    [
        ("1314.045 -3.974\n", "1314 rad/s, -3.97 rad/s per K", True),
        ("1314.045 -3.974\n", "1314 rad/s", False),
        ("0.655\n", "0.47 % of it", False),
        ("[0.0320213]\n", "0.0320", True),
        ("X0*tanh(Q/Q0) + k*Q\n", "X0*tanh(Q/Q0) + k*Q", True),
        ("True\n", "False", False),
    ],
)
def test_what_agrees(printed, comment, right):
    assert agrees(printed, comment) is right


def test_comments_are_those_at_the_end_of_a_line():
    assert comments('a = "#"  # one\nb = 2\n') == {1: "one"}
