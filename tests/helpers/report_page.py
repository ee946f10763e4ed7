"""What every report page must be, read as text and looked at in a browser."""

import base64
import hashlib
import json
import re
from pathlib import Path
from typing import Any

from helpers.chromium import Browser
from helpers.html_page import Tags


LARGEST = 2_500_000  # bytes
ADDRESSES = ("src", "href", "action", "formaction", "data", "poster")
KINDS = {"points", "line", "band", "bar", "interval"}


def views_of(page: str) -> list[list[dict[str, Any]]]:
    """The views of each viewer, as the page's script reads them."""
    return [json.loads(text) for text in re.findall(r'<script type="application/json">(.*?)</script>', page, re.DOTALL)]


def check_text(page: str) -> None:
    """No network, no script but the page's own, curves that hold together, names for what has no words, small enough."""
    opened = Tags(page).opened
    scripts = [attributes for tag, attributes in opened if tag == "script"]
    own = [attributes for attributes in scripts if attributes.get("type") != "application/json"]
    assert own == [{}]
    for tag, attributes in opened:
        assert tag not in ("link", "iframe", "object", "embed", "base"), tag
        assert not [name for name in attributes if name.startswith("on")], attributes
        for name in ADDRESSES:
            assert attributes.get(name, "data:").startswith("data:"), attributes
    drawn = re.sub(r'data:image/svg[^"]*', "", page).replace("url(#${id})", "")  # within pictures nothing is fetched
    assert "url(" not in drawn
    assert "@import" not in page
    script = page[page.rindex("<script>") + len("<script>") : page.rindex("</script>")]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in page
    assert "default-src 'none'" in page
    for attributes in (attributes for tag, attributes in opened if tag == "img"):
        assert attributes["alt"].strip()
    for attributes in (attributes for tag, attributes in opened if tag == "th"):
        assert attributes.get("scope") in ("col", "row")
    assert len(page.encode()) < LARGEST
    for views in views_of(page):
        assert views
        for view in views:
            check_view(view)


def check_view(view: dict[str, Any]) -> None:
    """Every index points at something, and every trace is as long as its abscissa."""
    assert view["title"]
    assert view["x"]["label"]
    assert {layer["kind"] for layer in view["layers"]} <= KINDS
    assert view["series"], view["title"]
    for which in ("colour", "mark", "hollow"):
        assert view[which] is None or view[which] < len(view["facets"])
    for series in view["series"]:
        assert [k < len(facet["values"]) for k, facet in zip(series["at"], view["facets"], strict=True)].count(
            False
        ) == 0
        for draw in series["draw"]:
            assert draw["layer"] < len(view["layers"])
            assert draw["panel"] < len(view["panels"])
            for key in ("y", "y2", "x2", "words"):
                assert key not in draw or len(draw[key]) == len(series["x"]), view["title"]


COUNTS = "[...document.querySelectorAll('.curves')].map((one) => one.querySelector('select')?.options.length || 1)"


def check_in_browser(browser: Browser, page: Path) -> None:
    """On a desk and on a phone, light and dark: no complaint, no network, every view drawn, nothing to scroll sideways."""
    for width, dark in ((1280, False), (390, True)):
        browser.open(page, width, dark=dark)
        assert browser.said == []
        assert [url for url in browser.asked if not url.startswith("data:")] == [page.resolve().as_uri()]
        assert browser.run("document.documentElement.scrollWidth") <= width
        drawn = browser.run(
            "[...document.querySelectorAll('.plot svg')].map((svg) => svg.querySelectorAll('path').length)"
        )
        assert drawn
        assert all(drawn)
        for place, count in enumerate(browser.run(COUNTS)):
            for view in range(1, count):
                choose(browser, place, view)
                assert browser.run(f"document.querySelectorAll('.plot')[{place}].querySelectorAll('path').length")
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert "NaN" not in browser.run(
            "[...document.querySelectorAll('.plot svg')].map((svg) => svg.outerHTML).join()"
        )
        assert browser.said == []


def choose(browser: Browser, viewer: int, view: int) -> None:
    """Another view of a viewer."""
    browser.run(
        f"(() => {{ const one = document.querySelectorAll('.curves')[{viewer}].querySelector('select');"
        f" one.value = {view}; one.dispatchEvent(new Event('input')); }})()"
    )
