"""The four-edge valve: its parameters, what separates a bench from it, and the four edge flows at given pressures."""

from dataclasses import dataclass, fields, replace

import numpy as np

from reference.edge import volume_flow
from reference.oil import T40, Array, Oil


@dataclass(frozen=True)
class Valve:
    """Geometry and the six identified parameters (SI), numbers or one entry per row. Default: the seed valve.

    edge_law: "orifice" or "lubrication", which has no transition number.
    """

    slot_width: Array = 12e-3
    edge_radius: Array = 15e-6
    clearance: Array = 2e-6
    underlap: Array = 15e-6
    discharge_coefficient: Array = 0.7
    transition_number: Array = 100.0
    null_bias: Array = 0.0
    null_pressure: Array | None = None  # supply pressure at which null_bias holds; None: that of the first row
    edge_law: str = "orifice"


@dataclass(frozen=True)
class Effects:
    """The effects of docs/physics.md section 8.2 by name; 0 switches one off exactly. `throttle_heating` is eta."""

    supply_edge_wear: Array = 0.0
    return_edge_wear: Array = 0.0
    edge_wear_pa: Array = 0.0
    edge_wear_pb: Array = 0.0
    edge_wear_at: Array = 0.0
    edge_wear_bt: Array = 0.0
    unequal_underlap: Array = 0.0
    eccentricity: Array = 0.0
    land_leakage: Array = 0.0
    null_shift_temperature: Array = 0.0
    null_shift_pressure: Array = 0.0
    thermal_clearance: Array = 0.0
    pressure_clearance: Array = 0.0
    flow_saturation: Array = 0.0
    supply_droop: Array = 0.0
    return_back_pressure: Array = 0.0
    throttle_heating: Array = 0.0
    pressure_viscosity: Array = 0.0
    viscosity_shift: Array = 0.0
    temperature_offset: Array = 0.0
    pilot_leakage: Array = 0.0
    bushing_leakage: Array = 0.0
    cross_port_leakage: Array = 0.0
    flowmeter_offset: Array = 0.0
    flowmeter_scale: Array = 0.0
    flowmeter_lag: Array = 0.0
    position_scale: Array = 0.0
    hysteresis: Array = 0.0
    position_lag: Array = 0.0
    pressure_offset: Array = 0.0
    load_pressure_scale: Array = 0.0


@dataclass(frozen=True)
class Rows:
    """Operating points as the bench reads them (SI, one entry per row).

    direction: +1 or -1, or None: found from the positions. load_pressure: p_A - p_B as imposed in load_flow.
    time and run matter to the flowmeter's lag only, rate (dx/dt as read, m/s) to the position's.
    """

    spool_position: np.ndarray
    supply_pressure: np.ndarray
    return_pressure: np.ndarray
    temperature: np.ndarray
    direction: np.ndarray | None = None
    time: np.ndarray | None = None
    run: np.ndarray | None = None
    load_pressure: np.ndarray | None = None
    rate: np.ndarray | None = None


