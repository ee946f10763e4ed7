"""What typed terms add to the machine of tests in motion.

A table of hundreds of laws is one effect of the machine, `Bank`: a coefficient for each place, signal and shape of a law, nearly all of
them 0. So it is one program (`motion_term_runs`), whose columns are the variational equations in as many directions. Every term that is
fitted is another one, `Few`, for all terms alike: which place, signal and shape is data. A delay of the command is no part of either: it
shifts what the machine is given.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.dynamics.circuit import AbstractCircuitEffect, Added, Seen
from thermohyd.dynamics.flows import softness_of_gas
from thermohyd.dynamics.machine import AbstractMotionEffect, Motion
from thermohyd.identify.model.places import place_of
from thermohyd.identify.model.term_variables import (
    DELAYED,
    DIRECTION_SPEED,
    IMPLICIT,
    MOVED,
    REFERENCE_TEMPERATURE,
    REMEMBERED,
    SIGNALS,
    signal_of,
)
from thermohyd.identify.model.typed_terms import GASEOUS, TypedTerm, coefficients_of


SHAPES = ("proportional", "square", "root", "first", "second", "third")
STORED = ("flow_a", "flow_b")  # places of what goes with dp/dt
STORES = ("proportional", GASEOUS)  # its laws
_PER_RATE = len(STORES) * len(STORED)
_SIZE = len(MOVED) * len(SIGNALS) * len(SHAPES) + _PER_RATE + 1  # the last: of the command's delay
ROUNDED = 1e-4  # of the range: a root begins with a slope


class AbstractTerms(eqx.Module):
    """Laws in a machine, of these coefficients (k,), SI."""

    coefficients: eqx.AbstractVar[Float[Array, " k"]]

    @abstractmethod
    def effect(self, coefficients: Float[Array, " k"]) -> AbstractCircuitEffect:
        """What they add to the circuit at other coefficients."""

    @abstractmethod
    def delay(self, coefficients: Float[Array, " k"]) -> "Delay":
        """By what time the command acts later at other coefficients."""


@final
class Terms(AbstractTerms):
    """A few terms, one slot for each place where one acts.

    takes (slots, 1 + shapes, k): which coefficients each slot has of a constant and of the shapes of its signal, with their signs; moved
    (places, slots) and signal (slots, signals): 1 where it acts, and at what it follows; low, high (slots,): where that was seen, beyond
    which it is held. stored (laws, 2, k): of what goes with dp/dt; delays (k,): of a lag with the command's rate. remembers: whether one
    goes with which way the command went last.
    """

    coefficients: Float[Array, " k"]
    takes: Float[Array, "slots shapes k"]
    moved: Float[Array, "places slots"]
    signal: Float[Array, "slots signals"]
    low: Float[Array, " slots"]
    high: Float[Array, " slots"]
    stored: Float[Array, "laws ports k"]
    delays: Float[Array, " k"]
    remembers: bool = eqx.field(static=True)

    def effect(self, coefficients: Float[Array, " k"]) -> "AbstractFew":
        amount = jnp.sum(self.takes * coefficients, axis=-1)
        per_rate = jnp.sum(self.stored * coefficients, axis=-1)
        few = FewThatRemember if self.remembers else Few
        return few(amount, per_rate, self.moved, self.signal, self.low, self.high)

    def delay(self, coefficients: Float[Array, " k"]) -> "Delay":
        return Delay(jnp.sum(self.delays * coefficients))


@final
class Directions(AbstractTerms):
    """A table of laws. acting (k, places x signals x shapes, then what goes with dp/dt, then the delay): where each coefficient acts; low,
    high (signals,): where each signal was seen, beyond which it is held."""

    coefficients: Float[Array, " k"]
    acting: Float[Array, "k places"]
    low: Float[Array, " signals"]
    high: Float[Array, " signals"]

    def effect(self, coefficients: Float[Array, " k"]) -> "Bank":
        return Bank(jnp.sum(coefficients[:, None] * self.acting[:, :-1], axis=0), self.low, self.high)

    def delay(self, coefficients: Float[Array, " k"]) -> "Delay":
        return Delay(jnp.sum(coefficients * self.acting[:, -1]))


@final
class Delay(AbstractMotionEffect):
    """The command acts later by `amount` [s]."""

    amount: Float[Array, ""]

    def motion(self, so_far: Motion) -> Motion:
        return so_far.later(self.amount)


@final
class Bank(AbstractCircuitEffect):
    """Everything that typed terms add to the circuit. amount (places x signals x shapes + stored,): a coefficient of each."""

    remembers: ClassVar[bool] = True
    amount: Float[Array, " places"]
    low: Float[Array, " signals"]
    high: Float[Array, " signals"]

    def added(self, seen: Seen) -> Added:
        split = len(self.amount) - _PER_RATE
        shapes = shapes_of(signals_of(seen), self.low, self.high)
        shift = jnp.sum(self.amount[:split].reshape(len(MOVED), *shapes.shape) * shapes, axis=(1, 2))
        return _added(shift, self.amount[split:].reshape(len(STORES), -1), seen)


class AbstractFew(AbstractCircuitEffect):
    """What a few terms add (see `Terms`). A run's derivatives go through it at every step; through the thousand coefficients of `Bank` they
    take half as long again.

    amount (slots, 1 + shapes): the coefficients of each; per_rate (laws, 2): of what goes with dp/dt.
    """

    per_rate: eqx.AbstractVar[Float[Array, "laws ports"]]
    moved: eqx.AbstractVar[Float[Array, "places slots"]]
    signal: eqx.AbstractVar[Float[Array, "slots signals"]]
    low: eqx.AbstractVar[Float[Array, " slots"]]
    high: eqx.AbstractVar[Float[Array, " slots"]]

    def added(self, seen: Seen) -> Added:
        followed = jnp.sum(self.signal * signals_of(seen), axis=1)
        shapes = shapes_of(followed, self.low, self.high)
        shift = self.amount[:, 0] + jnp.sum(self.amount[:, 1:] * shapes, axis=1)
        return _added(jnp.sum(self.moved * shift, axis=1), self.per_rate, seen)


@final
class Few(AbstractFew):
    """Terms that go with what the machine's states are."""

    amount: Float[Array, "slots shapes"]
    per_rate: Float[Array, "laws ports"]
    moved: Float[Array, "places slots"]
    signal: Float[Array, "slots signals"]
    low: Float[Array, " slots"]
    high: Float[Array, " slots"]


