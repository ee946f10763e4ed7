"""Predict a record's readings from a model, with standard deviations from the covariance of its parameters.

The simulator's valve is built for the rows of a test: parameters, effects, and learned terms row by row.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float
from matplotlib.figure import Figure
from rich.console import Console

from thermohyd.conditions import Conditions
from thermohyd.effects.effect import AbstractReadingEffect
from thermohyd.effects.library import effect, effect_info
from thermohyd.identify.bench.columns import column_unit, reading_unit
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.bench.units import from_si
from thermohyd.identify.fitting.reversed_signs import reversed_channels, warning_of
from thermohyd.identify.fitting.static_readings import base_valve, conditions_of, pad
from thermohyd.identify.reduction.reduce import smooth_sweep
from thermohyd.identify.result import Result
from thermohyd.numerics import quickly, require_float64
from thermohyd.oil import Oil
from thermohyd.oil_definition import OilDefinition, kinematic_viscosity_of
from thermohyd.valve import Valve

from .fitted_range import COLUMN, Outside, names_of_rows, outside, sentences
from .learned_terms import ABSOLUTE, term_values
from .model import Model, coefficient_names
from .pieces import PLACE, predicted_in_pieces
from .places import read_as
from .predict_motion import as_read, as_static, require_actuator, signal_of_reading, unit_of
from .simulation_output import note_lines, simulation_files, simulation_json, simulation_table, spare_the_record
from .term_variables import BLOCKED, States, of_the_oil
from .typed_terms import TypedTerm, entry_shifts, reading_shifts


SAME = 1e-9  # relative: what two files write of one number differs by less
GEOMETRY = ("stroke", "slot_width", "land_diameter", "rated_current")  # what of [valve] a prediction uses
NOT_THE_OIL = ("name", "source", "coldest", "hottest")  # they describe it


def as_in_record(model: Model, record: BenchRecord) -> tuple[Model, tuple[str, ...]]:
    """The model with the oil and the geometry that the record states, and a note for each in which the two differ."""
    changed, notes, oil = {}, [], model.oil
    for name in GEOMETRY:
        stated, fitted = getattr(record.valve, name), getattr(model.valve, name)
        if stated is None or (fitted is not None and _same(stated, fitted)):
            continue
        changed[name] = stated
        if fitted is not None:
            ours, theirs = (column_unit(name).words(value, 6) for value in (stated, fitted))
            notes.append(f"{name}: the record states {ours} and gets it; the model was fitted with {theirs}")
    if record.valve.polarity != model.valve.polarity:
        changed["polarity"] = record.valve.polarity  # of the record's own current
    if not _same_oil(record.oil, model.oil):
        oil = record.oil
        notes.append(f"oil: the record states {_named(oil)} and gets it; the model was fitted with {_named(model.oil)}")
        kept = [name for name in acting_effects(model) if "oil" in effect_info(name).stages]
        if kept:
            notes.append(f"oil: {', '.join(kept)} of the model was found with that other oil and is kept")
    return replace(model, valve=replace(model.valve, **changed), oil=oil), tuple(notes)


def _same(one: float, other: float) -> bool:
    return abs(one - other) <= SAME * max(abs(one), abs(other))


def _same_oil(one: OilDefinition, other: OilDefinition) -> bool:
    others = asdict(other)
    return all(_same(value, others[name]) for name, value in asdict(one).items() if name not in NOT_THE_OIL)


def _named(oil: OilDefinition) -> str:
    return f"{oil.name} ({kinematic_viscosity_of(oil, 313.15) * 1e6:.3g} cSt at 40 degC)"


def valve_without_effects(model: Model, record: BenchRecord) -> Valve:
    """The valve with the model's parameters alone."""
    own = BenchRecord(record.folder, record.name, model.valve, model.oil, record.tests)
    return base_valve(own, model.parameters, heat="heat_retention" in model.free)


def acting_effects(model: Model) -> dict[str, float]:
    """Effects that change something or whose uncertainty counts: an absent one is not even compiled."""
    counted = model.free if model.covariance is not None else ()
    return {name: amount for name, amount in model.effects.items() if amount != 0.0 or name in counted}


