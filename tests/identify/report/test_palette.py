"""Colours of the pages: readable on both themes (WCAG 2.2: 4.5 to 1 for text, 3 to 1 for curves), and apart for every kind of eye."""

import re
from importlib.resources import files
from itertools import combinations, pairwise

import numpy as np
import pytest

from thermohyd.identify.report.curves import KIND, MOST_WARM, warm_colours


SHEET = files("thermohyd.identify").joinpath("templates/report.css").read_text(encoding="utf-8")
NAMED = re.compile(r"--([a-z-]+): (#[0-9a-f]{6}|#[0-9a-f]{3})\b")
# Linear RGB as eyes without one kind of cone see it: Viénot, Brettel and Mollon 1999 (protan, deutan); Brettel, Viénot and Mollon
# 1997, two half planes with a normal between them (tritan).
BLIND = {
    "protan": [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]],
    "deutan": [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]],
}
TRITAN = (
    np.array([[1.01277, 0.13548, -0.14826], [-0.01243, 0.86812, 0.14431], [0.07589, 0.805, 0.11911]]),
    np.array([[0.93678, 0.18979, -0.12657], [0.06154, 0.81526, 0.1232], [-0.37562, 1.12767, 0.24796]]),
)
BETWEEN = np.array([0.03901, -0.02788, -0.01113])


def theme(which: str) -> dict[str, str]:
    dark = SHEET[SHEET.index("set dark_theme") : SHEET.index("endset")]
    light = SHEET[SHEET.index(":root { color-scheme: light") : SHEET.index("@media screen and")]
    return dict(NAMED.findall(dark if which == "dark" else light))


def linear(colour: str) -> np.ndarray:
    wide = colour[1:] if len(colour) == 7 else "".join(2 * one for one in colour[1:])
    value = np.array([int(wide[i : i + 2], 16) for i in (0, 2, 4)]) / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def contrast(a: str, b: str) -> float:
    bright = sorted(float(linear(one) @ [0.2126, 0.7152, 0.0722]) for one in (a, b))
    return (bright[1] + 0.05) / (bright[0] + 0.05)


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIE L*a*b* of linear sRGB."""
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ np.clip(
        rgb, 0.0, 1.0
    )
    ratio = xyz / [0.9505, 1.0, 1.089]
    f = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("which", ["light", "dark"])
def test_words_can_be_read(which):
    colours = theme(which)
    grounds = [colours[name] for name in ("paper", "sunk", "answer", "caution", "wrong", "next")]
    for ground in grounds:
        assert contrast(colours["ink"], ground) >= 7.0
    for name in ("faint", "alarm", "accent"):
        assert contrast(colours[name], colours["paper"]) >= 4.5, name
    assert contrast(colours["faint"], colours["sunk"]) >= 4.5


@pytest.mark.parametrize("which", ["light", "dark"])
def test_curves_can_be_seen(which):
    paper = theme(which)["paper"]
    for count in range(1, MOST_WARM + 1):
        for colour in (*KIND[which], *warm_colours(count, which == "dark")):
            assert contrast(colour, paper) >= 3.0, colour


@pytest.mark.parametrize("which", ["light", "dark"])
@pytest.mark.parametrize("eye", ["full", "tritan", *BLIND])
def test_colours_stay_apart_for_every_eye(which, eye):
    """By CIE 1976 units, of which one sees 2 to 3 side by side; neighbours on the way from cold to hot by more than that."""
    places = [lab(seen(linear(colour), eye)) for colour in KIND[which]]
    apart = lambda pairs: min(float(np.linalg.norm(a - b)) for a, b in pairs)
    assert apart(combinations(places, 2)) > 20.0
    warm = [lab(seen(linear(colour), eye)) for colour in warm_colours(6, which == "dark")]
    assert apart(pairwise(warm)) > 5.0


def seen(rgb: np.ndarray, eye: str) -> np.ndarray:
    if eye == "tritan":
        return TRITAN[0 if BETWEEN @ rgb >= 0.0 else 1] @ rgb
    return rgb if eye == "full" else np.array(BLIND[eye]) @ rgb


def test_warm_colours_go_one_way():
    """Order is seen without hue: on paper printed grey too."""
    for dark in (False, True):
        bright = [lab(linear(colour))[0] for colour in warm_colours(8, dark)]
        assert bright == sorted(bright)
