"""What may be named while a misfit of unknown cause remains: only what closes a good part of it, on rows kept back too."""

import numpy as np
import pytest
from helpers.linear_fit import LinearProblem, linear_fit, linear_library, linear_problem

from thermohyd.identify.diagnosis.case import Case
from thermohyd.identify.diagnosis.final_model import FinalModel, final_model, relative_closure
from thermohyd.identify.diagnosis.held_out import split_rows
from thermohyd.identify.diagnosis.record_noise import NoiseEstimate
from thermohyd.identify.diagnosis.search import search
from thermohyd.identify.fitting.outcome import Fitted
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.noise.correlation import NoiseCorrelation


WHITE = NoiseCorrelation()
PROBLEM = linear_problem(WHITE)
KEYS = list(PROBLEM.rows())
EACH = 256  # rows of each of three channels
ROWS = 3 * EACH
SPLIT = split_rows(PROBLEM.tests)


def fit_of(*reduced: float) -> Fit:
    """A fit that leaves this reduced chi-square in each channel."""
    return linear_fit(np.repeat(np.sqrt(reduced), EACH), np.zeros((ROWS, 1)))


@pytest.mark.parametrize(
    ("base", "without", "fit", "named"),
    [
        ((5.0, 1.0, 1.0), (5.0, 1.0, 1.0), (4.0, 1.0, 1.0), True),  # a quarter of the whole gap
        ((5.0, 1.0, 1.0), (5.0, 1.0, 1.0), (4.9, 1.0, 1.0), False),  # 2 % of it
        ((50.0, 1.3, 1.0), (50.0, 1.3, 1.0), (50.0, 1.1, 1.0), True),  # hardly anything, but most of one channel's
        ((50.0, 1.1, 1.0), (50.0, 1.1, 1.0), (50.0, 1.0, 1.0), False),  # of a channel without a gap to speak of
        ((50.0, 1.0, 1.0), (5.0, 1.0, 1.0), (4.0, 1.0, 1.0), True),  # a quarter of what another effect has left
        ((1.0, 1.0, 1.0), (1.0, 1.0, 1.0), (1.0, 0.9, 1.0), False),  # there is no gap
    ],
)
def test_what_is_worth_a_name(base, without, fit, named):
    assert (relative_closure(PROBLEM, fit_of(*base), fit_of(*without), fit_of(*fit)) >= 1.0) is named


def test_worth_is_a_share():
    """Of the whole gap a tenth is 1; of one channel's a fifth is 1."""
    base = fit_of(5.0, 5.0, 5.0)
    assert relative_closure(PROBLEM, base, base, fit_of(4.6, 4.6, 4.6)) == pytest.approx(1.0, rel=0.01)
    assert relative_closure(PROBLEM, base, base, fit_of(4.2, 5.0, 5.0)) == pytest.approx(1.0, rel=0.01)


def smooth_misfit(reduced: float) -> np.ndarray:
    """A wave over the position in all channels, the larger the warmer: nothing of the library."""
    tests = [PROBLEM.tests[test] for test, _ in KEYS]
    wave = np.concatenate([np.sin(t.spool_position / 60e-6) * (t.temperature - 250.0) for t in tests])
    return wave * np.sqrt((reduced - 1.0) * ROWS) / np.linalg.norm(wave)


def modelled(misfit: np.ndarray, signatures: dict[str, np.ndarray], known: bool = True) -> FinalModel:
    """Search on the rows that are not kept back, then the final model of all rows."""
    rng = np.random.default_rng(8)
    nuisance = rng.normal(size=(ROWS, 6)) / np.sqrt(ROWS)
    problem: LinearProblem = linear_library(misfit + rng.normal(size=ROWS), nuisance, signatures)
    noise = {key: NoiseEstimate(np.ones(EACH), WHITE, "", "", known) for key in KEYS}
    unread = Fitted.__new__(Fitted)  # the final model looks at nothing of it
    case = Case(unread, problem, {}, noise, problem.fit(), {})
    chosen = problem.with_rows(~SPLIT.held)
    return final_model(case, search(chosen, chosen.fit(), {}), SPLIT)


def alike(misfit: np.ndarray, share: float, seed: int = 1) -> np.ndarray:
    """A signature, 5 long, that closes this share of a misfit."""
    own = misfit / np.linalg.norm(misfit)
    other = np.random.default_rng(seed).normal(size=ROWS)
    other -= (other @ own) * own
    return 5.0 * (-np.sqrt(share) * own + np.sqrt(1.0 - share) * other / np.linalg.norm(other))


def others() -> dict[str, np.ndarray]:
    shapes = np.random.default_rng(2).normal(size=(2, ROWS))
    return dict(zip(("viscosity_shift", "flowmeter_offset"), 5.0 * shapes / np.sqrt(ROWS), strict=True))


def test_nothing_missing():
    model = modelled(np.zeros(ROWS), others())
    assert model.fit.effects == ()
    assert model.rivals == {}
    assert not model.disagrees
    assert model.left.p_value > 1e-3


def test_an_effect_that_explains_everything():
    rng = np.random.default_rng(3)
    signature = 5.0 * rng.normal(size=ROWS) / np.sqrt(ROWS)
    model = modelled(-4.0 * signature, {"hysteresis": signature, **others()})
    assert model.fit.effects == ("hysteresis",)
    assert model.seen_apart
    assert not model.disagrees
    assert model.p_values["hysteresis"] < 1e-6
    assert model.gap_closed(model.rivals["hysteresis"].without) > 0.7


def test_a_misfit_of_unknown_cause_is_said_and_nothing_named():
    model = modelled(smooth_misfit(5.0), others())
    assert model.fit.effects == ()
    assert model.disagrees
    assert model.left.p_value < 1e-5
    assert model.scale > 4.0


@pytest.mark.parametrize(("share", "named"), [(0.8, True), (0.05, False)])
def test_beside_it_only_what_closes_a_good_part_is_named(share, named):
    misfit = smooth_misfit(5.0)
    signature = alike(misfit, share)
    model = modelled(misfit, {"hysteresis": signature, **others()})
    assert (model.fit.effects == ("hysteresis",)) is named
    assert model.disagrees
    assert (misfit @ signature) ** 2 / (signature @ signature) > 100.0  # chance does neither


def test_what_closes_nothing_on_rows_kept_back_is_not_named():
    misfit = smooth_misfit(5.0)
    everywhere = alike(misfit, 0.8)
    model = modelled(misfit, {"hysteresis": np.where(SPLIT.held, 0.0, everywhere), **others()})
    assert model.fit.effects == ()
    assert model.disagrees


@pytest.mark.parametrize("known", [True, False])
def test_a_rough_misfit_counts_where_the_noise_is_known(known):
    """Twice the noise in every row: no smooth curve finds that, and where nobody knows the noise, it is the noise."""
    rough = np.random.default_rng(9).normal(size=ROWS)
    assert modelled(rough, others(), known).disagrees is known
