"""`thermohyd seed`: files whole and readable, the terminal's screen, and what happens where nothing can be written."""

import io
import json
import xml.etree.ElementTree as ElementTree

import pandas as pd
import pytest
from helpers.chromium import PROGRAM, browser
from helpers.pictures import is_drawn
from helpers.report_page import check_in_browser, check_text
from rich.console import Console
from typer.testing import CliRunner

from thermohyd.identify.cli import jax_setup
from thermohyd.identify.cli.commands import app
from thermohyd.identify.seed import study as seed_module
from thermohyd.identify.seed.report import CAPTIONS, print_seed, seed_page


@pytest.fixture
def run(monkeypatch, study):
    """`thermohyd` with arguments; the study is the one that the other tests made."""
    monkeypatch.setattr(jax_setup, "set_up_jax", lambda: None)
    monkeypatch.setattr(seed_module, "seed_study", lambda progress=None, **_: study)
    monkeypatch.delenv("THERMOHYD_DEBUG", raising=False)
    return lambda *arguments: CliRunner().invoke(app, ["seed", *(str(a) for a in arguments)])


def test_writes_every_file(run, study, tmp_path):
    ran = run("--out", tmp_path / "seed", "--json")
    assert ran.exit_code == 0, ran.stderr
    written = {file.name: file for file in (tmp_path / "seed").iterdir()}
    figures = {f"{name}.{kind}" for name in CAPTIONS for kind in ("png", "svg")}
    tables = {"curves.csv", "gains.csv", "eq6.csv", "claims.csv"}
    assert set(written) == figures | tables | {".thermohyd.json", "seed.json", "eq6.json", "seed.html"}
    assert {f"figure_{n}" for n in range(3, 9)} < set(CAPTIONS)
    for name in figures:
        drawing = written[name].read_bytes()
        assert is_drawn(drawing) if name.endswith("png") else ElementTree.fromstring(drawing).tag.endswith("svg"), name
    page = written["seed.html"].read_text()
    assert page.count("data:image/svg+xml") == len(CAPTIONS)
    assert "X0*tanh(Q/Q0) + k*Q" in page
    content = json.loads(written["seed.json"].read_text())
    assert json.loads(ran.stdout) == content
    assert len(content["claims"]) == len(study.claims)
    assert json.loads(written["eq6.json"].read_text()).keys() == {"HM", "THM"}
    gains = pd.read_csv(written["gains.csv"])
    null = gains.query("model == 'HM' and `supply_pressure [bar]` == 70")["leakage at 0 % [l/min]"]
    assert null.to_numpy(dtype=float).max() == pytest.approx(0.28388, abs=1e-5)
    assert len(pd.read_csv(written["claims.csv"])) == len(study.claims)


@pytest.mark.skipif(PROGRAM is None, reason="no Chromium here (apt-get install chromium)")
def test_page_in_a_browser(study, tmp_path):
    page = seed_page(study, {})
    check_text(page)
    (tmp_path / "seed.html").write_text(page, encoding="utf-8")
    with browser() as tab:
        check_in_browser(tab, tmp_path / "seed.html")


def test_nothing_is_written_where_the_folder_is_a_file(run, tmp_path):
    (tmp_path / "taken").write_text("mine")
    ran = run("--out", tmp_path / "taken")
    assert ran.exit_code == 2
    assert ran.stderr == f"thermohyd: {tmp_path / 'taken'}: is a file; --out takes a folder\n"
    assert (tmp_path / "taken").read_text() == "mine"


def test_one_screen_of_eighty_columns(study):
    out = io.StringIO()
    print_seed(study, Console(file=out, width=80, no_color=True))
    lines = out.getvalue().splitlines()
    assert "…" not in out.getvalue()
    assert len(lines) < 40
    assert sum(line.rstrip().endswith(("holds", "partly", " no")) for line in lines) == len(study.claims)


def test_help():
    ran = CliRunner().invoke(app, ["seed", "--help"])
    assert ran.exit_code == 0
    assert "Figures 3 to 8" in ran.stdout
    assert "--out" in ran.stdout
