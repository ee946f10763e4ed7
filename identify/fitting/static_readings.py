"""The static tests of a record as one differentiable function of the parameters, and the whitened residuals that a fit minimises.

Rows are padded to a few sizes (pads weigh nothing), so that records of similar length share one compiled program.
Leakage and pressure gain are the same balance of blocked ports: their rows run through it together. Residuals of every
channel come first, then the priors.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.identify.bench.record import BenchRecord, at_first_row
from thermohyd.identify.bench.test_record import Channel, TestRecord
from thermohyd.numerics import quickly
from thermohyd.oil import oil_from_definition
from thermohyd.port_storage import StoredPorts
from thermohyd.ports import Joined
from thermohyd.static_tests import (
    blocked_port_readings,
    control_flow,
    load_flow,
    stored_port_rows,
    unloaded_readings,
)
from thermohyd.valve import Valve, coupling

from .row_sizes import padded_size
from .sensed import sensed


# The tests by the balance of the ports that they share.
STORED_GROUP = "blocked"  # whose ports may store oil
GROUPS = {STORED_GROUP: ("leakage", "pressure_gain"), "flow_gain": ("flow_gain",), "load_flow": ("load_flow",)}
# What the rows of any test are called in a compiled program: those of a test without a load go through one balance, and a program of
# that serves every such test, whose rows read what they are asked for.
UNLOADED, LOADED = "leakage", "load_flow"
READ_AT = {
    UNLOADED: ("leakage_flow", "supply_flow", "pressure_a", "pressure_b", "load_pressure", "flow"),
    LOADED: ("flow",),
}
JOINED = ("flow_gain",)  # tests whose use ports are connected
# The tests whose rows go through one balance where their ports store no oil, by what their rows are called.
BALANCES = {UNLOADED: (*GROUPS[STORED_GROUP], *JOINED), LOADED: (LOADED,)}


def rows_called(test: str) -> str:
    """Which of `READ_AT` the rows of a test are."""
    return next(name for name, tests in BALANCES.items() if test in tests)


def read_in(test: str) -> tuple[str, ...]:
    """What the rows of a test can read."""
    return ("flow",) if test in (*JOINED, LOADED) else tuple(name for name in READ_AT[UNLOADED] if name != "flow")


class SensorOfRows(eqx.Module):
    """A channel's sensor: reading = (quantity/gain + zero - reference_zero) reference (`sensed.Sensed`).

    gain: name of a parameter, or "" where the gain is the reference; zeros: names, each of the rows of its mask, or none: `zero`.
    """

    gain: str = eqx.field(static=True)
    zeros: tuple[str, ...] = eqx.field(static=True)
    masks: Float[Array, "zeros padded"]
    reference: Float[Array, ""]
    reference_zero: Float[Array, ""]
    zero: Float[Array, ""]

    def readings(
        self, values: dict[str, Float[Array, ""]], quantity: Float[Array, " padded"]
    ) -> tuple[Float[Array, " padded"], dict[str, Float[Array, " padded"]]]:
        """(the readings, their derivatives to the sensor's own parameters)."""
        factor = self.reference / values[self.gain] if self.gain else jnp.ones(())
        slopes = {self.gain: -factor / values[self.gain] * quantity} if self.gain else {}
        shift = self.reference * ((self.zero if not self.zeros else 0.0) - self.reference_zero)
        for name, mask in zip(self.zeros, self.masks, strict=True):
            shift = shift + self.reference * values[name] * mask
            slopes[name] = self.reference * mask
        return factor * quantity + shift, slopes


class ChannelRows(eqx.Module):
    """One channel's readings: padded values [SI] and weights, 1/standard deviation; a pad weighs 0."""

    test: str = eqx.field(static=True)
    name: str = eqx.field(static=True)
    reads: str = eqx.field(static=True)  # what of the simulator's readings it is
    value: Float[Array, " padded"]
    weight: Float[Array, " padded"]
    sensor: SensorOfRows | None = None


class StaticData(eqx.Module):
    """The conditions of every test and the readings beside them.

    weights: of a test whose readings are means over bins, {test: (padded, nodes)}; its conditions then have one entry per
    node, the nodes of a reading behind one another.
    """

    conditions: dict[str, Conditions]
    channels: tuple[ChannelRows, ...]
    weights: dict[str, Float[Array, "padded nodes"]]

    def means(self, test: str, values: Float[Array, "*columns rows"]) -> Float[Array, "*columns padded"]:
        """The model's values at a test's operating points, averaged as its readings are."""
        weight = self.weights.get(test)
        return values if weight is None else mean_over_nodes(values, weight)


def mean_over_nodes(
    values: Float[Array, "*columns rows"], weight: Float[Array | np.ndarray, "padded nodes"]
) -> Float[Array, "*columns padded"]:
    """Weighted means of the nodes of every reading."""
    return jnp.sum(values.reshape(*values.shape[:-1], *weight.shape) * weight, axis=-1)


Size = Callable[[int], int]


def pad(values: np.ndarray, fill: float | None = None, size: Size = padded_size) -> Array:
    """Pad with `fill`, by default with the last row, whose operating point is known to be sound."""
    missing = size(len(values)) - len(values)
    tail = np.full(missing, values[-1] if fill is None else fill, dtype=float)
    return jnp.asarray(np.concatenate([np.asarray(values, dtype=float), tail]))


# Columns that a bench may read wrong, and what `Conditions` calls them.
FIELDS = {"spool_position": "position", "supply_pressure": "supply_pressure", "temperature": "temperature"}


def _column(test: TestRecord, name: str, size: Size) -> Array:
    """A test's column, padded; of a reduced log at the nodes of every point behind one another."""
    values, nodes = getattr(test, name), test.nodes
    if nodes is None:
        return pad(values, size=size)
    spread = np.repeat(np.asarray(values, dtype=float)[:, None], nodes.count, axis=1)
    offset = nodes.time if name == "time" else nodes.offset if name == nodes.axis else None
    spread = spread if offset is None else spread + offset
    missing = size(len(values)) - len(values)
    return jnp.asarray(np.concatenate([spread, np.repeat(spread[-1:], missing, axis=0)]).ravel())


def conditions_of(test: TestRecord, size: Size = padded_size) -> Conditions:
    """A test's operating points."""
    column = lambda name: None if getattr(test, name) is None else _column(test, name, size)
    return Conditions(
        position=_column(test, "spool_position", size),
        supply_pressure=_column(test, "supply_pressure", size),
        temperature=_column(test, "temperature", size),
        return_pressure=_column(test, "return_pressure", size),
        load_pressure=column("load_pressure"),
        time=column("time"),
        direction=_column(test, "direction", size),
        run=_column(test, "run", size),
        rate=column("rate"),
    )


def with_columns(conditions: Conditions, test: TestRecord, names: Iterable[str], size: Size) -> Conditions:
    """A test's operating points with these columns, of FIELDS, read anew; the others stay."""
    return replace(conditions, **{FIELDS[name]: _column(test, name, size) for name in names})


def row_weights(test: TestRecord, size: Size = padded_size) -> Array | None:
    """Weights of a reduced log's nodes, padded; None where every reading is a row."""
    if test.nodes is None:
        return None
    missing = size(test.rows) - test.rows
    return jnp.asarray(np.concatenate([test.nodes.weight, np.repeat(test.nodes.weight[-1:], missing, axis=0)]))


def base_valve(record: BenchRecord, parameters: Mapping[str, float], heat: bool = False) -> Valve:
    """The valve of a record with the given parameters; `heat` computes heat retention even where it starts at 0."""
    numbers = dict(parameters)
    eta = numbers.pop("heat_retention", 0.0)
    body = at_first_row(record.valve, record.tests)
    return Valve(
        oil=oil_from_definition(record.oil),
        stroke=record.valve.stroke,
        slot_width=record.valve.slot_width,
        heat_retention=jnp.asarray(eta) if heat or eta > 0.0 else None,
        land_diameter=None if record.valve.land_diameter is None else jnp.asarray(record.valve.land_diameter),
        null_pressure=body.null_pressure,
        edge_law=record.valve.edge_law,
        **numbers,  # pyright: ignore[reportArgumentType]  # names checked against Valve's fields by plan_parameters
    )


def with_parameters(valve: Valve, names: tuple[str, ...], values: Sequence[Array] | Float[Array, "free ..."]) -> Valve:
    """The valve with some of its parameters replaced; one number each, or one per row of a test."""
    if not names:
        return valve
    return eqx.tree_at(lambda v: [getattr(v, name) for name in names], valve, [values[i] for i in range(len(names))])


def _joined(parts: list[Conditions]) -> Conditions:
    """Rows of several tests behind one another; a column that only some have is left out (none of them needs it)."""

    def column(name: str) -> Array | None:
        arrays = [getattr(part, name) for part in parts]
        return None if any(a is None for a in arrays) else jnp.concatenate(arrays)

    def given(name: str) -> Array:
        return jnp.concatenate([getattr(part, name) for part in parts])

    # Runs of different tests must not look like one sweep.
    runs = [part.run + 1000.0 * i for i, part in enumerate(parts) if part.run is not None]
    return Conditions(
        position=given("position"),
        supply_pressure=given("supply_pressure"),
        return_pressure=given("return_pressure"),
        temperature=given("temperature"),
        time=column("time"),
        direction=column("direction"),
        run=jnp.concatenate(runs) if len(runs) == len(parts) else None,
        rate=column("rate"),
    )


def groups_of(
    conditions: dict[str, Conditions], table: Mapping[str, tuple[str, ...]] = GROUPS
) -> dict[str, tuple[str, ...]]:
    """Tests that are solved together, by the name of the balance that they share, in the order of the table."""
    found = {group: tuple(test for test in tests if test in conditions) for group, tests in table.items()}
    return {group: tests for group, tests in found.items() if tests}


def group_rows(conditions: dict[str, Conditions], tests: tuple[str, ...]) -> int:
    """Padded rows (or nodes) of a group's tests, behind one another."""
    return sum(conditions[test].position.shape[0] for test in tests)


# One array for each entry of a vector. Of a matrix the reverse pass would make one of zeros for every entry that is picked from
# it, and add them all up: that took three quarters of an evaluation with the whole library.
Rows = tuple[Float[Array, " rows"], ...]


def spread_over_rows(
    values: Float[Array, " all"], conditions: dict[str, Conditions], groups: dict[str, tuple[str, ...]] | None = None
) -> dict[str, Rows]:
    """The values beside every row of each group of tests, by default of `groups_of`."""
    return {
        group: tuple(jnp.broadcast_to(value, (group_rows(conditions, tests),)) for value in values)
        for group, tests in (groups or groups_of(conditions)).items()
    }


def stacked(spread: dict[str, Rows]) -> dict[str, Float[Array, "all rows"]]:
    """The same with one matrix for each group."""
    return {group: jnp.stack(rows) for group, rows in spread.items()}


def predict_group(
    valve: Valve,
    group: str,
    tests: tuple[str, ...],
    conditions: dict[str, Conditions],
    joined: Joined | None = None,
) -> dict[str, dict[str, Float[Array, " padded"]]]:
    """{test: {channel: readings}} of one group, node by node where a test has nodes.

    Parameters of the valve may have one entry per row of the group. joined: of rows that any test without a load may have, with all
    that one of these reads (`unloaded_readings`).
    """
    if group == "flow_gain":
        return {group: {"flow": control_flow(valve, conditions[group])}}
    if group == "load_flow":
        return {group: {"flow": load_flow(valve, conditions[group])}}
    rows = _joined([conditions[test] for test in tests])
    found = blocked_port_readings(valve, rows) if joined is None else unloaded_readings(valve, rows, joined)
    return _by_test(found, tests, conditions)


def predict_stored(
    valve: Valve, tests: tuple[str, ...], conditions: dict[str, Conditions], push: Float[Array, "2 rows"]
) -> tuple[dict[str, dict[str, Float[Array, " padded"]]], StoredPorts]:
    """The blocked tests' readings with every row by itself, and what ties their rows together (`stored_port_rows`)."""
    readings, stored = stored_port_rows(valve, _joined([conditions[test] for test in tests]), push)
    return _by_test(readings, tests, conditions), stored


def _by_test(
    readings: dict[str, Float[Array, " rows"]], tests: tuple[str, ...], conditions: dict[str, Conditions]
) -> dict[str, dict[str, Float[Array, " padded"]]]:
    found: dict[str, dict[str, Array]] = {}
    first = 0
    for test in tests:
        last = first + conditions[test].position.shape[0]
        found[test] = {channel: value[first:last] for channel, value in readings.items()}
        first = last
    return found


def predict_balance(
    valve: Valve, tests: tuple[str, ...], conditions: dict[str, Conditions]
) -> dict[str, dict[str, Float[Array, " padded"]]]:
    """`predict_group` of all tests that share one of the `BALANCES`."""
    if tests == BALANCES[LOADED]:
        return predict_group(valve, LOADED, tests, conditions)
    rows = _joined([conditions[test] for test in tests])
    joined = [np.full(len(conditions[test].position), test in JOINED) for test in tests]
    return _by_test(unloaded_readings(valve, rows, jnp.asarray(np.concatenate(joined))), tests, conditions)


def predict(valve: Valve, conditions: dict[str, Conditions]) -> dict[str, dict[str, Float[Array, " padded"]]]:
    """Readings of every test at its padded operating points, not averaged over nodes: {test: {channel: values [SI]}}."""
    found: dict[str, dict[str, Array]] = {}
    if coupling(valve).storage:  # a row of a blocked test is then of the rows before it, too
        for group, tests in groups_of(conditions).items():
            found |= predict_group(valve, group, tests, conditions)
        return found
    for tests in groups_of(conditions, BALANCES).values():
        found |= predict_balance(valve, tests, conditions)
    return found


def weighted_residuals(
    found: dict[str, dict[str, Float[Array, " padded"]]], data: StaticData, values: dict[str, Float[Array, ""]]
) -> Float[Array, " readings"]:
    """(model - reading) / standard deviation, all channels behind one another, in the order of `data.channels`.

    values: of the parameters of sensors, by name.
    """
    parts = []
    for c in data.channels:
        quantity = data.means(c.test, found[c.test][c.reads])
        reading = quantity if c.sensor is None else c.sensor.readings(values, quantity)[0]
        parts.append((reading - c.value) * c.weight)
    return jnp.concatenate(parts)


def static_data(
    tests: dict[str, TestRecord], std: dict[tuple[str, str], np.ndarray], size: Size = padded_size
) -> StaticData:
    """Everything a fit needs of the tests; `std` gives each channel's standard deviations, row by row."""
    channels = tuple(
        ChannelRows(
            test.name,
            channel.name,
            read_by(test, channel.name),
            pad(channel.value, size=size),
            pad(1.0 / std[test.name, channel.name], fill=0.0, size=size),
            _sensor_of(test, channel, size),
        )
        for test in tests.values()
        for channel in test.channels
    )
    weights = {test.name: row_weights(test, size) for test in tests.values()}
    return StaticData(
        {test.name: conditions_of(test, size) for test in tests.values()},
        channels,
        {name: weight for name, weight in weights.items() if weight is not None},
    )


def _sensor_of(test: TestRecord, channel: Channel, size: Size) -> SensorOfRows | None:
    behind = sensed(test, channel)
    if behind is None:
        return None
    s = behind.sensor
    numbers = (jnp.asarray(float(value)) for value in (s.reference, s.reference_zero, s.zero))
    masks = jnp.stack([pad(mask, fill=0.0, size=size) for mask in behind.masks])
    return SensorOfRows(behind.gain, behind.zeros, masks[: len(behind.zeros)], *numbers)


@quickly
def quantities_of(valve: Valve, data: StaticData) -> list[Float[Array, " padded"]]:
    """What every channel's readings are of, before any sensor, in the order of `data.channels`, SI."""
    found = predict(valve, data.conditions)
    return [data.means(c.test, found[c.test][c.reads]) for c in data.channels]


def read_by(test: TestRecord, channel: str) -> str:
    """The name of a channel's readings in the simulator: a leakage may be read in the supply line."""
    return "supply_flow" if channel == "leakage_flow" and test.meter == "supply" else channel


def channel_slices(tests: Mapping[str, TestRecord], size: Size = padded_size) -> dict[tuple[str, str], slice]:
    """Where each channel's rows lie in the residual vector, pads left out."""
    slices: dict[tuple[str, str], slice] = {}
    first = 0
    for test in tests.values():
        for channel in test.channels:
            slices[test.name, channel.name] = slice(first, first + test.rows)
            first += size(test.rows)
    return slices
