"""The film between two rounded edges from its definition: the integral of ds/g(s)^3, by adaptive quadrature."""

import warnings
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.integrate import IntegrationWarning, quad

from reference.oil import Array


def recess(d: float, r: float) -> float:
    """rec(d) [m] of an arc, d beyond its start, up to d = r; written so that a small one keeps its digits."""
    return d * d / (r + np.sqrt(max((r - d) * (r + d), 0.0))) if d > 0.0 else 0.0


@cache
def _integral(u: float, r: float, c: float, power: int) -> float:
    """Of ds/g^power [m^(1 - power)] over the whole film, g(s) = c + rec(s + u/2) + rec(u/2 - s)."""
    land, half = max(-u, 0.0), 0.5 * max(u, 0.0)
    room = r - half
    film = 0.0
    if room > 0.0:
        # Even in s; s = room sin t takes the vertical ends of the arcs out. Panels meet where an arc starts, and narrow
        # towards the narrowest place, whose width is the root of r times the gap there.
        width = np.sqrt(r * (c + 2.0 * recess(half, r)))
        places = {0.0, min(half, room), *(min(k * width, room) for k in (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)), room}

        def integrand(t: float) -> float:
            s = room * np.sin(t)
            return room * np.cos(t) * (c + recess(half + s, r) + recess(half - s, r)) ** -power

        ends = np.arcsin(np.minimum(np.array(sorted(places)) / room, 1.0))
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", IntegrationWarning
            )  # rounding, where the tolerance asks for the last digits
            parts = [
                quad(integrand, low, high, epsabs=0.0, epsrel=1e-13)[0] for low, high in pairwise(ends) if high > low
            ]
        film = 2.0 * sum(parts)
    return land / c**power + film


def film_integral(u: Array, r: Array, c: Array, power: int = 3) -> np.ndarray:
    """I(u; r, c) [1/m2] for power 3; for other powers what its derivatives are made of."""
    u, r, c = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in (u, r, c)))
    values = [_integral(*map(float, each), power) for each in zip(u.flat, r.flat, c.flat, strict=True)]
    return np.array(values).reshape(u.shape)


def resistance(u: Array, h: Array, r: Array, c: Array, land_factor: Array) -> np.ndarray:
    """J [1/m2]: the film, over the factor of an eccentric spool, or creeping flow through a sharp slit of height h."""
    film = film_integral(u, r, c) / land_factor
    slit = 8.0 / (3.0 * np.pi * np.asarray(h) ** 2)
    larger = np.maximum(film, slit)
    return larger * ((film / larger) ** 4 + (slit / larger) ** 4) ** 0.25
