"""Effects that a valve or its bench may well have, but no library here holds: each wraps the ideal reference model."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np

from reference import static_tests
from reference.balance import blocked, connected, solve_ports
from reference.edge import gap
from reference.hidden_bench import CHANNELS, STROKE, Bench
from reference.oil import T40
from reference.valve import Effects, Plant, Rows, Valve, plant_of


SILTING_TIME = 60.0  # s, of a run, in which the silt settles
HUMP = 300.0  # flow number at which the discharge coefficient overshoots
WAVE = 80e-6  # m, period of the position transducer's error
NARROW_FROM = 0.6  # of the stroke, where the slots' corners begin

Readings = dict[tuple[str, str], np.ndarray]


@dataclass(frozen=True)
class OddPlant(Plant):
    """A plant whose edges are not all alike, or follow another law; `amount` as in `SENTENCES`."""

    amount: float = 0.0


@dataclass(frozen=True)
class DamagedPlant(OddPlant):
    """A nick rounds edge P-A alone."""

    def edge(self, name, drop, p_mean, temperature):
        worn = replace(self.valve, edge_radius=self.valve.edge_radius + (self.amount if name == "PA" else 0.0))
        return Plant.edge(replace(self, valve=worn), name, drop, p_mean, temperature)


@dataclass(frozen=True)
class OvershootingPlant(OddPlant):
    """Discharge coefficients overshoot around a flow number, as those of measured slits do before they settle."""

    def edge(self, name, drop, p_mean, temperature):
        v = self.valve
        opening = v.underlap + (1.0 if name in ("PA", "BT") else -1.0) * self.x
        rho = self.oil.rho(p_mean, temperature)
        nu = self.oil.mu(p_mean, temperature) / rho
        velocity = np.sqrt(2.0 * np.maximum(np.abs(drop), 1e-200) / rho)
        flow_number = 2.0 * gap(opening, v.clearance, v.edge_radius) / nu * velocity
        hump = np.exp(-((np.log(flow_number / HUMP) / 0.7) ** 2))
        humped = replace(v, discharge_coefficient=v.discharge_coefficient * (1.0 + self.amount * hump))
        return Plant.edge(replace(self, valve=humped), name, drop, p_mean, temperature)


PLANTS: dict[str, type[OddPlant]] = {"one_damaged_edge": DamagedPlant, "discharge_with_flow_number": OvershootingPlant}

SENTENCES = {
    "discharge_with_opening": "C_qmax (1 - a |x|/X_n): jets reattach as the slots open",
    "discharge_with_flow_number": "C_q overshoots by a share a around a flow number of 300",
    "one_damaged_edge": "radius of edge P-A alone: r + d",
    "flowmeter_saturates": "read Q (1 - a (Q/15 l/min)^2): the meter flattens at large flows",
    "position_waves": "true x = read x + a sin(2 pi x/80 um): the transducer's winding",
    "null_bias_with_temperature": "x0 + k (T - 40 degC): the body expands",
    "silting": "clearance falls by a share a within each run, with a time constant of 60 s",
    "gauge_curvature": "read dP (1 - a (dP/210 bar)^2): a tired diaphragm",
    "slot_narrows": "slots narrow by a share a from 60 % of the stroke to its end",
    "supply_gauge_gain": "true P_s = read P_s (1 + s)",
}


def _valve(kind: str, amount: float, valve: Valve, rows: Rows) -> Valve:
    """The valve row by row, where the hidden effect is a parameter that varies."""
    away = np.abs(rows.spool_position) / STROKE
    if kind == "discharge_with_opening":
        return replace(valve, discharge_coefficient=valve.discharge_coefficient * (1.0 - amount * away))
    if kind == "null_bias_with_temperature":
        return replace(valve, null_bias=valve.null_bias + amount * (rows.temperature - T40))
    if kind == "slot_narrows":
        share = np.clip((away - NARROW_FROM) / (1.0 - NARROW_FROM), 0.0, 1.0)
        return replace(valve, slot_width=valve.slot_width * (1.0 - amount * share))
    if kind == "silting":
        assert rows.time is not None
        return replace(valve, clearance=valve.clearance * (1.0 - amount * -np.expm1(-rows.time / SILTING_TIME)))
    return valve


def _rows(kind: str, amount: float, rows: Rows) -> Rows:
    """The true operating points, where an instrument of theirs is wrong."""
    if kind == "position_waves":
        x = rows.spool_position
        return replace(rows, spool_position=x + amount * np.sin(2.0 * np.pi * x / WAVE))
    if kind == "supply_gauge_gain":
        return replace(rows, supply_pressure=rows.supply_pressure * (1.0 + amount))
    return rows


def _read(kind: str, amount: float, channel: str, value: np.ndarray) -> np.ndarray:
    if kind == "flowmeter_saturates" and channel in ("flow", "leakage_flow"):
        return value * (1.0 - amount * (value * 6e4 / 15.0) ** 2)
    if kind == "gauge_curvature" and "pressure" in channel:
        return value * (1.0 - amount * (value / 210e5) ** 2)
    return value


def readings(bench: Bench, kind: str, amount: float) -> Readings:
    """Noise-free readings [SI] of `bench.rows` with an effect from outside, by (test, channel)."""
    found = {}
    for test, channels in CHANNELS.items():
        read = bench.rows(test)
        rows = _rows(kind, amount, read)
        valve = _valve(kind, amount, bench.valve, read)
        simulate: Callable[..., dict[str, np.ndarray]] = static_tests.TESTS[test]
        if kind in PLANTS:
            plain = plant_of(valve, Effects(), bench.oil, rows)
            parts = {f.name: getattr(plain, f.name) for f in fields(plain)}
            values = _solved(test, PLANTS[kind](**parts, amount=amount))
        else:
            values = simulate(valve, bench.oil, rows)
        for channel in channels:
            if channel in bench.noise:
                found[test, channel] = _read(kind, amount, channel, values[channel])
    return found


def _solved(test: str, plant: Plant) -> dict[str, np.ndarray]:
    """What `static_tests` reads of a plant whose edges are its own."""
    state = solve_ports(plant, *((connected, 1) if test == "flow_gain" else (blocked, 2)))
    if test == "flow_gain":
        return {"flow": state.load_flow / plant.oil.rho(state.p_a, state.t_a)}
    if test == "leakage":
        return {"leakage_flow": state.return_flow / plant.oil.rho(plant.pt, state.return_temperature)}
    return {"load_pressure": state.load_drop, "pressure_a": state.p_a, "pressure_b": state.p_b}
