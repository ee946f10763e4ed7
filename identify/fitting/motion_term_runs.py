"""Readings of tests in motion of a machine with typed terms, and their derivatives: to parameters, amounts and the terms' coefficients."""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from thermohyd.dynamics.circuit import seen_at
from thermohyd.dynamics.equilibrium import equilibrium, scaling_of
from thermohyd.dynamics.integrate import NO_EQUILIBRIUM, integrate
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
from .motion_terms import AbstractTerms, signals_of
from .uncertainty import Key


def _given(given: Given, terms: AbstractTerms, coefficients: Array) -> Given:
    added = terms.effect(coefficients), terms.delay(coefficients)
    return eqx.tree_at(lambda g: g.valve.effects, given, (*given.valve.effects, *added))


@quickly
def runs_with_terms(
    plan: Plan, alone: bool, p: Float[Array, " all"], terms: AbstractTerms, given: Given, inputs: Any
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

    return jax.lax.map(one, inputs)  # see `motion_readings.readings_and_slopes`


@quickly
def responses_with_terms(
    plan: Plan,
    alone: bool,
    p: Float[Array, " all"],
    terms: AbstractTerms,
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
    terms: AbstractTerms,
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


def _steps(
    plan: Plan, alone: bool, p: Any, terms: AbstractTerms, given: Given, runs: StepRuns, into: TermReadings
) -> int:
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
