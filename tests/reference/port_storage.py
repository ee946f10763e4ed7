"""Blocked ports that store oil along a sweep: C dp/dt = Q_in - Q_out, integrated row by row."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import identity
from scipy.special import logit

from reference.balance import blocked, has_lines
from reference.oil import T40, Oil
from reference.static_tests import blocked_state, read_flow
from reference.valve import Effects, Plant, Rows, Valve, plant_of, sweep_direction


def _at(rows: Rows, before: Any, row: Any, share: float) -> Rows:
    """The operating points between rows, each a number or (n,), with the direction of the motion that ends at the second."""
    linear = ("spool_position", "supply_pressure", "return_pressure", "temperature")
    own = {f.name: getattr(rows, f.name) for f in fields(rows)}
    cut = {name: None if column is None else np.atleast_1d(column[row]) for name, column in own.items()}
    mixed = {n: np.atleast_1d((1.0 - share) * own[n][before] + share * own[n][row]) for n in linear}
    return Rows(**{**cut, **mixed})


def net_flows(valve: Valve, oil: Oil, effects: Effects, rows: Rows, p: np.ndarray) -> np.ndarray:
    """What flows into A and into B beyond what leaves [m3/s], at pressures p (2,) of one operating point, or (2, rows)."""
    plant = plant_of(valve, effects, oil, rows)
    one = p.ndim == 1
    p = p[:, None] if one else p
    ps, pt = plant.ps, plant.pt
    warm = [plant.heated(plant.ts, ps - p[i], 0.5 * (ps + p[i])) for i in (0, 1)]
    cross = plant.cross_flow(p[0] - p[1], 0.5 * (p[0] + p[1]), np.where(p[0] > p[1], *warm))
    found = []
    for i, (enter, leave) in enumerate((("PA", "AT"), ("PB", "BT"))):
        inflow = plant.edge(enter, ps - p[i], 0.5 * (ps + p[i]), plant.ts)
        outflow = plant.edge(leave, p[i] - pt, 0.5 * (p[i] + pt), warm[i])
        mass = inflow - outflow + (-cross if i == 0 else cross)
        found.append(mass / plant.oil.rho(p[i], warm[i]))
    return np.array(found)[:, 0] if one else np.array(found)


def _started(
    valve: Valve, oil: Oil, rows: Rows, effects: Effects
) -> tuple[Rows, np.ndarray, np.ndarray, Plant, np.ndarray]:
    """The rows with directions, their times and runs, the plant, and the steady pressures (2, rows) of A and B."""
    clock, run = rows.time, rows.run
    assert clock is not None
    assert run is not None
    if rows.direction is None:
        rows = replace(rows, direction=sweep_direction(rows.spool_position, run))
    plant, steady = blocked_state(valve, oil, rows, effects)
    assert not has_lines(plant)
    return rows, clock, run, plant, np.stack([steady.p_a, steady.p_b]).astype(float)


def swept(
    valve: Valve, oil: Oil, rows: Rows, effects: Effects, compliance: tuple[float, float], tolerance: float = 1e-10
) -> dict[str, np.ndarray]:
    """{"leakage_flow", "supply_flow" [m3/s], "pressure_a", "pressure_b" [Pa]} of a sweep in time; C [m3/Pa] of A and B.

    A port without compliance is in balance at every moment, which needs ports that do not know of each other.
    """
    rows, clock, run, plant, p = _started(valve, oil, rows, effects)
    stores = np.flatnonzero(np.array(compliance) > 0.0)
    assert len(stores) == 2 or not np.any(effects.cross_port_leakage)
    c = np.array(compliance)[stores]
    for row in range(1, len(clock)):
        if run[row] != run[row - 1] or not len(stores):
            continue
        span = clock[row] - clock[row - 1]
        start = p[:, row - 1].copy()

        def rate(time: float, own: np.ndarray, row=row, span=span, start=start) -> np.ndarray:
            both = start.copy()
            both[stores] = own
            return net_flows(valve, oil, effects, _at(rows, row - 1, row, time / span), both)[stores] / c

        found = solve_ivp(rate, (0.0, span), start[stores], method="LSODA", rtol=tolerance, atol=tolerance * 1e5)
        p[stores, row] = found.y[:, -1]
    return _read(plant, rows, effects, p)


def swept_together(
    valve: Valve, oil: Oil, rows: Rows, effects: Effects, compliance: tuple[float, float], tolerance: float = 1e-5
) -> dict[str, np.ndarray]:
    """As `swept`, to 1e-4 of the largest reading and ten times as fast: all runs side by side, of equally many rows each. The ports do
    not know of each other."""
    rows, clock, run, plant, p = _started(valve, oil, rows, effects)
    assert not np.any(effects.cross_port_leakage)
    first = np.flatnonzero(np.diff(run, prepend=run[0] - 1))
    count = len(run) // len(first)
    assert np.array_equal(first, count * np.arange(len(first)))
    stores = np.flatnonzero(np.array(compliance) > 0.0)
    c = np.array(compliance)[stores, None]
    for row in first[:, None].T + np.arange(1, count)[:, None] if len(stores) else ():
        span, start = clock[row] - clock[row - 1], p[:, row - 1].copy()

        # Time as the share of each run's own step.
        def rate(share: float, own: np.ndarray, row=row, span=span, start=start) -> np.ndarray:
            both = start.copy()
            both[stores] = own.reshape(len(stores), -1)
            return (span * net_flows(valve, oil, effects, _at(rows, row - 1, row, share), both)[stores] / c).ravel()

        begin = start[stores].ravel()
        found = solve_ivp(rate, (0.0, 1.0), begin, method="Radau", rtol=tolerance, atol=tolerance * 1e5,
                          jac_sparsity=identity(begin.size))  # fmt: skip
        p[np.ix_(stores, row)] = found.y[:, -1].reshape(len(stores), -1)
    return _read(plant, rows, effects, p)


def _read(plant: Plant, rows: Rows, effects: Effects, p: np.ndarray) -> dict[str, np.ndarray]:
    """The readings at port pressures (2, rows)."""
    # Where a port lies at the supply's pressure, or the return's, the integration may end a pascal beyond.
    q = logit(np.clip((p - plant.pt) / (plant.ps - plant.pt), 1e-15, 1.0 - 1e-15))
    state = blocked(plant, q, plant.ps, plant.pt)
    drop = plant.ps - plant.pt
    ratio = plant.oil.mu(0.0, np.asarray(T40)) / plant.oil.mu(0.0, plant.ts)
    beside = effects.pilot_leakage * np.sqrt(drop) + effects.bushing_leakage * drop * ratio
    leaving = state.return_flow / plant.oil.rho(plant.pt, state.return_temperature)
    entering = state.supply_flow / plant.oil.rho(plant.ps, plant.ts)
    scale = 1.0 + np.asarray(effects.load_pressure_scale)
    return {
        "leakage_flow": read_flow(leaving + beside, rows, effects),
        "supply_flow": read_flow(entering + beside, rows, effects),
        "pressure_a": p[0] * scale,
        "pressure_b": p[1] * scale,
    }
