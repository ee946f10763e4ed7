"""Step tests of the reference actuator: start in equilibrium, Radau between the rows where a column bends."""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from reference.actuator import SIZES, STATES, Machine


READINGS = ("spool_position", "pressure_a", "pressure_b", "piston_position", "piston_velocity")
COLUMNS = tuple(STATES.index(name) for name in ("x", "pa", "pb", "z", "v"))


def equilibrium(machine: Machine) -> np.ndarray:
    """The state at the start of a run."""
    j, run = machine.jack, machine.run
    t0 = run.time[0]
    ps, pt, ts, fe = machine.surroundings(t0)
    closed = run.kind == "setpoint"
    command = float(run.command[0])
    middle = 0.5 * (ps + pt)
    half = (fe - (j.areas[0] - j.areas[1]) * middle) / j.areas.sum()
    x = float(machine.valve.null_bias) if closed else machine.asked(command, 0.0)
    start = np.array([x, 0.0, middle + half, middle - half, ts, ts, 0.0, 0.0, x])
    free = [2, 3, *([4, 5] if machine.adiabatic else []), 0, *([] if closed else [7])]
    sizes = np.array([1e9, 1e9, 100.0, 100.0])

    def state_of(unknown: np.ndarray) -> np.ndarray:
        state = start.copy()
        state[free] = unknown * SIZES[free]
        return state

    def jet(state: np.ndarray) -> float:
        p, t = state[2:4], state[4:6] if machine.adiabatic else np.array([ts, ts])
        inside = machine.behind_lines(state[0], ps, pt, p, t, ts)
        return machine.jet_force(machine.edges(state[0], *inside, p, t, ts, ps))

    def unbalanced(unknown: np.ndarray) -> np.ndarray:
        state = state_of(unknown)
        rates = machine.rates(t0, state)
        parts = [*(rates[2:4] / sizes[:2]), *(rates[4:6] / sizes[2:] if machine.adiabatic else []), rates[7]]
        if not closed:
            asked = machine.asked(command, 0.0)
            parts.append((asked - machine.dynamic.flow_force * jet(state) - state[0]) / SIZES[0])
        return np.array(parts)

    found = root(unbalanced, start[free] / SIZES[free], tol=1e-14)
    assert np.max(np.abs(unbalanced(found.x))) < 1e-8, found.message
    state = state_of(found.x)
    if closed:
        asked = state[0] + machine.dynamic.flow_force * jet(state)
        state[6] = command - asked * j.rated_current / (j.stroke * j.amplifier_gain * j.sensor_gain)
        state[8] = asked
    else:
        state[8] = machine.asked(command, 0.0)
    return state


def bends(machine: Machine) -> np.ndarray:
    """Times inside the run at which a column changes its slope, the command's delayed."""
    run, delay = machine.run, machine.dynamic.spool_delay
    times = set()
    for column in (run.command, run.supply_pressure, run.return_pressure, run.temperature, run.external_force):
        slope = np.diff(column) / np.diff(run.time)
        shift = delay if column is run.command else 0.0
        changes = np.flatnonzero(np.abs(np.diff(slope)) > 1e-9 * max(np.max(np.abs(slope)), 1e-300)) + 1
        times |= {float(run.time[i] + shift) for i in changes}
        if shift and slope[0] != 0.0:
            times.add(float(run.time[0] + shift))
    return np.array(sorted(time for time in times if run.time[0] < time < run.time[-1]))


def simulate(machine: Machine, rtol: float = 1e-9, method: str = "Radau") -> np.ndarray:
    """(rows, states) at the rows' times."""
    time, state = machine.run.time, equilibrium(machine)
    edges = np.concatenate([[time[0]], bends(machine), [time[-1]]])
    out = np.empty((len(time), len(STATES)))
    out[0] = state
    for begin, end in pairwise(edges):
        rows = np.flatnonzero((time > begin) & (time <= end))
        at = np.append(time[rows], end) if not rows.size or time[rows[-1]] < end else time[rows]
        solved = solve_ivp(machine.rates, (begin, end), state, method, at, rtol=rtol, atol=rtol * SIZES)
        assert solved.success, solved.message
        out[rows], state = solved.y.T[: rows.size], solved.y[:, -1]
    return out


def readings(machine: Machine, rtol: float = 1e-9, method: str = "Radau") -> np.ndarray:
    """(rows, 5) in the order of READINGS."""
    return simulate(machine, rtol, method)[:, COLUMNS]
