"""Many searches as one program: each lane is a search of its own, and one that has ended makes room for the next.

The step is `trust_region`'s, mapped over the lanes with residual and columns in it: the same code on a CPU and on a GPU. A lane
that has ended stands still (a mask) until the host has taken its result and put another search into it, so that no search waits
for the longest of a batch. A lane computes whether it searches or stands still: there should be few idle ones.
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from thermohyd.numerics import kept

from .boxes import Box, Boxes, free_values
from .least_squares import Residual
from .trust_region import BoxedLevenbergMarquardt, State


MOST_STEPS = 500  # as `least_squares.solve` has it
# Steps of each lane between two looks of the host. A look costs a CPU nothing, a lane that stands still as much as one that searches;
# of a GPU it is the other way round.
STRIDES = {"cpu": 1}
STRIDE = 4  # of everything else


@dataclass(eq=False)
class Search:
    """One search: the arguments of `least_squares.solve`, and what it left, as `least_squares.judged` takes it.

    key: alike for searches that share a program. woken: set once `out` is there, or never will be.
    """

    residual: Residual
    boxes: Sequence[Box]
    args: Any
    start: np.ndarray
    tolerance: float
    enough: float
    out: Any = None
    woken: threading.Event = field(default_factory=threading.Event)
    key: Any = field(init=False)

    def __post_init__(self) -> None:
        leaves, structure = jax.tree.flatten(self.args)
        shapes = [(np.shape(leaf), np.result_type(leaf)) for leaf in leaves]
        self.key = self.residual, len(self.boxes), structure, shapes


class _Wanted(eqx.Module):
    """What a search is beside its data: limits, where it stops, where it begins (`fresh`: it has not begun yet)."""

    boxes: Boxes
    tolerance: Any
    enough: Any
    fresh: Any
    begin: Any


def _one(residual: Residual, stride: Any, wanted: _Wanted, args: Any, z: Array, state: State) -> tuple[Array, State]:
    """Up to `stride` steps of one lane."""
    solver, boxes = BoxedLevenbergMarquardt(), wanted.boxes
    options = {"lower": boxes.lower, "upper": boxes.upper, "tolerance": wanted.tolerance, "enough": wanted.enough}
    fn = lambda z, args: (residual(boxes.physical(z), args), None)
    shape = jax.ShapeDtypeStruct(state.residual.shape, z.dtype)
    first = solver.init(fn, wanted.begin, args, options, shape, None, None)
    now = lambda new, old: jnp.where(wanted.fresh, new, old)
    z, state = now(wanted.begin, z), jax.tree.map(now, first, state)

    def goes_on(carry: tuple[Array, State, Array]) -> Array:
        _, state, count = carry
        return ~state.done & (state.evaluations < MOST_STEPS) & (count < stride)

    def step(carry: tuple[Array, State, Array]) -> tuple[Array, State, Array]:
        z, state, count = carry
        z, state, _ = solver.step(fn, z, args, options, state, None)
        return z, state, count + 1

    z, state, _ = jax.lax.while_loop(goes_on, step, (z, state, jnp.array(0)))
    return z, state


@kept
def _advance(residual: Residual, stride: Any, wanted: _Wanted, args: Any, z: Any, state: Any) -> Any:
    z, state = jax.vmap(lambda *lane: _one(residual, stride, *lane))(wanted, args, z, state)
    return z, state, state.done | (state.evaluations >= MOST_STEPS)


@kept
def _idle(residual: Residual, lanes: int, args: Any, begin: Any) -> Any:
    """Lanes with the data of one search, none of them searching."""
    spread = lambda leaf: jnp.broadcast_to(leaf, (lanes, *jnp.shape(leaf)))
    shape = jax.eval_shape(residual, begin, args)
    state = BoxedLevenbergMarquardt().init(None, begin, None, None, shape, None, None)
    state = eqx.tree_at(lambda s: s.done, state, jnp.array(True))
    return jax.tree.map(spread, (args, begin, state))


@jax.jit
def _put(all_of: Any, lane: Any, one: Any) -> Any:
    return jax.tree.map(lambda many, new: many.at[lane].set(new), all_of, one)


@jax.jit
def _take(z: Any, state: Any, boxes: Boxes, lane: Any) -> Any:
    z, residual, columns, size, evaluations, done = jax.tree.map(
        lambda many: many[lane], (z, state.residual, state.columns, state.size, state.evaluations, state.done)
    )
    small = jnp.stack([z, boxes.physical(z), boxes.slope(z), size])
    return small, residual, columns, evaluations, done


class Lanes:
    """So many lanes for searches that share a program: the same residual, and data of the same shapes."""

    def __init__(self, first: Search, lanes: int) -> None:
        self.key, self.residual = first.key, first.residual
        begin = jnp.asarray(free_values(first.boxes, first.start))
        self._args, self._z, self._state = _idle(self.residual, lanes, first.args, begin)
        self._searches: list[Search | None] = [None] * lanes
        self._stride = np.asarray(STRIDES.get(jax.default_backend(), STRIDE))
        self._placed: list[Any] = [None] * lanes  # whose data a lane holds
        count = len(first.boxes)
        ones = lambda: np.ones((lanes, count))
        self._limits = Boxes(ones(), ones(), ones(), np.zeros((lanes, count), dtype=bool))
        self._begin, self._fresh = np.zeros((lanes, count)), np.zeros(lanes, dtype=bool)
        self._tolerance, self._enough = np.ones(lanes), np.full(lanes, np.inf)

    def __len__(self) -> int:
        return len(self._searches)

    @property
    def free(self) -> int:
        return self._searches.count(None)

    @property
    def searching(self) -> int:
        return len(self.searches())

    def takes(self, search: Search) -> bool:
        """Whether a search shares the lanes' program."""
        return self.key == search.key

    def searches(self) -> list[Search]:
        """Those that have not ended."""
        return [search for search in self._searches if search is not None]

    def put(self, search: Search) -> None:
        """Into a lane that stands still; into one that holds its data, if there is one."""
        still = [i for i, own in enumerate(self._searches) if own is None]
        lane = next((i for i in still if self._placed[i] is search.args), still[0])
        if self._placed[lane] is not search.args:
            self._args = _put(self._args, lane, search.args)
            self._placed[lane] = search.args
        self._searches[lane] = search
        boxes = Boxes.of(search.boxes)
        for name in ("scale", "lower", "upper", "logarithmic"):
            getattr(self._limits, name)[lane] = getattr(boxes, name)
        self._begin[lane], self._fresh[lane] = free_values(search.boxes, search.start), True
        self._tolerance[lane], self._enough[lane] = search.tolerance, search.enough

    def advance(self) -> list[Search]:
        """A stride of all lanes; the searches that have ended, with what they left."""
        wanted = _Wanted(self._limits, self._tolerance, self._enough, self._fresh, self._begin)
        # Copies: on a CPU the program may still read a NumPy array while the next search is written into it.
        wanted = jax.tree.map(np.array, wanted)
        self._z, self._state, ended = _advance(self.residual, self._stride, wanted, self._args, self._z, self._state)
        self._fresh[:] = False
        over = np.asarray(ended)
        found = []
        for lane, search in enumerate(self._searches):
            if search is not None and over[lane]:
                own = jax.tree.map(lambda many, lane=lane: many[lane], self._limits)
                search.out = jax.device_get(_take(self._z, self._state, own, lane))
                self._searches[lane] = None
                found.append(search)
        return found
