"""The actuator in time in plain NumPy: docs/physics.md section 9 written out once more, one right-hand side for SciPy's solvers."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.optimize import root

from reference.edge import volume_flow
from reference.oil import T40, Array, Oil
from reference.static_tests import IDEAL
from reference.valve import Effects, Valve


P_ATM = 1.013e5
STATES = ("x", "vx", "pa", "pb", "ta", "tb", "z", "v", "y")
SIZES = np.array([1e-4, 0.1, 1e7, 1e7, 10.0, 10.0, 1e-3, 0.1, 1e-4])
# From the supply to A and B, from A and B to the return.
FROM_SUPPLY = np.array([1.0, 1.0, 0.0, 0.0])
OPENS = np.array([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Jack:
    """SI units, names of a bench record's `[actuator]`; the loop I = K_A K_p (z* - z). walls: (C_w, G_amb, T_amb) or None.

    An unequal jack: piston_area and chamber_volume None, and the pairs below in their place.
    """

    piston_area: float | None = 12e-4
    chamber_volume: float | None = 60e-6
    piston_stroke: float = 50e-3
    moving_mass: float = 50.0
    viscous_friction: float = 2000.0
    spool_frequency: float = 100.0
    spool_damping: float = 0.7
    bulk_modulus_factor: float = 1.0
    amplifier_gain: float = 0.01
    sensor_gain: float = 100.0
    rated_current: float = 25e-3
    stroke: float = 213e-6  # X_n of the valve
    polarity: int = 1
    piston_area_a: float | None = None
    piston_area_b: float | None = None
    chamber_volume_a: float | None = None
    chamber_volume_b: float | None = None

    @property
    def areas(self) -> np.ndarray:
        """S_a, S_b."""
        return both(self.piston_area, self.piston_area_a, self.piston_area_b)

    @property
    def mid_volumes(self) -> np.ndarray:
        """V_ta, V_tb."""
        return both(self.chamber_volume, self.chamber_volume_a, self.chamber_volume_b)


def both(shared: float | None, a: float | None, b: float | None) -> np.ndarray:
    assert (shared is None) == (a is not None) == (b is not None)
    return np.array([a, b] if shared is None else [shared, shared], dtype=float)


@dataclass(frozen=True)
class Dynamic:
    """The dynamic effects of docs/physics.md section 8.3 by name, the record's own friction and leakage included."""

    coulomb_friction: float = 0.0
    stribeck_friction: float = 0.0
    backlash: float = 0.0
    entrained_air: float = 0.0
    jack_leakage: float = 0.0
    flow_force: float = 0.0
    spool_delay: float = 0.0
    wall_heat: float = 0.0


@dataclass(frozen=True)
class Run:
    """Columns over time (rows,), SI; command by kind: "setpoint", "current" or "spool_position"."""

    kind: Literal["setpoint", "current", "spool_position"]
    time: np.ndarray
    command: np.ndarray
    supply_pressure: np.ndarray
    return_pressure: np.ndarray
    temperature: np.ndarray
    external_force: np.ndarray


