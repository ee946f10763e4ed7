"""Draws of densities that are known, and what is said where no draws can be trusted. One small program serves all of them."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.uncertainty.log_posterior import Clamp, LogPosterior
from thermohyd.identify.uncertainty.posterior import Sampling, sampled
from thermohyd.identify.uncertainty.sampler import sampler_or_sentence


def density(u, data):
    """Two normal laws, `apart` from each other, of p; nothing beyond `wall`; the second variable a normal law."""
    clamp, (apart, wall) = data
    p = clamp.physical(u)
    heaps = jnp.logaddexp(-0.5 * (p[0] - apart) ** 2, -0.5 * (p[0] + apart) ** 2)
    return jnp.where(p[0] < wall, heaps - 0.5 * (p[1] - 3.0) ** 2 + clamp.log_slope(u), -jnp.inf)


def posterior(apart=0.0, wall=1e3, lower=-100.0, start=0.5, wide=1.0, **more):
    clamp = Clamp(np.array([lower, -100.0]), np.ones(2), np.array([100.0 - lower, 200.0]))
    data = (clamp, (jnp.asarray(float(apart)), jnp.asarray(float(wall))))
    target = LogPosterior(
        ("p", "q"), density, clamp, clamp.free(np.array([start, 3.0])), np.diag([wide, 1.0]), data, "flat"
    )
    return sampled(target, Sampling(warmup=200, draws=300, seed=3, **more))


def test_of_a_normal_law_mean_deviation_and_intervals_are_its_own():
    found = posterior()
    assert found.trouble == ""
    assert found.draws.shape == (4, 300, 2)
    for name, mean in (("p", 0.0), ("q", 3.0)):
        own = found.parameters[name]
        error = 1.0 / np.sqrt(own.ess_bulk)
        assert abs(own.mean - mean) < 4.0 * error
        assert own.std == pytest.approx(1.0, abs=4.0 * error)
        assert own.at(0.68).low == pytest.approx(mean - 0.994, abs=0.2)
        assert own.at(0.68).high == pytest.approx(mean + 0.994, abs=0.2)
        assert own.at(0.95).high - own.at(0.95).low == pytest.approx(3.92, abs=0.4)
        assert own.r_hat < 1.01


def test_beside_a_limit_half_of_a_normal_law_is_heaped_up_there():
    own = posterior(lower=0.0, start=0.0).parameters["p"]
    assert own.mean == pytest.approx(np.sqrt(2.0 / np.pi), abs=0.08)
    assert own.at(0.95).low == pytest.approx(0.0313, abs=0.03)
    assert own.at(0.95).high == pytest.approx(2.241, abs=0.2)


def test_the_same_seed_gives_the_same_draws_and_the_same_file():
    one, other = posterior(), posterior()
    np.testing.assert_array_equal(one.draws, other.draws)
    assert one.file == other.file


def test_the_file_is_a_data_tree_of_draws_and_of_what_the_sampler_says(tmp_path):
    xarray = pytest.importorskip("xarray")
    (tmp_path / "posterior.nc").write_bytes(posterior().file)
    with xarray.open_datatree(tmp_path / "posterior.nc", engine="h5netcdf") as tree:
        assert tree["posterior"]["p"].shape == (4, 300)
        assert {"diverging", "energy", "acceptance_rate", "tree_depth"} <= set(tree["sample_stats"].data_vars)
        assert tree.attrs["inference_library"] == "blackjax"


def test_chains_that_do_not_meet_are_reported_as_nothing():
    found = posterior(apart=20.0, wide=900.0)
    assert "do not agree on p" in found.trouble
    assert found.parameters == {}
    assert found.file == b""


def test_divergent_trajectories_are_tried_again_with_smaller_steps_and_then_refused():
    found = posterior(wall=0.7)
    assert "diverged" in found.trouble
    assert "use the profiles" in found.trouble
    assert found.tried == (0.85, 0.95, 0.99)
    assert found.parameters == {}


def test_without_the_sampler_one_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "blackjax", None)
    with pytest.raises(BenchInputError, match=r"pip install -c constraints.txt '\.\[posterior\]'"):
        sampler_or_sentence()


def test_a_clamp_goes_there_and_back_and_has_the_slope_it_says():
    clamp = Clamp(np.array([0.0, -5.0, 1.0]), np.array([1e-6, 0.5, 2.0]), np.array([200.0, 20.0, 0.3]))
    p = np.array([3e-6, -4.9, 1.2])
    u = clamp.free(p)
    np.testing.assert_allclose(clamp.physical(jnp.asarray(u)), p, rtol=1e-9)
    slope = jnp.diag(jax.jacobian(clamp.physical)(jnp.asarray(u)))
    np.testing.assert_allclose(clamp.slope(u), slope, rtol=1e-9)
    assert float(clamp.log_slope(jnp.asarray(u))) == pytest.approx(float(np.sum(np.log(slope))), rel=1e-9)
    far = np.asarray(clamp.physical(jnp.asarray([-700.0, 900.0, -50.0])))
    assert (far >= np.asarray(clamp.lower)).all()
    assert (far <= np.asarray(clamp.lower + clamp.step * clamp.width)).all()
