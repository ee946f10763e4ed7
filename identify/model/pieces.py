"""A log's rows through the simulator, with derivatives: a large one piece by piece, each of which goes on where the last one ended."""

from collections.abc import Iterator
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from thermohyd.conditions import Conditions
from thermohyd.effects.library import classes_of, effect_info, factor_on, with_effects
from thermohyd.effects.row_shifts import SHIFTS, RowShifts
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.static_readings import (
    FIELDS,
    GROUPS,
    STORED_GROUP,
    conditions_of,
    predict,
    read_by,
    with_parameters,
)
from thermohyd.numerics import kept
from thermohyd.port_storage import PortsBefore
from thermohyd.static_tests import blocked_port_readings_after
from thermohyd.valve import Valve

from .learned_terms import ABSOLUTE


# Rows per evaluation: large logs are predicted piece by piece, so that what the balances need of memory stays flat.
CHUNK = 16384
ENDS = "pressures at the end"
PLACE = "place "  # before an entry of a typed term, among the terms of a row


class PieceBefore(eqx.Module):
    """How a piece of a long log ended whose ports store oil: their pressures [Pa], and the derivatives of these to what is free.
    Nothing is known before the first piece, nor where no pressures were found: the next one then starts steady."""

    pressure: Float[Array, "2"]
    slopes: Float[Array, "2 free"]
    known: Bool[Array, ""]


def with_terms(valve: Valve, terms: dict[str, Float[Array, " rows"]]) -> Valve:
    """The valve with learned changes of its quantities, and shifts of its places, one per row."""
    rows = next((len(change) for quantity, change in terms.items() if quantity.startswith(PLACE)), None)
    if rows is not None:
        shifts = [terms.get(f"{PLACE}{entry}", jnp.zeros(rows)) for entry in SHIFTS]
        valve = replace(valve, effects=(*valve.effects, RowShifts(jnp.stack(shifts))))
    for quantity, change in terms.items():
        if quantity.startswith(PLACE):
            continue
        factor = factor_on(quantity)
        if factor is not None:
            valve = with_effects(valve, {factor: change - 1.0})
            continue
        own = getattr(valve, quantity)
        changed = own + change if quantity in ABSOLUTE else own * change
        valve = with_parameters(valve, (quantity,), changed[None])
    return valve


def moved_by(terms: dict[str, Float[Array, " rows"]], read: Conditions) -> Conditions:
    """The operating points with what terms shift of them."""
    own = {field: terms[f"{PLACE}{field}"] for field in FIELDS.values() if f"{PLACE}{field}" in terms}
    return replace(read, **{field: getattr(read, field) + shift for field, shift in own.items()}) if own else read


@kept
def readings_and_slopes(
    valve: Valve,
    free: tuple[str, ...],
    values: Float[Array, " free"],
    amounts: dict[str, Array],
    classes: tuple[type, ...],
    terms: dict[str, Array],
    conditions: dict[str, Conditions],
    before: PieceBefore | None = None,
) -> tuple[dict, dict]:
    """Every channel's readings, and their derivatives to the free parameters and amounts (one row per reading).

    amounts: of every effect that acts row by row, the free ones too. classes: those behind their names, on which a compiled
    program depends too. terms: see `row_terms`. before: of one test whose ports store oil; what the next piece begins with then
    stands beside the test, under `ENDS`.
    """
    del classes

    def of(v: Float[Array, " free"]) -> dict:
        changed = {name: v[i] for i, name in enumerate(free)}
        own = tuple(name for name in free if name not in amounts)
        of_parameters = with_parameters(valve, own, jnp.stack([changed[name] for name in own])) if own else valve
        of_effects = with_effects(of_parameters, {name: changed.get(name, a) for name, a in amounts.items()})
        of_rows = with_terms(of_effects, terms)
        at = {test: moved_by(terms, read) for test, read in conditions.items()}
        if before is None:
            return predict(of_rows, at)
        (test,) = conditions
        begun = PortsBefore(before.pressure + before.slopes @ (v - values), before.known)
        readings, ends = blocked_port_readings_after(of_rows, at[test], begun)
        return {test: readings, ENDS: {"pressure": ends}}

    if not free:
        found = of(values)
        return found, jax.tree.map(lambda a: a[:, None][:, :0], found)
    return of(values), jax.jacfwd(of)(values)


Piece = tuple[Conditions, dict[str, Array]]


def _pieces(test: TestRecord, terms: dict[str, Array], shared: int) -> Iterator[tuple[slice, Piece]]:
    """The rows of each piece with the conditions and terms of these and, of all pieces but the first, of so many before them."""
    whole = conditions_of(test), terms
    if test.rows <= CHUNK:
        yield slice(0, test.rows), whole
        return
    last = 0
    while last < test.rows:
        first = max(last - shared, 0)
        index = jnp.minimum(jnp.arange(first, first + CHUNK), test.rows - 1)
        rows = slice(last, min(first + CHUNK, test.rows))
        yield rows, jax.tree.map(lambda a, index=index: a[index], whole)
        last = rows.stop


def predicted_in_pieces(
    valve: Valve,
    free: tuple[str, ...],
    values: Float[Array, " free"],
    amounts: dict[str, Array],
    terms: dict[str, Array],
    test: TestRecord,
    channels: tuple[str, ...],
) -> dict[str, np.ndarray]:
    """{channel: its readings, then their derivatives to what is free: (1 + free, rows)}; see `readings_and_slopes`."""
    columns = {name: np.empty((1 + len(free), test.rows)) for name in channels}
    before, shared = None, 0
    if test.rows > CHUNK and test.name in GROUPS[STORED_GROUP] and any(effect_info(name).stores for name in amounts):
        before = PieceBefore(jnp.zeros(2), jnp.zeros((2, len(free))), jnp.asarray(False))
        shared = 1
    for rows, (conditions, own) in _pieces(test, terms, shared):
        found, slopes = readings_and_slopes(
            valve, free, values, amounts, classes_of(amounts), own, {test.name: conditions}, before
        )
        skipped = min(shared, rows.start)
        new = slice(skipped, skipped + rows.stop - rows.start)
        for name in channels:
            columns[name][0, rows] = np.asarray(found[test.name][read_by(test, name)])[new]
            columns[name][1:, rows] = np.asarray(slopes[test.name][read_by(test, name)])[new].T
        if before is not None:
            ends, by = found[ENDS]["pressure"], slopes[ENDS]["pressure"]
            before = PieceBefore(ends, by, jnp.isfinite(ends).all() & jnp.isfinite(by).all())
    return columns
