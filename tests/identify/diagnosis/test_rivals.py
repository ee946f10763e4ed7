"""Who could stand in a named effect's place, and what an effect put there in exchange closes on rows kept back."""

import numpy as np
import pytest
from helpers.linear_fit import LinearProblem, linear_library
from helpers.small_bench import small_record
from helpers.small_diagnosis import opened

from thermohyd.effects.library import EFFECTS
from thermohyd.identify.diagnosis.final_model import closed, exchange_fits, held_out_result, mean_square
from thermohyd.identify.diagnosis.held_out import split_rows
from thermohyd.identify.diagnosis.rivals import ALIKE, rivals_of, settle_rivals, with_edges_exchanged


ROWS = 768  # of a small bench
TRUE, TWIN, COUSIN = "hysteresis", "position_scale", "flowmeter_offset"
BLEND = "land_leakage"
STRENGTH = 20.0


def unit(columns: np.ndarray) -> np.ndarray:
    return columns / np.linalg.norm(columns, axis=0)


def bench(alike: float = 1.0, seed: int = 0) -> LinearProblem:
    """`TRUE` is missing; the signature of `TWIN` is so much like its own (a correlation), that of `COUSIN` by a half."""
    rng = np.random.default_rng(seed)
    u, v, w, x, y = unit(rng.normal(size=(ROWS, 5))).T
    own = rng.normal(size=(ROWS, 6))
    shapes = {
        TRUE: u,
        TWIN: -(alike * u + np.sqrt(1.0 - alike**2) * v),
        COUSIN: 0.5 * u + np.sqrt(0.75) * w,
        "viscosity_shift": x,
        "flowmeter_scale": y,
    }
    signatures = {name: 10.0 * shape for name, shape in shapes.items()}  # so that amounts are usual ones
    return linear_library(rng.normal(size=ROWS) - STRENGTH * u, unit(own), signatures)


def test_a_twin_is_alike_and_a_cousin_is_not():
    problem = bench()
    final = problem.fit([TRUE])
    rivals = rivals_of(problem, final, TRUE, {})
    assert rivals.instead_of == TRUE
    assert rivals.without.effects == ()
    assert [r.name for r in rivals.alike] == [TWIN]
    [twin] = rivals.alike
    assert twin.chi2_more == pytest.approx(0.0, abs=1e-6)
    amounts = {name: fit.values[name] / EFFECTS[name].scale for name, fit in ((TRUE, final), (TWIN, twin.fit))}
    assert amounts[TWIN] == pytest.approx(-amounts[TRUE])


@pytest.mark.parametrize(("alike", "is_a_rival"), [(0.999, True), (0.95, False)])
def test_alike_is_a_matter_of_chi_square(alike, is_a_rival):
    """The twin leaves strength^2 (1 - alike^2) of chi-square open: 0.8, or 39."""
    problem = bench(alike)
    rivals = rivals_of(problem, problem.fit([TRUE]), TRUE, {})
    assert (TWIN in {r.name for r in rivals.alike}) is is_a_rival
    assert all((r.chi2_more < ALIKE) == (r in rivals.alike) for r in rivals.tried)
    assert list(rivals.tried) == sorted(rivals.tried, key=lambda r: r.chi2_more)


def test_a_large_misfit_makes_more_alike():
    problem = bench(0.95)
    assert not rivals_of(problem, problem.fit([TRUE]), TRUE, {}).alike
    assert rivals_of(problem, problem.fit([TRUE]), TRUE, {}, scale=20.0).alike


def test_the_better_of_two_takes_the_place():
    problem = bench(0.97)
    final, rivals = settle_rivals(problem, problem.fit([TWIN]), {})
    assert final.effects == (TRUE,)
    assert list(rivals) == [TRUE]
    again, _ = settle_rivals(problem, problem.fit([TRUE]), {})
    assert again.chi2 == pytest.approx(final.chi2)


def blend(first: float, second: float, of_both: float, seed: int = 0) -> LinearProblem:
    """`BLEND` does nearly what `TRUE` and `COUSIN` do together; the record misses so many standard errors of each of the three."""
    rng = np.random.default_rng(seed)
    u, v, w, x, y = unit(rng.normal(size=(ROWS, 5))).T
    both = unit((u + w + 0.3 * v)[:, None])[:, 0]
    shapes = {TRUE: u, COUSIN: w, BLEND: both, "viscosity_shift": x, "flowmeter_scale": y}
    signatures = {name: 10.0 * shape for name, shape in shapes.items()}
    misfit = first * u + second * w + of_both * both
    return linear_library(rng.normal(size=ROWS) - misfit, unit(rng.normal(size=(ROWS, 6))), signatures)