@dataclass(frozen=True)
class Plant:
    """The valve at its rows' true states: every field is a number or has one entry per row.

    x: spool displacement from null; ps, pt: pressures at the bench's gauges; ts: supply temperature; oil: as it is.
    """

    valve: Valve
    effects: Effects
    oil: Oil
    x: np.ndarray
    ps: np.ndarray
    pt: np.ndarray
    ts: np.ndarray

    def take(self, keep: np.ndarray) -> "Plant":
        """The same plant at some of its rows."""

        def part(value):
            if isinstance(value, (Valve, Effects, Oil)):
                return replace(value, **{f.name: part(getattr(value, f.name)) for f in fields(value)})
            return value[keep] if np.ndim(value) else value

        return Plant(**{f.name: part(getattr(self, f.name)) for f in fields(self)})

    def edge(self, name: str, drop: Array, p_mean: Array, temperature: Array) -> np.ndarray:
        """Mass flow [kg/s] of edge "PA", "PB", "AT" or "BT", from its first letter to its second."""
        v, e = self.valve, self.effects
        wear, underlap = (
            (e.supply_edge_wear, v.underlap)
            if name[0] == "P"
            else (e.return_edge_wear, v.underlap + np.asarray(e.unequal_underlap))
        )
        opens_with_x = 1.0 if name in ("PA", "BT") else -1.0
        flow = volume_flow(
            underlap + opens_with_x * self.x,
            drop,
            p_mean,
            temperature,
            self.oil,
            width=v.slot_width,
            radius=v.edge_radius + np.asarray(wear) + np.asarray(getattr(e, f"edge_wear_{name.lower()}")),
            clearance=v.clearance
            + np.asarray(e.thermal_clearance) * (self.ts - T40)
            + np.asarray(e.pressure_clearance) * p_mean,
            discharge_coefficient=v.discharge_coefficient,
            transition_number=v.transition_number,
            eccentricity=e.eccentricity,
            land_leakage=e.land_leakage,
            edge_law=v.edge_law,
        )
        return self.oil.rho(p_mean, temperature) * flow

    def cross_flow(self, drop: Array, p_mean: Array, upstream_temperature: Array) -> np.ndarray:
        """Mass flow [kg/s] from A to B past the spool, drop = p_A - p_B."""
        ratio = self.oil.mu(0.0, np.asarray(T40)) / self.oil.mu(0.0, self.ts)
        return self.oil.rho(p_mean, upstream_temperature) * self.effects.cross_port_leakage * ratio * drop

    def heated(self, temperature: Array, drop: Array, p_mean: Array) -> np.ndarray:
        """Temperature [K] after a throttling stage that keeps the share eta of its heat."""
        eta = self.effects.throttle_heating
        if not np.any(eta):
            return np.asarray(temperature + 0.0 * drop)
        return temperature + eta * self.oil.throttling_rise(drop, p_mean, temperature)


def plant_of(valve: Valve, effects: Effects, oil: Oil, rows: Rows) -> Plant:
    """What the bench really does at its rows: true position, true temperature, true oil."""
    direction = rows.direction if rows.direction is not None else sweep_direction(rows.spool_position, rows.run)
    read = np.asarray(rows.spool_position, dtype=float)
    x = read * (1.0 + np.asarray(effects.position_scale)) - valve.null_bias
    x = x - 0.5 * np.asarray(effects.hysteresis) * direction
    if np.any(effects.position_lag):
        if rows.rate is None:
            raise ValueError("a lag of the position needs the rate of every row")
        x = x - np.asarray(effects.position_lag) * rows.rate
    true_oil = replace(
        oil,
        viscosity_factor=oil.viscosity_factor * (1.0 + np.asarray(effects.viscosity_shift)),
        pressure_viscosity=oil.pressure_viscosity + np.asarray(effects.pressure_viscosity),
    )
    x = x - np.asarray(effects.null_shift_temperature) * (rows.temperature + effects.temperature_offset - T40)
    stated = np.ravel(rows.supply_pressure)[0] if valve.null_pressure is None else valve.null_pressure
    x = x - np.asarray(effects.null_shift_pressure) * (rows.supply_pressure - stated)
    ps, pt, t = (np.broadcast_to(np.asarray(v, dtype=float), x.shape) for v in
                 (rows.supply_pressure, rows.return_pressure, rows.temperature))  # fmt: skip
    return Plant(valve, effects, true_oil, x, ps, pt, t + effects.temperature_offset)


def sweep_direction(position: np.ndarray, run: np.ndarray | None = None) -> np.ndarray:
    """Sign of the last change of position within a run; a repeated position keeps it; a start takes the first."""
    position = np.asarray(position, dtype=float)
    codes = np.zeros(position.size) if run is None else np.unique(np.asarray(run), return_inverse=True)[1]
    direction = np.ones(position.size)
    for code in np.unique(codes):
        rows = np.flatnonzero(codes == code)
        steps = np.sign(np.diff(position[rows]))
        moving = np.flatnonzero(steps)
        if moving.size:
            # Each row looks back to the last step that moved; rows before the first movement take the first.
            last = np.maximum.accumulate(np.where(steps != 0, np.arange(steps.size), -1))
            direction[rows[1:]] = steps[np.where(last < 0, moving[0], last)]
            direction[rows[0]] = steps[moving[0]]
    return direction
