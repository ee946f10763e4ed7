"""One metering edge: a rounded edge with radial clearance, laminar to turbulent, open to overlapped (docs/physics.md section 3).

Two laws, one smooth expression each, finite with finite derivatives at zero pressure drop, at zero opening and deep in the
overlap. In the "orifice" law the land length max(-u, 0) starts where the opening u changes sign, so dG/du has a jump there;
automatic differentiation returns the mean of the two sides, as a central difference does. The "lubrication" law is smooth there.
"""

import math
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .film import film_resistance
from .oil import OilAtTemperature, density_at, viscosity_at


# An orifice in series with its overlapped land, or the viscous film between the edges in series with a velocity head.
EdgeLaw = Literal["orifice", "lubrication"]
EDGE_LAWS: tuple[EdgeLaw, ...] = ("orifice", "lubrication")


class MeteringEdge(eqx.Module):
    """The geometry and the flow coefficients of an edge; fields broadcast against the openings.

    slot_width w, radius r, clearance c, underlap U [m]; discharge_coefficient C_qmax and transition_number lambda_c [-].
    U is the opening between the arc centres with the spool at null: a lap between the virtual sharp edges, as drawings
    give it, differs by 2 r. The optional fields belong to effects; None means absent, and absent computes nothing.
    law: how drop and flow go together, a choice of the program and no number; "lubrication" knows no transition number.
    """

    slot_width: Float[Array, "..."]
    radius: Float[Array, "..."]
    clearance: Float[Array, "..."]
    underlap: Float[Array, "..."]
    discharge_coefficient: Float[Array, "..."]
    transition_number: Float[Array, "..."]
    # Flow of an overlapped land, in the lubrication law of the whole film, relative to that of a concentric one.
    land_factor: Float[Array, "..."] | None = None
    # Leakage over the lands between the slots, parallel to the edge: G = k c^3 / (12 mu), k [-].
    land_leakage: Float[Array, "..."] | None = None
    # Growth of the clearance with the edge's mean pressure [m/Pa].
    clearance_per_pressure: Float[Array, "..."] | None = None
    # Viscosity of the oil at this edge, relative to that of the oil at its pressure and temperature.
    viscosity_factor: Float[Array, "..."] | None = None
    law: EdgeLaw = eqx.field(static=True, default="orifice")


# S h^2 of a sharp slit: creeping flow through it is as if a film resisted by this (Happel and Brenner, section 4-29).
SLIT = 8.0 / (3.0 * math.pi)


# Coefficients of tanh x = x - x^3/3 + 2 x^5/15 - 17 x^7/315 + ..., and those of the derivative in y = x^2.
SERIES = (1.0, -1 / 3, 2 / 15, -17 / 315, 62 / 2835, -1382 / 155925, 21844 / 6081075, -929569 / 638512875)
SLOPES = tuple(i * c for i, c in enumerate(SERIES))[1:]
FEW = 0.02  # below it the first omitted term is under 1e-17, and the closed form of the slope would lose digits


def _polynomial(coefficients: tuple[float, ...], y: Float[Array, "..."]) -> Float[Array, "..."]:
    found = coefficients[-1] * y + coefficients[-2]
    for c in coefficients[-3::-1]:
        found = found * y + c
    return found


@jax.custom_jvp
def tanhc(y: Float[Array, "..."]) -> Float[Array, "..."]:
    """tanh(sqrt y)/sqrt y for y >= 0: 1 at zero, 1/sqrt y far out, smooth in between.

    Below y = 0.02 the Taylor series in y: sqrt y has no derivative at zero.
    """
    small = y < FEW
    s = jnp.sqrt(jnp.where(small, 1.0, y))
    return jnp.where(small, _polynomial(SERIES, jnp.where(small, y, 0.0)), jnp.tanh(s) / s)


@tanhc.defjvp
def _tanhc_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    """f' = (1 - tanh^2 - f)/(2 y): the rule's own derivatives are those of this, of any order. Every program of an edge differentiates
    f several times over, and a derivative of the series and of tanh each time was a tenth of it."""
    (y,) = primals
    found, small = tanhc(y), y < FEW
    there = jnp.where(small, 1.0, y)
    # Not 1 - y f^2, which loses the digits of f far out.
    above = (1.0 - jnp.square(jnp.tanh(jnp.sqrt(there))) - found) / (2.0 * there)
    slope = jnp.where(small, _polynomial(SLOPES, jnp.where(small, y, 0.0)), above)
    return found, slope * tangents[0]


def gap(
    opening: Float[Array, "..."], clearance: Float[Array, "..."], radius: Float[Array, "..."]
) -> Float[Array, "..."]:
    """h(u) = sqrt(max(u, 0)^2 + (c + 2r)^2) - 2r [m], the shortest distance between the rounded edges."""
    return jnp.sqrt(jnp.square(jnp.maximum(opening, 0.0)) + jnp.square(clearance + 2.0 * radius)) - 2.0 * radius


class Restriction(eqx.Module):
    """An edge at its openings: what of the conductance depends neither on the oil nor on the pressures.

    orifice 8 C_qmax w h^2/lambda_c [m3]; turbulence 32 h^2/lambda_c^2 [m2]; land 12 L/(w c^3) [1/m3]; parallel [m3].
    """

    orifice: Float[Array, "..."]
    turbulence: Float[Array, "..."]
    land: Float[Array, "..."]
    parallel: Float[Array, "..."] | None


