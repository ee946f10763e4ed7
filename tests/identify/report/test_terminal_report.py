"""What a fit's report says in a terminal: everything that matters, at any width, with or without colour."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.fake_fit import fake_fit, fake_parameters, with_files
from rich.console import Console
from rich.text import Text

from thermohyd.identify.bench.shown_units import beside, display_unit, significant
from thermohyd.identify.cli.process import consoles
from thermohyd.identify.report.fit_report import chi2_band, correlations, multi_start, print_report
from thermohyd.identify.report.terminal import OBEYED, PlainConsole, heading, table


def report(result, width: int = 100) -> str:
    out = io.StringIO()
    print_report(result, Console(file=out, width=width, no_color=True))
    return out.getvalue()


def words(text: str) -> str:
    return " ".join(text.replace("║", " ").split())


@pytest.mark.parametrize("width", [80, 120])
def test_parameters_in_bench_units(width):
    text = report(fake_fit(), width)
    table = text[text.index("95 % interval") : text.index("Correlations")]
    rows = {line.split()[0]: line.split() for line in table.splitlines() if line.split()}
    assert rows["edge_radius"][1:4] == ["14.93", "um", "0.12"]
    assert "14.70 to 15.16" in text
    assert rows["discharge_coefficient"][1:4] == ["0.7012", "-", "0.0021"]
    assert "AT BOUND" in text
    assert rows["heat_retention"][-1] == "fixed"


@pytest.mark.parametrize("width", [80, 120])
def test_nothing_is_cut_off(width):
    text = report(fake_fit(), width)
    assert "…" not in text
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width


def test_says_all_that_lmfit_says_and_why():
    text = words(report(fake_fit(), 80))
    for expected in (
        "1.17 (an exact model: 0.91 to 1.09 in 95 % of records)",
        "transition_number is AT ITS LOWER BOUND of 1: it ended at its lower bound",
        "clearance carries a prior: 3 +/- 0.5 um",
        "edge_radius and underlap trade off: +0.71 -0.70",
        "condition number 48",
        "3 of 5 starts reached the same best fit: that several ways lead there speaks for it.",
        "One ended at 3.16 times its chi-square after 22 steps: another minimum.",
        "not converged (the largest number of steps was reached)",
        "leakage, leakage_flow: scatter of the rows within each bin of the sweep",
        "146,220",
        "readings above 4 l/min are rounded",
    ):
        assert expected in text


def test_verdict_comes_first():
    text = report(fake_fit())
    assert text.index("The ideal valve describes") < text.index("Parameters") < text.index("Fit statistics")


def test_a_fit_that_did_not_converge_shouts():
    text = words(report(fake_fit(converged=False, message="100 steps were not enough")))
    assert text.count("THE FIT DID NOT CONVERGE: 100 steps were not enough") == 2
    assert "NOT CONVERGE" not in report(fake_fit())


def test_names_the_record():
    text = words(report(fake_fit(record=with_files(fake_fit().record)), 80))
    assert "record /bench/mine, 2 files, 800 rows, read 2026-03-04 05:06; seed oil; thermohyd 0.1.0" in text


def test_correlations_are_sorted_and_cut():
    pairs = correlations(fake_fit())
    assert [round(value, 2) for _, _, value in pairs] == [0.93, -0.71, -0.55, 0.32]


def test_user_text_is_not_markup():
    assert "[red]valve[/nope]" in report(fake_fit(name="[red]valve[/nope]"))


HOSTILE = "valve\x1b[31m\x1b]0;title\x07\x9b2J\u202e\r\x08 7"


def test_a_terminal_obeys_nothing_of_a_name():
    """In any report, in what a notebook shows, and as a path that is said."""
    out = io.StringIO()
    console = PlainConsole(file=out, width=100, force_terminal=True, color_system=None)
    print_report(fake_fit(name=HOSTILE, folder=Path(HOSTILE)), console)
    console.print(f"written: {HOSTILE}", markup=False, soft_wrap=True)
    console.print(table(["a"], [[HOSTILE]]))
    for text in (out.getvalue(), fake_fit(name=HOSTILE, folder=Path(HOSTILE)).summary()):
        assert "valve[31m" in text
        assert OBEYED.search(text) is None


def test_consoles_of_commands_obey_nothing(capsys):
    both = consoles(json=False)
    both.results.print(Text(HOSTILE))
    both.warn([HOSTILE])
    said = capsys.readouterr()
    assert OBEYED.search(said.out + said.err) is None
    assert said.out.startswith("valve[31m")


def test_colours_still_reach_a_terminal():
    out = io.StringIO()
    PlainConsole(file=out, force_terminal=True, color_system="standard").print(heading("Parameters"))
    assert "\x1b[1;36mParameters\x1b[0m" in out.getvalue()


def test_ascii_terminal():
    raw = io.BytesIO()
    with io.TextIOWrapper(raw, encoding="ascii") as out:
        print_report(fake_fit(converged=False), Console(file=out, width=80))
        out.flush()
        assert b"edge_radius" in raw.getvalue()


def test_a_parameter_without_error_bar_says_why():
    parameters = fake_parameters()
    parameters["clearance"] = replace(
        parameters["clearance"], std=None, ci95=None, why_no_error_bar="no reading depends on it"
    )
    text = words(report(fake_fit(parameters=parameters)))
    assert "no error bar for clearance: no reading depends on it" in text
    assert "NO ERROR" in text


def test_nothing_free_and_nothing_left_to_say():
    empty = fake_fit(
        free=(), correlation=np.zeros((0, 0)), covariance=np.zeros((0, 0)), starts=(), degrees_of_freedom=0.0
    )
    assert "Parameters" in report(empty)


def test_starts_agree_with_what_the_progress_counted():
    """A restart is none of the starts that were counted while they ran."""
    a, b, c, d, _ = fake_fit().starts
    low = replace(a, cost=0.9 * a.cost, restart=True)
    agree = lambda *starts: multi_start(fake_fit(starts=starts))[0]
    assert agree(a, b, c).startswith("3 of 3 starts reached the same best fit: ")
    assert agree(a, d).startswith("1 of 2 starts reached the best fit, the others ended higher. That is no failure")
    assert agree(low, a, b, c, d).startswith("None of the 4 starts ended at the best fit: a restart found it")
    assert agree(replace(low, cost=0.9999 * a.cost), a, b).startswith("2 of 2 starts reached the same best fit")
    assert multi_start(fake_fit(starts=(low, a)))[1].startswith("One ended at 1.11 times its chi-square")


def test_multi_start_of_one():
    assert multi_start(fake_fit(starts=fake_fit().starts[:1])) == ["One start, 9 steps."]


def test_chi2_band_is_the_quantiles():
    low, high = chi2_band(100.0)
    assert low == pytest.approx(0.7422193, rel=1e-6)  # chi-square tables: 74.22193 and 129.5612
    assert high == pytest.approx(1.2956120, rel=1e-6)


@pytest.mark.parametrize(
    ("value", "std", "expected"),
    [
        (14.9312, 0.118, "14.93"),
        (10234.0, 2300.0, "10234"),
        (0.0, None, "0"),
        (2.5e-12, None, "2.500e-12"),
        (3.0, 0.0, "3.000"),
    ],
)
def test_digits_follow_the_error_bar(value, std, expected):
    assert beside(value, std) == expected


def test_display_units():
    assert display_unit("m").label == "um"
    assert display_unit("m").factor * 15e-6 == pytest.approx(15.0)
    assert display_unit("Pa/(m^3/s)^2").factor == 1.0
    assert significant(float("nan")) == "nan"
