"""The differences of two records' parameters and amounts, with errors of the difference, from their joint fit. NumPy only.

A difference is a linear function of both records' readings, which says how each channel's noise enters it, how any two
differences correlate, and so the law of the largest of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, stdtr, stdtrit

from thermohyd.identify.diagnosis.max_t import MaxT, normal_score
from thermohyd.identify.fitting.uncertainty import Covariance

from .joint_fit import SHARED, Entry, JointFit


@dataclass(frozen=True)
class LinearDifference:
    """Second record minus first, SI. std_apart: of two separate fits; None where one of them says nothing.

    direction (rows,): unit vector of the readings that it is read off; freedom: degrees of freedom of their noise.
    """

    name: str
    value: float
    std: float
    std_apart: float | None
    direction: np.ndarray
    freedom: float

    @property
    def reach(self) -> float:
        """Standard errors on either side of its 95 % interval, by Student's t for noise that was estimated."""
        return float(stdtrit(min(self.freedom, 1e6), 0.975))


@dataclass(frozen=True)
class Estimates:
    """What a joint fit says of every entry: `known`, its covariance beside what stays at a limit."""

    fit: JointFit
    known: Covariance

    def place(self, entry: Entry) -> int:
        return self.fit.free.index(entry)

    def std(self, entry: Entry) -> float | None:
        """Standard error; None where there is none, as at a limit."""
        if entry not in self.fit.free or self.place(entry) in self.known.why:
            return None
        return float(np.sqrt(self.known.matrix[self.place(entry), self.place(entry)]))


def estimates_of(fit: JointFit) -> Estimates:
    """Values and errors of a joint fit."""
    return Estimates(fit, fit.covariance())


def difference(found: Estimates, name: str, first: str, second: str) -> LinearDifference | str:
    """The second record's entry minus the first's; or in words why there is none.

    One of them at its limit counts as free, and its step beyond the limit is taken on paper: a difference is not shortened by where
    an amount must end.
    """
    fit, entries = found.fit, ((first, name), (second, name))
    a, b = (found.place(entry) for entry in entries)
    pressed = [i for i in (a, b) if fit.active[i]]
    freed = [fit.free[i] for i in pressed]
    known = fit.covariance(freed=freed) if freed else found.known
    for entry, place in zip(entries, (a, b), strict=True):
        if place in known.why:
            return f"{entry[0]}: {known.why[place]}"
    contrast = np.zeros(len(fit.free))
    contrast[a], contrast[b] = -1.0, 1.0
    value = fit.values[entries[1]] - fit.values[entries[0]]
    value -= float(contrast @ known.matrix[:, pressed] @ (fit.columns[:, pressed].T @ fit.residual))
    # To the linear order the entries are -C J' r: what each row has to say of the difference.
    influence = fit.columns @ (known.matrix @ contrast)
    std = float(np.linalg.norm(influence))
    if not std > 0.0:
        return "no reading depends on the difference"
    direction = influence / std
    freedom = fit.freedom.along(direction, np.ones(len(direction), dtype=bool))
    apart = 0.0
    for record, place in ((first, a), (second, b)):
        own = fit.covariance(record, freed)
        apart += np.nan if place in own.why else own.matrix[place, place]
    return LinearDifference(name, value, std, float(np.sqrt(apart)) if apart > 0.0 else None, direction, freedom)


def equal_amounts(found: Estimates, name: str, first: str, second: str) -> float:
    """p-value of one entry's being the same in two records that were fitted apart; 1 where they cannot say."""
    own = difference(found, name, first, second)
    if isinstance(own, str):
        return 1.0
    return float(2.0 * stdtr(min(own.freedom, 1e6), -abs(own.value) / own.std))


def largest_of(differences: list[LinearDifference]) -> MaxT:
    """The law of the largest of these scores where both records are of one valve: single-step max-T, two-sided."""
    directions = np.stack([d.direction for d in differences], axis=1) if differences else np.zeros((0, 0))
    return MaxT.of(directions, np.zeros(len(differences), dtype=bool))


def scores(differences: list[LinearDifference], std: Mapping[str, float]) -> dict[str, float]:
    """{name: the normal score as rare as the difference over its standard error `std`}."""
    return {d.name: abs(normal_score(d.value / std[d.name], d.freedom)) for d in differences}


@dataclass(frozen=True)
class Remainder:
    """Some entries equal in both records, which they may be with this probability: {name: (difference, std)} of the others then."""

    p_value: float
    others: dict[str, tuple[float, float]]


def if_equal(differences: list[LinearDifference], equal: list[str]) -> Remainder:
    """What follows if the entries named do not differ: how probable their differences are, and the others with that known."""
    if not equal:
        return Remainder(1.0, {d.name: (d.value, d.std) for d in differences})
    std = np.array([d.std for d in differences])
    directions = np.stack([d.direction for d in differences], axis=1)
    correlation, z = directions.T @ directions, np.array([d.value for d in differences]) / std
    held = np.array([d.name in equal for d in differences])
    values, vectors = np.linalg.eigh(correlation[np.ix_(held, held)])
    alive = values > 1e-10 * values.max()
    inverse = (vectors[:, alive] / values[alive]) @ vectors[:, alive].T
    p = float(chdtrc(int(alive.sum()), float(z[held] @ inverse @ z[held])))
    cross = correlation[np.ix_(~held, held)]
    moved = z[~held] - cross @ inverse @ z[held]
    left = np.maximum(1.0 - np.einsum("ij,jk,ik->i", cross, inverse, cross), 0.0)
    own = [d for d, fixed in zip(differences, held, strict=True) if not fixed]
    return Remainder(
        p, {d.name: (float(m * d.std), float(np.sqrt(v) * d.std)) for d, m, v in zip(own, moved, left, strict=True)}
    )


def shared_value(found: Estimates, name: str) -> tuple[float, float | None]:
    """Value and standard error of an entry that both records share."""
    entry = (SHARED, name)
    return found.fit.values[entry], found.std(entry)
