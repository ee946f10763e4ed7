"""The pages of a store: what they hold, and that a browser draws them without an error, where there is one."""

import json
import re
import shutil
import subprocess
from datetime import datetime

import pytest
from helpers.fleet_records import stored_row

from thermohyd.identify.fleet.identity import Found, Settings
from thermohyd.identify.fleet.life import FleetLife, Trend, Valve
from thermohyd.identify.fleet.page import fleet_page, page_files
from thermohyd.identify.fleet.rows import failure_of
from thermohyd.identify.fleet.store import Store


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fleet")
    store = Store(folder / "store")
    for number in range(12):
        value = {
            "name": "clearance",
            "value": 2e-6 + 1e-8 * number,
            "std": 1e-8,
            "unit": "m",
            "at_bound": False,
            "fixed": False,
        }
        row = {"serial": f"<b>{number % 3}", "parameters": [value], "date": datetime(2020, 1 + number, 1)}
        store.write_result(stored_row(number, **row, report="reports/own page" if number == 11 else None))
    store.write_failure(
        failure_of(Found("/records/bad", "x", ()), Settings("fit"), "unreadable", "</script> is no number")
    )
    fleet_page(store, folder / "out")
    return folder / "out"


def data(text: str) -> dict:
    return json.loads(re.sub(r"^var fleet = |;\n$", "", text))


def test_the_table_and_the_lives(page):
    head = data((page / "data" / "valves.js").read_text())
    assert sorted(row[2] for row in head["valves"]) == ["<b>0", "<b>1", "<b>2"]
    assert head["failures"] == [
        {"path": "/records/bad", "kind": "unreadable", "reason": "</script> is no number", "strikes": 1}
    ]
    (kind,) = head["types"].values()
    assert sum(kind["spread"][0]["level"]["counts"]) == kind["valves"] == 3
    lives = json.loads((page / "data" / "lives-0.js").read_text().removeprefix("fleet.lives(0, ").removesuffix(");\n"))
    place = next(i for i, row in enumerate(head["valves"]) if row[2] == "<b>2")
    life = lives[str(place)]
    assert [trend["unit"] for trend in life["trends"]] == ["um"]
    assert len(life["trends"][0]["points"]) == 4
    assert life["records"][0]["report"] == "../store/reports/own%20page/report.html"
    assert [record["date"] for record in life["records"]] == ["2020-12-01", "2020-09-01", "2020-06-01", "2020-03-01"]


def test_the_worst_come_first_and_thousands_are_split():
    trend = Trend(
        "clearance", "m", 1e-6, 1e-8, 1e-10, 1e-11, 1e-10, 1e-11, 3, [(0.0, 1e-6, 1e-8)] * 3, [(0.0, 1e-6, 1e-8)]
    )
    valves = [Valve("T", str(i), "hours", 3, None, 10.0, "named", [trend]) for i in range(250)]
    files = page_files(FleetLife(valves), {}, [])
    assert {name for name in files if name.startswith("data/lives")} == {f"data/lives-{i}.js" for i in range(3)}
    assert not re.search(r"https?://(?!www\.w3\.org/)", "".join(str(text) for text in files.values()))


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("", ["12 records", "3 of 3 valves", "1 records without a result", "&lt;b&gt;1"]),
        ("#valve/MOOG%2076%2F1%20%3D%20%C3%A4/%3Cb%3E2", ["clearance [um]", "per 1000 h", "own%20page"]),
        ("#type/MOOG%2076%2F1%20%3D%20%C3%A4", ["3 valves; last records", "at the last record of each valve"]),
    ],
)
def test_in_a_browser(page, place, words, tmp_path):
    options = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={tmp_path}",
        "--virtual-time-budget=2000",
    ]
    command = [
        str(CHROMIUM),
        *options,
        "--enable-logging=stderr",
        "--dump-dom",
        f"{(page / 'index.html').as_uri()}{place}",
    ]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=60)
    for word in words:
        assert word in ran.stdout
    assert "Uncaught" not in ran.stderr
    assert "Content Security Policy" not in ran.stderr


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
def test_what_is_not_of_the_page_does_not_run(page, tmp_path):
    """A name that came in as markup would find its script, its image and its style forbidden."""
    shutil.copytree(page, tmp_path / "out")
    index = tmp_path / "out" / "index.html"
    hostile = "<b style='color: red'>x</b><script>document.title = 'run'</script><img src='data:image/gif;base64,R0lGODlhAQAB'>"
    index.write_text(index.read_text().replace("<header>", f"<header>{hostile}"))
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'user'}"]
    command = [
        str(CHROMIUM),
        *options,
        "--virtual-time-budget=2000",
        "--enable-logging=stderr",
        "--dump-dom",
        index.as_uri(),
    ]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert "3 of 3 valves" in ran.stdout
    assert "<title>Fleet</title>" in ran.stdout
    refused = [line for line in ran.stderr.splitlines() if "Content Security Policy" in line]
    assert all(any(word in line for line in refused) for word in ("inline style", "inline script", "image"))
