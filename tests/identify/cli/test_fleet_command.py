"""`thermohyd fleet` as a user sees it: help without heavy imports, answers, refusals, a missing package."""

import json
import subprocess
import sys

import pytest
from helpers.fleet_records import stored_row, write_fleet
from typer.testing import CliRunner

from thermohyd.identify.cli.commands import app
from thermohyd.identify.fleet.store import Store


def run(*arguments: object):
    return CliRunner().invoke(app, ["fleet", *map(str, arguments)])


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    opened = Store(tmp_path_factory.mktemp("fleet") / "store")
    for number in range(8):
        opened.write_result(stored_row(number))
    return opened.folder


def test_help_needs_none_of_the_packages():
    code = (
        "import sys\n"
        "from thermohyd.identify.cli.commands import app\n"
        "assert not {'jax', 'distributed', 'dask', 'duckdb', 'pyarrow', 'pandas', 'psutil'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-P", "-c", code], check=True)
    assert all(word in run("--help").stdout for word in ("run", "watch", "query", "life", "report"))


def test_a_missing_package_is_named(store, monkeypatch):
    monkeypatch.setitem(sys.modules, "duckdb", None)
    found = run("query", store, "FROM records")
    assert (found.exit_code, found.stderr) == (
        2,
        "thermohyd: fleets need the package duckdb: pip install -c constraints.txt '.[fleet]' in the source folder of thermohyd\n",
    )


def test_answers(store):
    sql = "SELECT serial, count(*) AS n FROM records GROUP BY serial ORDER BY serial"
    assert json.loads(run("query", store, sql, "--json").stdout) == [
        {"serial": "S0", "n": 3},
        {"serial": "S1", "n": 3},
        {"serial": "S2", "n": 2},
    ]
    assert run("query", store, sql, "--csv").stdout.splitlines() == ["serial,n", "S0,3", "S1,3", "S2,2"]
    assert [line.split() for line in run("query", store, sql).stdout.splitlines()[2:]] == [
        ["S0", "3"],
        ["S1", "3"],
        ["S2", "2"],
    ]


@pytest.mark.parametrize("command", ["query", "life", "report", "run"])
def test_a_damaged_file_is_named_on_stderr(tmp_path, command):
    opened = Store(tmp_path / "store")
    for number in range(4):
        opened.write_result(stored_row(number))
    opened.tidy(all_of_them=True)
    path = opened.files()[0]
    path.write_bytes(b"PAR1")
    more = {
        "query": ("SELECT count(*) AS n FROM records", "--json"),
        "life": ("--json",),
        "report": ("--out", tmp_path / "page"),
        "run": ("--records", write_fleet(tmp_path / "records", 1), "--job", "read"),
    }
    found = run(command, opened.folder, *more[command])
    assert found.exit_code == 0
    said = [line for line in found.stderr.splitlines() if line.startswith("thermohyd: warning: ")]
    assert len(said) == 1
    assert said[0].startswith(f"thermohyd: warning: {path} cannot be read (")
    assert said[0].endswith("); remove it, and its records are computed again")
    if command == "query":
        assert json.loads(found.stdout) == [{"n": 2}]


def test_the_life_and_the_pages(store, tmp_path):
    life = json.loads(run("life", store, "--json").stdout)
    assert {valve["serial"] for valve in life["valves"]} == {"S0", "S1", "S2"}
    found = run("report", store, "--out", tmp_path / "page")
    assert found.exit_code == 0
    assert found.stdout == f"written: {tmp_path / 'page' / 'index.html'}\n"


def test_quiet_says_nothing_of_what_went_well(store, tmp_path):
    found = run("report", store, "--out", tmp_path / "page", "--quiet")
    assert (found.exit_code, found.stdout, found.stderr) == (0, "", "")
    assert (tmp_path / "page" / "index.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("query", "nowhere", "FROM records"), "nowhere: is no fleet's store"),
        (
            ("run", "{new}", "--records", "nowhere"),
            "nowhere: no such folder; --records takes a folder, or a pattern in quotes",
        ),
        (("run", "{new}", "--records", "{fleet}", "--job", "fix"), 'unknown job "fix"; did you mean "fit"?'),
        (("run", "{new}", "--records", "{fleet}", "--without", "droop"), "--without is for --job diagnose"),
        (
            ("run", "{new}", "--records", "{fleet}", "--job", "read", "--cluster", "head"),
            '--cluster takes "local", the address',
        ),
        (("watch", "{new}", "--records", "nowhere"), "nowhere: no such folder"),
        (("life", "{store}", "--limits", "nowhere"), "nowhere: no such file"),
    ],
)
def test_refusals(store, tmp_path, arguments, words):
    fleet = write_fleet(tmp_path / "records", 1)
    places = {"new": tmp_path / "new", "store": store, "fleet": fleet}
    found = run(*[argument.format(**places) for argument in arguments])
    assert (found.exit_code, found.stdout) == (2, "")
    assert words in found.stderr
