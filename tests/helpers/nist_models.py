"""The model functions of the NIST StRD nonlinear regression problems, f(b, x), as their files state them."""

from collections.abc import Callable

import jax.numpy as jnp
from jax import Array


def bennett5(b: Array, x: Array) -> Array:
    return b[0] * (b[1] + x) ** (-1.0 / b[2])


def saturating(b: Array, x: Array) -> Array:
    return b[0] * (1.0 - jnp.exp(-b[1] * x))


def chwirut(b: Array, x: Array) -> Array:
    return jnp.exp(-b[0] * x) / (b[1] + b[2] * x)


def danwood(b: Array, x: Array) -> Array:
    return b[0] * x ** b[1]


def enso(b: Array, x: Array) -> Array:
    turn = 2.0 * jnp.pi * x
    wave = lambda cosine, sine, period: cosine * jnp.cos(turn / period) + sine * jnp.sin(turn / period)
    return b[0] + wave(b[1], b[2], 12.0) + wave(b[4], b[5], b[3]) + wave(b[7], b[8], b[6])


def eckerle4(b: Array, x: Array) -> Array:
    return b[0] / b[1] * jnp.exp(-0.5 * ((x - b[2]) / b[1]) ** 2)


def gauss(b: Array, x: Array) -> Array:
    peak = lambda height, centre, width: height * jnp.exp(-((x - centre) ** 2) / width**2)
    return b[0] * jnp.exp(-b[1] * x) + peak(b[2], b[3], b[4]) + peak(b[5], b[6], b[7])


def cubic_ratio(b: Array, x: Array) -> Array:
    return (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1.0 + b[4] * x + b[5] * x**2 + b[6] * x**3)


def quadratic_ratio(b: Array, x: Array) -> Array:
    return (b[0] + b[1] * x + b[2] * x**2) / (1.0 + b[3] * x + b[4] * x**2)


def lanczos(b: Array, x: Array) -> Array:
    return b[0] * jnp.exp(-b[1] * x) + b[2] * jnp.exp(-b[3] * x) + b[4] * jnp.exp(-b[5] * x)


def mgh09(b: Array, x: Array) -> Array:
    return b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3])


def mgh10(b: Array, x: Array) -> Array:
    return b[0] * jnp.exp(b[1] / (x + b[2]))


def mgh17(b: Array, x: Array) -> Array:
    return b[0] + b[1] * jnp.exp(-x * b[3]) + b[2] * jnp.exp(-x * b[4])


def misra1b(b: Array, x: Array) -> Array:
    return b[0] * (1.0 - (1.0 + b[1] * x / 2.0) ** (-2))


def misra1c(b: Array, x: Array) -> Array:
    return b[0] * (1.0 - (1.0 + 2.0 * b[1] * x) ** (-0.5))


def misra1d(b: Array, x: Array) -> Array:
    return b[0] * b[1] * x / (1.0 + b[1] * x)


def nelson(b: Array, x: Array) -> Array:
    """ln y, of two predictors."""
    return b[0] - b[1] * x[:, 0] * jnp.exp(-b[2] * x[:, 1])


def rat42(b: Array, x: Array) -> Array:
    return b[0] / (1.0 + jnp.exp(b[1] - b[2] * x))


def rat43(b: Array, x: Array) -> Array:
    return b[0] / (1.0 + jnp.exp(b[1] - b[2] * x)) ** (1.0 / b[3])


def roszman1(b: Array, x: Array) -> Array:
    return b[0] - b[1] * x - jnp.arctan(b[2] / (x - b[3])) / jnp.pi


MODELS: dict[str, Callable[[Array, Array], Array]] = {
    "Bennett5": bennett5,
    "BoxBOD": saturating,
    "Chwirut1": chwirut,
    "Chwirut2": chwirut,
    "DanWood": danwood,
    "ENSO": enso,
    "Eckerle4": eckerle4,
    "Gauss1": gauss,
    "Gauss2": gauss,
    "Gauss3": gauss,
    "Hahn1": cubic_ratio,
    "Kirby2": quadratic_ratio,
    "Lanczos1": lanczos,
    "Lanczos2": lanczos,
    "Lanczos3": lanczos,
    "MGH09": mgh09,
    "MGH10": mgh10,
    "MGH17": mgh17,
    "Misra1a": saturating,
    "Misra1b": misra1b,
    "Misra1c": misra1c,
    "Misra1d": misra1d,
    "Nelson": nelson,
    "Rat42": rat42,
    "Rat43": rat43,
    "Roszman1": roszman1,
    "Thurber": cubic_ratio,
}
