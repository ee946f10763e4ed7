"""The page in a headless Chromium, served by `thermohyd app`: a folder is dropped, headers mapped, a command runs, its report is shown.

Nothing is asked of another machine, and nothing that was dropped stays.
"""

import sys
import time
from pathlib import Path

import pytest
from helpers.chromium import AXE, PROGRAM, browser
from helpers.served_app import served_app


pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no Chromium here (apt-get install chromium)")

# The real page; fits are made by hand, and a page that is closed is given up at once.
SCRIPT = f"""
from thermohyd.identify.app import closing, command_run
from thermohyd.identify.app.page import page

command_run.PROGRAM = ({sys.executable!r}, "-P", {str(Path(__file__).parents[2] / "helpers" / "quick_program.py")!r})
closing._WATCH.grace, closing.EVERY = 0.5, 0.2
page()
"""
# What is typed while the page is still being drawn anew goes out beside the old choices, which Streamlit takes for new ones.
SETTLED = "document.querySelector('[data-test-script-state=notRunning]') !== null"
SHOWN = "document.body.innerText.includes({!r})"
REPORT = "document.querySelector('iframe').contentDocument"
TOML = """[valve]
stroke = "213 um"
slot_width = "12 mm"
[oil]
preset = "mil-prf-5606"
[conditions]
supply_pressure = "70 bar"
[tests.leakage]
file = "leakage.csv"
"""


def test_from_a_folder_to_a_report(tmp_path):
    folder, home, script = tmp_path / "valve 7", tmp_path / "home", tmp_path / "served.py"
    folder.mkdir()
    home.mkdir()
    rows = "".join(f"{10 * i - 50},{0.1 + 0.01 * i}\n" for i in range(11))
    (folder / "leakage.csv").write_text(f"LVDT [um],leakage_flow [l/min]\n{rows}")
    (folder / "bench.toml").write_text(TOML)
    script.write_text(SCRIPT)
    left = lambda: [file.name for file in home.glob("thermohyd-app-*")]
    change = "from pathlib import Path\nfrom thermohyd.identify.cli import app_command\n"
    change += f"app_command._script = lambda: Path({str(script)!r})"
    with served_app(home, change) as served:
        with browser() as chromium:
            chromium.visit(served.address)
            chromium.wait("document.querySelector('input[type=file]') !== null")
            chromium.give("input[type=file]", folder)
            chromium.wait(SHOWN.format('valve 7/leakage.csv, line 1, column "LVDT [um]": unknown column'))
            assert len(left()) == 1
            chromium.click("Take the proposals")
            chromium.wait(SHOWN.format("temperature is missing"))
            chromium.wait(SETTLED)
            chromium.write("input[aria-label^='Oil temperature']", "40 degC")
            chromium.wait(SHOWN.format("valve 7: 1 test, 11 rows can be read."))
            chromium.click("Fit")
            chromium.wait(SHOWN.format("Report of the fit"))
            chromium.wait(f"document.querySelector('iframe') && {REPORT}.querySelector('svg') !== null")
            assert "edge_radius" in chromium.run(f"{REPORT}.body.innerText")
            chromium.wait(f"{REPORT}.defaultView.scrollTo(0, 400), {REPORT}.defaultView.scrollY > 0")
            chromium.wait(SHOWN.format("Download report.html"))
            if AXE.is_file():
                assert chromium.serious_faults() == []
            assert [url for url in chromium.asked if not url.startswith((served.address, "data:", "blob:"))] == []
            assert not [words for words in chromium.said if "Uncaught" in words or "rror" in words]
        end = time.monotonic() + 30
        while left() and time.monotonic() < end:
            time.sleep(0.1)
        assert left() == []  # the page is closed, the server still there
        served.interrupt()
    assert (served.status, left()) == (0, []), served.errors
    assert "Traceback" not in served.errors
