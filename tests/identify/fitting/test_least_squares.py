"""The bounded solver: limits reached and left, words for what goes wrong, one compiled program, several starts."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings, strategies as st

from thermohyd.identify.fitting.boxes import Box
from thermohyd.identify.fitting.least_squares import (
    as_converged,
    judged,
    multi_start,
    near_best,
    not_worth_while,
    solve,
)


TIME = jnp.linspace(0.0, 3.0, 40)


def decay(p: jax.Array, data: jax.Array) -> jax.Array:
    """p0 exp(-p1 t) + p2 - data."""
    return p[0] * jnp.exp(-p[1] * TIME) + p[2] - data


def decay_data(seed: int, amplitude: float, rate: float, offset: float) -> jax.Array:
    noise = np.random.default_rng(seed).normal(0.0, 0.02, TIME.shape)
    return jnp.asarray(amplitude * np.exp(-rate * np.asarray(TIME)) + offset + noise)


def decay_boxes(start: tuple[float, float, float] = (1.0, 1.0, 0.0)) -> list[Box]:
    return [
        Box("amplitude", start[0], 1.0),
        Box("rate", start[1], 1.0, 0.0, 5.0),
        Box("offset", start[2], 1.0, 0.0, 2.0),
    ]


def test_optimum_on_a_limit_is_reached_exactly_and_said() -> None:
    result = solve(decay, decay_boxes(), decay_data(0, 2.0, 0.7, -0.3))
    assert result.converged, result.message
    assert result.p[2] == 0.0
    assert list(result.active) == [0, 0, -1]


def test_a_start_on_the_limit_leaves_it() -> None:
    result = solve(decay, decay_boxes((1.0, 0.0, 2.0)), decay_data(0, 2.0, 0.7, 0.3))
    assert result.converged, result.message
    assert list(result.active) == [0, 0, 0]
    np.testing.assert_allclose(result.p, [2.0, 0.7, 0.3], atol=0.1)


def test_a_search_that_promises_no_lower_end_is_given_up() -> None:
    """Near its optimum a search says where it will end: beside a better one known it need not go there."""
    data = decay_data(0, 2.0, 0.7, 0.3)
    best = solve(decay, decay_boxes((0.3, 4.0, 1.5)), data)
    for enough in (0.9 * best.cost, 0.999 * best.cost):
        given_up = solve(decay, decay_boxes((0.3, 4.0, 1.5)), data, enough=enough)
        assert not given_up.converged
        assert given_up.steps < best.steps
        assert best.cost < given_up.cost
    again = solve(decay, decay_boxes((0.3, 4.0, 1.5)), data, enough=1.001 * best.cost)
    assert again.converged
    assert again.cost == best.cost


@settings(max_examples=40)
@given(
    seed=st.integers(0, 1000),
    true=st.tuples(st.floats(0.5, 3.0), st.floats(0.3, 6.0), st.floats(-0.5, 2.5)),
    start=st.tuples(st.floats(0.2, 4.0), st.floats(0.1, 5.0), st.floats(0.0, 2.0)),
)
def test_agrees_with_scipy_inside_a_box(seed: int, true: tuple, start: tuple) -> None:
    """SciPy's reflective trust region from the truth is the peer: ours must end as low, from anywhere in the box."""
    data = decay_data(seed, *true)
    mine = solve(decay, decay_boxes(start), data)
    time, readings = np.asarray(TIME), np.asarray(data)
    peer = scipy.optimize.least_squares(
        lambda p: p[0] * np.exp(-p[1] * time) + p[2] - readings,
        np.clip(true, [-np.inf, 1e-3, 1e-3], [np.inf, 4.999, 1.999]),
        bounds=([-np.inf, 0.0, 0.0], [np.inf, 5.0, 2.0]),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    assert mine.converged, mine.message
    assert mine.cost <= 2.0 * peer.cost * (1.0 + 1e-6)


def test_logarithmic_boxes_find_the_same_optimum() -> None:
    data = decay_data(3, 2.0, 0.7, 0.3)
    boxes = [Box("amplitude", 0.1, 1.0, 1e-3, 1e3, logarithmic=True), *decay_boxes()[1:]]
    plain, log = solve(decay, decay_boxes(), data), solve(decay, boxes, data)
    assert log.converged, log.message
    np.testing.assert_allclose(log.p, plain.p, rtol=1e-6)
    np.testing.assert_allclose(log.jacobian, plain.jacobian, rtol=1e-5, atol=1e-6)


def test_other_data_starts_and_limits_do_not_compile_again() -> None:
    traces = []

    def counted(p: jax.Array, data: jax.Array) -> jax.Array:
        traces.append(1)
        return decay(p, data)

    solve(counted, decay_boxes(), decay_data(0, 2.0, 0.7, 0.3))
    before = len(traces)
    solve(counted, [Box("a", 2.0, 3.0), Box("b", 1.0, 0.1, 0.5, 9.0), Box("c", 0.0, 1.0)], decay_data(1, 1.0, 2.0, 0.1))
    assert len(traces) == before


def test_a_model_that_fails_at_a_trial_point_is_survived() -> None:
    fragile = lambda p, data: jnp.where(p[0] > 3.0, jnp.nan, decay(p, data))
    data = decay_data(0, 2.9, 0.7, 0.3)
    result = solve(fragile, decay_boxes((0.1, 4.0, 1.9)), data)
    assert result.converged, result.message
    np.testing.assert_allclose(result.p, solve(decay, decay_boxes(), data).p, rtol=1e-6)


def test_a_model_that_fails_at_the_start_is_named() -> None:
    broken = lambda p, data: jnp.where(jnp.arange(40) < 7, jnp.nan, decay(p, data))
    result = solve(broken, decay_boxes(), decay_data(0, 2.0, 0.7, 0.3))
    assert not result.converged
    assert result.message == "the model gives no finite value at the start for 7 of 40 readings"


def test_a_derivative_that_fails_at_the_start_is_named() -> None:
    rooted = lambda p, data: decay(p, data) + jnp.sqrt(p[2])
    result = solve(rooted, decay_boxes(), decay_data(0, 2.0, 0.7, 0.3))
    assert not result.converged
    assert result.message.startswith("the model has no finite derivative at the start for")
    assert "offset" in result.message


def test_a_wrong_derivative_is_not_called_an_optimum() -> None:
    @jax.custom_jvp
    def twisted(p: jax.Array) -> jax.Array:
        return p

    twisted.defjvp(lambda primals, tangents: (primals[0], -tangents[0]))
    result = solve(lambda p, data: decay(twisted(p), data), decay_boxes(), decay_data(0, 2.0, 0.7, 0.3))
    assert not result.converged
    assert "the slope is not zero" in result.message


def test_running_out_to_where_nothing_depends_on_a_parameter_is_no_optimum() -> None:
    bump = lambda p, data: 1e-3 + jnp.exp(-((TIME - p[0]) ** 2)) - data
    result = solve(bump, [Box("centre", 4.5, 1.0)], -jnp.ones(40))
    assert not result.converged
    assert "no longer depend on centre" in result.message


def test_a_parameter_without_any_effect_does_not_disturb_the_others() -> None:
    data = decay_data(0, 2.0, 0.7, 0.3)
    result = solve(decay, [*decay_boxes(), Box("idle", 1.0, 1.0, 0.0, 2.0)], data)
    assert result.converged, result.message
    assert result.p[3] == 1.0
    np.testing.assert_allclose(result.p[:3], solve(decay, decay_boxes(), data).p, rtol=1e-7)


def test_exact_data_give_the_exact_parameters() -> None:
    data = 2.0 * jnp.exp(-0.7 * TIME) + 0.3
    result = solve(decay, decay_boxes(), data)
    assert result.converged, result.message
    np.testing.assert_allclose(result.p, [2.0, 0.7, 0.3], rtol=1e-12)
    assert "to rounding" in result.message


def test_a_search_does_not_grope_in_what_a_model_is_known_to() -> None:
    """Readings that jump a little from one point to the next, as steps chosen by need make them: the optimum is near, and that is all."""
    data = decay_data(3, 2.0, 0.7, 0.3)

    def both(p: Any, args: Any) -> tuple[Any, Any]:
        values, phase = args
        rough = 2e-5 * jnp.sin(1e7 * jnp.sum(p) + TIME + phase)
        return decay(p, values) + rough, jax.jacfwd(decay)(p, values).T

    smooth = solve(decay, decay_boxes(), data)
    for phase in range(6):
        result = solve(None, decay_boxes(), (data, float(phase)), both=both, tolerance=1e-3, believe=0.05)
        assert result.converged, result.message
        assert result.steps < smooth.steps + 6
        np.testing.assert_allclose(result.p, smooth.p, rtol=1e-3)


def test_a_search_on_a_kink_ends_where_shorter_steps_promise_nothing() -> None:
    """Beside a kink trials fail at every length; halved down to rounding they took twice as many evaluations as these."""
    data = decay_data(3, 2.0, 0.7, 0.3)

    def kinked(p: jax.Array, values: jax.Array) -> jax.Array:
        return jnp.concatenate([decay(p, values), 0.3 + 3.0 * jnp.abs(p[2:] - 0.4)])

    to_rounding = solve(kinked, decay_boxes(), data)
    result = solve(kinked, decay_boxes(), data, tolerance=1e-2)
    assert result.steps < 0.6 * to_rounding.steps
    assert result.cost < to_rounding.cost * (1.0 + 1e-4)
    assert not result.converged


def test_single_precision_is_refused_in_one_sentence() -> None:
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(RuntimeError, match="a fit needs double precision"):
            solve(decay, decay_boxes(), TIME)
    finally:
        jax.config.update("jax_enable_x64", True)


def test_several_starts_find_the_lower_of_two_minima() -> None:
    two_wells = lambda p, data: jnp.stack([p[0] ** 2 - 4.0, 0.5 * (p[0] - 2.0)])
    boxes = [Box("p", -2.5, 1.0, -4.0, 4.0)]
    outcomes = multi_start(two_wells, boxes, count=5)
    assert outcomes[0].p[0] == pytest.approx(2.0)
    assert outcomes[0].cost < 1e-12
    assert any(outcome.p[0] < 0.0 for outcome in outcomes)
    assert {round(outcome.p[0], 6) for outcome in near_best(outcomes)} == {2.0}


def test_starts_without_a_finite_cost_are_dropped() -> None:
    half = lambda p, data: jnp.where(p[0] < 0.0, jnp.nan, p - 1.0)
    said: list[str] = []
    outcomes = multi_start(half, [Box("p", 0.5, 1.0)], count=6, candidates=8, progress=said.append)
    assert all(outcome.converged and outcome.start[0] >= 0.0 for outcome in outcomes)
    assert len(said) == len(outcomes) > 1


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"start": 3.0, "lower": 0.0, "upper": 1.0}, r"p starts at 3, outside its box \[0, 1\]"),
        ({"start": 0.0, "lower": 0.0, "upper": 0.0}, "the box of p is empty"),
        ({"start": 0.0, "scale": 0.0}, "the scale of p must be positive"),
        ({"start": 1.0, "lower": 0.0, "logarithmic": True}, "p cannot be fitted by its logarithm"),
    ],
)
def test_senseless_boxes_are_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Box(**{"name": "p", "scale": 1.0, **wrong})