@final
class FewThatRemember(AbstractFew):
    """Terms of which one at least goes with the way that the spool's command went last: a state more."""

    remembers: ClassVar[bool] = True
    amount: Float[Array, "slots shapes"]
    per_rate: Float[Array, "laws ports"]
    moved: Float[Array, "places slots"]
    signal: Float[Array, "slots signals"]
    low: Float[Array, " slots"]
    high: Float[Array, " slots"]


def _added(shift: Float[Array, " places"], per_rate: Float[Array, "laws ports"], seen: Seen) -> Added:
    of = dict(zip(MOVED, shift, strict=True))
    plain, gaseous = per_rate
    return Added(
        piston_force=of["force_on_piston"],
        spool_target=of["force_on_spool"],
        inflow=jnp.stack([of["flow_a"], of["flow_b"]]),
        inflow_per_rate=plain + gaseous * softness_of_gas(seen.pressure),
        heat=jnp.stack([of["heat_a"], of["heat_b"]]),
        opening=of["position"],
        viscosity=of["viscosity"],
    )


def signals_of(seen: Seen) -> Float[Array, " signals"]:
    """Every signal that a variable is made of, in the order of `SIGNALS`."""
    p, supply = seen.pressure, seen.supply_pressure
    found = {
        "constant": jnp.ones(()),
        "position": seen.spool,
        "opening": jnp.abs(seen.spool),
        "rate": seen.spool_speed,
        "turn": jnp.tanh(seen.spool_speed / DIRECTION_SPEED),
        "turned": seen.turned,
        "velocity": seen.velocity,
        "direction": jnp.tanh(seen.velocity / DIRECTION_SPEED),
        "piston_position": seen.position,
        "pressure_a": p[0],
        "pressure_b": p[1],
        "load": p[0] - p[1],
        "drop_a": supply - p[0],
        "drop_b": supply - p[1],
        "drop": supply - seen.return_pressure,
        "warming_a": seen.warming[0],
        "warming_b": seen.warming[1],
        "temperature": seen.temperature - REFERENCE_TEMPERATURE,
        "time": seen.time,
    }
    return jnp.stack([found[name] for name in SIGNALS])


