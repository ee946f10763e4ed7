"""Readings of a record's static tests with every effect of a library present, from parameters and amounts given row by row.

A fit of some effects holds the others at 0 (an effect at its neutral value changes nothing), so that all refits of a search share
their compiled programs: `row_blocks` evaluates some hundred rows at a time, `stored_programs` a whole test whose ports store oil.
"""

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from thermohyd.conditions import Conditions
from thermohyd.effects.library import EFFECTS, effect, effect_info, factor_on, with_effects
from thermohyd.effects.row_shifts import SHIFTS, RowShifts
from thermohyd.identify.fitting.parameters import PARAMETERS
from thermohyd.identify.fitting.static_readings import (
    FIELDS,
    JOINED,
    READ_AT,
    STORED_GROUP,
    ChannelRows,
    Rows,
    StaticData,
    groups_of,
    predict_group,
    predict_stored,
    rows_called,
    spread_over_rows,
    with_parameters,
)
from thermohyd.identify.noise.whitening import Whitening, whiten
from thermohyd.port_storage import StoredPorts
from thermohyd.ports import Joined
from thermohyd.valve import Valve


class RowTerms(eqx.Module):
    """Learned terms, row by row of a group of tests: parameter = fitted factor + shift, viscosity times `viscosity`.

    places: shifts of `ENTRIES`; None where the model has no term of a place and nobody asks what one would do.
    """

    factor: Float[Array | np.ndarray, "parameters rows"]
    shift: Float[Array | np.ndarray, "parameters rows"]
    viscosity: Float[Array | np.ndarray, " rows"]
    places: Float[Array | np.ndarray, "entries rows"] | None = None


class LibraryArgs(eqx.Module):
    """Data of the problem; `valve` gives what is neither a parameter nor an effect."""

    valve: Valve
    data: StaticData
    whitening: tuple[Whitening, ...]  # one per channel
    terms: dict[str, RowTerms]  # by group


def order_of(effects: tuple[str, ...]) -> tuple[str, ...]:
    """Names of the entries of the vector of a program with these effects: parameters, row-wise effects, then the filters."""
    rowwise, filters = split(effects)
    return PARAMETERS + rowwise + filters


