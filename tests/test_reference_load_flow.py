"""The reference's load-flow test: its limits, its signs, and its balance where flows reverse."""

from dataclasses import replace

import numpy as np
import pytest
from reference import static_tests
from reference.oil import seed_oil
from reference.valve import Effects, Rows, Valve


BAR, UM = 1e5, 1e-6
WITH_EVERYTHING = Effects(
    supply_edge_wear=3e-6,
    land_leakage=20.0,
    flow_saturation=2e13,
    supply_droop=2e9,
    return_back_pressure=3e13,
    throttle_heating=0.7,
    pressure_viscosity=1.5e-8,
    pressure_clearance=2e-14,
    cross_port_leakage=3e-13,
)


def random_rows(n: int, seed: int) -> Rows:
    random = np.random.default_rng(seed)
    supply = random.uniform(50.0, 210.0, n) * BAR
    return Rows(
        random.uniform(-1.0, 1.0, n) ** 3 * 213 * UM,
        supply,
        random.uniform(0.0, 5.0, n) * BAR,
        random.uniform(263.15, 343.15, n),
        direction=np.ones(n),
        load_pressure=random.uniform(-1.5, 1.5, n) * supply,
    )


@pytest.mark.parametrize("effects", [Effects(), Effects(throttle_heating=1.0), WITH_EVERYTHING])
def test_without_load_it_is_the_flow_gain_test(effects):
    rows = random_rows(300, 1)
    free = replace(rows, load_pressure=np.zeros(300))
    a = static_tests.flow_gain(Valve(), seed_oil(), rows, effects)["flow"]
    b = static_tests.load_flow(Valve(), seed_oil(), free, effects)["flow"]
    assert np.abs(a - b).max() < 1e-13 * np.abs(a).max()


@pytest.mark.parametrize("effects", [Effects(), WITH_EVERYTHING])
def test_at_the_blocked_load_pressure_no_flow_is_left(effects):
    rows = random_rows(300, 2)
    blocked = static_tests.pressure_gain(Valve(), seed_oil(), rows, effects)["load_pressure"]
    left = static_tests.load_flow(Valve(), seed_oil(), replace(rows, load_pressure=blocked), effects)["flow"]
    scale = static_tests.flow_gain(Valve(), seed_oil(), rows, effects)["flow"]
    assert np.abs(left).max() < 1e-10 * np.abs(scale).max()


@pytest.mark.parametrize("effects", [Effects(), replace(WITH_EVERYTHING, supply_edge_wear=0.0)])
def test_swapping_the_ports_reverses_the_flow(effects):
    rows = random_rows(300, 3)
    mirrored = replace(rows, spool_position=-rows.spool_position, load_pressure=-rows.load_pressure)  # pyright: ignore
    a = static_tests.load_flow(Valve(), seed_oil(), rows, effects)["flow"]
    b = static_tests.load_flow(Valve(), seed_oil(), mirrored, effects)["flow"]
    assert np.abs(a + b).max() < 1e-12 * np.abs(a).max()


def test_flow_falls_as_the_load_pressure_rises():
    load = np.linspace(-1.5, 1.5, 121) * 70 * BAR
    full = lambda v: np.full(121, v)
    for x in (-50 * UM, 0.0, 5 * UM, 200 * UM):
        rows = Rows(full(x), full(70 * BAR), full(0.0), full(313.15), load_pressure=load)
        for effects in (Effects(), WITH_EVERYTHING):
            assert np.all(np.diff(static_tests.load_flow(Valve(), seed_oil(), rows, effects)["flow"]) < 0.0)


def test_a_circulating_overlapped_valve_is_refused():
    """Cross flow that the load returns heats itself without a limit: no steady state, so no number."""
    one = lambda v: np.array([v])
    rows = Rows(one(0.0), one(70 * BAR), one(0.0), one(313.15), load_pressure=one(60 * BAR))
    effects = Effects(throttle_heating=1.0, cross_port_leakage=1e-12)
    with pytest.raises(ArithmeticError, match="did not converge"):
        static_tests.load_flow(Valve(underlap=-30 * UM, clearance=1 * UM), seed_oil(), rows, effects)