def row_terms(model: Model, test: TestRecord) -> dict[str, Float[Array, " padded"]]:
    """{quantity: what its value is multiplied by, or what is added to it [m]} at each padded row, all terms together.

    Raises BenchInputError where the test lacks the column that a term follows.
    """
    found: dict[str, np.ndarray] = {}
    for term in model.learned:
        if isinstance(term, TypedTerm):
            continue
        try:
            change = term_values(term, test, model.oil)
        except ValueError:
            column = "time" if term.variable in ("elapsed", "rate") else term.variable
            raise BenchInputError(
                f"the model's learned term makes {term.quantity} follow {term.variable}, which needs the column "
                f'"{column}"; add it, or take the term out of the model',
                file=test.path,
            ) from None
        if term.quantity in ABSOLUTE:
            found[term.quantity] = found.get(term.quantity, 0.0) + change
        else:
            found[term.quantity] = found.get(term.quantity, 1.0) * (1.0 + change)
    return {quantity: pad(change) for quantity, change in found.items()}


def place_shifts(
    terms: tuple[TypedTerm, ...], test: TestRecord, states: States
) -> tuple[dict[str, Float[Array, " padded"]], dict[str, np.ndarray]]:
    """What typed terms shift at each row: {`PLACE` and entry: padded rows}, and {what of the simulator's readings: (rows,)}, SI.

    Raises BenchInputError where the test lacks the column that a term follows.
    """
    entries: dict[str, np.ndarray] = {}
    read: dict[str, np.ndarray] = {}
    for term in terms:
        try:
            own, more = entry_shifts(term, test, states), reading_shifts(term, test, states)
        except ValueError:
            raise BenchInputError(
                f"the model's term makes {term.place} go with {term.variable}, which needs the column "
                f'"time"; add it, or take the term out of the model',
                file=test.path,
            ) from None
        for entry, moved in own.items():
            entries[f"{PLACE}{entry}"] = entries.get(f"{PLACE}{entry}", 0.0) + moved
        for reading, shift in more.items():
            read[reading] = read.get(reading, 0.0) + shift
    return {entry: pad(values) for entry, values in entries.items()}, read


def require_columns(model: Model, test: TestRecord) -> None:
    """Raise BenchInputError where an effect of the model needs a column that the test does not have."""
    for name in acting_effects(model):
        info = effect_info(name)
        lacks = ("time" in info.needs and test.time is None) or ("rate" in info.needs and test.rate is None)
        if test.name in info.shows and lacks:
            raise BenchInputError(
                f'the model has a {name}, which needs the time of every row: add the column "time", or take the effect '
                "out of the model",
                file=test.path,
            )


# What a test reads where the record itself says nothing of it.
READINGS = {
    "leakage": ("leakage_flow",),
    "pressure_gain": ("load_pressure",),
    "flow_gain": ("flow",),
    "load_flow": ("flow",),
}


@quickly
def readings_behind(
    instrument: AbstractReadingEffect, channel: str, columns: Float[Array, "columns rows"], read: Conditions, oil: Oil
) -> tuple[Float[Array, "columns rows"], Float[Array, " rows"]]:
    """Readings (first) and their derivatives (the others) behind a filter, and the derivative to its own amount.

    A filter is linear in the reading and lets constants pass, so it may come after the meter's scale and offset.
    """

    def passed(value: Float[Array, " rows"], amount: Float[Array, ""]) -> Float[Array, " rows"]:
        own = eqx.tree_at(lambda e: e.amount, instrument, amount)
        return own.reading(channel, value, read, read, oil)

    behind = jax.vmap(lambda column: passed(column, instrument.amount))(columns)
    one = jnp.ones_like(instrument.amount)
    return behind, jax.jvp(lambda amount: passed(columns[0], amount), (instrument.amount,), (one,))[1]


@dataclass(frozen=True)
class Simulation(Result):
    """What `simulate` predicts.

    tables: {test: the record's columns with `<reading>_predicted [unit]` and `<reading>_predicted_std [unit]` added, and
    `outside_fitted_range` where any of its rows lies outside}. notes: what the user must know, in sentences. outside: the
    rows meant there. record: whose rows they are.
    """

    _command: ClassVar[str] = "simulate"

    tables: dict[str, pd.DataFrame]
    notes: tuple[str, ...] = ()
    outside: tuple[Outside, ...] = field(default=())
    record: BenchRecord | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is unusual about the record, and the notes."""
        return (*(() if self.record is None else self.record.warnings), *self.notes)

    def to_dict(self) -> dict[str, Any]:
        """{test: {column with its unit: values}}, "notes", and "outside_fitted_range": bench units, as the headers say."""
        return simulation_json(self.tables, self.notes, self.outside)

    def to_dataframe(self) -> pd.DataFrame:
        """The tables of all tests below one another, with a column "test" before theirs; bench units, as the headers say."""
        return pd.concat(dict(self.tables), names=["test", "row"]).reset_index("test").reset_index(drop=True)

    def print_on(self, console: Console) -> None:
        console.print(simulation_table(self.tables))
        for line in note_lines(self.warnings):
            console.print(line)

    def figures(self) -> dict[str, Figure]:
        """None: a prediction is drawn beside the readings of a fit."""
        return {}

    def save(self, folder: str | Path) -> list[Path]:
        """A CSV per test, all or none. Raises BenchInputError where one would replace the record's own, OSError."""
        if self.record is not None:
            spare_the_record(self.record, Path(folder))
        return super().save(folder)

    def _files(self) -> dict[str, bytes | str]:
        return simulation_files(self.tables)

    def _of(self) -> str:
        return "" if self.record is None else self.record.source