class Film(eqx.Module):
    """The same of the lubrication law: viscous 12 J/w [1/m3]; inertia 2/(C_q w h)^2 [1/m4]; parallel [m3]."""

    viscous: Float[Array, "..."]
    inertia: Float[Array, "..."]
    parallel: Float[Array, "..."] | None


class OpenEdge(eqx.Module):
    """An edge at its openings u [m], ready for any pressures; `fixed` is None where the clearance follows the pressure."""

    edge: MeteringEdge
    opening: Float[Array, "..."]
    fixed: Restriction | Film | None


def _parallel(edge: MeteringEdge, clearance: Float[Array, "..."]) -> Float[Array, "..."] | None:
    return None if edge.land_leakage is None else edge.land_leakage * clearance**3 / 12.0


def _restriction(edge: MeteringEdge, opening: Float[Array, "..."], clearance: Float[Array, "..."]) -> Restriction:
    h2 = jnp.square(gap(opening, clearance, edge.radius))
    land = 12.0 * jnp.maximum(-opening, 0.0) / (edge.slot_width * clearance**3)
    return Restriction(
        orifice=8.0 * edge.discharge_coefficient * edge.slot_width * h2 / edge.transition_number,
        turbulence=32.0 * h2 / jnp.square(edge.transition_number),
        land=land if edge.land_factor is None else land / edge.land_factor,
        parallel=_parallel(edge, clearance),
    )


def _film(edge: MeteringEdge, opening: Float[Array, "..."], clearance: Float[Array, "..."]) -> Film:
    """The film between the arcs, I, or where they are too far apart to be one, creeping flow through a sharp slit,
    q = pi h^2 dp/(32 mu), as if I were S = 8/(3 pi h^2); J = (I^4 + S^4)^(1/4)."""
    h2 = jnp.square(gap(opening, clearance, edge.radius))
    film = film_resistance(opening, edge.radius, clearance)
    if edge.land_factor is not None:
        film = film / edge.land_factor
    slit = SLIT / h2
    # (I/S)^4 and not I^4 + S^4, whose eighth powers of micrometres a deep overlap would bring near the largest number.
    resistance = slit * jnp.sqrt(jnp.sqrt(1.0 + jnp.square(jnp.square(film / slit))))
    flow_area2 = jnp.square(edge.discharge_coefficient * edge.slot_width) * h2
    return Film(12.0 * resistance / edge.slot_width, 2.0 / flow_area2, _parallel(edge, clearance))


def _through(edge: MeteringEdge, opening: Float[Array, "..."], clearance: Float[Array, "..."]) -> Restriction | Film:
    return (_restriction if edge.law == "orifice" else _film)(edge, opening, clearance)


def at_opening(edge: MeteringEdge, opening: Float[Array, "..."]) -> OpenEdge:
    """The edge at openings u [m]; what no pressure changes is computed here, once, and not in every balance step."""
    fixed = _through(edge, opening, edge.clearance) if edge.clearance_per_pressure is None else None
    return OpenEdge(edge, opening, fixed)


def mass_flow(
    opened: OpenEdge, oil: OilAtTemperature, drop: Float[Array, "..."], mean_pressure: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Mass flow through an edge [kg/s], positive along a positive drop dp [Pa]; `oil` at the upstream temperature.

    The drop and the mean of both pressures are given, not the two pressures: near a fully open edge the drop is a small
    difference that subtracting pressures would lose. An orifice in series with its overlapped land, Q = G dp:
    C_q = C_qmax tanh(2 lambda/lambda_c) with lambda = (2h/nu) sqrt(2|dp|/rho), written so that it is linear in |dp|:
    y = (2 lambda/lambda_c)^2 = 32 h^2 rho |dp| / (mu lambda_c)^2, as nu = mu/rho.

    "lubrication", viscous loss and one velocity head: |dp| = a Q + b Q^2/4 with a = 12 mu J/w and b = 2 rho/(C_q w h)^2,
    solved as Q = 2 dp/(a + sqrt(a^2 + b |dp|)), which neither small drops nor thin oil cost a digit.
    """
    rho, mu = density_at(oil, mean_pressure), viscosity_at(oil, mean_pressure)
    if opened.edge.viscosity_factor is not None:
        mu = mu * opened.edge.viscosity_factor
    through = opened.fixed
    if through is None:
        assert opened.edge.clearance_per_pressure is not None
        through = _through(
            opened.edge, opened.opening, opened.edge.clearance + opened.edge.clearance_per_pressure * mean_pressure
        )
    if isinstance(through, Film):
        laminar = mu * through.viscous
        flow = 2.0 * drop / (laminar + jnp.sqrt(jnp.square(laminar) + rho * through.inertia * jnp.abs(drop)))
        if through.parallel is not None:
            flow = flow + through.parallel * drop / mu
        return rho * flow
    y = through.turbulence * rho * jnp.abs(drop) / jnp.square(mu)
    orifice = through.orifice * tanhc(y)
    total = orifice / (1.0 + orifice * through.land)  # G mu
    if through.parallel is not None:
        total = total + through.parallel
    return rho * total * drop / mu
