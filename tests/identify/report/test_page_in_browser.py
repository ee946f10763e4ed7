"""The pages of a fit, a diagnosis and a comparison in a headless Chromium: switches, zoom, copying, themes, paper, hostile names."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.chromium import AXE, PROGRAM, Browser, browser as chromium
from helpers.fake_comparison import fake_comparison
from helpers.fake_diagnosis import fake_diagnosis
from helpers.fake_fit import fake_channel, fake_fit, with_files
from helpers.report_page import check_in_browser, check_text, choose

from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.comparison.report import comparison_page
from thermohyd.identify.report.diagnosis_page import diagnosis_page
from thermohyd.identify.report.page import html_report
from thermohyd.identify.typed_command import typed


SVG = b"<svg xmlns='http://www.w3.org/2000/svg' width='8' height='8'/>"
HOSTILE = "</script><script>window.hit = 1</script>\"'><img src=x onerror='window.hit = 1'>&"

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no Chromium here (apt-get install chromium)")


def hostile_fit():
    """Record, oil, runs and files with names that would be scripts, and a file that a spreadsheet would run."""
    fit = fake_fit(HOSTILE, warnings=(HOSTILE,), notes=(HOSTILE,))
    channel = replace(fake_channel("leakage", "leakage_flow", 1e-7, 1, 12), run=np.arange(96) % 12 // 6)
    where = (channel.position, channel.supply_pressure, channel.supply_pressure, channel.temperature)
    test = TestRecord("leakage", Path("x"), *where, (), channel.run, (HOSTILE, "fast"), channel.direction)
    record = with_files(replace(fit.record, name=HOSTILE, tests={"leakage": test}))
    assert record.provenance is not None
    files = tuple(replace(file, name=f"=1+1{HOSTILE}") for file in record.provenance.files)
    record = replace(record, provenance=replace(record.provenance, files=files, path=HOSTILE))
    return replace(fit, record=record, channels=(channel,))


def dynamic_fit():
    step = [fake_channel(f"step{own}", "piston_position", 1e-6, 4, 12) for own in ("", "_slow")]
    return fake_fit(channels=(*step, fake_channel("frequency", "amplitude_ratio", 1e-2, 5, 12)))


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    fit = fake_fit()
    figures = {
        name: SVG for name in ("leakage", "flow_gain", "parameters", "differences", "residual_map", "candidates")
    }
    with typed(["fit", "my bench", "--out", HOSTILE]):
        made = {
            "fit": html_report(replace(fit, record=with_files(fit.record)), figures, "0.1.0"),
            "hostile": html_report(hostile_fit(), {HOSTILE: SVG}, "0.1.0"),
            "dynamic": html_report(dynamic_fit(), {}, "0.1.0"),
            "diagnosis": diagnosis_page(fake_diagnosis("ambiguous", points=12), figures, "0.1.0"),
            "variations": diagnosis_page(fake_diagnosis("helped", points=12), figures, "0.1.0"),
            "comparison": comparison_page(fake_comparison(), figures),
        }
    for name, text in made.items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    return {name: folder / f"{name}.html" for name in made}


@pytest.fixture(scope="module")
def tab():
    with chromium() as found:
        yield found


NAMES = ("fit", "hostile", "dynamic", "diagnosis", "variations", "comparison")


@pytest.mark.parametrize("name", NAMES)
def test_every_page_is_drawn_and_says_nothing_to_the_console(tab: Browser, pages, name):
    check_text(pages[name].read_text(encoding="utf-8"))
    check_in_browser(tab, pages[name])


def test_hostile_names_do_nothing(tab: Browser, pages):
    tab.open(pages["hostile"])
    assert tab.run("window.hit === undefined")
    assert tab.run("document.querySelectorAll('script:not([type])').length") == 1
    assert tab.run("document.querySelector('h1').textContent") == HOSTILE
    assert HOSTILE in tab.run("document.querySelector('.chips').textContent")
    for picture in tab.run("[...document.images].map((one) => one.src)"):
        assert picture.startswith("data:image/svg+xml,")


def click(tab: Browser, words: str) -> None:
    found = tab.run(
        f"(() => {{ const one = [...document.querySelectorAll('button')].find((b) => b.textContent === {json.dumps(words)});"
        " one.click(); return one.getAttribute('aria-pressed'); })()"
    )
    assert found in (None, "true", "false")


def counted(tab: Browser, what: str) -> int:
    return tab.run(f"document.querySelectorAll({json.dumps(what)}).length")


def ticks(tab: Browser) -> list[str]:
    return tab.run("[...document.querySelectorAll('.plot svg text[text-anchor=middle]')].map((t) => t.textContent)")


def test_traces_conditions_and_tests_are_switched(tab: Browser, pages):
    tab.open(pages["fit"])
    lines, points = counted(tab, ".plot .curve"), counted(tab, ".plot .points")
    assert lines > 2
    click(tab, "model")
    assert counted(tab, ".plot .curve") == 0
    assert counted(tab, ".plot .points") == points
    click(tab, "model")
    click(tab, "20 °C")
    assert 0 < counted(tab, ".plot .curve") < lines
    assert tab.run("document.querySelector('.chip[aria-pressed=false]').textContent") == "20 °C"
    choose(tab, 0, 2)
    assert "flow [l/min]" in tab.run("document.querySelector('.plot').textContent")
    assert counted(tab, ".plot .curve") == lines  # each test has its own switches


PLACE = """(() => {
  const plot = document.querySelector('.plot svg');
  plot.scrollIntoView();
  const r = plot.getBoundingClientRect();
  return [r.left, r.top, r.width];
})()"""


def test_zoom_and_hover_say_units(tab: Browser, pages):
    tab.open(pages["fit"])
    whole = ticks(tab)
    left, top, wide = tab.run(PLACE)
    tab.drag((left + 0.45 * wide, top + 120), (left + 0.6 * wide, top + 122))
    near = ticks(tab)
    assert max(map(float, near)) < 0.5 * max(map(float, whole))
    click(tab, "Show all")
    assert ticks(tab) == whole
    tab.run("document.querySelector('.plot').focus()")
    tab.press("ArrowRight")
    said = tab.run("document.querySelector('.tip').innerText")
    assert re.search(r"spool position -?[\d.]+ um", said)
    assert re.search(r"leakage, bench -?[\d.e-]+ l/min", said)
    assert "bar" in said
    assert tab.run("document.querySelector('[aria-live]').textContent").startswith("spool position")
    tab.press("+")
    assert ticks(tab) != whole
    tab.press("0")
    tab.hover((left + 0.5 * wide, top + 60))
    click(tab, "Picture")
    assert tab.run("getComputedStyle(document.querySelector('.pictures')).display") == "block"


def copied(tab: Browser, press: str) -> str:
    """What lies in the clipboard; its writing is caught, for a test has no right to read it."""
    return tab.run(
        "(async () => { let kept = null; navigator.clipboard.writeText = async (text) => { kept = text; };"
        f" {press}.click(); await new Promise((go) => setTimeout(go, 20)); return kept; }})()"
    )


def test_tables_and_curves_copy_as_cells(tab: Browser, pages):
    tab.open(pages["fit"])
    rows = copied(tab, "[...document.querySelectorAll('button')].find((b) => b.textContent === 'Copy table')").split(
        "\n"
    )
    assert rows[0].split("\t")[:3] == ["name", "value", "unit"]
    assert rows[1].split("\t")[:3] == ["edge_radius", "14.93", "um"]
    assert len({row.count("\t") for row in rows}) == 1
    text = copied(tab, "[...document.querySelectorAll('button')].find((b) => b.textContent === 'Copy data')")
    head, first, *_ = text.split("\n")
    assert head.split("\t")[:4] == ["temperature", "supply", "direction", "spool position [um]"]
    assert float(first.split("\t")[3]) < 0.0
    assert copied(tab, "[...document.querySelectorAll('button')].find((b) => b.textContent === 'Copy command')") == (
        tab.run("document.querySelector('code.command').textContent")
    )
    tab.open(pages["hostile"])
    last = copied(tab, "[...document.querySelectorAll('button')].filter((b) => b.textContent === 'Copy table').pop()")
    assert last.split("\n")[1].startswith("'=1+1")


def test_themes_and_paper(tab: Browser, pages):
    paper = lambda: tab.run("getComputedStyle(document.body).backgroundColor")
    tab.open(pages["fit"], dark=True)
    dark = paper()
    click(tab, "Light")
    light = paper()
    assert light == "rgb(255, 255, 255)" != dark
    click(tab, "Dark")
    assert paper() == dark
    tab.resize(1280, 900, dark=True, media="print")
    assert paper() == light
    shown = lambda what: tab.run(f"getComputedStyle(document.querySelector('{what}')).display")
    assert shown(".viewer") == "none"
    assert shown(".pictures") == "block"


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("name", ["fit", "diagnosis", "comparison"])
def test_axe_finds_no_serious_fault(tab: Browser, pages, name, dark):
    if not AXE.is_file():
        pytest.skip("axe-core is not here: `make axe` takes it from the npm registry")
    tab.open(pages[name], dark=dark)
    assert tab.serious_faults() == []
