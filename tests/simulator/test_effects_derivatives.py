"""Derivatives to every effect's amount: forward = reverse = finite differences, at neutral and where the law has its seams."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.valves import STROKE, seed_valve

from thermohyd.conditions import Conditions
from thermohyd.effects.library import EFFECTS, with_effects
from thermohyd.static_tests import blocked_port_readings, control_flow, load_flow


ROWS = 8
UNDERLAP, NULL_BIAS = 8e-6, 0.5e-6
COUPLED = ("flow_saturation", "supply_droop", "return_back_pressure", "cross_port_leakage")
# What ports store has programs of its own (test_port_storage.py).
STEADY = tuple(name for name in EFFECTS if not EFFECTS[name].stores)
PLAIN = tuple(name for name in STEADY if name not in COUPLED)
BALANCES = {
    "blocked": lambda valve, points: jnp.concatenate([*blocked_port_readings(valve, points).values()]),
    "connected": control_flow,
    "loaded": load_flow,
}


@functools.cache
def compiled(balance: str, effects: tuple[str, ...]):
    """(amounts in steps that matter, underlap, points, unit, weights) -> readings, forward Jacobian, weights @ reverse one.

    One cotangent at a time: a batch of them takes five times as long to compile.
    """

    def reading(steps, underlap, points, unit):
        amounts = {name: EFFECTS[name].scale * steps[i] for i, name in enumerate(effects)}
        valve = seed_valve(underlap=underlap, null_bias=NULL_BIAS)
        return BALANCES[balance](with_effects(valve, amounts), points) / unit

    def all_three(steps, underlap, points, unit, weights):
        value, push = jax.linearize(lambda s: reading(s, underlap, points, unit), steps)
        pull = jax.linear_transpose(push, steps)  # reverse mode, from the same linearisation
        return value, jax.vmap(push)(jnp.eye(steps.size)), pull(weights)[0]

    return jax.jit(all_three)


def points_of(position, load, supply=100e5) -> Conditions:
    a = lambda values: jnp.asarray(np.resize(np.asarray(values, dtype=float), ROWS))
    return Conditions(
        position=a(position),
        supply_pressure=a(supply),
        return_pressure=a(3e5),
        temperature=jnp.linspace(283.15, 333.15, ROWS),
        load_pressure=a(load),
        time=jnp.asarray(np.arange(ROWS) * 0.7),
        run=a([0, 0, 0, 0, 1, 1, 1, 1]),
        direction=a([1, 1, -1, -1]),
        rate=jnp.linspace(-8e-6, 8e-6, ROWS),
    )


# name: (underlap, points, how far derivatives at a kink may be from central differences)
PLACES = {
    "a sweep": (
        UNDERLAP,
        points_of(STROKE * np.array([-1, -0.3, -0.02, 0.01, 0.05, 0.2, 0.6, 1.0]), [-2e6, 3e6]),
        1e-6,
    ),
    "null, equal ports": (UNDERLAP, points_of([NULL_BIAS], [0.0]), 1e-5),
    "edges that just close": (UNDERLAP, points_of([NULL_BIAS + UNDERLAP, NULL_BIAS - UNDERLAP], [1e6, -1e6]), 2e-2),
    "a closed spool": (-10e-6, points_of([NULL_BIAS, NULL_BIAS + 4e-6, NULL_BIAS - 6e-6], [1e6, 0.0]), 1e-5),
    "no drop over open edges": (UNDERLAP, points_of([0.4 * STROKE, -0.4 * STROKE], [97e5, -97e5]), 2e-2),
}


def check(balance, effects, place, steps):
    """All three kinds of derivative agree."""
    underlap, points, tolerance = PLACES[place]
    count = (5 if balance == "blocked" else 1) * ROWS
    weights = np.random.default_rng(2).standard_normal((2, count))
    fn = compiled(balance, effects)

    def at(z, unit, w=weights[0]):
        with quick_compile():
            found = fn(jnp.asarray(z), jnp.asarray(underlap), points, unit, jnp.asarray(w))
        return [np.asarray(part) for part in found]

    first = at(steps, jnp.ones(count))[0].reshape(-1, ROWS)
    # Pressures by a typical one: at null their difference vanishes.
    size = np.maximum(np.max(np.abs(first), axis=1), [1e-6, 1e7, 1e7, 1e7, 1e-6][: len(first)])
    unit = jnp.asarray(np.repeat(size, ROWS))
    forward = at(steps, unit)[1]
    assert np.all(np.isfinite(forward))
    spread = np.maximum(np.max(np.abs(forward), axis=1), 1e-2)
    for w in weights:
        reverse = at(steps, unit, w)[2]
        np.testing.assert_array_less(np.abs(reverse - forward @ w) / spread, 1e-9)
    # Along directions in which every effect moves the readings alike, so that a wrong derivative of any one shows.
    for signs in np.random.default_rng(3).choice([-1.0, 1.0], (2, len(effects))):
        direction = signs / spread
        ends = [
            (at(steps + h * direction, unit)[0] - at(steps - h * direction, unit)[0]) / (2 * h) for h in (1e-4, 2e-4)
        ]
        numeric = (4 * ends[0] - ends[1]) / 3
        np.testing.assert_array_less(np.abs(direction @ forward - numeric), tolerance)


# Heat in the load flow takes half a minute to compile, and so does heat in both directions beside coupled blocked ports:
# test_gradients.py has the derivatives of the one, test_effects_neutral.py looks at the other.
COLD = tuple(name for name in STEADY if name != "throttle_heating")
RUNS = {
    "plain-blocked": ("blocked", PLAIN),
    "plain-connected": ("connected", PLAIN),
    "plain-loaded": ("loaded", tuple(name for name in PLAIN if name in COLD)),
    "coupled-blocked": ("blocked", COLD),
    "coupled-connected": ("connected", STEADY),
    "coupled-loaded": ("loaded", COLD),
}


@pytest.mark.parametrize("run", RUNS)
def test_derivatives_at_neutral(run):
    balance, effects = RUNS[run]
    for place in PLACES:
        check(balance, effects, place, np.zeros(len(effects)))
