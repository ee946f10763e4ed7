"""The load-flow test: p_A - p_B is imposed, load flow leaves port A and enters port B; the mean port pressure balances.

Conventions of docs/physics.md section 5 where flows may have either sign (a load pressure above the supply's):
every edge takes its oil at the upstream temperature; oil that comes back from the return line is at the supply's;
the load flow arrives at the sending port's temperature, without a throttling rise of its own.
"""

import numpy as np

from reference.balance import PortState, has_lines, line_losses
from reference.roots import bracketed_newton, damped_newton
from reference.valve import Plant


TEMPERATURE_SCALE = 10.0  # K, of a temperature equation's imbalance
HOTTEST = 100.0  # K above the supply, beyond which a port only circulates its own oil
SUBSTITUTIONS = 5


def imposed(plant: Plant, load: np.ndarray, mean: np.ndarray, t_a, t_b, ps, pt) -> PortState:
    """Flows at a mean port pressure and port temperatures; three imbalances: mass, and both temperatures."""
    ts = plant.ts
    p_a, p_b = mean + 0.5 * load, mean - 0.5 * load

    def edge(name, p1, p2, t1, t2):
        return plant.edge(name, p1 - p2, 0.5 * (p1 + p2), np.where(p1 >= p2, t1, t2))

    pa, pb = edge("PA", ps, p_a, ts, t_a), edge("PB", ps, p_b, ts, t_b)
    at, bt = edge("AT", p_a, pt, t_a, ts), edge("BT", p_b, pt, t_b, ts)
    cross = np.zeros_like(mean)
    if np.any(plant.effects.cross_port_leakage):
        cross = plant.cross_flow(load, mean, np.where(load > 0.0, t_a, t_b))
    load_flow = pa - at - cross  # leaves A, enters B: at the balance also bt - pb - cross
    plus = lambda m: np.maximum(m, 0.0)

    def mixed(streams):
        """Flow-weighted temperature of (mass flow in, temperature on arrival)."""
        total = sum(m for m, _ in streams)
        return np.where(total > 0.0, sum(m * t for m, t in streams) / np.where(total > 0.0, total, 1.0), ts)

    arrive = lambda t, p1, p2: plant.heated(t, p1 - p2, 0.5 * (p1 + p2))
    into_a = [
        (plus(pa), arrive(ts, ps, p_a)),
        (plus(-at), arrive(ts, pt, p_a)),
        (plus(-cross), arrive(t_b, p_b, p_a)),
        (plus(-load_flow), t_b),
    ]
    into_b = [
        (plus(pb), arrive(ts, ps, p_b)),
        (plus(-bt), arrive(ts, pt, p_b)),
        (plus(cross), arrive(t_a, p_a, p_b)),
        (plus(load_flow), t_a),
    ]
    t_return = mixed([(plus(at), arrive(t_a, p_a, pt)), (plus(bt), arrive(t_b, p_b, pt))])
    size = np.abs(pa) + np.abs(pb) + np.abs(at) + np.abs(bt)
    imbalance = (
        (pa + pb - at - bt) / size,
        (t_a - mixed(into_a)) / TEMPERATURE_SCALE,
        (t_b - mixed(into_b)) / TEMPERATURE_SCALE,
    )
    return PortState(p_a, p_b, t_a, t_b, imbalance, pa + pb, at + bt, t_return, load_flow, load)


def solve_imposed(plant: Plant, load: np.ndarray) -> PortState:
    """The balanced state under an imposed load pressure [Pa] per row, lines, heat and cross flow included.

    Raises ArithmeticError where oil that only circulates between the ports heats up without a limit (overlapped edges,
    eta near 1 and cross flow: the load returns what crossed over, and nothing cools it), or where the solve fails.
    """
    ts, span = plant.ts, plant.ps - plant.pt

    def at_gauges(mean: np.ndarray) -> PortState:
        return imposed(plant, load, mean, t_a, t_b, plant.ps, plant.pt)

    # At these ends both ports are below the return, or above the supply: every flow goes one way.
    low, high = plant.pt - 0.5 * np.abs(load), plant.ps + 0.5 * np.abs(load)
    heat, lines = bool(np.any(plant.effects.throttle_heating)), has_lines(plant)
    # Temperatures by substitution to start with: far from the balance Newton has no sense of which way they go.
    mean, t_a, t_b = 0.5 * (low + high), ts, ts
    for _ in range(SUBSTITUTIONS if heat else 1):
        mean = bracketed_newton(lambda m: at_gauges(m).imbalance[0], low, high, mean)
        state = at_gauges(mean)
        if heat:
            t_a = np.minimum(t_a - TEMPERATURE_SCALE * state.imbalance[1], ts + HOTTEST)
            t_b = np.minimum(t_b - TEMPERATURE_SCALE * state.imbalance[2], ts + HOTTEST)
    if not heat and not lines:
        return at_gauges(mean)

    def state_of(z: np.ndarray) -> PortState:
        t_a, t_b = (ts + TEMPERATURE_SCALE * z[1], ts + TEMPERATURE_SCALE * z[2]) if heat else (ts, ts)
        ps, pt = (plant.ps - z[-2] * span, plant.pt + z[-1] * span) if lines else (plant.ps, plant.pt)
        return imposed(plant, load, plant.pt + z[0] * span, t_a, t_b, ps, pt)

    def residual(z: np.ndarray) -> np.ndarray:
        state = state_of(z)
        rows = list(state.imbalance if heat else state.imbalance[:1])
        if lines:
            lost, gained = line_losses(plant, state.supply_flow, state.return_flow, state.return_temperature)
            rows += [z[-2] - lost / span, z[-1] - gained / span]
        return np.array(rows)

    def admissible(z: np.ndarray) -> np.ndarray:
        p = plant.pt + z[0] * span
        ok = (p >= low) & (p <= high)
        if heat:
            ok &= np.all(np.abs(z[1:3]) < HOTTEST / TEMPERATURE_SCALE, axis=0)
        return ok & (z[-2] + z[-1] < 0.999) if lines else ok

    unknowns = 1 + (2 if heat else 0) + (2 if lines else 0)
    start = np.zeros((unknowns, mean.size))
    start[0] = (mean - plant.pt) / span
    if heat:
        start[1], start[2] = (t_a - ts) / TEMPERATURE_SCALE, (t_b - ts) / TEMPERATURE_SCALE
    return state_of(damped_newton(residual, start, admissible))
