"""The reference simulator against closed forms and against the figures of an independent model (docs/physics.md section 13)."""

from dataclasses import replace

import numpy as np
import pytest
from reference import static_tests
from reference.oil import Oil, seed_oil
from reference.valve import Effects, Rows, Valve


BAR, LPM, UM = 1e5, 1e-3 / 60.0, 1e-6
STROKE, SUPPLY = 213 * UM, 70 * BAR
HM, THM = Effects(), Effects(throttle_heating=1.0)
# cSt: null leakage l/min HM, THM; bar K_PX, THM (HM: 33.851 at every viscosity). 70 bar.
# The published K_PX are slopes at null: over a chord of +-1 % of the stroke HM gives 32.559.
INDEPENDENT = {
    30.0: (0.28388, 0.28819, 34.333),
    100.0: (0.09257, 0.09540, 34.773),
    300.0: (0.03054, 0.03190, 35.188),
    1000.0: (0.00902, 0.00957, 35.690),
    4000.0: (0.00222, 0.00241, 36.322),
}


def temperature_of(cst: float, oil: Oil) -> float:
    """Where the oil has this kinematic viscosity [K]."""
    return float(10.0 ** ((oil.walther_a - np.log10(np.log10(cst + 0.7))) / oil.walther_b))


def incompressible(oil: Oil) -> Oil:
    return replace(oil, bulk_modulus=1e30)


def rows_at(x, temperature: float, supply: float | np.floating = SUPPLY) -> Rows:
    x = np.atleast_1d(np.asarray(x, dtype=float))
    full = lambda v: np.full(x.shape, v)
    return Rows(x, full(supply), full(0.0), full(temperature))


@pytest.mark.parametrize("cst", INDEPENDENT)
def test_figures_of_an_independent_model(cst):
    oil = seed_oil()
    t = temperature_of(cst, oil)
    leakage = [static_tests.leakage(Valve(), oil, rows_at(0.0, t), e)["leakage_flow"][0] / LPM for e in (HM, THM)]
    gain = []
    for effects in (HM, THM):
        pressure = static_tests.pressure_gain(Valve(), oil, rows_at([-1e-5 * STROKE, 1e-5 * STROKE], t), effects)
        gain.append(np.ptp(pressure["load_pressure"]) / 2e-5 / SUPPLY)
    print(f"{cst:g} cSt: leakage {leakage[0]:.5f}/{leakage[1]:.5f} l/min, K_PX {gain[0]:.3f}/{gain[1]:.3f}")
    expected = INDEPENDENT[cst]
    # Five decimals are given; the one at 100 cSt, THM (.09540 against .095393) is off by one in the last.
    assert leakage == pytest.approx(expected[:2], abs=0.8e-5)
    assert gain == pytest.approx((33.851, expected[2]), abs=0.8e-3)


@pytest.mark.parametrize(("oil_of", "tolerance"), [(incompressible, 1e-13), (lambda oil: oil, 4e-3)])
def test_port_pressures_of_a_matched_valve_add_up_to_supply_plus_return(oil_of, tolerance):
    x = np.linspace(-STROKE, STROKE, 101)
    for t in (253.15, 313.15, 343.15):
        p = static_tests.pressure_gain(Valve(), oil_of(seed_oil()), rows_at(x, t, 210 * BAR))
        total = (p["pressure_a"] + p["pressure_b"]) / (210 * BAR)
        assert np.abs(total - 1.0).max() < tolerance


@pytest.mark.parametrize(("oil_of", "tolerance"), [(incompressible, 1e-7), (lambda oil: oil, 2e-4)])
def test_pressure_gain_at_null_is_the_gap_law(oil_of, tolerance):
    v, step = Valve(), 1e-9
    offset = v.clearance + 2.0 * v.edge_radius
    diagonal = np.hypot(v.underlap, offset)
    expected = 2.0 * 210 * BAR * (v.underlap / diagonal) / (diagonal - 2.0 * v.edge_radius)
    for t in (253.15, 343.15):
        p = static_tests.pressure_gain(v, oil_of(seed_oil()), rows_at([-step, step], t, 210 * BAR))["load_pressure"]
        assert (p[1] - p[0]) / (2.0 * step) == pytest.approx(expected, rel=tolerance)


def test_pressure_gain_with_sharp_edges_peaks_where_underlap_equals_clearance():
    underlap = np.linspace(0.2, 4.0, 1901) * 2 * UM
    v = Valve(edge_radius=0.0, clearance=2 * UM, underlap=underlap)
    step = 1e-9
    full = lambda x: static_tests.pressure_gain(v, incompressible(seed_oil()), rows_at(np.full(1901, x), 313.15))
    slope = (full(step)["load_pressure"] - full(-step)["load_pressure"]) / (2.0 * step)
    assert underlap[np.argmax(slope)] == pytest.approx(2 * UM, abs=2e-9)


def test_null_leakage_over_viscosity_collapses_to_one_curve():
    """Q/(w nu) = F(h sqrt(dp/rho)/nu): pairs of temperature and supply with the same group give the same number."""
    oil, v = incompressible(seed_oil()), Valve()
    numbers = []
    for t in (273.15, 303.15, 343.15):
        nu, rho = oil.nu0(t), oil.rho(0.0, t)
        supply = 2.0 * rho * (0.8 * nu / (10 * UM)) ** 2
        flow = static_tests.leakage(v, oil, rows_at(np.linspace(-14, 14, 9) * UM, t, float(supply)))["leakage_flow"]
        numbers.append(flow / (v.slot_width * nu))
    np.testing.assert_allclose(numbers[1:], [numbers[0]] * 2, rtol=1e-12)


def test_adiabatic_return_temperature_does_not_depend_on_position():
    x = np.linspace(-STROKE, STROKE, 41)
    # The share grows with the supply: a stage's properties are those of its own temperature and mean pressure.
    for supply, share in ((70 * BAR, 2e-3), (210 * BAR, 6e-3)):
        plant, state = static_tests.blocked_state(Valve(), seed_oil(), rows_at(x, 313.15, supply), THM)
        rise = state.return_temperature - plant.ts
        print(f"{supply / BAR:g} bar: rise {rise.min():.4f} to {rise.max():.4f} K")
        assert np.ptp(rise) < share * rise.mean()


def test_leakage_peaks_at_null_and_rises_with_temperature():
    x = np.linspace(-STROKE, STROKE, 201)
    peaks = []
    for t in (273.15, 313.15, 343.15):
        flow = static_tests.leakage(Valve(), seed_oil(), rows_at(x, t))["leakage_flow"]
        assert np.argmax(flow) == 100
        peaks.append(flow[100])
    assert peaks == sorted(peaks)


def test_balance_keeps_small_drops_deep_in_the_overlap():
    """A land behind a wide-open edge takes all but a millionth of the supply; the flow is nearly the land's alone."""
    v = Valve(underlap=-100 * UM, clearance=1 * UM)
    t = 313.15
    oil = incompressible(seed_oil())
    _, state = static_tests.blocked_state(v, oil, rows_at([STROKE - 1 * UM], t, 210 * BAR))
    length = 100 * UM + STROKE - 1 * UM
    land = oil.rho(0.0, t) * v.slot_width * v.clearance**3 * 210 * BAR / (12.0 * oil.mu(0.0, t) * length)
    assert 1.0 - state.p_a[0] / (210 * BAR) < 1e-6
    assert state.return_flow[0] == pytest.approx(2.0 * land, rel=1e-2)
    assert np.abs(np.array(state.imbalance)).max() < 1e-13
