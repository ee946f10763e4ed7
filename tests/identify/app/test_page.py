"""The page without a browser: from files to a report, by what a user would click and type."""

import re
import sys
import time
from pathlib import Path

import pytest
from helpers.bench_folder import LEAKAGE, TOML
from streamlit.testing.v1 import AppTest

import thermohyd.identify.app as app
from thermohyd.identify.app import command_run
from thermohyd.identify.app.widgets import plain


SCRIPT = Path(str(app.__file__)).parent / "served.py"
QUICK = (sys.executable, "-P", str(Path(__file__).parents[2] / "helpers" / "quick_program.py"))
LOG = "Zeit [s],LVDT,QL [l/min],note\n" + "".join(f"{i},{10 * i - 50},{0.1 + 0.01 * i},x\n" for i in range(11))
ROWS = "time [s],spool_position [um],leakage_flow [l/min]\n" + "".join(LOG.replace(",x", "").splitlines(True)[1:])


def seen(page: AppTest) -> str:
    """Every sentence of the page, as a reader sees it."""
    kinds = ("error", "warning", "success", "info", "markdown", "text", "header")
    return re.sub(
        r"\\([\W_])", r"\1", "\n".join(str(getattr(part, "value", "")) for kind in kinds for part in page.get(kind))
    )


def dropped(*files: tuple[str, str]) -> AppTest:
    page = AppTest.from_file(str(SCRIPT), default_timeout=60).run()
    sent = [(name, content.encode(), "text/plain") for name, content in files]
    return well(page.file_uploader(key="upload").set_value(sent).run())


def well(page: AppTest) -> AppTest:
    assert not page.exception, page.exception
    return page


def test_from_a_log_to_a_report(monkeypatch):
    monkeypatch.setattr(command_run, "PROGRAM", QUICK)
    page = dropped(("bench 3/leak.csv", LOG), ("bench 3/readme.md", "x"))
    assert "stroke is missing" in seen(page)
    assert page.button(key="fit").disabled
    page = well(page.text_input(key="valve.stroke").set_value("213 um").run())
    page = well(page.text_input(key="valve.slot_width").set_value("12 mm").run())
    page = well(page.selectbox(key="oil").set_value("mil-prf-5606").run())
    assert 'unknown columns "Zeit [s]", "LVDT", "QL [l/min]", "note"' in seen(page)
    page = well(page.button(key="leakage|guesses").click().run())
    page = well(page.selectbox(key="leakage|3|is").set_value("left out").run())
    assert 'bench 3/leak.csv, line 1, column "LVDT": the unit is missing' in seen(page)
    page = well(page.selectbox(key="leakage|1|unit").set_value("um").run())
    assert "supply_pressure and temperature are missing: leak.csv has no such columns" in seen(page)
    page = well(page.text_input(key="conditions.supply_pressure").set_value("70 bar").run())
    page = well(page.text_input(key="conditions.temperature").set_value("40 degC").run())
    assert "bench 3: 1 test, 11 rows can be read." in seen(page)
    (table,) = page.dataframe
    assert list(table.value["read as"]) == ["time", "spool_position", "leakage_flow", "not used"]
    work = page.session_state["work"]
    assert 'spool_position = "LVDT [um]"' in work.text
    assert page.text_area(key="text").value == work.text

    page = well(page.button(key="fit").click().run())
    assert [info.value for info in page.info]
    assert [button.key for button in page.button] == ["stop"]
    end = time.monotonic() + 120
    while work.run.status is None and time.monotonic() < end:
        time.sleep(0.1)
    assert "fitting by hand" in work.run.steps()[-2]
    page = well(page.run())
    assert [part.proto.label for part in page.get("download_button")] == [
        "Download bench.toml", "Download report.html", "Download fit.json", "Download model.json"
    ]  # fmt: skip
    (frame,) = page.get("iframe")
    assert "thermohyd fit &#39;bench 3&#39; --out results --verbose" in frame.proto.srcdoc
    assert str(work.home.folder) not in frame.proto.srcdoc
    page = well(page.text_input(key="valve.name").set_value("lost").run())
    assert "bench.toml has changed since" in seen(page)

    page = well(page.button(key="fit").click().run())
    while work.run.status is None and time.monotonic() < end:
        time.sleep(0.1)
    page = well(page.run())
    assert "fit: the computation failed: ArithmeticError: nothing fits" in seen(page)
    assert not page.get("iframe")
    # the files taken away, their folder goes
    well(page.file_uploader(key="upload").set_value([]).run())
    assert not work.home.folder.exists()
    assert "work" not in page.session_state


def test_a_command_is_stopped(monkeypatch):
    monkeypatch.setattr(command_run, "PROGRAM", QUICK)
    page = dropped(("v/bench.toml", TOML.replace("test valve", "slow")), ("v/leakage.csv", ROWS))
    page = well(page.button(key="diagnose").click().run())
    page = well(page.button(key="stop").click().run())
    assert "diagnose: " in seen(page)
    assert page.session_state["work"].run.stopped


