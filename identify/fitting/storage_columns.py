"""What oil stored at the blocked ports would do to the readings of a model that stores none: derivatives and finite amounts.

A search asks that of every record, and a program that fits stored oil takes as long to compile as all the others that most
records need. This one goes forward only: to any amounts by Newton's method, and once more for the derivatives to them.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.effects.library import classes_of, with_effects
from thermohyd.identify.noise.whitening import whiten
from thermohyd.kept_programs import made_once
from thermohyd.numerics import OPTIONS, jitted, known_options

from .library_program import LibraryArgs, filtered, rowwise_valve, split
from .static_readings import STORED_GROUP, groups_of, predict_group, spread_over_rows


def storage_columns(
    effects: tuple[str, ...],
    stored: tuple[str, ...],
    p: Float[Array | np.ndarray, " all"],
    amounts: Float[Array | np.ndarray, " stored"],
    args: LibraryArgs,
) -> tuple[Float[Array, " residuals"], Float[Array, "stored residuals"]]:
    """Whitened residuals with these amounts stored, and their derivatives to the amounts; 0 where ports are not blocked.

    effects: of the model, none of which stores oil or ties the ports together; p: in the order of `order_of(effects)`.
    Compiled once per set of names and shapes.
    """
    return _compiled(effects, stored, classes_of((*effects, *stored)))(jnp.asarray(p), jnp.asarray(amounts), args)


@made_once
def _compiled(effects: tuple[str, ...], stored: tuple[str, ...], classes: tuple[type, ...]) -> Any:
    return jitted(functools.partial(columns_of_stored, effects, stored), known_options(OPTIONS), classes)


def columns_of_stored(
    effects: tuple[str, ...], stored: tuple[str, ...], p: Array, amounts: Array, args: LibraryArgs
) -> tuple[Array, Array]:
    """`storage_columns`, not compiled."""
    data, filters = args.data, split(effects)[1]
    entries = len(p) - len(filters)
    tests = groups_of(data.conditions)[STORED_GROUP]
    values = spread_over_rows(p[:entries], data.conditions)[STORED_GROUP]
    valve = rowwise_valve(effects, STORED_GROUP, values, args)

    def blocked(amounts: Array) -> dict[str, dict[str, Array]]:
        storing = with_effects(valve, dict(zip(stored, amounts, strict=True)))
        return predict_group(storing, STORED_GROUP, tests, data.conditions)

    found, push = jax.linearize(blocked, amounts)
    moved = jax.vmap(push)(jnp.eye(len(stored)))
    parts, columns = [], []
    for whitening, channel in zip(args.whitening, data.channels, strict=True):
        if channel.test not in tests:
            parts.append(jnp.zeros_like(channel.value))
            columns.append(jnp.zeros((len(stored), channel.value.shape[0])))
            continue
        reading, column = found[channel.test][channel.reads], moved[channel.test][channel.reads]
        for name, amount in zip(filters, p[entries:], strict=True):
            reading, column = filtered(name, amount, channel, reading, column, args)
            column = column[:-1]  # without that of the filter
        reading, column = data.means(channel.test, reading), data.means(channel.test, column)
        parts.append(whiten(whitening, (reading - channel.value) * channel.weight))
        columns.append(whiten(whitening, column * channel.weight))
    return jnp.concatenate(parts), jnp.concatenate(columns, axis=1)
