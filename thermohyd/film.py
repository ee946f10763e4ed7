"""How much an oil film between two rounded edges resists: I(u; r, c) of lubrication theory (docs/physics.md section 3.1).

    I = integral of ds/g(s)^3,  g(s) = c + rec(s + u/2) + rec(u/2 - s),  rec(d) = r - sqrt(r^2 - d^2) for 0 < d < r, else 0

along the gap, as far as both arcs reach; a flat land of length |u| where u < 0. Where one arc alone recedes the integral is a
closed form; where both do it is elliptic, and eleven Gauss nodes take it. Against adaptive quadrature, for c/r from 1e-4 to
30 and all openings, the error is below 1e-11 of I, and below 3e-11 of each integral in its first derivatives.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


Values = Float[Array, "..."]

NODES = 11
# With both arcs the integrand has poles beside s = 0. Nodes lie denser there, by s -> 0.65 v + 0.35 v^3: plain Gauss nodes
# would take four more.
LINEAR = 0.65
# Below this sin^2 the moments' closed forms lose digits to cancellation, and the power series takes over: of twelve terms,
# whose first omitted one is 5e-16 of the sum.
SMALL_ANGLE, TERMS = 0.07, 12
# At u = 2 r the gap has no length left, and its roots no slope.
LARGEST_SHARE = 1.0 - 2.0**-52


def _nodes() -> tuple[np.ndarray, np.ndarray]:
    """Places in 0 ... 1 and their weights."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    v = 0.5 * (x + 1.0)
    return LINEAR * v + (1.0 - LINEAR) * v**3, 0.5 * w * (LINEAR + 3.0 * (1.0 - LINEAR) * v**2)


def _moments(sine: Values, cosine: Values, angle: Values) -> tuple[Values, Values, Values, Values]:
    """Integrals of 1, sin^2, sin^4 and sin^6 from 0 to an angle up to pi/2, each to full relative precision."""
    square, product = jnp.square(sine), sine * cosine
    first = 0.5 * (angle - product)
    second = 0.25 * (3.0 * first - square * product)
    third = (5.0 * second - jnp.square(square) * product) / 6.0
    # The same recurrence backwards, from sin^6/cos expanded in sin^2: there it adds and damps.
    small = square < SMALL_ANGLE
    z = jnp.where(small, square, 0.0)
    series = jnp.zeros(())
    coefficients = np.cumprod([1.0, *((2 * j - 1) / (2 * j) for j in range(1, TERMS))])
    for j in reversed(range(TERMS)):
        series = series * z + coefficients[j] / (7 + 2 * j)
    third_small = z**3 * jnp.where(small, sine, 0.0) * series
    second_small = (6.0 * third_small + jnp.square(z) * product) / 5.0
    first_small = (4.0 * second_small + z * product) / 3.0
    return (
        angle,
        jnp.where(small, first_small, first),
        jnp.where(small, second_small, second),
        jnp.where(small, third_small, third),
    )


def _one_arc(reach: Values, ratio: Values) -> tuple[Values, Values]:
    """Integrals of d(d/r) (c/g)^3 and (c/g)^4 over one arc, g = c + rec(d), from d = reach r to d = r; ratio = r/c.

    With d = r sin t, tan(psi) = gamma/tan(t/2) and gamma^2 = c/(c + 2r) they are integrals of polynomials in sin^2 psi:
    with D = gamma^2 + (1 - gamma^2) sin^2 and N = (1 + gamma^2) sin^2 - gamma^2 it is g = c/D, cos t = N/D, dt = 2 gamma dpsi/D.
    """
    q = 1.0 / (1.0 + 2.0 * ratio)
    gamma = jnp.sqrt(q)
    # The root has no slope where the reach ends; nothing depends on it there, as the gap is cut off.
    inside = reach < 1.0
    tall = gamma * (1.0 + jnp.where(inside, jnp.sqrt(jnp.where(inside, 1.0 - jnp.square(reach), 1.0)), 0.0))
    length = jnp.sqrt(jnp.square(tall) + jnp.square(reach))
    upper = _moments(tall / length, reach / length, jnp.arctan2(tall, reach))
    end = jnp.sqrt(1.0 + q)
    lower = _moments(gamma / end, 1.0 / end, jnp.arctan(gamma))
    m0, m1, m2, m3 = (above - below for above, below in zip(upper, lower, strict=True))
    p = 1.0 - q
    third = (1.0 - q * q) * m2 + q * q * (2.0 * m1 - m0)
    fourth = (1.0 + q) * p * p * m3 + q * p * (1.0 + 3.0 * q) * m2 + q * q * (3.0 * q - 1.0) * m1 - q**3 * m0
    return jnp.where(inside, 2.0 * gamma * third, 0.0), jnp.where(inside, 2.0 * gamma * fourth, 0.0)


