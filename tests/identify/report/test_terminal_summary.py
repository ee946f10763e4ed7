"""A diagnosis in a terminal: the answer first, one screen, figures with units, no word too much."""

import html
import io
from dataclasses import replace

import pytest
from helpers.fake_diagnosis import HEADLINES, KINDS, fake_diagnosis, hysteresis, pilot, regions
from helpers.fake_fit import with_files
from rich.console import Console

from thermohyd.identify.cli.several_results import print_summary_of_many
from thermohyd.identify.report.diagnosis_page import diagnosis_page
from thermohyd.identify.report.diagnosis_report import SCREEN, print_summary
from thermohyd.identify.report.diagnosis_words import p_words, percent


def summary(result, width: int = 100) -> str:
    out = io.StringIO()
    print_summary(result, Console(file=out, width=width, no_color=True))
    return out.getvalue()


def words(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.parametrize("width", [80, 100, 160])
@pytest.mark.parametrize("kind", KINDS)
def test_one_screen_and_the_answer_first(kind, width):
    text = summary(fake_diagnosis(kind), width)
    assert words(text).startswith(words(HEADLINES[kind]))
    lines = text.splitlines()
    assert len(lines) <= (SCREEN if width >= 100 else SCREEN + 5)
    assert max(len(line.rstrip()) for line in lines) <= width
    assert "…" not in text


def test_one_screen_however_much_there_is_to_say():
    crowded = fake_diagnosis(
        "helped",
        where=regions() * 6,
        effects=(pilot(), hysteresis(), *(pilot(name=f"effect_{i}") for i in range(3))),
        warnings=("the position gauge drifts by 3 um over the record, which is more than its noise",) * 9,
        absorbed=tuple(fake_diagnosis().absorbed) * 2,
        shifts=fake_diagnosis().shifts * 2,
    )
    assert len(summary(crowded).splitlines()) <= SCREEN


def test_a_figure_that_is_cut_off_shows_it():
    text = summary(fake_diagnosis("two"), 60)
    row = next(line for line in text.splitlines() if line.split()[:1] == ["clearance"])
    assert row.split()[1:4] == ["2.630", "2.031", "0.0…"]  # 0.042: as 0.04 it would be another


def test_figures_have_units():
    text = words(summary(fake_diagnosis("named")))
    for expected in (
        "0.04510 +/- 0.00061 l/min/sqrt(bar) < 1e-6 97 %",
        "leakage -203 to 203 um 71 % 9,200 0.64 l/min RMS, above",
        "-90 to 85 um, 60 to 71 degC, falling",
        "clearance 2.630 2.031 0.042 um +14.3",
        "Reduced chi-square 12.4 with the ideal valve, 1.17 with the final model",
        "97 % closed. Put in its place instead: bushing_leakage 61 %, hysteresis -2 %.",
        "nothing smooth beyond noise (lack-of-fit test, p = 0.43)",
    ):
        assert expected in text


def test_names_the_record():
    result = fake_diagnosis("named")
    text = words(summary(replace(result, record=with_files(result.record)), 80))
    assert "record /bench/mine, 2 files, 800 rows, read 2026-03-04 05:06; seed oil; thermohyd 0.1.0" in text


def test_absorbed_is_neither_named_nor_excluded():
    text = words(summary(fake_diagnosis("consistent")))
    assert "flowmeter_scale, position_scale: cannot be seen by this record, because the free parameters swallow" in text
    assert "neither named nor excluded" in text
    assert "With 80 % probability the record shows an effect from: supply_edge_wear 1.0 um" in text
    assert "Effects added" not in text


def test_rivals_and_what_separates_them():
    text = words(summary(fake_diagnosis("ambiguous")))
    assert "bushing_leakage of 0.001860 l/min/bar (chi-square +1.7); flowmeter_offset of 0.3720 l/min" in text
    assert "Repeat the leakage test at 210 bar" in text


def test_a_curve_is_not_called_a_cause():
    text = words(summary(fake_diagnosis("unexplained")))
    assert "If clearance varied smoothly with temperature (20 to 70 degC), that would close 55 % of the gap" in text
    assert "not a cause. --learn adds it to the model." in text
    assert text.count("--learn") == 1
    assert "Learned at your word: clearance varies with temperature" in words(summary(fake_diagnosis("learned")))


def test_without_held_out_rows_it_says_so():
    assert "No rows were held out" in words(summary(fake_diagnosis("named", held_out=None)))


def test_a_fit_that_did_not_converge_shouts():
    broken = fake_diagnosis()
    broken = replace(broken, after=replace(broken.after, converged=False, message="100 steps were not enough"))
    assert "THE FINAL FIT DID NOT CONVERGE: 100 steps were not enough" in words(summary(broken))


def test_user_text_is_not_markup_and_ascii_is_enough():
    result = fake_diagnosis("two", headline="[red]valve[/nope] is fine")
    result = replace(result, record=replace(result.record, name="[bold]x[/]"))
    assert "[red]valve[/nope]" in summary(result)
    assert "[bold]x[/]" in summary(result)
    raw = io.BytesIO()
    with io.TextIOWrapper(raw, encoding="ascii") as out:
        print_summary(result, Console(file=out, width=80))


def test_several_records_get_a_line_each():
    out = io.StringIO()
    results = {kind: fake_diagnosis(kind) for kind in KINDS}
    print_summary_of_many(results, Console(file=out, width=200, no_color=True))
    text = words(out.getvalue())
    assert "two named pilot_leakage + hysteresis leakage 71 % 12.4 -> 1.17 97 % closed" in text
    assert "pilot_leakage or bushing_leakage or flowmeter_offset" in text
    assert "consistent consistent none 1.17" in text
    assert "learned clearance(temperature)" in text


@pytest.mark.parametrize(
    ("p", "expected"),
    [(0.0, "< 1e-6"), (2e-5, "2e-5"), (0.0041, "0.004"), (0.43, "0.43"), (1.0, "1.00"), (float("nan"), "")],
)
def test_p_values(p, expected):
    assert p_words(p) == expected


@pytest.mark.parametrize(("share", "expected"), [(0.97, "97 %"), (0.9951, "99.5 %"), (1.0, "100 %"), (-0.001, "0 %")])
def test_shares(share, expected):
    assert percent(share) == expected


def test_the_test_that_decides_comes_before_the_details():
    text = summary(fake_diagnosis("ambiguous"))
    places = [text.index(f"\n{label} ") for label in ("gap", "next test", "held out", "left over")]
    assert places == sorted(places)


def test_what_is_held_near_the_usual_is_said_on_one_screen_and_on_the_page():
    result = fake_diagnosis("named")
    name = next(iter(result.after.parameters))
    because = 'held near what is usual; "x = 1" in [start] changes it'
    held = {**result.after.parameters, name: replace(result.after.parameters[name], prior_because=because)}
    found = replace(result, after=replace(result.after, parameters=held))
    assert f"prior {name}: {because}" in words(summary(found, 160))
    assert because in html.unescape(diagnosis_page(found, {}, "0.1.0"))