def predict_test(model: Model, record: BenchRecord, test: TestRecord) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """{channel: (reading, standard deviation)} for each row of a test, SI units.

    The deviation is that of the parameters and amounts in the model's covariance, and of the coefficients of typed terms; smooth
    terms count as known. Raises
    BenchInputError where the model has an effect or a learned term that needs a column which the test does not have.
    """
    channels = tuple(channel.name for channel in test.channels) or READINGS[test.name]
    require_columns(model, test)
    free = model.free if model.covariance is not None else ()
    acting = acting_effects(model)
    filters = sorted(
        (name for name in acting if not effect_info(name).rowwise and not effect_info(name).stores),
        key=lambda name: effect_info(name).effect_class.order,
    )
    rowwise = tuple(name for name in free if name not in filters and name not in model.sensors)
    valve = valve_without_effects(model, record)
    values = jnp.asarray([model.value(name) for name in rowwise], dtype=float)
    amounts = {name: jnp.asarray(amount) for name, amount in acting.items() if name not in filters}
    smooth = row_terms(model, test)
    ask = lambda more, wanted: predicted_in_pieces(valve, rowwise, values, amounts, smooth | more, test, wanted)
    columns, of_terms = _with_typed_terms(model, test, channels, ask)
    free, covariance = (*free, *of_terms), model.joint_covariance()
    out: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for name in channels:
        slope = dict(zip(("", *rowwise), columns[name], strict=True))  # the reading itself under no name
        slope |= {coefficient: by[name] for coefficient, by in of_terms.items()}
        for filter_ in filters:
            slope = _behind(filter_, acting[filter_], slope, name, test, valve.oil)
        slope = as_read(slope, model, test, name)
        out[name] = (
            slope[""],
            _deviation([slope.get(n, np.zeros(test.rows)) for n in free], covariance, test.rows),
        )
    return out


PASSES = 2  # that variables made of the model's own pressures and flows are counted anew
STEP = 1e-3  # of a coefficient, or of its standard error: a difference for its derivative


def _with_typed_terms(
    model: Model,
    test: TestRecord,
    channels: tuple[str, ...],
    ask: Callable[[dict[str, Array], tuple[str, ...]], dict[str, np.ndarray]],
) -> tuple[dict[str, np.ndarray], dict[str, dict[str, np.ndarray]]]:
    """Readings and slopes of a test with the model's typed terms, and {coefficient: {channel: (rows,)}} by differences.

    ask(shifts, names): `predicted_in_pieces` with these shifts of places, of these readings of the simulator.
    """
    terms = tuple(term for term in model.learned if isinstance(term, TypedTerm))
    if not terms:
        return ask({}, channels), {}
    wanted = ("leakage_flow", "supply_flow", "pressure_a", "pressure_b") if test.name in BLOCKED else ("flow",)
    thin = of_the_oil(model.oil, test.temperature)
    states_of = lambda more: {test.name: {n: found[0] for n, found in ask(more, wanted).items()} | thin}
    states = states_of({})
    for _ in range(PASSES):
        states = states_of(place_shifts(terms, test, states)[0])

    def with_terms(terms: tuple[TypedTerm, ...]) -> dict[str, np.ndarray]:
        entries, read = place_shifts(terms, test, states)
        columns = ask(entries, channels)
        for name in channels:
            columns[name][0] += read.get(read_as(test, name), 0.0)
        return columns

    columns, slopes = with_terms(terms), {}
    for i, term in enumerate(terms):
        if model.covariance is None or not term.covariance:
            continue
        for k, name in enumerate(coefficient_names(i, term)):
            step = STEP * max(abs(term.coefficients[k]), np.sqrt(term.covariance[k][k])) or 1.0
            moved = replace(term, coefficients=tuple(c + step * (j == k) for j, c in enumerate(term.coefficients)))
            beside = with_terms((*terms[:i], moved, *terms[i + 1 :]))
            slopes[name] = {channel: (beside[channel][0] - columns[channel][0]) / step for channel in channels}
    return columns, slopes