def _two_arcs(share: Values, ratio: Values, *, slopes: bool) -> tuple[Values, Values, Values]:
    """Integrals of (c/g)^3, (c/g)^4 and rec'(u/2 - s) (c/g)^4 over d(s/r), s > 0, where both arcs recede; share = u/(2 r).

    s = (r - u/2)(1 - z^2) takes the vertical end of an arc out of the integrand. Without `slopes` the last two are zero.
    """
    room = 1.0 - share
    parted = share < 0.5  # else both arcs reach as far as the gap does
    start = jnp.where(parted, jnp.sqrt(jnp.where(parted, 1.0 - 2.0 * share, 1.0) / jnp.where(parted, room, 1.0)), 0.0)

    def with_node(sums: tuple[Values, ...], node: tuple[Array, Array]) -> tuple[tuple[Values, ...], None]:
        place, weight = node
        z = 1.0 - (1.0 - start) * place
        square = z * z
        s = room * (1.0 - square)
        near, far = 1.0 + (share - s), 1.0 + (share + s)
        own = z * jnp.sqrt(room * far)
        other = jnp.sqrt(room * (2.0 - square) * near)
        thin = 1.0 / (1.0 + ratio * (2.0 - own - other))
        part = (2.0 * weight) * z * thin * thin * thin
        if not slopes:
            return (sums[0] + part, *sums[1:]), None
        return (sums[0] + part, sums[1] + part * thin, sums[2] + part * thin * (share - s) / other), None

    # A loop: written out, the nodes were a third of a program of this law.
    none = jnp.zeros(jnp.broadcast_shapes(share.shape, ratio.shape))
    places, weights = _nodes()
    nodes = jnp.asarray(places), jnp.asarray(weights)
    (third, fourth, slope), _ = jax.lax.scan(with_node, (none, none, none), nodes)
    spread = (1.0 - start) * room
    return third * spread, fourth * spread, slope * spread


# 2 r [m] below which an edge is sharp: far below an atom, and far above what second derivatives of u/(2 r) overflow at.
SHARP = 1e-30


def _shares(opening: Values, radius: Values, clearance: Values) -> tuple[Values, Values, Values]:
    """(1 where the arcs face each other, 0 beyond, 1/2 where they end; u/(2 r) in 0 ... 1, and short of 1; r/c)."""
    ends = jnp.where(2.0 * radius > SHARP, 2.0 * radius, 0.0)
    facing = jnp.where(opening < ends, 1.0, jnp.where(opening == ends, 0.5, 0.0))
    within = (opening > 0.0) & (opening <= ends)
    share = jnp.where(within, opening, 0.0) / jnp.where(within, ends, 1.0)
    return facing, jnp.minimum(share, LARGEST_SHARE), radius / clearance


@jax.custom_jvp
def film_resistance(opening: Values, radius: Values, clearance: Values) -> Values:
    """I(u; r, c) [1/m2] of openings u [m], either sign, edge radii r >= 0 and clearances c > 0 [m], which broadcast.

    Smooth through u = 0; zero from u = 2 r on, where the slope jumps and derivatives give the mean of both sides.
    """
    facing, share, ratio = _shares(opening, radius, clearance)
    single = _one_arc(jnp.minimum(2.0 * share, 1.0), ratio)[0]
    double = _two_arcs(share, ratio, slopes=False)[0]
    land = jnp.maximum(-opening, 0.0)
    return (land + 2.0 * radius * jnp.floor(facing) * (single + double)) / clearance**3


@film_resistance.defjvp
def _film_resistance_jvp(
    primals: tuple[Values, Values, Values], tangents: tuple[Values, Values, Values]
) -> tuple[Values, Values]:
    """Its derivatives are integrals of the same kind, by the nodes of the same sum: finite at every seam, at no root's cost.

    dI/du = -1/g(0)^3 - 6 int rec'(u/2 - s)/g^4 ds and dI/dc = -6 int ds/g^4, both over s > 0; dI/dr as I scales by -2.
    """
    opening, radius, clearance = primals
    facing, share, ratio = _shares(opening, radius, clearance)
    single, single_fourth = _one_arc(jnp.minimum(2.0 * share, 1.0), ratio)
    double, double_fourth, slope = _two_arcs(share, ratio, slopes=True)
    third, fourth = single + double, single_fourth + double_fourth
    receding = 1.0 - jnp.sqrt((1.0 - share) * (1.0 + share))
    by_opening = -1.0 / (1.0 + 2.0 * ratio * receding) ** 3 - 6.0 * ratio * slope
    by_radius = 6.0 * fourth - 4.0 * third - 2.0 * share * by_opening
    land = jnp.maximum(-opening, 0.0)
    cube = 1.0 / clearance**3
    value = (land + 2.0 * radius * jnp.floor(facing) * third) * cube
    # An overlapped land adds to what the arcs resist: its own -1/c^3 is the arcs' at u = 0.
    change = (
        facing * by_opening * tangents[0]
        + facing * by_radius * tangents[1]
        - (3.0 * land + 6.0 * radius * facing * fourth) / clearance * tangents[2]
    )
    return value, change * cube