@dataclass(frozen=True)
class Machine:
    """Valve, oil, jack, effects and whether the chambers keep their heat."""

    valve: Valve
    oil: Oil
    jack: Jack
    run: Run
    adiabatic: bool = True
    dynamic: Dynamic = field(default_factory=Dynamic)
    static: Effects = IDEAL

    @cached_property
    def true_oil(self) -> Oil:
        e, oil = self.static, self.oil
        return replace(
            oil,
            viscosity_factor=oil.viscosity_factor * (1.0 + e.viscosity_shift),
            pressure_viscosity=oil.pressure_viscosity + e.pressure_viscosity,
        )

    @cached_property
    def _around(self) -> list[tuple[float | None, np.ndarray]]:
        """(value where it never changes, column) of P_s, P_t, T_s, F_e."""
        r = self.run
        columns = [np.asarray(c) for c in (r.supply_pressure, r.return_pressure, r.temperature, r.external_force)]
        return [(float(c.flat[0]) if np.all(c == c.flat[0]) else None, c) for c in columns]

    def surroundings(self, t: float) -> tuple[float, float, float, float]:
        """P_s, P_t, true T_s, F_e."""
        ps, pt, ts, fe = (
            held if held is not None else float(np.interp(t, self.run.time, c)) for held, c in self._around
        )
        return ps, pt, ts + float(self.static.temperature_offset), fe

    def command(self, t: float) -> float:
        return float(np.interp(t - self.dynamic.spool_delay, self.run.time, self.run.command))

    def edges(
        self, x: float, ps: float, pt: float, p: np.ndarray, t: np.ndarray, ts: float, gauge: float | None = None
    ) -> dict[str, np.ndarray]:
        """The four edges P-A, P-B, A-T, B-T: mass, drop, mean pressure, upstream temperature, density, jet force.

        gauge: the supply pressure before any line, where that is not `ps`.
        """
        v, e, oil = self.valve, self.static, self.true_oil
        ahead = np.array([ps, ps, p[0], p[1]])
        behind = np.array([p[0], p[1], pt, pt])
        drop, mean = ahead - behind, 0.5 * (ahead + behind)
        warm = np.where(drop >= 0.0, np.array([ts, ts, t[0], t[1]]), np.array([t[0], t[1], ts, ts]))
        wear = np.where(FROM_SUPPLY > 0.0, e.supply_edge_wear, e.return_edge_wear)
        wear = wear + np.array([e.edge_wear_pa, e.edge_wear_pb, e.edge_wear_at, e.edge_wear_bt])
        null = v.null_bias + e.null_shift_temperature * (ts - T40)
        if np.any(e.null_shift_pressure):
            assert v.null_pressure is not None
            null = null + e.null_shift_pressure * ((ps if gauge is None else gauge) - v.null_pressure)
        opening = v.underlap + (1.0 - FROM_SUPPLY) * e.unequal_underlap + OPENS * (x - null)
        clearance = v.clearance + e.thermal_clearance * (ts - T40) + e.pressure_clearance * mean
        geometry = {
            "width": v.slot_width, "radius": v.edge_radius + wear, "clearance": clearance, "eccentricity": e.eccentricity,
            "discharge_coefficient": v.discharge_coefficient, "transition_number": v.transition_number,
            "edge_law": v.edge_law,
        }  # fmt: skip
        jet = volume_flow(opening, drop, mean, warm, oil, **geometry)
        flow = jet
        if np.any(e.land_leakage):
            flow = volume_flow(opening, drop, mean, warm, oil, **geometry, land_leakage=e.land_leakage)
        rho = oil.rho(mean, warm)
        force = OPENS * np.abs(jet) * np.sqrt(2.0 * rho * np.abs(drop))
        return {"mass": rho * flow, "drop": drop, "mean": mean, "warm": warm, "force": force}

    def behind_lines(self, x, ps, pt, p, t, ts) -> tuple[float, float]:
        """Pressures at the edges, where lines and passages lose some: two implicit equations."""
        e, oil = self.static, self.true_oil
        if not (e.supply_droop or e.flow_saturation or e.return_back_pressure):
            return ps, pt

        def missing(z: np.ndarray) -> np.ndarray:
            at = self.edges(x, ps - z[0] * 1e6, pt + z[1] * 1e6, p, t, ts, ps)
            m, warm = at["mass"], ts
            if self.adiabatic and np.any(m[2:] > 0.0):
                left = t + oil.throttling_rise(at["drop"][2:], at["mean"][2:], t)
                out = np.maximum(m[2:], 0.0)
                warm = float((out * left).sum() / out.sum())
            qs, qt = m[:2].sum() / oil.rho(ps, ts), m[2:].sum() / oil.rho(pt, warm)
            lost = e.supply_droop * qs + e.flow_saturation * qs * abs(qs)
            gained = (e.flow_saturation + e.return_back_pressure) * qt * abs(qt)
            return np.array([lost, gained]) / 1e6 - z

        found = root(missing, np.zeros(2), tol=1e-13)
        assert np.max(np.abs(missing(found.x))) < 1e-9, found.message
        return ps - found.x[0] * 1e6, pt + found.x[1] * 1e6

    def rates(self, t: float, state: np.ndarray, command: float | None = None) -> np.ndarray:
        """d(state)/dt, states in the order of STATES."""
        x, vx, pa, pb, ta, tb, z, v, y = state
        j, d, oil = self.jack, self.dynamic, self.true_oil
        ps, pt, ts, fe = self.surroundings(t)
        p = np.array([pa, pb])
        warm = np.array([ta, tb]) if self.adiabatic else np.array([ts, ts])
        at_s, at_t = self.behind_lines(x, ps, pt, p, warm, ts)
        edges = self.edges(x, at_s, at_t, p, warm, ts, ps)
        m = edges["mass"]

        upstream = warm[0] if pa > pb else warm[1]
        thin = oil.mu(0.0, T40) / oil.mu(0.0, ts) if self.static.cross_port_leakage else 0.0
        leak = oil.rho(0.5 * (pa + pb), upstream) * (d.jack_leakage + self.static.cross_port_leakage * thin) * (pa - pb)
        into = np.array([m[0] - m[2] - leak, m[1] - m[3] + leak])

        side = np.array([1.0, -1.0])
        volume = j.mid_volumes + side * j.areas * z
        rho, alpha = oil.rho(p, warm), oil.alpha(p, warm)
        beta = self.modulus(p, warm)
        squeeze = into / (rho * volume) - side * j.areas * v / volume
        if self.adiabatic:
            # Each stream in: mass, the pressure and temperature that it leaves, throttled to the chamber's pressure.
            brought = np.zeros(2)
            for i, other in ((0, 1), (1, 0)):
                streams = ((m[i], at_s, ts), (-m[2 + i], at_t, ts), ((-leak, leak)[i], p[other], warm[other]))
                for mass, origin, t_up in streams:
                    if mass > 0.0:
                        rise = oil.throttling_rise(origin - p[i], 0.5 * (origin + p[i]), t_up)
                        brought[i] += mass * (t_up + rise - warm[i])
            cp = oil.cp(warm)
            heat = brought * cp + d.wall_heat * (ts - warm)
            # dp - beta alpha dT = beta squeeze and dT - (alpha T / (rho cp)) dp = heat/(rho V cp)
            k = alpha * warm / (rho * cp)
            feed = heat / (rho * volume * cp)
            dp = beta * (squeeze + alpha * feed) / (1.0 - beta * alpha * k)
            dt = feed + k * dp
        else:
            dp, dt = beta * squeeze, np.zeros(2)

        asked = self.asked(self.command(t) if command is None else command, z)
        held = np.clip(asked - y, -0.5 * d.backlash, 0.5 * d.backlash)
        target = asked - held - d.flow_force * self.jet_force(edges)
        omega = 2.0 * np.pi * j.spool_frequency
        ax = omega**2 * (target - x) - 2.0 * j.spool_damping * omega * vx
        thrust = j.areas[0] * pa - j.areas[1] * pb - j.viscous_friction * v - fe - self.friction(v) - self.stops(z, v)
        return np.array([vx, ax, *dp, *dt, v, thrust / j.moving_mass, (asked - y - held) / 1e-4])

    def modulus(self, p: np.ndarray, t: np.ndarray) -> np.ndarray:
        beta = self.true_oil.beta(p, t) * self.jack.bulk_modulus_factor
        phi = self.dynamic.entrained_air
        if not phi:
            return beta
        absolute = p + P_ATM
        g = phi * (P_ATM / absolute) ** (1.0 / 1.4)
        return 1.0 / (((1.0 - phi) / beta + g / (1.4 * absolute)) / (1.0 - phi + g))

    def asked(self, command: float, z: float) -> float:
        j = self.jack
        if self.run.kind == "setpoint":
            command = j.stroke * j.amplifier_gain * j.sensor_gain * (command - z) / j.rated_current
        elif self.run.kind == "current":
            command = j.polarity * j.stroke * command / j.rated_current
        return float(np.clip(command, -j.stroke, j.stroke))

    def jet_force(self, edges: dict[str, np.ndarray]) -> float:
        return float(np.cos(np.deg2rad(69.0)) * edges["force"].sum())

    def friction(self, v: float) -> float:
        d = self.dynamic
        return (d.coulomb_friction + d.stribeck_friction * np.exp(-((v / 0.01) ** 2))) * np.tanh(v / 1e-3)

    def stops(self, z: float, v: float) -> float:
        half = 0.5 * self.jack.piston_stroke
        if abs(z) <= half:
            return 0.0
        side, depth = np.sign(z), abs(z) - half
        return float(side * max(1e8 * depth + 1e5 * min(depth / 1e-5, 1.0) * side * v, 0.0))


def volumes(machine: Machine, z: Array) -> tuple[np.ndarray, np.ndarray]:
    (s_a, s_b), (v_a, v_b) = machine.jack.areas, machine.jack.mid_volumes
    return np.asarray(v_a + s_a * z), np.asarray(v_b - s_b * z)