@pytest.mark.parametrize(
    ("costs", "goal", "worth", "left"),
    [
        ([3015.0, 2837.0], 1312.0, 0.0, False),  # too early to say
        ([3015.0, 2837.0, 2823.0], 1312.0, 0.0, False),  # the better of two steps counts: 15 times 178
        ([3015.0, 2837.0, 2823.0, 2820.0], 1312.0, 0.0, True),
        ([1334.0, 1333.0, 1317.0, 1315.0], 1312.0, 0.0, False),
        ([610.02, 610.01, 610.009], np.inf, 0.05, False),
        ([610.02, 610.018, 610.017], np.inf, 0.05, True),
        ([610.02, 610.018, 610.017], np.inf, 0.0, False),  # nobody asked
    ],
)
def test_a_search_is_left_where_what_is_asked_of_it_is_out_of_reach(costs, goal, worth, left) -> None:
    assert not_worth_while(costs, goal, worth) is left


def test_a_search_on_the_host_is_left_where_it_will_not_reach_its_goal() -> None:
    data, boxes = decay_data(0, 2.0, 0.7, 0.3), decay_boxes()
    both = lambda p, args: (decay(p, data), jax.jacfwd(decay)(jnp.asarray(p), data).T)
    whole = solve(None, boxes, both=both)
    assert whole.converged
    early = solve(None, boxes, both=both, goal=-1e6)
    assert early.steps < whole.steps
    assert not early.converged
    assert not early.exhausted
    again = solve(None, boxes, both=both, goal=whole.cost + 1.0)
    assert again.cost == whole.cost


