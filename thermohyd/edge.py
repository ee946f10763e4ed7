"""One metering edge: a rounded edge with radial clearance, laminar to turbulent, open to overlapped (MODEL section 3).

The law is one smooth expression, finite with finite derivatives at zero pressure drop, at zero opening and deep in the
overlap. Where the opening u changes sign the land length max(-u, 0) starts, so dG/du has a jump there; automatic
differentiation returns the mean of the two sides, as a central difference does.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .oil import OilAtTemperature, density_at, viscosity_at


class MeteringEdge(eqx.Module):
    """The geometry and the flow coefficients of an edge; fields broadcast against the openings.

    slot_width w, radius r, clearance c, underlap U [m]; discharge_coefficient C_qmax and transition_number lambda_c [-].
    U is the opening between the arc centres with the spool at null: a lap between the virtual sharp edges, as drawings
    give it, differs by 2 r. The optional fields belong to effects; None means absent, and absent computes nothing.
    """

    slot_width: Float[Array, "..."]
    radius: Float[Array, "..."]
    clearance: Float[Array, "..."]
    underlap: Float[Array, "..."]
    discharge_coefficient: Float[Array, "..."]
    transition_number: Float[Array, "..."]
    # Flow of an overlapped land relative to that of a concentric one.
    land_factor: Float[Array, "..."] | None = None
    # Leakage over the lands between the slots, parallel to the edge: G = k c^3 / (12 mu), k [-].
    land_leakage: Float[Array, "..."] | None = None
    # Growth of the clearance with the edge's mean pressure [m/Pa].
    clearance_per_pressure: Float[Array, "..."] | None = None


def tanhc(y: Float[Array, "..."]) -> Float[Array, "..."]:
    """tanh(sqrt y)/sqrt y for y >= 0: 1 at zero, 1/sqrt y far out, smooth in between.

    Below y = 0.02 the Taylor series in y, whose first omitted term is under 1e-17: sqrt y has no derivative at zero.
    """
    small = y < 0.02
    s = jnp.sqrt(jnp.where(small, 1.0, y))
    z = jnp.where(small, y, 0.0)
    # Coefficients of tanh x = x - x^3/3 + 2 x^5/15 - 17 x^7/315 + ...
    series = 1.0 + z * (
        -1 / 3
        + z
        * (
            2 / 15
            + z
            * (-17 / 315 + z * (62 / 2835 + z * (-1382 / 155925 + z * (21844 / 6081075 + z * (-929569 / 638512875)))))
        )
    )
    return jnp.where(small, series, jnp.tanh(s) / s)


def gap(
    opening: Float[Array, "..."], clearance: Float[Array, "..."], radius: Float[Array, "..."]
) -> Float[Array, "..."]:
    """h(u) = sqrt(max(u, 0)^2 + (c + 2r)^2) - 2r [m], the shortest distance between the rounded edges."""
    return jnp.sqrt(jnp.square(jnp.maximum(opening, 0.0)) + jnp.square(clearance + 2.0 * radius)) - 2.0 * radius


def conductance(
    edge: MeteringEdge,
    opening: Float[Array, "..."],
    oil: OilAtTemperature,
    drop: Float[Array, "..."],
    mean_pressure: Float[Array, "..."],
    rho: Float[Array, "..."],
) -> Float[Array, "..."]:
    """Volume flow per pressure drop, Q = G dp [m3/(s Pa)], of an orifice in series with its overlapped land.

    opening u [m]; drop dp [Pa], of either sign; rho [kg/m3] at the upstream temperature and the mean pressure.
    C_q = C_qmax tanh(2 lambda/lambda_c) with lambda = (2h/nu) sqrt(2|dp|/rho), written so that it is linear in |dp|:
    y = (2 lambda/lambda_c)^2 = 32 h^2 rho |dp| / (mu lambda_c)^2, as nu = mu/rho.
    """
    mu = viscosity_at(oil, mean_pressure)
    c = edge.clearance
    if edge.clearance_per_pressure is not None:
        c = c + edge.clearance_per_pressure * mean_pressure
    h2 = jnp.square(gap(opening, c, edge.radius))
    y = 32.0 * h2 / jnp.square(edge.transition_number * mu) * rho * jnp.abs(drop)
    orifice = 8.0 * edge.discharge_coefficient * edge.slot_width * h2 / edge.transition_number * tanhc(y)  # times 1/mu
    resistance = 12.0 * jnp.maximum(-opening, 0.0) / (edge.slot_width * c**3)  # of the land, times mu
    if edge.land_factor is not None:
        resistance = resistance / edge.land_factor
    total = orifice / (1.0 + orifice * resistance)
    if edge.land_leakage is not None:
        total = total + edge.land_leakage * c**3 / 12.0
    return total / mu


def mass_flow(
    edge: MeteringEdge,
    opening: Float[Array, "..."],
    oil: OilAtTemperature,
    drop: Float[Array, "..."],
    mean_pressure: Float[Array, "..."],
) -> Float[Array, "..."]:
    """Mass flow through an edge [kg/s], positive along a positive drop; `oil` at the upstream temperature.

    The drop and the mean of both pressures are given, not the two pressures: near a fully open edge the drop is a small
    difference that subtracting pressures would lose.
    """
    rho = density_at(oil, mean_pressure)
    return rho * conductance(edge, opening, oil, drop, mean_pressure, rho) * drop
