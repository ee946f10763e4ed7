"""The position servo of dynamics_speed in CasADi symbols, for SUNDIALS' stiff solvers and their forward sensitivities.

The equations are those of tests/reference (adiabatic chambers, closed loop, no effects), in states of order 1, with the start
as a root of the same equations. Solvers are restarted where the setpoint bends, as SciPy's are.
"""

from collections.abc import Callable

import casadi as ca
import numpy as np
from reference.actuator import SIZES, Machine
from reference.oil import T0, Oil
from reference.step_test import bends


STATES = SIZES[:8]  # x, vx, pa, pb, ta, tb, z, v
READ = [0, 2, 3, 6, 7]
TURNOVERS = (1e9, 1e9, 100.0, 100.0)  # of pressures [Pa/s] and temperatures [K/s], to scale the imbalance at the start


class _Oil:
    """The oil's laws for symbols."""

    def __init__(self, oil: Oil):
        self.oil, self.stiffening = oil, 1.0 + float(oil.tait_slope)

    def modulus0(self, t):
        return self.oil.bulk_modulus * ca.exp(-self.oil.bulk_modulus_decay * (t - T0))

    def laws(self, p, t):
        """(rho, alpha, beta)."""
        o, k0, k1 = self.oil, self.modulus0(t), self.stiffening
        y = k1 * p / k0
        squeeze = 1.0 - ca.log1p(y) / k1
        thermal = 1.0 - o.expansion * (t - T0)
        alpha = o.expansion / thermal - o.bulk_modulus_decay * y / (k1 * (1.0 + y) * squeeze)
        return o.density * thermal / squeeze, alpha, k0 * (1.0 + y) * squeeze

    def mu(self, t):
        o = self.oil
        nu = (10.0 ** (10.0 ** (o.walther_a - o.walther_b * ca.log10(t))) - 0.7) * 1e-6
        return o.density * (1.0 - o.expansion * (t - T0)) * nu

    def cp(self, t):
        return self.oil.specific_heat + self.oil.specific_heat_slope * (t - T0)

    def rise(self, drop, mean, t):
        rho, alpha, _ = self.laws(mean, t)
        return (1.0 - alpha * t) / rho * drop / self.cp(t)


def _flow(valve, oil: _Oil, opening, p1, p2, t1, t2):
    """Mass flow of an edge from p1 to p2."""
    r, c, cq, transition = valve["edge_radius"], valve["clearance"], valve["discharge_coefficient"], valve["transition"]
    drop, mean = p1 - p2, 0.5 * (p1 + p2)
    t = ca.if_else(drop >= 0.0, t1, t2)
    rho, mu = oil.laws(mean, t)[0], oil.mu(t)
    size = ca.fmax(ca.fabs(drop), 1e-30)
    speed = ca.sqrt(2.0 * size / rho)
    h = ca.sqrt(ca.fmax(opening, 0.0) ** 2 + (c + 2.0 * r) ** 2) - 2.0 * r
    orifice = cq * ca.tanh(4.0 * h * rho / (mu * transition) * speed) * valve["width"] * h * speed / size
    land = ca.fmax(-opening, 0.0) * 12.0 * mu / (valve["width"] * c**3)
    return rho * drop / (1.0 / orifice + land)


def _rates(machine: Machine, state, setpoint, theta):
    """Rates of the state in SI units; theta scales the ten parameters of dynamics_speed, in its order."""
    v, j, d = machine.valve, machine.jack, machine.dynamic
    ps, pt, ts, fe = machine.surroundings(float(machine.run.time[0]))
    oil = _Oil(machine.oil)
    valve = {
        "edge_radius": v.edge_radius * theta[0], "clearance": v.clearance * theta[1], "width": v.slot_width,
        "discharge_coefficient": v.discharge_coefficient * theta[3], "transition": v.transition_number * theta[4],
    }  # fmt: skip
    x, vx, pa, pb, ta, tb, z, speed = (state[i] for i in range(8))
    u, open_ = v.underlap * theta[2], x - v.null_bias * theta[5]
    leak = oil.laws(0.5 * (pa + pb), ca.if_else(pa > pb, ta, tb))[0] * d.jack_leakage * (pa - pb)
    rates = []
    for side, p, t, own_leak, p_other, t_other in ((1.0, pa, ta, -leak, pb, tb), (-1.0, pb, tb, leak, pa, ta)):
        entering = _flow(valve, oil, u + side * open_, ps, p, ts, t)
        leaving = _flow(valve, oil, u - side * open_, p, pt, t, ts)
        rho, alpha, beta = oil.laws(p, t)
        beta = beta * j.bulk_modulus_factor * theta[8]
        volume = float(j.mid_volumes[0]) + side * float(j.areas[0]) * z
        squeeze = (entering - leaving + own_leak) / (rho * volume) - side * float(j.areas[0]) * speed / volume
        brought = 0.0
        for mass, origin, up in ((entering, ps, ts), (-leaving, pt, ts), (own_leak, p_other, t_other)):
            brought += ca.fmax(mass, 0.0) * (up + oil.rise(origin - p, 0.5 * (origin + p), up) - t)
        feed, k = brought / (rho * volume), alpha * t / (rho * oil.cp(t))
        dp = beta * (squeeze + alpha * feed) / (1.0 - beta * alpha * k)
        rates.append((dp, feed + k * dp))
    gain = j.stroke * j.amplifier_gain * j.sensor_gain / j.rated_current
    target = ca.fmin(ca.fmax(gain * (setpoint - z), -j.stroke), j.stroke)
    omega = 2.0 * np.pi * j.spool_frequency * theta[6]
    ax = omega**2 * (target - x) - 2.0 * j.spool_damping * theta[7] * omega * vx
    force = float(j.areas[0]) * (pa - pb) - j.viscous_friction * theta[9] * speed - fe
    (dpa, dta), (dpb, dtb) = rates
    return ca.vertcat(vx, ax, dpa, dpb, dta, dtb, speed, force / j.moving_mass)


