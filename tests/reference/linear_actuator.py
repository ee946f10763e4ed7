"""The actuator's vector field at small motions, and its linearisation by central differences: the peer of the formulas.

Written from the dynamic model (docs/physics.md section 9), not from the appendix: chambers, piston, spool and loop, isothermal or
adiabatic, on the same edge law as the static tests.
"""

from dataclasses import dataclass, replace

import numpy as np

from reference.oil import Oil
from reference.static_tests import IDEAL, blocked_state
from reference.valve import Effects, Plant, Rows, Valve


# States, in this order, and the step of a central difference in each: small beside its range, large beside rounding.
STATES = ("x", "vx", "pa", "pb", "ta", "tb", "z", "v")
STEPS = np.array([2e-8, 1e-4, 2e3, 2e3, 1e-2, 1e-2, 1e-6, 1e-5])


@dataclass(frozen=True)
class Jack:
    """SI units; the names of a bench record's `[actuator]`. spool_frequency in Hz; the loop I = K_A K_p (z* - z)."""

    piston_area: float = 12e-4
    chamber_volume: float = 60e-6
    moving_mass: float = 50.0
    viscous_friction: float = 2000.0
    jack_leakage: float = 0.0
    spool_frequency: float = 100.0
    spool_damping: float = 0.7
    amplifier_gain: float = 0.01
    sensor_gain: float = 100.0
    rated_current: float = 25e-3
    stroke: float = 213e-6  # X_n of the valve


@dataclass(frozen=True)
class Bench:
    """Valve, oil, jack and conditions; `adiabatic`: chambers keep their heat (THM), else all is at the supply's (HM)."""

    valve: Valve
    oil: Oil
    jack: Jack
    temperature: float
    supply_pressure: float
    return_pressure: float = 0.0
    adiabatic: bool = False
    effects: Effects = IDEAL


def equilibrium(bench: Bench, position: float = 0.0) -> np.ndarray:
    """The state at null with the piston at rest at `position` [m]."""
    rows = Rows(*(np.array([v]) for v in (0.0, bench.supply_pressure, bench.return_pressure, bench.temperature)))
    effects = replace(bench.effects, throttle_heating=1.0 if bench.adiabatic else 0.0)
    _, ports = blocked_state(bench.valve, bench.oil, rows, effects)
    return np.array([0.0, 0.0, ports.p_a[0], ports.p_b[0], ports.t_a[0], ports.t_b[0], position, 0.0])


def rates(bench: Bench, state: np.ndarray, setpoint: float = 0.0, force: float = 0.0) -> np.ndarray:
    """d(state)/dt of the closed loop, near null: no flow runs backwards through an edge."""
    x, vx, pa, pb, ta, tb, z, v = state
    j, oil = bench.jack, bench.oil
    ps, pt, ts = bench.supply_pressure, bench.return_pressure, bench.temperature
    plant = Plant(bench.valve, bench.effects, oil, *(np.array([value]) for value in (x, ps, pt, ts)))
    current = j.amplifier_gain * j.sensor_gain * (setpoint - z)
    omega = 2.0 * np.pi * j.spool_frequency
    commanded = j.stroke * current / j.rated_current
    # Leakage across the piston: mass at the mean pressure and the upstream temperature.
    upstream = ta if pa > pb else tb
    leak = oil.rho(0.5 * (pa + pb), upstream) * j.jack_leakage * (pa - pb)

    def chamber(supply: str, back: str, p: float, t: float, leaking_in: float, other: tuple[float, float], sign: float):
        into = float(plant.edge(supply, ps - p, 0.5 * (ps + p), ts)[0])
        out = float(plant.edge(back, p - pt, 0.5 * (p + pt), t)[0])
        volume = j.chamber_volume + sign * j.piston_area * z
        rho, beta, alpha, cp = (float(f) for f in (oil.rho(p, t), oil.beta(p, t), oil.alpha(p, t), oil.cp(t)))
        squeeze = beta * ((into - out + leaking_in) / (rho * volume) - sign * j.piston_area * v / volume)
        if not bench.adiabatic:
            return squeeze, 0.0
        rise = float(oil.throttling_rise(ps - p, 0.5 * (ps + p), ts))
        brought = into * (ts + rise - t)
        if leaking_in > 0.0:
            p_from, t_from = other
            heat = float(oil.throttling_rise(p_from - p, 0.5 * (p + p_from), t_from))
            brought += leaking_in * (t_from + heat - t)
        # dp = squeeze + beta alpha dT, dT = warming + k dp: two linear equations.
        warming, k = brought / (rho * volume), alpha * t / (rho * cp)
        dp = (squeeze + beta * alpha * warming) / (1.0 - beta * alpha * k)
        return dp, warming + k * dp

    dpa, dta = chamber("PA", "AT", pa, ta, -leak, (pb, tb), 1.0)
    dpb, dtb = chamber("PB", "BT", pb, tb, leak, (pa, ta), -1.0)
    thrust = j.piston_area * (pa - pb) - j.viscous_friction * v - force
    spool = omega**2 * (commanded - x) - 2.0 * j.spool_damping * omega * vx
    return np.array([vx, spool, dpa, dpb, dta, dtb, v, thrust / j.moving_mass])


def jacobian(bench: Bench, position: float = 0.0) -> np.ndarray:
    """(8, 8): d(rates)/d(state) at null, fourth-order central differences."""
    at = equilibrium(bench, position)

    def slope(i: int) -> np.ndarray:
        step = np.eye(len(STATES))[i] * STEPS[i]
        near = rates(bench, at + step, position) - rates(bench, at - step, position)
        far = rates(bench, at + 2.0 * step, position) - rates(bench, at - 2.0 * step, position)
        return (8.0 * near - far) / (12.0 * STEPS[i])

    columns = np.stack([slope(i) for i in range(len(STATES))], axis=1)
    if not bench.adiabatic:
        # Temperatures that do not move are no states.
        columns[:, [STATES.index("ta"), STATES.index("tb")]] = 0.0
    return columns


def some(matrix: np.ndarray, rows: str, columns: str) -> np.ndarray:
    """The block of the named states, names separated by blanks."""
    pick = [[STATES.index(name) for name in names.split()] for names in (rows, columns)]
    return matrix[np.ix_(*pick)]
