"""What a shift of each place of the circuit would do to every reading, beside a model of static tests: one forward program.

A search for terms (`diagnosis.typed_terms`) asks that only where a misfit is left, so the program holds no more than the model does:
its effects, not the library's. Forward, all tangents at once, it takes a third of the time to compile that the reverse pass of
`library_program` with places takes, and runs half as fast.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.effects.library import classes_of
from thermohyd.identify.noise.whitening import whiten
from thermohyd.numerics import OPTIONS, jitted, known_options

from .library_program import LibraryArgs, behind, filtered, readings_of_rows, split
from .static_readings import spread_over_rows


def place_program(
    effects: tuple[str, ...],
) -> Callable[[Any, Any], tuple[Array, Array, Array, dict[str, dict[str, Array]]]]:
    """Compiled (p, args) -> `residual_columns_and_places`; p in the order of `order_of(effects)`, args with places."""
    return _program(effects, classes_of(effects))


@functools.cache
def _program(effects: tuple[str, ...], classes: tuple[type, ...]) -> Any:
    del classes
    return jitted(functools.partial(residual_columns_and_places, effects), known_options(OPTIONS))


def residual_columns_and_places(
    effects: tuple[str, ...], p: Float[Array, " all"], args: LibraryArgs
) -> tuple[
    Float[Array, " residuals"],
    Float[Array, "all residuals"],
    Float[Array, "entries residuals"],
    dict[str, dict[str, Float[Array, " padded"]]],
]:
    """Residuals and columns as `library_program` gives them, what a shift of each of `ENTRIES` at a reading's own row does to its
    residual before whitening, and what the model's rows could read: {test: {reading: SI}}. No effect may store oil.
    """
    data, filters = args.data, split(effects)[1]
    given = len(p) - len(filters)
    whole = jnp.concatenate([p[:given], jnp.zeros(behind(effects, args))])

    def of(whole: Float[Array, " entries"]) -> dict[str, dict[str, Array]]:
        found, _ = readings_of_rows(effects, spread_over_rows(whole, data.conditions), args)
        return {test: {n: data.means(test, value) for n, value in own.items()} for test, own in found.items()}

    found, push = jax.linearize(of, whole)
    # A row depends on its own entries alone, so a change of an entry at all rows shows at each what the row's own change does.
    moved = jax.vmap(push)(jnp.eye(len(whole)))
    parts, columns, by_row = [], [], []
    for i, channel in enumerate(data.channels):
        reading, column = found[channel.test][channel.reads], moved[channel.test][channel.reads]
        for name, amount in zip(filters, p[given:], strict=True):
            reading, column = filtered(name, amount, channel, reading, column, args)
        column = column * channel.weight
        parts.append(whiten(args.whitening[i], (reading - channel.value) * channel.weight))
        columns.append(whiten(args.whitening[i], jnp.concatenate([column[:given], column[len(whole) :]])))
        by_row.append(column[given : len(whole)])
    return jnp.concatenate(parts), jnp.concatenate(columns, axis=1), jnp.concatenate(by_row, axis=1), found
