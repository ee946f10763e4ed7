"""One metering edge in its textbook form: flow number, flow coefficient, orifice in series with its overlapped land; or a
film by lubrication theory in series with one velocity head."""

import numpy as np

from reference.film import resistance
from reference.oil import Array, Oil


def gap(u: Array, c: Array, r: Array) -> np.ndarray:
    """h(u) [m]; u = opening between the arc centres, positive when open."""
    return np.hypot(np.maximum(u, 0.0), c + 2.0 * np.asarray(r)) - 2.0 * np.asarray(r)


def volume_flow(
    u: Array,
    drop: Array,
    p_mean: Array,
    temperature: Array,
    oil: Oil,
    *,
    width: Array,
    radius: Array,
    clearance: Array,
    discharge_coefficient: Array,
    transition_number: Array,
    eccentricity: Array = 0.0,
    land_leakage: Array = 0.0,
    edge_law: str = "orifice",
) -> np.ndarray:
    """Q [m3/s], of the sign of `drop`; oil at the upstream temperature and the mean pressure (docs/physics.md section 3).

    `drop` and `p_mean` come separately, so that a small drop is not lost in the difference of two large pressures.
    """
    rho = oil.rho(p_mean, temperature)
    mu = oil.mu(p_mean, temperature)
    nu = mu / rho
    # A drop of exactly zero has a finite conductance, but 0/0 in this form; the smallest normal drop has the same one.
    magnitude = np.maximum(np.abs(drop), 1e-200)
    velocity = np.sqrt(2.0 * magnitude / rho)
    h = gap(u, clearance, radius)
    land_factor = 1.0 + 1.5 * np.asarray(eccentricity) ** 2
    parallel = land_leakage * np.asarray(clearance) ** 3 / (12.0 * mu)
    if edge_law == "lubrication":
        # dp = viscous q + inertia q |q| per width
        viscous = 12.0 * mu * resistance(u, h, radius, clearance, land_factor)
        inertia = 0.5 * rho / (discharge_coefficient * h) ** 2
        q = 2.0 * drop / (viscous + np.sqrt(viscous**2 + 4.0 * inertia * np.abs(drop)))
        return width * q + parallel * drop
    flow_number = 2.0 * h / nu * velocity
    cq = discharge_coefficient * np.tanh(2.0 * flow_number / transition_number)
    g_orifice = cq * width * h * velocity / magnitude
    length = np.maximum(-np.asarray(u), 0.0)
    land_flow = width * np.asarray(clearance) ** 3 / (12.0 * mu) * land_factor
    # 1/G = 1/G_o + 1/G_l with G_l = land_flow/length, which an open edge (length 0) leaves at G_o.
    g = 1.0 / (1.0 / g_orifice + length / land_flow)
    return (g + parallel) * drop
