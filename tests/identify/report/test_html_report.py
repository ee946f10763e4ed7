"""`report.html`: one page that needs no network, says what the terminal says, and escapes what users write."""

import re

from helpers.fake_fit import fake_fit, with_files
from helpers.html_page import Tags
from helpers.report_page import check_text

from thermohyd.identify.report.page import html_report


SVG = b"<svg xmlns='http://www.w3.org/2000/svg'/>"


def test_needs_no_network():
    check_text(html_report(fake_fit(), {"leakage": SVG}, "0.1.0"))


def test_says_what_the_terminal_says():
    words = re.sub(r"\s+", " ", " ".join(Tags(html_report(fake_fit(), {}, "0.1.0")).words))
    for expected in (
        "14.93",
        "14.70 to 15.16",
        "AT BOUND",
        "AT ITS LOWER BOUND",
        "The ideal valve describes this record",
        "edge_radius and underlap trade off",
        "1.17 (an exact model",
        "scatter of the rows within each bin",
        "3 of 5 starts",
        "50,000 rows became 480 points",
    ):
        assert expected in words


def test_names_the_record_with_its_files():
    page = html_report(fake_fit(record=with_files(fake_fit().record)), {}, "0.1.0")
    words = re.sub(r"\s+", " ", " ".join(Tags(page).words))
    for expected in (
        "record /bench/mine",
        "read 2026-03-04 05:06:07+01:00 by thermohyd 0.1.0",
        "valve seed valve, made by hand: stroke 213 um, slot width 12 mm, land diameter 6.9 mm, rated flow 9.8 l/min, at 70 bar",
        "oil seed oil:",
        "870 kg/m3 at 15 degC",
        f"leakage.csv 800 790 {'cd' * 32}",
    ):
        assert expected in words


def test_user_text_is_escaped():
    page = html_report(
        fake_fit(name="<script>alert(1)</script> & co", notes=("a <b>note</b>",)), {'x"><i>': SVG}, "0.1.0"
    )
    tags = [tag for tag, _ in Tags(page).opened]
    assert tags.count("script") == [tag for tag, _ in Tags(html_report(fake_fit(), {}, "0.1.0")).opened].count("script")
    assert "i" not in tags
    assert "<b>note" not in page
    assert "&lt;script&gt;" in page


def test_a_fit_that_did_not_converge_shouts():
    assert 'role="alert">THE FIT DID NOT CONVERGE' in html_report(fake_fit(converged=False), {}, "0.1.0")
    assert 'role="alert"' not in html_report(fake_fit(), {}, "0.1.0")


def test_paper_neither_scrolls_nor_keeps_a_table_on_one_page():
    page = html_report(fake_fit(), {}, "0.1.0")
    printed = page[page.index("@media print {") : page.index("</style>")]
    assert ".scroll { overflow: visible; }" in printed
    whole = re.findall(r"([^{}]*)\{[^{}]*break-inside: avoid", printed)
    assert [set(re.split(r"[,\s]+", selectors.strip())) for selectors in whole] == [{"tr", "li", "figure"}]