def _behind(
    name: str, amount: float, columns: dict[str, np.ndarray], channel: str, test: TestRecord, oil: Oil
) -> dict[str, np.ndarray]:
    """A channel's reading and derivatives behind a filter, its own derivative added."""
    if test.name not in effect_info(name).shows:
        return {**columns, name: np.zeros(test.rows)}
    padded = jnp.stack([pad(column) for column in columns.values()])
    read = conditions_of(replace(test, nodes=None))  # of a reduced log it acts on the means
    passed, own = readings_behind(effect(name, amount), channel, padded, read, oil)
    found = zip(columns, np.asarray(passed)[:, : test.rows], strict=True)
    return {**dict(found), name: np.asarray(own)[: test.rows]}


def _deviation(slopes: list[np.ndarray], covariance: np.ndarray | None, rows: int) -> np.ndarray:
    if not slopes or covariance is None:
        # Without a covariance nothing is known of the error, which is not the same as no error.
        return np.full(rows, np.nan)
    jacobian = np.stack(slopes)
    return np.sqrt(np.maximum(np.einsum("ir,ij,jr->r", jacobian, covariance, jacobian), 0.0))


def simulate_record(
    record: BenchRecord, model: Model, *, progress: Callable[[str], None] | None = None
) -> dict[str, pd.DataFrame]:
    """The tables of `simulate`."""
    return simulate(record, model, progress=progress).tables


def simulate(record: BenchRecord, model: Model, *, progress: Callable[[str], None] | None = None) -> Simulation:
    """Predict each row of a record, with the oil and the geometry that the record states.

    Rows of a raw log are predicted where its smooth sweep is, at that sweep's rate and direction. Standard deviations are
    those of the parameters; rows outside what was fitted are named. Raises BenchInputError, RuntimeError in single precision.
    """
    require_float64("simulate")
    require_actuator(model, record)
    say = progress or (lambda _: None)
    model, notes = as_in_record(model, record)
    static = as_static(model)
    told = [*notes]
    tables: dict[str, pd.DataFrame] = {}
    for test in record.static_tests.values():
        say(f"simulating {test.name}: {test.rows:,} rows")
        turned = reversed_channels(test)
        told += [warning_of(test, channel) for channel in turned]
        smooth = smooth_sweep(test)
        if smooth.spool_position is not test.spool_position or smooth.load_pressure is not test.load_pressure:
            told.append(f"{test.name}: a raw log, so position, direction and rate are those of its smooth sweep")
        table = pd.DataFrame(index=range(test.rows)) if test.table is None else test.table.copy()
        for name, (reading, std) in predict_test(static, record, smooth).items():
            unit = reading_unit(name, signal_of_reading(test, name)).label
            # Beside a gauge that the record shows to be wired the other way round, the prediction turns with it.
            table[f"{name}_predicted [{unit}]"] = from_si(-reading if name in turned else reading, unit)
            table[f"{name}_predicted_std [{unit}]"] = from_si(std, unit)
            if lost := int(np.sum(np.isnan(reading))):
                told.append(
                    f"{test.name}: {lost:,} of {test.rows:,} rows have no prediction: no steady state was found there"
                )
        tables[test.name] = table
    if record.dynamic_tests:
        tables |= _dynamic_tables(record, model, say)
    beyond = outside(model, record)
    for name in dict.fromkeys(entry.test for entry in beyond):
        tables[name][COLUMN] = names_of_rows(beyond, name, len(tables[name]))
    return Simulation(tables, (*told, *sentences(beyond, record, model)), tuple(beyond), record)


def _dynamic_tables(record: BenchRecord, model: Model, say: Callable[[str], None]) -> dict[str, pd.DataFrame]:
    from .predict_motion import predict_motion  # a static test does not wait for the solvers of motion

    tests = record.dynamic_tests
    say(f"simulating {', '.join(tests)}")
    tables: dict[str, pd.DataFrame] = {}
    for (name, channel), columns in predict_motion(model, record).items():
        test = tests[name]
        if name not in tables:
            tables[name] = pd.DataFrame(index=range(test.rows)) if test.table is None else test.table.copy()
        unit = unit_of(test, channel)
        for word, values in zip(("predicted", "predicted_std"), columns, strict=True):
            tables[name][f"{channel}_{word} [{unit}]"] = from_si(values, unit)
    return tables
