"""The ideal isothermal valve, written for speed: the fair NumPy peer of the speed benchmark.

Same equations as the rest of this package with every effect absent, but everything that depends on the row or the
parameters only is computed once, the slope of the balance is analytic, and a solve can start from the last one's roots,
as a careful NumPy user would write it. Unknown per port: q, with p = P_t + (P_s - P_t)/(1 + exp(-q)).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from reference.oil import Oil
from reference.valve import Rows


PARAMETERS = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
LONGEST_STEP = 3.0  # of q, in one Newton step


@dataclass(frozen=True)
class IsothermalRows:
    """Rows of one test with the oil evaluated at their temperatures: made once per record, used at every simulation."""

    x: np.ndarray
    span: np.ndarray  # P_s - P_t, Pa
    pt: np.ndarray
    mu: np.ndarray
    rho0: np.ndarray
    k1: float  # 1 + K'
    stiffness: np.ndarray  # k1/K0(T), 1/Pa
    rho_return: np.ndarray

    @classmethod
    def of(cls, rows: Rows, oil: Oil) -> "IsothermalRows":
        ps, pt, t, x = np.broadcast_arrays(rows.supply_pressure, rows.return_pressure, rows.temperature,
                                           rows.spool_position)  # fmt: skip
        if np.any(oil.pressure_viscosity):
            raise ValueError("the fast path has no pressure-viscosity")
        k1 = 1.0 + float(oil.tait_slope)
        k0 = oil.bulk_modulus * np.exp(-oil.bulk_modulus_decay * (t - 288.15))
        return cls(x, ps - pt, pt, oil.mu(0.0, t), oil.rho(0.0, t), k1, k1 / k0, oil.rho(pt, t))


@dataclass(frozen=True)
class Edge:
    """One edge over the rows: mass flow = rho G dp with G = a tanhc/(1 + a b tanhc), y = c2 rho |dp|."""

    a: np.ndarray
    b: np.ndarray
    c2: np.ndarray

    @classmethod
    def of(cls, opening: np.ndarray, width: float, p: np.ndarray, mu: np.ndarray) -> "Edge":
        r, c, _, cq, transition, _ = p
        h2 = (np.hypot(np.maximum(opening, 0.0), c + 2.0 * r) - 2.0 * r) ** 2
        return cls(
            8.0 * cq * width * h2 / (transition * mu),
            12.0 * mu * np.maximum(-opening, 0.0) / (width * c**3),
            32.0 * h2 / (transition * mu) ** 2,
        )

    def flow(self, drop: np.ndarray, rho: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mass flow [kg/s] and d ln(mass flow)/d ln(rho drop), for a drop above zero."""
        s = np.sqrt(self.c2 * rho * drop)
        th = np.tanh(s)
        orifice = self.a * th / s
        series = 1.0 / (1.0 + orifice * self.b)
        # d ln tanhc/d ln s = s (1 - tanh^2)/tanh - 1, half of it per ln(drop); the land takes its share of the drop.
        slope = 1.0 + 0.5 * (s * (1.0 - th * th) / th - 1.0) * series
        return rho * orifice * series * drop, slope


def _density(rows: IsothermalRows, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """rho [kg/m3] and d ln rho/dp [1/Pa], Tait."""
    y = rows.stiffness * p
    squeeze = 1.0 - np.log1p(y) / rows.k1
    return rows.rho0 / squeeze, rows.stiffness / (rows.k1 * (1.0 + y) * squeeze)


def _balance(
    rows: IsothermalRows, supply: list[Edge], back: list[Edge], q: np.ndarray, tolerance: float, max_steps: int
) -> np.ndarray:
    """Newton on ln(inflow/outflow) of a port that `supply` edges feed and `back` edges drain."""
    for _ in range(max_steps):
        share, rest = expit(q), expit(-q)
        down, up = rows.span * share, rows.span * rest
        rho_in, soft_in = _density(rows, rows.pt + down + 0.5 * up)
        rho_out, soft_out = _density(rows, rows.pt + 0.5 * down)
        m_in, gain_in = _total(supply, up, rho_in)
        m_out, gain_out = _total(back, down, rho_out)
        # ln(up), ln(down) and the mean pressures move by -share, rest and down rest/2 per q; the flow sees rho * drop.
        moved = 0.5 * down * rest
        slope = gain_in * (soft_in * moved - share) - gain_out * (soft_out * moved + rest)
        step = -np.log(m_in / m_out) / slope
        q = q + np.clip(step, -LONGEST_STEP, LONGEST_STEP)
        if np.abs(step).max() < tolerance:
            return q
    raise ArithmeticError(f"a port balance did not converge in {max_steps} Newton steps")


def _total(edges: list[Edge], drop: np.ndarray, rho: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mass flow of edges side by side, and its d ln/d ln(rho drop)."""
    if len(edges) == 1:
        return edges[0].flow(drop, rho)
    (m1, k1), (m2, k2) = (edge.flow(drop, rho) for edge in edges)
    total = m1 + m2
    return total, (m1 * k1 + m2 * k2) / total


def simulate(
    test: str,
    rows: IsothermalRows,
    width: float,
    parameters: np.ndarray,
    *,
    tolerance: float = 1e-6,
    start: np.ndarray | None = None,
    max_steps: int = 60,
) -> tuple[np.ndarray, np.ndarray]:
    """(reading in SI, roots) of "leakage", "pressure_gain" or "flow_gain"; parameters in the order of PARAMETERS.

    `start`: roots of an earlier call for the same rows. The solve stops when Newton's last step of q is below
    `tolerance`, which leaves an error of about its square. Raises ArithmeticError where it does not get there.
    """
    p = np.asarray(parameters, dtype=float)
    x, underlap = rows.x - p[5], p[2]
    if test == "flow_gain":
        with_x, against_x = (Edge.of(underlap + s * x, width, p, rows.mu) for s in (1.0, -1.0))
        edges = [with_x, against_x]
        q = _balance(rows, edges, edges, np.zeros(x.shape) if start is None else start, tolerance, max_steps)
        down, up = rows.span * expit(q), rows.span * expit(-q)
        inward = with_x.flow(up, _density(rows, rows.pt + down + 0.5 * up)[0])[0]
        outward = against_x.flow(down, _density(rows, rows.pt + 0.5 * down)[0])[0]
        return (inward - outward) / _density(rows, rows.pt + down)[0], q
    # Port B of a matched valve is port A with x reversed, so the two are the two rows of one array.
    both = np.stack([x, -x])
    supply, back = (Edge.of(underlap + s * both, width, p, rows.mu) for s in (1.0, -1.0))
    q = _balance(rows, [supply], [back], np.zeros(both.shape) if start is None else start, tolerance, max_steps)
    down, up = rows.span * expit(q), rows.span * expit(-q)
    if test == "pressure_gain":
        return np.where(up.sum(0) < down.sum(0), up[1] - up[0], down[0] - down[1]), q
    out = back.flow(down, _density(rows, rows.pt + 0.5 * down)[0])[0]
    return out.sum(axis=0) / rows.rho_return, q
