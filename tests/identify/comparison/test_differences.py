"""Differences of two linear records beside what least squares says by hand: shared instruments, limits, noise that was estimated."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from helpers.linear_fit import LinearProblem, linear_library
from helpers.small_bench import REACH

from thermohyd.identify.comparison.differences import difference, estimates_of, if_equal, largest_of, scores
from thermohyd.identify.comparison.joint_fit import SHARED, JointFit, Part, joint_fit
from thermohyd.identify.diagnosis.max_t import NoiseFreedom
from thermohyd.identify.fitting.boxes import Box
from thermohyd.identify.fitting.parameters import PARAMETERS, ParameterInfo, ParameterPlan, Prior
from thermohyd.identify.fitting.problem import System


ROWS = 256 * len(REACH)
NAMES = PARAMETERS[:2]
GAIN, GAIN_STD = "flow_gain", 0.5


@dataclass(frozen=True)
class WithGain(LinearProblem):
    """A linear problem of two parameters, an effect of one sign and an instrument's gain that only its data sheet knows well."""

    gain: np.ndarray = field(default_factory=lambda: np.zeros(0))
    prior_std: float = GAIN_STD

    @property
    def parameters(self) -> tuple[str, ...]:
        return (*NAMES, GAIN)

    def system(self, effects=(), start=None) -> System:
        order = (*self.parameters, *self.library.names)
        own = np.stack([*self.nuisance.T, self.gain, *self.signatures.values()])

        def both(p, args):
            residual = self.misfit + np.asarray(p) @ own
            priors = np.array([0.0, 0.0, p[2] / self.prior_std])
            slopes = np.zeros((len(order), 3))
            slopes[2, 2] = 1.0 / self.prior_std
            return np.append(residual, priors), np.concatenate([own, slopes], axis=1)

        boxes = [Box(name, 0.0, 1.0) for name in self.parameters] + [Box(n, 0.1, 1.0, 0.0, 10.0) for n in effects]
        return System(tuple(effects), order, order, boxes, both, lambda count: np.arange(count))


def plan_of_gain(std: float) -> ParameterPlan:
    info = ParameterInfo(GAIN, "dimensionless", 0.0, -10.0, 10.0, 1.0, "gain")
    return ParameterPlan(info, 0.0, False, -10.0, 10.0, Prior(0.0, std))


def record(seed: int, *, effect: float = 0.0, prior_std: float = GAIN_STD, truth=(0.0, 0.0), gain=0.3) -> Part:
    """One record of known truth: unit noise; the gain acts as the first parameter does."""
    random = np.random.default_rng(seed)
    nuisance = np.random.default_rng(5).standard_normal((ROWS, 2))
    signature = np.random.default_rng(6).standard_normal(ROWS)
    column = nuisance[:, 0] + 0.1 * np.random.default_rng(7).standard_normal(ROWS)
    read = nuisance @ np.array(truth) + gain * column + effect * signature + random.standard_normal(ROWS)
    plain = linear_library(-read, nuisance, {"hysteresis": signature})
    plans = {**plain.plans, GAIN: plan_of_gain(prior_std)}
    problem = WithGain(
        plain.record, plain.tests, plans, plain.library, plain.noise, misfit=plain.misfit, nuisance=nuisance,
        signatures=plain.signatures, gain=column, prior_std=prior_std,
    )  # fmt: skip
    channel = np.append(np.repeat(np.arange(3), 256), np.full(3, 3))
    return Part(
        f"record {seed}", problem, ("hysteresis",), {}, 1.0, NoiseFreedom(channel, np.array([20.0, 20.0, 20.0, np.inf]))
    )


def by_hand(first: Part, second: Part, prior_std: float) -> tuple[np.ndarray, np.ndarray]:
    """Values and covariance of (a's two, shared gain, a's effect, b's two, b's effect) by dense least squares."""
    rows = []
    for part, places in ((first, (0, 1, 2, 3)), (second, (4, 5, 2, 6))):
        problem = part.problem
        block = np.zeros((ROWS, 7))
        own = [*problem.nuisance.T, problem.gain, problem.signatures["hysteresis"]]  # pyright: ignore
        for place, column in zip(places, own, strict=True):
            block[:, place] = column
        rows.append((block, problem.misfit))  # pyright: ignore
    prior = np.zeros((1, 7))
    prior[0, 2] = 1.0 / prior_std
    matrix = np.concatenate([rows[0][0], rows[1][0], prior])
    residual = np.concatenate([rows[0][1], rows[1][1], [0.0]])
    covariance = np.linalg.inv(matrix.T @ matrix)
    return -covariance @ (matrix.T @ residual), covariance


