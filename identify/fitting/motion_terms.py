"""Typed terms in tests in motion: what they add to the machine, and the readings' derivatives to their coefficients.

All places and variables are one effect of the machine, `Bank`: a coefficient for each place, signal and shape of a law, nearly all of
them 0. So a table of hundreds of laws is one program, whose columns are the variational equations in as many directions, and every
term that is fitted is another one for all terms alike.
"""

from dataclasses import dataclass
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from thermohyd.dynamics.circuit import AbstractCircuitEffect, Added, Seen, seen_at
from thermohyd.dynamics.equilibrium import equilibrium, scaling_of
from thermohyd.dynamics.integrate import NO_EQUILIBRIUM, integrate
from thermohyd.identify.model.places import place_of
from thermohyd.identify.model.term_variables import (
    DIRECTION_SPEED,
    IMPLICIT,
    MOVED,
    REFERENCE_TEMPERATURE,
    SIGNALS,
    signal_of,
)
from thermohyd.identify.model.typed_terms import TypedTerm, coefficients_of
from thermohyd.numerics import quickly

from .motion_readings import (
    FREQUENCY_READINGS,
    MOST_STEPS,
    STEP_READINGS,
    DynamicSimulator,
    Given,
    Plan,
    read_of,
    responses_of,
)
from .motion_runs import StepRuns
from .uncertainty import Key


SHAPES = ("proportional", "square", "root", "first", "second", "third")
STORED = ("flow_a", "flow_b")  # places of what goes with dp/dt
_SIZE = len(MOVED) * len(SIGNALS) * len(SHAPES) + len(STORED)
ROUNDED = 1e-4  # of the range: a root begins with a slope


class Terms(eqx.Module):
    """Laws in a machine. coefficients (k,), SI; acting (k, places x signals x shapes, then what goes with dp/dt): where each acts;
    low, high (signals,): where each signal was seen, beyond which it is held."""

    coefficients: Float[Array, " k"]
    acting: Float[Array, "k places"]
    low: Float[Array, " signals"]
    high: Float[Array, " signals"]