def shapes_of(
    signals: Float[Array, " signals"], low: Float[Array, " signals"], high: Float[Array, " signals"]
) -> Float[Array, "signals shapes"]:
    """What the coefficients of `SHAPES` multiply: v, v |v|, the root, and Legendre polynomials of the range's share."""
    v = jnp.clip(signals, low, high)
    reach = 0.5 * (high - low)
    s = jnp.where(reach > 0.0, (v - 0.5 * (low + high)) / jnp.where(reach > 0.0, reach, 1.0), 0.0)
    small = ROUNDED * jnp.maximum(jnp.abs(low), jnp.abs(high)) + 1e-30
    root = v * jnp.power(jnp.square(v) + jnp.square(small), -0.25)
    second, third = 1.5 * s**2 - 0.5, 2.5 * s**3 - 1.5 * s
    return jnp.stack([v, v * jnp.abs(v), root, s, second, third], axis=-1)


def place_number(moved: str, signal: str, shape: str) -> int:
    """Where a coefficient of a part of the machine, a signal and a shape stands in `Bank.amount`."""
    return (MOVED.index(moved) * len(SIGNALS) + SIGNALS.index(signal)) * len(SHAPES) + SHAPES.index(shape)


@dataclass(frozen=True)
class Part:
    """A part of a law. number: of its coefficient; sign: with which it acts; signal is `IMPLICIT` where it goes with dp/dt, `DELAYED`
    where it is a delay."""

    number: int
    sign: float
    moved: str
    signal: str
    shape: str = "proportional"


def parts_of(place: str, variable: str, law: str) -> list[Part]:
    """The parts of a law; none of a reading, on which the machine does not depend."""
    found = []
    where = place_of(place, moving=True)
    for moved, sign in where.moving.items():
        if variable in (IMPLICIT, DELAYED):
            found.append(Part(0, sign, moved, variable, law))
            continue
        signal = signal_of(where, moved, variable)
        if law in ("constant", "smooth"):
            found.append(Part(0, sign, moved, "constant"))
        if law == "smooth":
            found += [
                Part(i, sign, moved, signal, shape) for i, shape in enumerate(("first", "second", "third"), start=1)
            ]
        elif law != "constant":
            found.append(Part(0, sign, moved, signal, law))
    return found


def acting(place: str, variable: str, law: str) -> np.ndarray:
    """(coefficients, places): where each coefficient of a law acts among those of a `Bank`."""
    found = np.zeros((coefficients_of(law), _SIZE))
    for part in parts_of(place, variable, law):
        if part.signal == DELAYED:
            where = _SIZE - 1
        elif part.signal == IMPLICIT:
            where = _SIZE - 1 - _PER_RATE + STORES.index(part.shape) * len(STORED) + STORED.index(part.moved)
        else:
            where = place_number(part.moved, part.signal, part.shape)
        found[part.number, where] = part.sign
    return found


COEFFICIENTS = 4  # of one term, at most: a program serves them all
SLOTS = 2  # of one term, at most: what passes from one chamber to the other acts at both
_ANYWHERE = 1e30  # the end of no range


def terms_in(terms: tuple[TypedTerm, ...]) -> Terms:
    """Typed terms as the machine takes them, each padded to so many coefficients and slots."""
    coefficients, slots = COEFFICIENTS * len(terms), SLOTS * len(terms)
    values, stored = np.zeros(coefficients), np.zeros((len(STORES), len(STORED), coefficients))
    delays = np.zeros(coefficients)
    takes = np.zeros((slots, 1 + len(SHAPES), coefficients))
    moved, signal = np.zeros((len(MOVED), slots)), np.zeros((slots, len(SIGNALS)))
    low, high, remembers = np.full(slots, -_ANYWHERE), np.full(slots, _ANYWHERE), False
    for number, term in enumerate(terms):
        first = COEFFICIENTS * number
        values[first : first + len(term.coefficients)] = term.coefficients
        places = list(place_of(term.place, moving=True).moving)
        for part in parts_of(term.place, term.variable, term.law):
            own, slot = first + part.number, SLOTS * number + places.index(part.moved)
            if part.signal == IMPLICIT:
                stored[STORES.index(part.shape), STORED.index(part.moved), own] = part.sign
                continue
            if part.signal == DELAYED:
                delays[own] = part.sign
                continue
            moved[MOVED.index(part.moved), slot] = 1.0
            if part.signal == "constant":
                takes[slot, 0, own] = part.sign
                continue
            takes[slot, 1 + SHAPES.index(part.shape), own] = part.sign
            signal[slot, SIGNALS.index(part.signal)] = 1.0
            remembers |= part.signal == REMEMBERED
            low[slot], high[slot] = term.low, term.high
    parts = [jnp.asarray(part) for part in (values, takes, moved, signal, low, high, stored, delays)]
    return Terms(*parts, remembers=remembers)