def test_a_shared_gain_makes_differences_tighter_than_two_fits():
    a, b = record(1, effect=0.5), record(2, effect=0.8, truth=(0.4, 0.0))
    found = estimates_of(joint_fit(a, b, frozenset({GAIN})))
    values, covariance = by_hand(a, b, GAIN_STD)
    for name, i, j in ((NAMES[0], 0, 4), (NAMES[1], 1, 5), ("hysteresis", 3, 6)):
        own = difference(found, name, a.record, b.record)
        assert not isinstance(own, str)
        contrast = np.zeros(7)
        contrast[i], contrast[j] = -1.0, 1.0
        assert own.value == pytest.approx(float(contrast @ values), abs=1e-6)
        assert own.std == pytest.approx(float(np.sqrt(contrast @ covariance @ contrast)), rel=1e-6)
        assert own.freedom == pytest.approx(120.0, rel=0.3)  # of both records' three channels
    own = difference(found, NAMES[0], a.record, b.record)
    assert not isinstance(own, str)
    assert own.std_apart is not None
    assert own.std < 0.25 * own.std_apart  # apart, each fit's gain is known to its data sheet only
    assert found.fit.values[SHARED, GAIN] == pytest.approx(float(values[2]), abs=1e-6)


def test_of_two_priors_the_wider_counts_once():
    a, b = record(1, effect=0.5, prior_std=0.4), record(2, effect=0.5)
    for pair in ((a, b), (b, a)):
        found = estimates_of(joint_fit(*pair, frozenset({GAIN})))
        values, covariance = by_hand(a, b, GAIN_STD)
        assert found.fit.values[SHARED, GAIN] == pytest.approx(float(values[2]), abs=1e-6)
        assert found.std((SHARED, GAIN)) == pytest.approx(float(np.sqrt(covariance[2, 2])), rel=1e-6)


def test_an_amount_at_its_limit_does_not_shorten_the_difference():
    a, b = record(3, effect=-0.2), record(4, effect=0.5)
    fit = joint_fit(a, b, frozenset({GAIN}))
    assert fit.values[a.record, "hysteresis"] == 0.0
    assert fit.active[fit.free.index((a.record, "hysteresis"))] == -1
    own = difference(estimates_of(fit), "hysteresis", a.record, b.record)
    values, _ = by_hand(a, b, GAIN_STD)
    assert not isinstance(own, str)
    assert own.value == pytest.approx(float(values[6] - values[3]), abs=1e-6)


def test_what_is_equal_in_both_sharpens_the_rest():
    a, b = record(1, effect=0.5), record(2, effect=0.8, truth=(0.4, 0.0))
    found = estimates_of(joint_fit(a, b, frozenset()))
    own = [difference(found, name, a.record, b.record) for name in (*NAMES, "hysteresis", GAIN)]
    differences = [d for d in own if not isinstance(d, str)]
    rest = if_equal(differences, [NAMES[1], GAIN])
    assert rest.p_value > 0.01
    value, std = rest.others[NAMES[0]]
    assert abs(value - 0.4) < 4.0 * std
    assert std < 0.3 * differences[0].std  # the gain was what it could not be told from
    assert if_equal(differences, [NAMES[0], "hysteresis"]).p_value < 1e-6


def test_the_largest_of_all_rows_is_judged_with_their_correlation():
    a, b = record(1), record(2)
    found = estimates_of(joint_fit(a, b, frozenset({GAIN})))
    own = [difference(found, name, a.record, b.record) for name in (*NAMES, "hysteresis")]
    differences = [d for d in own if not isinstance(d, str)]
    law = largest_of(differences)
    assert 2.58 < law.critical(0.01) < 3.0  # between one score and, but for the draws, the bound of Bonferroni of three
    z = scores(differences, {d.name: d.std for d in differences})
    for d in differences:  # twenty degrees of freedom a channel: a score counts less than it would of a known noise
        assert z[d.name] <= abs(d.value / d.std)


def test_rates_of_random_records():
    """Nothing differs: intervals hold 0 about as often as they say, and hardly anything is called different."""
    inside, different = [], 0
    for seed in range(100, 160, 2):
        a, b = record(seed, effect=1.0), record(seed + 1, effect=1.0)
        found = estimates_of(joint_fit(a, b, frozenset({GAIN})))
        own = [difference(found, name, a.record, b.record) for name in (*NAMES, "hysteresis")]
        differences = [d for d in own if not isinstance(d, str)]
        inside += [abs(d.value) <= d.reach * d.std for d in differences]
        z = scores(differences, {d.name: d.std for d in differences})
        different += max(z.values()) > largest_of(differences).critical(0.01)
    assert 0.88 <= np.mean(inside) <= 1.0
    assert different <= 2


def test_a_dead_entry_says_why():
    fit = JointFit(
        (("a", "clearance"), ("b", "clearance")), {("a", "clearance"): 1.0, ("b", "clearance"): 1.0}, np.zeros(4),
        np.array([[0.0, 1.0]] * 4), {"a": np.zeros((4, 2)), "b": np.ones((4, 2))}, np.zeros(2, int),
        NoiseFreedom(np.zeros(4, int), np.array([np.inf])), 0.0, True, "",
    )  # fmt: skip
    assert difference(estimates_of(fit), "clearance", "a", "b") == "a: no reading depends on clearance"
