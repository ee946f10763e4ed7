"""Port pressures, line pressures and temperatures that balance the four edges, solved to rounding error.

A port's pressure is p = P_t + (P_s - P_t)/(1 + exp(-q)): both its drops, to supply and to return, follow from q without
subtraction, so a drop of 1e-6 of the supply keeps its digits. Lines between gauge and valve add two unknowns per row,
the relative losses (P_s, P_t seen by the edges against those of the gauges).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit

from reference.roots import bracketed_newton, damped_newton
from reference.valve import Plant


Q_LIMIT = 80.0  # of q: a drop of 1e-35 of the supply


@dataclass(frozen=True)
class PortState:
    """Flows and temperatures at given pressures; masses in kg/s, temperatures in K, pressures in Pa.

    imbalance: one entry per equation of the ports, zero at the balance, 1 when far away.
    supply_flow: mass from the supply; return_flow: mass to the return, at return_temperature.
    """

    p_a: np.ndarray
    p_b: np.ndarray
    t_a: np.ndarray
    t_b: np.ndarray
    imbalance: tuple[np.ndarray, ...]
    supply_flow: np.ndarray
    return_flow: np.ndarray
    return_temperature: np.ndarray
    load_flow: np.ndarray
    load_drop: np.ndarray  # p_A - p_B without loss of digits


Ports = Callable[[np.ndarray, np.ndarray, np.ndarray], PortState]


def blocked(plant: Plant, q: np.ndarray, ps: np.ndarray, pt: np.ndarray) -> PortState:
    """Both load ports closed: q has two rows, for A and B; each port's inflow equals its outflow."""
    span = ps - pt
    up = [span * expit(-q[i]) for i in (0, 1)]  # supply to port
    down = [span * expit(q[i]) for i in (0, 1)]  # port to return
    p_a, p_b = pt + down[0], pt + down[1]
    t_a = plant.heated(plant.ts, up[0], 0.5 * (ps + p_a))
    t_b = plant.heated(plant.ts, up[1], 0.5 * (ps + p_b))
    pa = plant.edge("PA", up[0], 0.5 * (ps + p_a), plant.ts)
    pb = plant.edge("PB", up[1], 0.5 * (ps + p_b), plant.ts)
    # The form of p_A - p_B with the smaller terms: it keeps its digits where both ports are near one end.
    drop = np.where(up[0] + up[1] < down[0] + down[1], up[1] - up[0], down[0] - down[1])
    cross = np.zeros_like(drop)
    if np.any(plant.effects.cross_port_leakage):
        mean = 0.5 * (p_a + p_b)
        cross = plant.cross_flow(drop, mean, np.where(drop > 0.0, t_a, t_b))
        # The sending port holds supply oil only; the receiving one mixes it with what crosses over.
        into_a, into_b = np.maximum(-cross, 0.0), np.maximum(cross, 0.0)
        new_a = (pa * t_a + into_a * plant.heated(t_b, -drop, mean)) / (pa + into_a)
        new_b = (pb * t_b + into_b * plant.heated(t_a, drop, mean)) / (pb + into_b)
        t_a, t_b = np.where(cross < 0.0, new_a, t_a), np.where(cross > 0.0, new_b, t_b)
    at = plant.edge("AT", down[0], 0.5 * (p_a + pt), t_a)
    bt = plant.edge("BT", down[1], 0.5 * (p_b + pt), t_b)
    out = at + bt
    t_return = (
        at * plant.heated(t_a, down[0], 0.5 * (p_a + pt)) + bt * plant.heated(t_b, down[1], 0.5 * (p_b + pt))
    ) / out
    imbalance = (
        np.log((pa + np.maximum(-cross, 0.0)) / (at + np.maximum(cross, 0.0))),
        np.log((pb + np.maximum(cross, 0.0)) / (bt + np.maximum(-cross, 0.0))),
    )
    return PortState(p_a, p_b, t_a, t_b, imbalance, pa + pb, out, t_return, np.zeros_like(out), drop)