@pytest.mark.parametrize(("off", "believed"), [(0.04, True), (0.12, True), (0.29, True), (0.31, False), (2.0, False)])
def test_an_end_within_a_third_of_a_standard_error_counts_and_says_how_near_it_is(off, believed):
    wave = np.tile([1.0, -1.0], 50) * np.sqrt(
        99.0 / 100.0
    )  # orthogonal to the column, variance 1 in 99 degrees of freedom
    small, columns = np.array([[0.0], [0.0], [1.0], [10.0]]), np.ones((1, 100))
    end = judged([Box("slope", 0.0, 1.0)], np.zeros(1), (small, wave + 0.1 * off, columns, 9, False), 0.05)
    assert end.relative_offset == pytest.approx(off)
    assert end.converged == (off < 0.05)
    found = as_converged(end)
    assert found.converged == believed
    assert (f"converged to {off:g} standard errors in 8 steps" == found.message) == (believed and not end.converged)


def test_a_parameter_that_no_reading_depends_on_any_more_is_no_near_miss():
    small, columns = np.array([[0.0], [0.0], [1.0], [1e9]]), np.ones((1, 100))
    end = judged([Box("slope", 0.0, 1.0)], np.zeros(1), (small, np.tile([1.0, -0.99], 50), columns, 9, False), 0.05)
    assert "no longer depend on slope" in as_converged(end).message
    assert not as_converged(end).converged
