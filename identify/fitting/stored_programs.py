"""Programs of a blocked test whose ports store oil: all its rows at once, as what a row's pressures are follows the row before.

What one is compiled for is a number of rows and what is read: any blocked test of that length runs through it, as each is a balance
of blocked ports and nothing in it asks for the test's name. Weights, noise and filters follow on the host, as they do for `row_blocks`.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.chain_in_time import along_rows
from thermohyd.effects.library import classes_of, with_effects
from thermohyd.kept_programs import KeptProgram, made_once
from thermohyd.numerics import OPTIONS, jitted, known_options
from thermohyd.port_storage import StoredPorts

from .library_rows import MOVES, PUSHES, LibraryArgs, readings_of_rows, rowwise_valve
from .static_readings import STORED_GROUP, UNLOADED, predict_group, spread_over_rows


def stored_program(effects: tuple[str, ...], reads: tuple[str, ...]) -> KeptProgram:
    """`readings_and_slopes_of_stored`, compiled."""
    return _made(readings_and_slopes_of_stored, effects, classes_of(effects), reads)


def stored_readings(effects: tuple[str, ...], reads: tuple[str, ...]) -> KeptProgram:
    """`readings_of_stored`, compiled: for differences, at a third of the cost."""
    return _made(readings_of_stored, effects, classes_of(effects), reads)


@made_once
def _made(
    function: Callable, effects: tuple[str, ...], classes: tuple[type, ...], reads: tuple[str, ...]
) -> KeptProgram:
    """classes: what stands behind the names; a user may put another effect under a name."""
    return jitted(functools.partial(function, effects, reads), known_options(OPTIONS), classes)


def readings_of_stored(
    effects: tuple[str, ...], reads: tuple[str, ...], p: Float[Array, " given"], args: LibraryArgs
) -> Float[Array, "reads rows"]:
    """Of a test's rows, from parameters and amounts of `effects`, which act row by row or store oil."""
    whole = jnp.concatenate([p, jnp.zeros(PUSHES)])
    found, _ = readings_of_rows(effects, spread_over_rows(whole, args.data.conditions), args)
    return jnp.stack([found[UNLOADED][name] for name in reads])


def readings_and_slopes_of_stored(
    effects: tuple[str, ...], reads: tuple[str, ...], p: Float[Array, " given"], args: LibraryArgs
) -> tuple[Float[Array, "reads rows"], Float[Array, "reads entries rows"]]:
    """`readings_of_stored` and slopes to all entries: parameters, amounts, and changes of what was read of the operating point, NaN,
    as a row's pressures follow those that were read at the rows before.

    A reverse pass for each reading says how it follows its row's entries and pressures; one for each port how a row's entries move
    its pressure if the row before stays, and a linear recursion takes that along the sweep.
    """
    given = len(p)
    spread = spread_over_rows(jnp.concatenate([p, jnp.zeros(PUSHES)]), args.data.conditions)

    def of_rows(spread: dict[str, tuple[Array, ...]]) -> tuple[Array, Array, Array]:
        found, stored = readings_of_rows(effects, spread, args)
        assert isinstance(stored, StoredPorts)
        return jnp.stack([found[UNLOADED][name] for name in reads]), stored.source, stored.carried

    (readings, source, carried), push = jax.linearize(of_rows, spread)

    def slopes(of: int, like: Float[Array, "parts rows"]) -> Float[Array, "parts entries rows"]:
        """One pass for each part, all in one under vmap: a pass takes as long to compile as all that goes before it."""
        pull = jax.linear_transpose(lambda moved: push(moved)[of], spread)
        ones = jnp.eye(len(like))[:, :, None] * jnp.ones_like(like)
        return jax.vmap(lambda one: jnp.stack(pull(one)[0][STORED_GROUP]))(ones)

    # Transposed apart: a pass of the readings that is handed zeros for `source` would still run through every step.
    own, by_port = slopes(0, readings), slopes(1, source)[:, :given]
    along = jax.vmap(lambda sources: along_rows(carried, sources), in_axes=1, out_axes=1)(by_port)
    whole = own[:, :given]
    for port in range(PUSHES):
        whole = whole + own[:, given + port, None] * along[port]
    return readings, jnp.concatenate([whole, jnp.full((len(reads), MOVES, readings.shape[1]), jnp.nan)], axis=1)


def storage_program(effects: tuple[str, ...], stored: tuple[str, ...], reads: tuple[str, ...]) -> KeptProgram:
    """`readings_and_storage`, compiled once per set of names and rows.

    A search asks every record what stored oil would do to it, and a program that fits stored oil takes as long to compile as all the
    others that most records need.
    """
    return _storage(effects, stored, classes_of((*effects, *stored)), reads)


@made_once
def _storage(
    effects: tuple[str, ...], stored: tuple[str, ...], classes: tuple[type, ...], reads: tuple[str, ...]
) -> KeptProgram:
    return jitted(functools.partial(readings_and_storage, effects, stored, reads), known_options(OPTIONS), classes)


def readings_and_storage(
    effects: tuple[str, ...],
    stored: tuple[str, ...],
    reads: tuple[str, ...],
    p: Float[Array, " all"],
    args: LibraryArgs,
) -> tuple[Float[Array, "reads rows"], Float[Array, "reads stored rows"]]:
    """Readings of a model that stores none with these amounts stored, and their derivatives to the amounts: forward only, to any amounts
    by Newton's method, and once more for the derivatives.

    p: parameters, amounts of `effects`, which act row by row and leave the ports apart, then those of `stored`.
    """
    given = len(p) - len(stored)
    values = spread_over_rows(p[:given], args.data.conditions)[STORED_GROUP]
    valve = rowwise_valve(effects, STORED_GROUP, values, args)

    def of(amounts: Float[Array, " stored"]) -> Float[Array, "reads rows"]:
        storing = with_effects(valve, dict(zip(stored, amounts, strict=True)))
        found = predict_group(storing, STORED_GROUP, (UNLOADED,), args.data.conditions)
        return jnp.stack([found[UNLOADED][name] for name in reads])

    readings, push = jax.linearize(of, p[given:])
    return readings, jnp.moveaxis(jax.vmap(push)(jnp.eye(len(stored))), 0, 1)
