"""Blocked ports that store oil along a sweep: C dp/dt = Q_in - Q_out, integrated row by row."""

from dataclasses import fields, replace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import logit

from reference.balance import blocked, has_lines
from reference.oil import T40, Oil
from reference.static_tests import blocked_state, read_flow
from reference.valve import Effects, Rows, Valve, plant_of, sweep_direction


def _at(rows: Rows, before: int, row: int, share: float) -> Rows:
    """The operating point between two rows, with the direction of the motion that ends at the second."""
    linear = ("spool_position", "supply_pressure", "return_pressure", "temperature")
    own = {f.name: getattr(rows, f.name) for f in fields(rows)}
    cut = {name: None if column is None else column[row : row + 1] for name, column in own.items()}
    mixed = {n: np.atleast_1d((1.0 - share) * own[n][before] + share * own[n][row]) for n in linear}
    return Rows(**{**cut, **mixed})


def net_flows(valve: Valve, oil: Oil, effects: Effects, rows: Rows, p: np.ndarray) -> np.ndarray:
    """What flows into A and into B beyond what leaves [m3/s], at pressures p = (p_A, p_B) of one operating point."""
    plant = plant_of(valve, effects, oil, rows)
    ps, pt = plant.ps[0], plant.pt[0]
    warm = [plant.heated(plant.ts, ps - p[i], 0.5 * (ps + p[i])) for i in (0, 1)]
    cross = plant.cross_flow(p[0] - p[1], 0.5 * (p[0] + p[1]), warm[0] if p[0] > p[1] else warm[1])[0]
    found = []
    for i, (enter, leave) in enumerate((("PA", "AT"), ("PB", "BT"))):
        inflow = plant.edge(enter, ps - p[i], 0.5 * (ps + p[i]), plant.ts)[0]
        outflow = plant.edge(leave, p[i] - pt, 0.5 * (p[i] + pt), warm[i])[0]
        mass = inflow - outflow + (-cross if i == 0 else cross)
        found.append(mass / plant.oil.rho(p[i], warm[i][0]))
    return np.array(found)


def swept(
    valve: Valve, oil: Oil, rows: Rows, effects: Effects, compliance: tuple[float, float], tolerance: float = 1e-10
) -> dict[str, np.ndarray]:
    """{"leakage_flow", "supply_flow" [m3/s], "pressure_a", "pressure_b" [Pa]} of a sweep in time; C [m3/Pa] of A and B.

    A port without compliance is in balance at every moment, which needs ports that do not know of each other.
    """
    clock, run = rows.time, rows.run
    assert clock is not None
    assert run is not None
    if rows.direction is None:
        rows = replace(rows, direction=sweep_direction(rows.spool_position, run))
    plant, steady = blocked_state(valve, oil, rows, effects)
    assert not has_lines(plant)
    p = np.stack([steady.p_a, steady.p_b]).astype(float)
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
    q = logit((p - plant.pt) / (plant.ps - plant.pt))
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