@pytest.mark.parametrize("seed", range(3))
def test_two_take_the_place_of_one_that_resembles_both(seed):
    """Beside the one neither of them is missed enough to be added: only both in its place show that it stands for them."""
    problem = blend(20.0, 16.0, 0.0, seed)
    one = problem.fit([BLEND])
    beside = [one.chi2 - problem.fit([BLEND, name]).chi2 for name in (TRUE, COUSIN)]
    instead = one.chi2 - problem.fit([TRUE, COUSIN]).chi2
    assert instead > max(beside) + 10.0
    settled, rivals = settle_rivals(problem, one, {})
    assert set(settled.effects) == {TRUE, COUSIN} == set(rivals)
    assert settled.chi2 < one.chi2 - 20.0


@pytest.mark.parametrize("seed", range(3))
def test_two_do_not_take_the_place_of_one_that_is_there(seed):
    problem = blend(0.0, 0.0, 25.0, seed)
    settled, rivals = settle_rivals(problem, problem.fit([BLEND]), {})
    assert settled.effects == (BLEND,)
    assert rivals[BLEND].two is None


def test_nothing_named_has_no_rivals():
    problem = bench()
    base = problem.fit()
    final, rivals = settle_rivals(problem, base, {})
    assert final is base
    assert rivals == {}


WORN = {"supply_edge_wear": 9e-6, "edge_wear_bt": 6e-6}


def test_supply_and_return_edges_change_places_together():
    """Wear of both supply edges and of one return edge looks like that of both return edges and of the supply edge across; each of
    these beside one of the others does not."""
    changed = {name: EFFECTS[name].exchanged for name in WORN}
    assert changed == {"supply_edge_wear": "return_edge_wear", "edge_wear_bt": "edge_wear_pa"}
    case = opened(small_record(effects=WORN, seed=9), (*WORN, *changed.values(), "viscosity_shift"))
    problem = case.problem
    final = problem.fit([*WORN], {**case.base.values, **WORN}, hop_basins=True)
    alone = {name: rivals_of(problem, final, name, case.steps) for name in WORN}
    assert not any(rivals.alike for rivals in alone.values())
    together = with_edges_exchanged(problem, final, alone)
    for name, other in changed.items():
        [rival] = together[name].alike
        assert (rival.name, rival.instead_of) == (other, name)
        assert rival.fit.values[other] == pytest.approx(final.values[name], rel=0.1)
    one = problem.fit(["edge_wear_bt"], case.base.values)
    assert with_edges_exchanged(problem, one, {}) == {}


def test_who_is_exchanged_is_exchanged_back():
    for name, info in EFFECTS.items():
        assert not info.exchanged or EFFECTS[info.exchanged].exchanged == name


def test_another_effect_in_its_place_closes_less_on_rows_kept_back():
    problem = bench(seed=3)
    split = split_rows(problem.tests)
    chosen = problem.with_rows(~split.held)
    base, final = chosen.fit(), chosen.fit([TRUE])
    exchanged = exchange_fits(chosen, final, [TRUE, TWIN, COUSIN, "viscosity_shift", "flowmeter_scale"], {TRUE, TWIN})
    assert COUSIN in exchanged  # the runner-up
    assert len(exchanged) == 2  # and one by lot
    assert not {TRUE, TWIN} & set(exchanged)
    held = held_out_result(problem, problem, split, base, final, exchanged, split.what)
    assert held.rows == split.held.sum()
    assert held.gap_closed > 0.7
    assert all(share < held.gap_closed - 0.3 for share in held.exchange.values())
    assert held.after < 0.3 < held.before
    assert held.reduced_chi2_before == pytest.approx(mean_square(problem, base, split))


def test_exchange_without_anything_named():
    problem = bench()
    assert exchange_fits(problem, problem.fit(), [TRUE, TWIN], set()) == {}


@pytest.mark.parametrize(
    ("before", "after", "share"),
    [(5.0, 1.0, 1.0), (5.0, 3.0, 0.5), (5.0, 7.0, -0.5), (5.0, 90.0, -1.0), (0.9, 0.8, 0.0)],
)
def test_share_of_the_gap(before, after, share):
    assert closed(before, after) == pytest.approx(share)


@pytest.mark.parametrize(
    ("before", "after", "rows", "share"),
    [
        (0.98, 0.93, 500, 1.0),
        (1.03, 0.98, 500, 1.0),
        (0.98, 0.97, 500, 0.0),
        (1.03, 1.02, 500, 1.0 / 3.0),
        (5.0, 3.0, 500, 0.5),
    ],
)
def test_noise_that_was_taken_too_large_hides_no_gap(before, after, rows, share):
    assert closed(before, after, rows) == pytest.approx(share)