def _start(machine: Machine, theta):
    """The equilibrium under the first setpoint as a function of theta, scaled."""
    ps, pt, ts, fe = machine.surroundings(float(machine.run.time[0]))
    j = machine.jack
    unknown, given = ca.SX.sym("unknown", 5), ca.SX.sym("theta", 10)
    first = float(machine.run.command[0])
    gain = j.stroke * j.amplifier_gain * j.sensor_gain / j.rated_current
    scaled = ca.vertcat(unknown[0], 0.0, unknown[1:5], (first - unknown[0] * STATES[0] / gain) / STATES[6], 0.0)
    rates = _rates(machine, scaled * STATES, first, given)
    unbalanced = ca.vertcat(rates[2:6] / ca.DM(TURNOVERS), rates[7])
    root = ca.rootfinder("start", "newton", {"x": unknown, "p": given, "g": unbalanced}, {"abstol": 1e-12})
    middle, half = 0.5 * (ps + pt), 0.5 * fe / float(j.areas[0])
    guess = np.array([machine.valve.null_bias, middle + half, middle - half, ts, ts]) / STATES[[0, 2, 3, 4, 5]]
    found = root(x0=guess, p=theta)["x"]
    return ca.Function("scaled", [unknown], [scaled])(found)


def casadi_runs(
    machine: Machine, solver: str, tolerance: float
) -> tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]]:
    """(theta -> readings (rows, 5), theta -> readings and their derivatives (rows, 5, 10)); solver "cvodes" or "idas"."""
    time, command = machine.run.time, machine.run.command
    state, theta, t, line = ca.SX.sym("x", 8), ca.SX.sym("theta", 10), ca.SX.sym("t"), ca.SX.sym("line", 2)
    ode = _rates(machine, state * STATES, line[0] + line[1] * t, theta) / STATES
    # The line that the setpoint follows between two rows; the solver starts anew where it changes.
    knots = np.concatenate([[time[0]], bends(machine), [time[-1]]])
    at = np.interp(knots, time, command)
    slopes = np.diff(at) / np.diff(knots)
    piece = np.clip(np.searchsorted(knots, 0.5 * (time[:-1] + time[1:])) - 1, 0, len(slopes) - 1)
    lines = np.stack([at[piece] - slopes[piece] * knots[piece], slopes[piece]])
    # Without the correction the same derivatives, to 2e-5, come four times faster.
    options = {"reltol": tolerance, "abstol": tolerance, "max_num_steps": 1_000_000, "second_order_correction": False}
    run = ca.integrator(
        "run", solver, {"x": state, "p": theta, "t": t, "u": line, "ode": ode}, time[0], time[1:], options
    )
    p = ca.MX.sym("p", 10)
    start = _start(machine, p)
    rows = ca.horzcat(start, run(x0=start, p=p, u=lines)["xf"])
    readings = ca.Function("readings", [p], [(rows * ca.repmat(ca.DM(STATES), 1, len(time)))[READ, :]])
    forward = readings.forward(10)

    def value(at: np.ndarray) -> np.ndarray:
        return np.asarray(readings(at)).T

    def derivatives(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = readings(at)
        # Directions lie side by side: (5, 10 rows).
        along = np.asarray(forward(at, found, np.eye(10)))
        return np.asarray(found).T, along.reshape(5, 10, len(time)).transpose(2, 0, 1)

    return value, derivatives
