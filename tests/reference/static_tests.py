"""The four static tests: what the bench reads at its rows."""

import numpy as np

from reference.balance import PortState, blocked, connected, solve_ports
from reference.imposed_load import solve_imposed
from reference.oil import T40, Oil
from reference.valve import Effects, Plant, Rows, Valve, plant_of


IDEAL = Effects()


def leakage(valve: Valve, oil: Oil, rows: Rows, effects: Effects = IDEAL) -> dict[str, np.ndarray]:
    """Blocked ports: {"leakage_flow": return flow [m3/s], volume at return conditions}."""
    plant = plant_of(valve, effects, oil, rows)
    state = solve_ports(plant, blocked, 2)
    flow = state.return_flow / plant.oil.rho(plant.pt, state.return_temperature)
    drop = plant.ps - plant.pt
    ratio = plant.oil.mu(0.0, np.asarray(T40)) / plant.oil.mu(0.0, plant.ts)
    flow = flow + effects.pilot_leakage * np.sqrt(drop) + effects.bushing_leakage * drop * ratio
    return {"leakage_flow": read_flow(flow, rows, effects)}


def pressure_gain(valve: Valve, oil: Oil, rows: Rows, effects: Effects = IDEAL) -> dict[str, np.ndarray]:
    """Blocked ports: {"load_pressure": p_A - p_B, "pressure_a", "pressure_b"} [Pa]; the offset is the first one's."""
    state = solve_ports(plant_of(valve, effects, oil, rows), blocked, 2)
    scale = 1.0 + np.asarray(effects.load_pressure_scale)
    return {
        "load_pressure": state.load_drop * scale + effects.pressure_offset,
        "pressure_a": state.p_a * scale,
        "pressure_b": state.p_b * scale,
    }


def flow_gain(valve: Valve, oil: Oil, rows: Rows, effects: Effects = IDEAL) -> dict[str, np.ndarray]:
    """Connected ports: {"flow": m(P-A) - m(A-T) as a volume [m3/s] at the ports' pressure and temperature}."""
    plant = plant_of(valve, effects, oil, rows)
    state = solve_ports(plant, connected, 1)
    return {"flow": read_flow(state.load_flow / plant.oil.rho(state.p_a, state.t_a), rows, effects)}


def load_flow(valve: Valve, oil: Oil, rows: Rows, effects: Effects = IDEAL) -> dict[str, np.ndarray]:
    """Load pressure imposed by `rows.load_pressure`: {"flow": load flow [m3/s] from A to B}.

    Volume at the mean of p_A and p_B, at the temperature of the port that the flow leaves. The imposed load pressure is
    what the differential gauge reads, so the true one is that minus `pressure_offset`, over 1 + `load_pressure_scale`.
    """
    if rows.load_pressure is None:
        raise ValueError("the load-flow test needs the imposed load pressure of every row")
    plant = plant_of(valve, effects, oil, rows)
    load = np.broadcast_to(rows.load_pressure, plant.x.shape) - effects.pressure_offset
    load = load / (1.0 + np.asarray(effects.load_pressure_scale))
    state = solve_imposed(plant, load)
    leaving = np.where(state.load_flow > 0.0, state.t_a, state.t_b)
    volume = state.load_flow / plant.oil.rho(0.5 * (state.p_a + state.p_b), leaving)
    return {"flow": read_flow(volume, rows, effects)}


def blocked_state(valve: Valve, oil: Oil, rows: Rows, effects: Effects = IDEAL) -> tuple[Plant, PortState]:
    """Everything about the blocked-port balance, for tests that look behind the readings."""
    plant = plant_of(valve, effects, oil, rows)
    return plant, solve_ports(plant, blocked, 2)


def read_flow(flow: np.ndarray, rows: Rows, effects: Effects) -> np.ndarray:
    """What a flowmeter shows: lag along each run, then scale, then offset."""
    if np.any(effects.flowmeter_lag):
        if rows.time is None:
            raise ValueError("a flowmeter's lag needs the time of every row")
        flow = lagged(flow, rows.time, rows.run, float(effects.flowmeter_lag))
    return flow * (1.0 + np.asarray(effects.flowmeter_scale)) + effects.flowmeter_offset


def lagged(flow: np.ndarray, time: np.ndarray, run: np.ndarray | None, tau: float) -> np.ndarray:
    """tau dr/dt = flow - r, exact for a flow that is linear between rows; every run starts steady."""
    read = np.array(flow, dtype=float)
    codes = np.zeros(read.size) if run is None else np.asarray(run)
    for i in range(1, read.size):
        if codes[i] != codes[i - 1]:
            continue
        z = (time[i] - time[i - 1]) / tau
        if z > 0.0:
            # Steady response to a ramp trails it by tau times its slope; what is left of the start decays.
            trail = (flow[i] - flow[i - 1]) / z
            read[i] = flow[i] - trail + (read[i - 1] - flow[i - 1] + trail) * np.exp(-z)
        else:
            read[i] = read[i - 1]
    return read


TESTS = {"leakage": leakage, "pressure_gain": pressure_gain, "flow_gain": flow_gain, "load_flow": load_flow}
READING = {"leakage": "leakage_flow", "pressure_gain": "load_pressure", "flow_gain": "flow", "load_flow": "flow"}