def connected(plant: Plant, q: np.ndarray, ps: np.ndarray, pt: np.ndarray) -> PortState:
    """Both load ports joined without resistance: one q, one pressure, one temperature; load flow from A to B."""
    span = ps - pt
    up, down = span * expit(-q[0]), span * expit(q[0])
    p = pt + down
    high, low = 0.5 * (ps + p), 0.5 * (p + pt)
    t = plant.heated(plant.ts, up, high)
    pa, pb = plant.edge("PA", up, high, plant.ts), plant.edge("PB", up, high, plant.ts)
    at, bt = plant.edge("AT", down, low, t), plant.edge("BT", down, low, t)
    t_return = plant.heated(t, down, low)
    imbalance = (np.log((pa + pb) / (at + bt)),)
    return PortState(p, p, t, t, imbalance, pa + pb, at + bt, t_return, pa - at, np.zeros_like(p))


def line_losses(plant: Plant, supply_flow, return_flow, return_temperature) -> tuple[np.ndarray, np.ndarray]:
    """Pressure lost between the supply gauge and the edges, and gained between the return gauge and the edges [Pa].

    Volumes at the gauges; a reversed flow (possible under an imposed load pressure) reverses its loss.
    """
    e = plant.effects
    qs = supply_flow / plant.oil.rho(plant.ps, plant.ts)
    qt = return_flow / plant.oil.rho(plant.pt, return_temperature)
    lost = e.supply_droop * qs + e.flow_saturation * qs * np.abs(qs)
    gained = (np.asarray(e.flow_saturation) + e.return_back_pressure) * qt * np.abs(qt)
    return lost, gained


def has_lines(plant: Plant) -> bool:
    e = plant.effects
    return any(np.any(v) for v in (e.supply_droop, e.flow_saturation, e.return_back_pressure))


def solve_ports(plant: Plant, ports: Callable[..., PortState], unknowns: int) -> PortState:
    """The balanced state of `blocked` (2 unknowns) or `connected` (1), lines and cross flow included."""
    q = np.zeros((unknowns, plant.x.size))
    # Alone, a port's imbalance falls with its own q and a bracketed solve cannot fail; the coupled one starts there.
    alone = _without_coupling(plant)

    def own(q: np.ndarray) -> np.ndarray:
        return np.array(ports(alone, q, plant.ps, plant.pt).imbalance)

    q = bracketed_newton(own, q - Q_LIMIT, q + Q_LIMIT, q)
    lines = has_lines(plant)
    crossed = unknowns == 2 and np.any(plant.effects.cross_port_leakage)
    if not lines and not crossed:
        return ports(plant, q, plant.ps, plant.pt)
    span = plant.ps - plant.pt

    def pressures(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if not lines:
            return plant.ps, plant.pt
        return plant.ps - z[-2] * span, plant.pt + z[-1] * span

    def residual(z: np.ndarray) -> np.ndarray:
        ps, pt = pressures(z)
        state = ports(plant, z[:unknowns], ps, pt)
        if not lines:
            return np.array(state.imbalance)
        lost, gained = line_losses(plant, state.supply_flow, state.return_flow, state.return_temperature)
        return np.array([*state.imbalance, z[-2] - lost / span, z[-1] - gained / span])

    def admissible(z: np.ndarray) -> np.ndarray:
        ok = np.all(np.abs(z[:unknowns]) < Q_LIMIT, axis=0)
        return ok & (z[-2] + z[-1] < 0.999) if lines else ok

    start = np.vstack([q, np.zeros((2 if lines else 0, q.shape[1]))])
    z = damped_newton(residual, start, admissible)
    return ports(plant, z[:unknowns], *pressures(z))


def _without_coupling(plant: Plant) -> Plant:
    return replace(plant, effects=replace(plant.effects, cross_port_leakage=0.0))