@final
class Bank(AbstractCircuitEffect):
    """Everything that typed terms add to the circuit. amount (places x signals x shapes + stored,): a coefficient of each."""

    amount: Float[Array, " places"]
    low: Float[Array, " signals"]
    high: Float[Array, " signals"]

    def added(self, seen: Seen) -> Added:
        split = _SIZE - len(STORED)
        shapes = shapes_of(signals_of(seen), self.low, self.high)
        shift = jnp.sum(self.amount[:split].reshape(len(MOVED), *shapes.shape) * shapes, axis=(1, 2))
        of = dict(zip(MOVED, shift, strict=True))
        return Added(
            piston_force=of["force_on_piston"],
            spool_target=of["force_on_spool"],
            inflow=jnp.stack([of["flow_a"], of["flow_b"]]),
            inflow_per_rate=self.amount[split:],
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


def acting(place: str, variable: str, law: str) -> np.ndarray:
    """(coefficients, places): where each coefficient of a law acts; rows of zeros for a reading, on which the machine does not depend."""
    found = np.zeros((coefficients_of(law), _SIZE))
    where = place_of(place, moving=True)
    for moved, sign in where.moving.items():
        if variable == IMPLICIT:
            found[0, _SIZE - len(STORED) + STORED.index(moved)] = sign
            continue
        signal = signal_of(where, moved, variable)
        if law == "constant":
            found[0, place_number(moved, "constant", "proportional")] = sign
        elif law == "smooth":
            found[0, place_number(moved, "constant", "proportional")] = sign
            for i, shape in enumerate(("first", "second", "third"), start=1):
                found[i, place_number(moved, signal, shape)] = sign
        else:
            found[0, place_number(moved, signal, law)] = sign
    return found


COEFFICIENTS = 4  # of one term, at most: a program serves them all


def terms_in(terms: tuple[TypedTerm, ...]) -> Terms:
    """Typed terms as the machine takes them, each padded to so many coefficients."""
    coefficients, rows = np.zeros(COEFFICIENTS * len(terms)), np.zeros((COEFFICIENTS * len(terms), _SIZE))
    low, high = np.full(len(SIGNALS), -np.inf), np.full(len(SIGNALS), np.inf)
    for number, term in enumerate(terms):
        first = COEFFICIENTS * number
        count = len(term.coefficients)
        coefficients[first : first + count] = term.coefficients
        rows[first : first + count] = acting(term.place, term.variable, term.law)
        where = place_of(term.place, moving=True)
        for moved in where.moving if term.variable != IMPLICIT else ():
            signal = SIGNALS.index(signal_of(where, moved, term.variable))
            low[signal], high[signal] = term.low, term.high
    # A signal that no term follows needs no range; one of infinite ends has no middle.
    free = ~np.isfinite(low)
    low[free], high[free] = -1e30, 1e30
    return Terms(*(jnp.asarray(part) for part in (coefficients, rows, low, high)))


def _given(given: Given, terms: Terms, coefficients: Array) -> Given:
    bank = Bank(jnp.sum(coefficients[:, None] * terms.acting, axis=0), terms.low, terms.high)
    return eqx.tree_at(lambda g: g.valve.effects, given, (*given.valve.effects, bank))


@quickly
def runs_with_terms(
    plan: Plan, alone: bool, p: Float[Array, " all"], terms: Terms, given: Given, inputs: Any
) -> tuple[
    Float[Array, "runs rows readings"],
    Float[Array, "runs rows readings directions"],
    Float[Array, "runs rows signals"],
    Int[Array, " runs"],
]:
    """What `readings_and_slopes` gives, of a machine with terms: derivatives to the vector and then to the coefficients, or to
    these `alone`; and the signals (see `signals_of`) at each row."""

    def read(q: Array, inputs: Any) -> tuple[Array, tuple[Array, Array, Array]]:
        vector, coefficients = (p, q) if alone else (q[: len(p)], q[len(p) :])
        plant = plan.plant(vector, _given(given, terms, coefficients), inputs)
        scaling = scaling_of(plant, plant.surroundings(inputs.time[0]))
        start, found = equilibrium(plant, scaling, inputs.time[0])
        pace = plan.tolerance
        run = integrate(plant, scaling, start, gradient="forward", rtol=pace, atol=pace, max_steps=MOST_STEPS)
        readings = jax.vmap(lambda state: read_of(state, plant.valve))(run.states)
        signals = jax.vmap(lambda time, state: signals_of(seen_at(plant, plant.surroundings(time), state)))(
            inputs.time, run.states
        )
        return readings, (readings, signals, jnp.where(found, run.failure, NO_EQUILIBRIUM))

    def one(inputs: Any) -> tuple[Array, Array, Array, Array]:
        at = terms.coefficients if alone else jnp.concatenate([p, terms.coefficients])
        slopes, (readings, signals, failure) = jax.jacfwd(lambda q: read(q, inputs), has_aux=True)(at)
        return readings, slopes, signals, failure

    return jax.vmap(one)(inputs)


@quickly
def responses_with_terms(
    plan: Plan,
    alone: bool,
    p: Float[Array, " all"],
    terms: Terms,
    given: Given,
    respond: Any,
    inputs: Any,
    frequency: Array,
) -> tuple[Array, Array, Array]:
    """What `responses_all` gives, of a machine with terms; derivatives as of `runs_with_terms`. respond: see `responses_of`."""

    def all_of(q: Array) -> tuple[Array, tuple[Array, Array]]:
        vector, coefficients = (p, q) if alone else (q[: len(p)], q[len(p) :])
        values, found = responses_of(plan, vector, _given(given, terms, coefficients), inputs, frequency, respond)
        return values, (values, found)

    at = terms.coefficients if alone else jnp.concatenate([p, terms.coefficients])
    slopes, (values, found) = jax.jacfwd(all_of, has_aux=True)(at)
    return values, slopes, found


@dataclass(frozen=True)
class TermReadings:
    """values {key: (rows,)}, slopes {key: (directions, rows)}, signals {test: (rows, signals)} of step tests, SI; a run that fails
    reads NaN. failure: 0, or why."""

    values: dict[Key, np.ndarray]
    slopes: dict[Key, np.ndarray]
    signals: dict[str, np.ndarray]
    failure: int


def read_with_terms(
    simulator: DynamicSimulator,
    names: tuple[str, ...],
    effects: tuple[str, ...],
    vector: np.ndarray,
    terms: Terms,
    alone: bool,
) -> TermReadings:
    """Readings of all channels that the tests could have, of a machine with terms, and their derivatives."""
    plan, given = simulator.plan(names, effects), simulator.given
    p = jnp.asarray(vector, dtype=float)
    into = TermReadings({}, {}, {}, 0)
    failures = []
    for runs in simulator.steps:
        failures.append(_steps(simulator.plan_of(plan, runs), alone, p, terms, given, runs, into))
    for name, runs in simulator.frequencies.items():
        test = simulator.tests[name]
        respond = (test.output, test.absolute, simulator.polarity)
        values, slopes, found = (
            np.array(part)
            for part in responses_with_terms(plan, alone, p, terms, given, respond, runs.inputs, runs.frequency)
        )
        values[~found] = slopes[~found] = np.nan
        for i, channel in enumerate(FREQUENCY_READINGS):
            into.values[name, channel] = values[runs.run, runs.place, i]
            into.slopes[name, channel] = slopes[runs.run, runs.place, i].T
        failures.append(0 if np.all(found) else 1)
    return TermReadings(into.values, into.slopes, into.signals, max(failures, default=0))


def _steps(plan: Plan, alone: bool, p: Any, terms: Terms, given: Given, runs: StepRuns, into: TermReadings) -> int:
    values, slopes, signals, failures = (
        np.array(part) for part in runs_with_terms(plan, alone, p, terms, given, runs.inputs)
    )
    values[failures != 0] = slopes[failures != 0] = np.nan
    for name, (run, place) in runs.rows.items():
        for i, channel in enumerate(STEP_READINGS):
            into.values[name, channel] = values[run, place, i]
            into.slopes[name, channel] = slopes[run, place, i].T
        into.signals[name] = signals[run, place]
    return int(np.max(failures))