def test_a_record_is_shown_as_it_was_dropped():
    toml = TOML + 'noise = { leakage_flow = "0.01 l/min" }\nskip_rows = 0\nmissing = "skip"\n'
    page = dropped(("v/bench.toml", toml), ("v/leakage.csv", ROWS), (".DS_Store", "x"))
    assert "test valve: 1 test, 11 rows can be read." in seen(page)
    assert "Not of this record: .DS_Store" in seen(page)
    assert page.session_state["work"].text == toml
    assert page.text_input(key="conditions.supply_pressure").value == "70 bar"
    assert page.text_input(key="tests.leakage.noise").disabled
    assert page.checkbox(key="leakage|missing").value
    page = well(page.toggle(key="curves").set_value(True).run())
    assert page.get("image")
    page = well(page.selectbox(key="file|leakage.csv").set_value("no test").run())
    assert "[tests] is missing" in seen(page)
    page = well(page.text_area(key="text").set_value(toml).run())
    assert "test valve: 1 test, 11 rows can be read." in seen(page)
    page = well(page.number_input(key="leakage|skip_rows").set_value(2).run())
    assert "skip_rows = 2" in page.session_state["work"].text


def test_oil_of_own_points():
    page = dropped(("v/bench.toml", TOML), ("v/leakage.csv", ROWS))
    page = well(page.selectbox(key="oil").set_value("own viscosity points").run())
    page = well(page.text_input(key="oil.viscosity.0.1").set_value("46 cSt").run())
    text = page.session_state["work"].text
    assert 'viscosity = [["40 degC", "46 cSt"], ["100 degC", "5.4 cSt"]]' in text
    assert "preset" not in text
    assert "can be read" in seen(page)


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ([("../../leakage.csv", LEAKAGE)], '"../../leakage.csv" leads out of the folder'),
        ([("v/bench.toml", TOML.replace("leakage.csv", "/etc/passwd"))], "lies outside the folder that was dropped"),
        ([("v/bench.toml", "[valve\n"), ("v/leakage.csv", LEAKAGE)], "v/bench.toml, line 1: is not valid TOML"),
        ([("v/bench.toml", TOML)], 'there is no file "leakage.csv"; the folder holds no CSV file'),
        ([("v/bench.toml", TOML), ("v/leakage.csv", "")], "v/leakage.csv: is empty"),
        ([("v/bench.toml", TOML), ("v/leakage.csv", LEAKAGE.replace("0.3", "o.3"))], '"o.3" is not a number'),
    ],
)
def test_what_is_wrong_is_said_in_the_programs_own_words(files, words):
    page = dropped(*files)
    assert words in seen(page)
    assert "/tmp" not in seen(page)
    assert not page.button or page.button(key="fit").disabled


def added(page: AppTest, name: str, content: str) -> AppTest:
    """One more file beside those that are there, as a browser adds it: these keep their identity."""
    uploader = page.file_uploader(key="upload")
    there = [(file.file_id, file.name, file.getvalue(), file.type) for file in page.session_state["upload"]]
    uploader.upload(name, content.encode(), "text/plain")
    assert isinstance(uploader._files, list)
    uploader._files[:0] = there
    return well(page.run())


def test_more_files_go_on_with_what_was_begun():
    page = dropped(("v/leakage.csv", LEAKAGE))
    page = well(page.text_input(key="valve.stroke").set_value("213 um").run())
    first = page.session_state["work"]
    page = added(page, "v/flow_gain.csv", "spool_position [um],flow [l/min]\n0,1\n")
    assert not first.home.folder.exists()
    text = page.session_state["work"].text
    assert 'stroke = "213 um"' in text
    assert 'file = "leakage.csv"' in text
    assert 'file = "flow_gain.csv"' in text
    # a bench.toml that comes later is the record's own, and changes to it stay when more comes
    toml = TOML.replace("200 um", "300 um")
    page = added(page, "v/bench.toml", toml)
    assert page.session_state["work"].text == toml
    page = well(page.text_input(key="valve.stroke").set_value("213 um").run())
    page = added(page, "v/notes.txt", "x")
    assert page.session_state["work"].text == TOML.replace("200 um", "213 um")
    # another record is another beginning
    page = well(page.file_uploader(key="upload").set_value([("w/leakage.csv", LEAKAGE.encode(), "text/plain")]).run())
    assert "stroke" not in page.session_state["work"].text


def test_the_how_to_page_shows_what_is_written():
    text = (Path(__file__).parents[3] / "docs" / "howto" / "app.md").read_text(encoding="utf-8")
    (rows,), (toml,) = (re.findall(rf"```{kind} .*?\n(.*?)```", text, re.DOTALL) for kind in ("csv", "toml"))
    page = dropped(("my_valve/leak 17-05.csv", rows))
    page = well(page.text_input(key="valve.stroke").set_value("213 um").run())
    page = well(page.text_input(key="valve.slot_width").set_value("12 mm").run())
    page = well(page.selectbox(key="oil").set_value("mil-prf-5606").run())
    page = well(page.text_input(key="conditions.temperature").set_value("40 degC").run())
    page = well(page.button(key="leakage|guesses").click().run())
    page = well(page.selectbox(key="leakage|4|is").set_value("left out").run())
    assert "the unit is missing" in seen(page)
    page = well(page.selectbox(key="leakage|1|unit").set_value("um").run())
    assert page.session_state["work"].text.strip() == toml.strip()
    assert not page.button(key="fit").disabled


def test_a_users_text_is_no_markdown():
    header = "![x](http://evil.test/x.png) <b> $a$ :red[b]"
    page = dropped(("v/bench.toml", TOML), ("v/leakage.csv", f"{header},leakage_flow [l/min]\n1,2\n"))
    shown = [str(getattr(part, "value", "")) for kind in ("error", "markdown") for part in page.get(kind)]
    shown += [button.label for button in page.button] + [box.label for box in page.selectbox]
    assert not [text for text in shown if "](" in text or "<b>" in text or "$a$" in text or ":red[" in text]
    assert header in seen(page)
    assert plain("a_b 1.") == r"a\_b 1\."
