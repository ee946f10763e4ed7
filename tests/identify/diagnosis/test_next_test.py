"""The measurement to make next: what a bench can change, and how far two explanations then come apart."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.linear_fit import linear_library
from helpers.small_bench import REACH, conditions_only
from helpers.small_diagnosis import small_case

from thermohyd.identify.diagnosis.next_test import ENOUGH, cheaper, check_of, menu, next_test, what_settles, what_shows
from thermohyd.identify.diagnosis.result import Proposal, Region, Suspect, Variation
from thermohyd.identify.diagnosis.rivals import Rival, Rivals
from thermohyd.identify.diagnosis.screening import Projection
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.noise.two_parts import TwoParts


def bench(**columns):
    return {name: replace(conditions_only(name), **columns) for name in REACH}


def test_noise_that_goes_with_the_reading_is_that_of_the_one_to_come():
    """Readings that halve where the record says 0.01 of its own and 0.1 of the reading; all else is known as before."""
    rows = sum(test.rows for test in bench().values())
    problem = linear_library(np.zeros(rows), np.zeros((rows, 1)), {})
    key, other = list(problem.rows())[:2]
    level, own = np.linspace(0.0, 4.0, problem.tests[key[0]].rows), TwoParts(0.01, 0.1)
    channels = tuple(replace(c, value=level) for c in problem.tests[key[0]].channels)
    tests = {**problem.tests, key[0]: replace(problem.tests[key[0]], channels=channels)}
    std = {**problem.noise.std, key: np.hypot(own.std(level), 0.02)}  # beside it what positions add
    misfit = np.zeros(rows)
    misfit[problem.rows()[key]] = -0.5 * level / std[key]
    problem = replace(problem, tests=tests, misfit=misfit, noise=replace(problem.noise, std=std, parts={key: own}))
    there = problem.under(tests, problem.evaluate({})).noise
    np.testing.assert_allclose(there.std[key], np.hypot(own.std(0.5 * level), 0.02))
    np.testing.assert_array_equal(there.std[other], problem.noise.std[other])


def test_what_a_bench_can_change():
    words = [words for words, _ in menu(bench())]
    assert words == [
        "once more as they were",
        "at -25 degC",
        "at 85 degC",
        "at 84 bar supply pressure",
        "at 315 bar supply pressure",
        "with 32 bar in the return",
        "at five times the sweep rate",
        "at a fifth of the sweep rate",
    ]


def test_no_rate_without_time_and_nothing_that_no_bench_stands():
    hot = bench(time=None, rate=None, temperature=np.full(256, 393.15), supply_pressure=np.full(256, 280e5))
    words = [words for words, _ in menu(hot)]
    assert not any("rate" in w for w in words)
    assert "at 145 degC" not in words
    assert "at 420 bar supply pressure" not in words


def test_a_change_changes_what_it_says():
    old = bench()
    options = dict(menu(old))
    for name, test in options["at 315 bar supply pressure"].items():
        assert set(test.supply_pressure) == {315e5}
        np.testing.assert_array_equal(test.spool_position, old[name].spool_position)
    for test in options["at 85 degC"].values():
        np.testing.assert_allclose(test.temperature, 358.15)
    for name, test in options["at five times the sweep rate"].items():
        before = old[name]
        assert test.time is not None
        assert before.time is not None
        assert test.rate is not None
        np.testing.assert_allclose(np.diff(test.time[:32]), np.diff(before.time[:32]) / 5.0)
        moved = np.diff(test.spool_position[:32]) / np.diff(test.time[:32])
        np.testing.assert_allclose(np.abs(moved[1:15]), np.abs(test.rate[1:15]), rtol=1e-9)


@pytest.fixture(scope="module")
def rivals() -> tuple[Fit, Fit]:
    """Two explanations of a loop that a fast sweep tells apart, as if this record had not told them apart."""
    problem = small_case("two").problem
    return problem.fit(["hysteresis", "flowmeter_offset"]), problem.fit(["position_lag", "flowmeter_offset"])


def test_hysteresis_and_a_lag_come_apart_with_the_rate(rivals):
    final, other = rivals
    rival = Rival("position_lag", "hysteresis", other, 1.0)
    found = next_test(small_case("two").problem, final, {"hysteresis": Rivals("hysteresis", other, (rival,))}, 1.0)
    assert found is not None
    evidence = {option.words: option.evidence for option in found.options}
    assert evidence["at five times the sweep rate"] > 4.0 * evidence["once more as they were"]
    assert found.evidence == max(evidence.values())
    assert "hysteresis, position_lag" in found.sentence
    assert found.sentence.startswith("repeat the")
    # One test alone shows less, and takes less: worth a word where that is enough.
    first = found.options[0]
    [alone] = [option for option in found.options if option.words.startswith(f"{first.words}, ")]
    assert alone.evidence <= first.evidence
    assert alone.seconds is not None
    assert first.seconds is not None
    assert alone.seconds < first.seconds
    [five] = [option for option in found.options if option.words == "at five times the sweep rate"]
    [same] = [option for option in found.options if option.words == "once more as they were"]
    assert five.seconds == pytest.approx(0.2 * (same.seconds or 0.0))
    less = cheaper(list(found.options))
    assert (less is not None) == ("of the reading" in found.sentence)
    if less is not None:
        assert less[0].evidence >= ENOUGH
        assert less[0].words in found.sentence


def test_a_cheaper_measurement_is_compared_in_one_unit():
    """Of tests with time and tests without, rows are what all have."""
    best, other = Proposal("all", 50.0, 800, 300.0), Proposal("leakage alone", 30.0, 400, 90.0)
    assert cheaper([best, other]) == (other, 0.3)
    assert cheaper([replace(best, seconds=None), other]) == (other, 0.5)
    assert cheaper([best, replace(other, seconds=250.0)]) is None
    assert cheaper([best, replace(other, evidence=ENOUGH - 1.0)]) is None


def test_evidence_is_counted_in_the_misfit_that_is_there(rivals):
    final, other = rivals
    rival = {"hysteresis": Rivals("hysteresis", other, (Rival("position_lag", "hysteresis", other, 1.0),))}
    problem = small_case("two").problem
    one, four = (next_test(problem, final, rival, scale) for scale in (1.0, 4.0))
    assert one is not None
    assert four is not None
    assert four.evidence == pytest.approx(one.evidence / 4.0)


def test_without_rivals_there_is_nothing_to_separate(rivals):
    final, other = rivals
    assert next_test(small_case("two").problem, final, {}, 1.0) is None
    far = Rival("position_lag", "hysteresis", other, 100.0)
    assert next_test(small_case("two").problem, final, {"hysteresis": Rivals("hysteresis", other, (far,))}, 1.0) is None


WORST = Region("leakage", "leakage_flow", {}, excess_chi2=50.0, share=0.9, rows=32, mean=1e-7)


def varying(variable, gap_closed=0.9):
    none = np.zeros(3)
    return Variation("null_bias", variable, "m", none, none, none, 100.0, 1e-9, gap_closed, (0.0,), 0.0, 1.0)


def unexplained(misses=4.0, **columns):
    """A case whose run 3 of the leakage misses by so many standard deviations, and whether it knows time."""
    case = small_case("nothing")
    tests = {name: replace(test, **columns) for name, test in case.problem.tests.items()}
    problem, fit = replace(case.problem, tests=tests), case.base
    rows = np.arange(len(fit.residual))
    first = problem.rows()["leakage", "leakage_flow"].start
    off = np.isin(rows - first, np.flatnonzero(problem.tests["leakage"].run == 2))
    return problem, replace(fit, residual=np.where(off, misses, fit.residual)), int(off.sum())


def test_where_nothing_explains_the_run_that_misses_most_is_repeated():
    problem, fit, rows = unexplained()
    found = check_of(problem, fit, (WORST,), (), {}, 1.0)
    assert found is not None
    assert f"repeat leakage, run {problem.tests['leakage'].run_names[2]} ({rows} rows" in found.sentence
    assert "as it was" in found.sentence
    assert found.evidence == pytest.approx(rows * (16.0 - 1.0))
    whole, halved = found.options
    assert "at half the rate" in halved.words
    assert halved.evidence == pytest.approx(0.25 * whole.evidence)
    assert (whole.rows, halved.rows) == (rows, rows)
    assert whole.seconds is not None
    assert halved.seconds == pytest.approx(2.0 * whole.seconds)


@pytest.mark.parametrize(
    ("variable", "words"),
    [("rate", "at half the rate"), ("temperature", "in the opposite order"), ("spool_position", "as it was")],
)
def test_a_curve_that_closes_the_gap_says_what_to_change(variable, words):
    problem, fit, _ = unexplained()
    found = check_of(problem, fit, (WORST,), (varying(variable),), {}, 1.0)
    assert found is not None
    assert words in found.sentence
    weak = check_of(problem, fit, (WORST,), (varying(variable, gap_closed=0.2),), {}, 1.0)
    assert weak is not None
    assert "as it was" in weak.sentence


def test_no_half_rate_without_time_and_nothing_without_a_region():
    problem, fit, _ = unexplained(time=None, rate=None)
    found = check_of(problem, fit, (WORST,), (), {}, 1.0)
    assert found is not None
    assert not any("rate" in option.words for option in found.options)
    assert check_of(problem, fit, (), (), {}, 1.0) is None


def test_what_parameters_absorb_would_show_elsewhere():
    """The change under which most effects would show comes first; what none shows is not promised."""
    case = small_case("nothing")
    names = ("viscosity_shift", "temperature_offset", "position_scale")
    assert what_shows(case.problem, case.base, names, critical=1e6) is None
    assert what_shows(case.problem, case.base, (), critical=3.5) is None
    proposed = what_shows(case.problem, case.base, names, critical=3.5)
    assert proposed is not None
    assert proposed.evidence >= (3.5 + 0.84) ** 2
    first = proposed.options[0]
    assert first.evidence == proposed.evidence
    assert proposed.sentence.startswith(f"repeat the tests {first.words}: ")
    assert all(name in proposed.sentence for name in names)
    dear = what_shows(case.problem, case.base, names, critical=0.99 * np.sqrt(proposed.evidence) - 0.84)
    assert dear is not None
    assert first.words in [option.words for option in dear.options]


def test_a_hint_says_what_would_settle_it():
    """What was found and not proven: the change under which it would stand out most, in the amount that was found."""
    case = small_case("nothing")
    hint = Suspect("pilot_leakage", 1e-10, "m3/(s Pa^0.5)", 4.0, 0.1, 6.0)
    settles = lambda *suspects: what_settles(case.problem, case.base, suspects, 1.0)
    assert settles() is None
    assert settles(replace(hint, strength=20.0)) is None  # no hint, a misfit
    found = settles(hint)
    assert found is not None
    assert found.evidence == found.options[0].evidence == max(option.evidence for option in found.options)
    again = next(option for option in found.options if option.words == "once more as they were")
    stands = strength_of(case, hint)
    assert again.evidence == pytest.approx(2.0 * stands**2, rel=0.05)  # twice the readings
    strong, faint = (settles(replace(hint, value=hint.value * by / np.sqrt(found.evidence))) for by in (8.1, 7.9))
    assert strong is not None
    assert faint is not None
    assert f"repeat the tests {found.options[0].words}: pilot_leakage" in strong.sentence
    assert "8 standard errors, where 8 are enough" in strong.sentence
    assert "lifts pilot_leakage beyond doubt" in faint.sentence
    assert "at 7.9 standard errors" in faint.sentence


def strength_of(case, hint: Suspect) -> float:
    """What the free parameters leave of the amount, in noise units."""
    fit = case.problem.with_all_columns(case.base)
    nuisance = np.stack([fit.column(name) for name in fit.free], axis=1)
    return abs(hint.value) * float(np.linalg.norm(Projection.beside(nuisance)(fit.column(hint.name))))
