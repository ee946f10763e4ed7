"""What a shift of each place of the circuit would do to every reading, beside a model of static tests: one forward program.

A search for terms (`diagnosis.typed_terms`) asks that only where a misfit is left, so the program holds no more than the model does:
its effects, not the library's. Forward, all tangents at once, it takes a third of the time to compile that a reverse pass with places
takes, and runs half as fast.
"""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.kept_programs import KeptProgram, made_once
from thermohyd.numerics import SELDOM, jitted, known_options

from .library_rows import Asked, LibraryArgs, behind, reading_asked
from .static_readings import spread_over_rows


@made_once
def place_program(effects: tuple[str, ...], classes: tuple[type, ...], rows_of: str) -> KeptProgram:
    """`readings_and_places`, compiled; classes: what stands behind the names of the effects."""
    return jitted(functools.partial(readings_and_places, effects, rows_of), known_options(SELDOM), classes)


def readings_and_places(
    effects: tuple[str, ...], rows_of: str, p: Float[Array, " given"], args: LibraryArgs, asked: Asked
) -> tuple[Float[Array, " rows"], Float[Array, "entries rows"], dict[str, Float[Array, " rows"]]]:
    """Of the rows of a block: the reading asked for, its slopes, and all that the rows could read.

    Entries: parameters, amounts of `effects`, and a shift of each of `ENTRIES`.
    """
    whole = jnp.concatenate([p, jnp.zeros(behind(effects, args))])

    def of(whole: Float[Array, " entries"]) -> tuple[Array, dict[str, Array]]:
        return reading_asked(effects, rows_of, spread_over_rows(whole, args.data.conditions), args, asked)

    (reading, found), push = jax.linearize(of, whole)
    # A row depends on its own entries alone, so a change of an entry at all rows shows at each what the row's own change does.
    return reading, jax.vmap(lambda moved: push(moved)[0])(jnp.eye(len(whole))), found
