"""What a shift of each place of the circuit would do to every reading, beside a model of static tests: one forward program.

A search for terms (`diagnosis.typed_terms`) asks that only where a misfit is left, so the program holds no more than the model does:
its effects, not the library's. Forward, all tangents at once, it takes a third of the time to compile that a reverse pass with places
takes, and runs half as fast.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from thermohyd.numerics import OPTIONS, known_options

from .library_program import LibraryArgs, behind, readings_of_rows
from .static_readings import spread_over_rows


@functools.cache
def place_program(
    effects: tuple[str, ...], classes: tuple[type, ...], test: str, reads: tuple[str, ...], structure: Any
) -> Callable[..., tuple[Array, Array, dict[str, Array]]]:
    """Compiled (p, *leaves of a block) -> (readings (reads, rows), their slopes (reads, entries, rows), all that the rows could read).

    Entries: parameters, amounts of `effects`, and a shift of each of `ENTRIES`. classes: what stands behind the names of the effects.
    """
    del classes

    def of_block(p: Float[Array, " given"], *leaves: Any) -> tuple[Array, Array, dict[str, Array]]:
        args: LibraryArgs = jax.tree.unflatten(structure, leaves)
        whole = jnp.concatenate([p, jnp.zeros(behind(effects, args))])

        def of(whole: Float[Array, " entries"]) -> dict[str, Array]:
            return readings_of_rows(effects, spread_over_rows(whole, args.data.conditions), args)[0][test]

        found, push = jax.linearize(of, whole)
        # A row depends on its own entries alone, so a change of an entry at all rows shows at each what the row's own change does.
        moved = jax.vmap(push)(jnp.eye(len(whole)))
        return jnp.stack([found[name] for name in reads]), jnp.stack([moved[name] for name in reads]), found

    return jax.jit(of_block, compiler_options=known_options(OPTIONS))