def split(effects: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """(those that act row by row, those along a run: filters such as a meter's lag, in the order in which they act).

    Oil stored at the ports acts row by row as far as amounts go; what a row hands on to the next is taken along apart.
    """
    infos = {name: effect_info(name) for name in effects}
    filters = [name for name in effects if not infos[name].rowwise and not infos[name].stores]
    return (
        tuple(name for name in effects if name not in filters),
        tuple(sorted(filters, key=lambda name: infos[name].effect_class.order)),
    )


def with_amounts(valve: Valve, names: tuple[str, ...], amounts: Sequence[Float[Array, "..."]]) -> Valve:
    """The valve with the named effects at these amounts; one number each, or one per row of a test."""
    added = with_effects(valve, dict.fromkeys(names, 0.0))
    place = {EFFECTS[name].effect_class: i for i, name in enumerate(names)}
    order = [place[type(effect)] for effect in added.effects]
    return eqx.tree_at(lambda v: [effect.amount for effect in v.effects], added, [amounts[i] for i in order])


def rowwise_valve(effects: tuple[str, ...], group: str, values: Rows, args: LibraryArgs) -> Valve:
    """The valve at the rows of a group, with the learned terms, from parameters and amounts row by row."""
    rowwise, _ = split(effects)
    terms = args.terms[group]
    parameters, amounts = values[: len(PARAMETERS)], values[len(PARAMETERS) :]
    factor = str(factor_on("viscosity"))
    if factor not in rowwise:
        rowwise, amounts = (*rowwise, factor), (*amounts, jnp.zeros_like(values[0]))
    # Without heat (valve.heat_retention None) its entry stands in the vector but nothing depends on it.
    heat = args.valve.heat_retention is not None
    names = PARAMETERS if heat else PARAMETERS[:-1]
    changed = [value * terms.factor[i] + terms.shift[i] for i, value in enumerate(parameters)]
    valve = with_parameters(args.valve, names, changed)
    thicker = rowwise.index(factor)
    thickened = (1.0 + amounts[thicker]) * terms.viscosity - 1.0
    return with_amounts(valve, rowwise, (*amounts[:thicker], thickened, *amounts[thicker + 1 :]))


# Entries of a row behind its parameters and amounts: changes of both port pressures [Pa] where ports store oil, elsewhere of
# what was read of its operating point, in the order of FIELDS (SI). A step of stored oil sees two rows' operating points.
PUSHES, MOVES = 2, len(FIELDS)
# What a term of a model may shift at a row: what was read of its operating point, and the places behind it.
ENTRIES = (*FIELDS.values(), *SHIFTS)


def moved_conditions(
    conditions: dict[str, Conditions], tests: tuple[str, ...], moves: Sequence[Float[Array, " rows"]]
) -> dict[str, Conditions]:
    """The operating points of a group's tests with these changes."""
    found, first = {}, 0
    for test in tests:
        before = conditions[test]
        rows = slice(first, first + before.position.shape[0])
        changed = {field: getattr(before, field) + moves[i][rows] for i, field in enumerate(FIELDS.values())}
        found[test] = replace(before, **changed)
        first = rows.stop
    return found


def behind(effects: tuple[str, ...], args: LibraryArgs) -> int:
    """How many entries of a row stand behind its parameters and amounts."""
    if any(effect_info(name).stores for name in effects):
        return PUSHES
    return MOVES if any(terms.places is None for terms in args.terms.values()) else len(ENTRIES)


def readings_of_rows(
    effects: tuple[str, ...], spread: dict[str, Rows], args: LibraryArgs, joined: Joined | None = None
) -> tuple[dict[str, dict[str, Float[Array, " padded"]]], StoredPorts | None]:
    """{test: {channel: reading}} before any filter and any mean over bins, from parameters and amounts given row by row, and
    what ties the rows of blocked ports together where they store oil. joined: see `predict_group`."""
    rowwise, _ = split(effects)
    storing = any(effect_info(name).stores for name in rowwise)
    found: dict[str, dict[str, Array]] = {}
    stored = None
    for group, tests in groups_of(args.data.conditions).items():
        values, places = spread[group], args.terms[group].places
        count = len(values) - behind(effects, args)
        valve = rowwise_valve(effects, group, values[:count], args)
        conditions = args.data.conditions
        moves = None if storing else values[count : count + MOVES]
        if places is not None:
            shifts = [jnp.asarray(place) for place in places]
            if not storing:
                shifts = [shift + value for shift, value in zip(shifts, values[count:], strict=True)]
            moves = shifts[:MOVES]
            valve = replace(valve, effects=(*valve.effects, RowShifts(jnp.stack(shifts[MOVES:]))))
        if moves is not None:
            conditions = moved_conditions(conditions, tests, moves)
        if storing and group == STORED_GROUP:
            readings, stored = predict_stored(valve, tests, conditions, jnp.stack(values[count:]))
            found |= readings
        else:
            found |= predict_group(valve, group, tests, conditions, joined if group == STORED_GROUP else None)
    return found, stored


class Asked(eqx.Module):
    """What is asked of the rows of a block. reading: 1 for that of what they could read (`READ_AT`), 0 for all else; joined: whether
    the use ports are connected."""

    reading: Float[Array, " kinds"]
    joined: Bool[Array, ""]

    @staticmethod
    def of(test: str, read: str) -> "Asked":
        """One reading of a test."""
        kinds = READ_AT[rows_called(test)]
        return Asked(jnp.asarray([float(kind == read) for kind in kinds]), jnp.asarray(test in JOINED))


def reading_asked(
    effects: tuple[str, ...], rows_of: str, spread: dict[str, Rows], args: LibraryArgs, asked: Asked
) -> tuple[Float[Array, " rows"], dict[str, Float[Array, " rows"]]]:
    """The one reading of a block's rows that is asked for, and all that they could read; rows_of: which of `READ_AT` they are."""
    found = readings_of_rows(effects, spread, args, asked.joined)[0][rows_of]
    return asked.reading @ jnp.stack([found[name] for name in READ_AT[rows_of]]), found


def residual_alone(effects: tuple[str, ...], p: Float[Array, " all"], args: LibraryArgs) -> Float[Array, " residuals"]:
    """Whitened residuals of all channels behind one another; p in the order of `order_of(effects)`, any of which may store oil."""
    data, filters = args.data, split(effects)[1]
    given = len(p) - len(filters)
    whole = jnp.concatenate([p[:given], jnp.zeros(behind(effects, args))])
    found, _ = readings_of_rows(effects, spread_over_rows(whole, data.conditions), args)
    parts = []
    for whitening, channel in zip(args.whitening, data.channels, strict=True):
        reading = found[channel.test][channel.reads]
        for name, amount in zip(filters, p[given:], strict=True):
            reading, _ = filtered(name, amount, channel, reading, jnp.zeros((0, *reading.shape)), args)
        residual = (data.means(channel.test, reading) - channel.value) * channel.weight
        parts.append(whiten(whitening, residual))
    return jnp.concatenate(parts)


def filtered(
    name: str, amount: Array, channel: ChannelRows, reading: Array, columns: Array, args: LibraryArgs
) -> tuple[Array, Array]:
    """A reading and its columns behind a filter, with the column of its own amount added as the last."""
    if channel.test not in effect_info(name).shows:
        return reading, jnp.concatenate([columns, jnp.zeros_like(reading)[None]])
    read = args.data.conditions[channel.test]

    def passed(value: Array, amount: Array) -> Array:
        return effect(name, amount).reading(channel.name, value, read, read, args.valve.oil)

    out, own = jax.jvp(lambda a: passed(reading, a), (amount,), (jnp.ones_like(amount),))
    behind = jax.vmap(lambda column: passed(column, amount))(columns)
    return out, jnp.concatenate([behind, own[None]])
