"""Rodas5P for a batch of scenarios, arranged so that a processor's vectors fill with scenarios.

`jax.vmap` puts the scenarios into the first axis of small arrays, (scenarios, 2, 2) say: XLA's loops then run over an axis
of two, and every `stack` in the function becomes a branch inside them. Here the function's program (a jaxpr) is read as it
is for one scenario, and each number in it becomes one vector over scenarios. Arrays of such vectors are kept by Python:
shaping, slicing and stacking them costs nothing at run time, and what is known to be zero (most of a Jacobian) is left out.

XLA would compute a value again in every place that reads it, unless it is hard to compute. What several places read is
therefore passed into the branch of a condition that always holds: what enters a branch is stored.
"""

import operator
from collections.abc import Callable, Sequence
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.extend import core
from jaxtyping import Array

from thermohyd.small_systems import inverses

from .rodas5p import DENSE, GAMMA, TABLEAU
from .rosenbrock import Rodas5P


# Where a primitive that calls another program keeps it.
_INNER = {"jit": "jaxpr", "closed_call": "call_jaxpr", "custom_jvp_call": "call_jaxpr", "checkpoint": "jaxpr"}
_ARITHMETIC = {"mul": operator.mul, "add": operator.add, "add_any": operator.add, "sub": operator.sub}
# Primitives that act number by number. Every other one is left to `jax.vmap`, those of equal shapes in and out included (a
# sort, a running sum, a window): number by number they would silently mix what belongs apart.
_ELEMENTWISE = {"abs", "acos", "acosh", "add", "add_any", "and", "asin", "asinh", "atan", "atan2", "atanh", "cbrt",
                "ceil", "clamp", "convert_element_type", "copy", "cos", "cosh", "digamma", "div", "eq", "erf",
                "erf_inv", "erfc", "exp", "exp2", "expm1", "floor", "ge", "gt", "integer_pow", "is_finite", "le",
                "lgamma", "log", "log1p", "logistic", "lt", "max", "min", "mul", "ne", "neg", "nextafter", "not",
                "or", "pow", "reduce_precision", "rem", "round", "rsqrt", "select_n", "sign", "sin", "sinh", "sqrt",
                "square", "stop_gradient", "sub", "tan", "tanh", "xor"}  # fmt: skip


def each(shape: tuple[int, ...], entry: Callable[[tuple[int, ...]], Any]) -> np.ndarray:
    """An array of objects, entry by entry."""
    array = np.empty(shape, dtype=object)
    for index in np.ndindex(*shape):
        array[index] = entry(index)
    return array


def numbers(values: Any, batched: bool) -> np.ndarray:
    """The array's numbers: vectors over scenarios where it is batched (in its last axis)."""
    if not isinstance(values, jax.Array):
        values = np.asarray(values)  # known while tracing
    shape = values.shape[:-1] if batched else values.shape
    return each(shape, lambda index: values[index] if index else values if batched else values[()])


def _known(number: Any) -> bool:
    return isinstance(number, (np.generic, float, int, bool))


def _is(number: Any, value: float) -> bool:
    return bool(_known(number) and number == value)


def _plus(a: Any, b: Any) -> Any:
    return b if _is(a, 0) else a if _is(b, 0) else a + b


def _number(eqn: Any, given: list[Any]) -> Any:
    """One number of an elementwise primitive."""
    name = eqn.primitive.name
    first, last = given[0], given[-1]
    if name == "mul":
        if _is(first, 0) or _is(last, 0):
            return eqn.outvars[0].aval.dtype.type(0)
        if _is(first, 1) or _is(last, 1):
            return last if _is(first, 1) else first
    elif name in ("add", "add_any"):
        if _is(first, 0) or _is(last, 0):
            return last if _is(first, 0) else first
    elif (name == "sub" and _is(last, 0)) or (name in ("div", "neg") and _is(first, 0)):
        return first
    elif name == "select_n" and all(_known(case) for case in given[1:]) and len(set(given[1:])) == 1:
        return last
    if name in _ARITHMETIC and _known(first) and _known(last):
        return _ARITHMETIC[name](first, last)
    arrays = [jnp.asarray(number, var.aval.dtype) for number, var in zip(given, eqn.invars, strict=True)]
    arrays = jnp.broadcast_arrays(*arrays)
    return eqn.primitive.bind(*arrays, **eqn.params)


def _shaped(eqn: Any, given: list[np.ndarray], shape: tuple[int, ...]) -> np.ndarray | None:
    """What only moves or sums numbers; None for other primitives."""
    name, params = eqn.primitive.name, eqn.params
    if name == "broadcast_in_dim":
        kept = [1] * len(shape)
        for size, axis in zip(given[0].shape, params["broadcast_dimensions"], strict=True):
            kept[axis] = size
        return np.broadcast_to(given[0].reshape(kept), shape)
    if name in ("reshape", "squeeze", "expand_dims"):
        return given[0].reshape(shape)
    if name == "slice":
        strides = params["strides"] or (1,) * given[0].ndim
        return given[0][tuple(map(slice, params["start_indices"], params["limit_indices"], strides))]
    if name == "transpose":
        return given[0].transpose(params["permutation"])
    if name == "concatenate":
        return np.concatenate(given, axis=params["dimension"])
    if name == "stack":
        return np.stack(given, axis=params["axis"])
    if name == "rev":
        return np.flip(given[0], params["dimensions"])
    if name == "reduce_sum":
        total = each(shape, lambda _: eqn.outvars[0].aval.dtype.type(0))
        for index in np.ndindex(*given[0].shape):
            kept_index = tuple(i for axis, i in enumerate(index) if axis not in params["axes"])
            total[kept_index] = _plus(total[kept_index], given[0][index])
        return total
    return None


def _elementwise(eqn: Any, shape: tuple[int, ...]) -> bool:
    fits = lambda given: (
        given == () or (len(given) == len(shape) and all(n in (1, m) for n, m in zip(given, shape, strict=True)))
    )
    return eqn.primitive.name in _ELEMENTWISE and all(fits(var.aval.shape) for var in eqn.invars)


def _whole(eqn: Any, given: list[np.ndarray], count: int) -> list[np.ndarray]:
    """Any other primitive (a loop, a matrix product): its arrays put together and left to `jax.vmap`."""
    full = lambda number, var: jnp.broadcast_to(jnp.asarray(number, var.aval.dtype), (count,))
    together = [
        jnp.reshape(jnp.stack([full(number, var) for number in one.ravel()]), (*one.shape, count))
        for one, var in zip(given, eqn.invars, strict=True)
    ]

    def alone(*arrays: Any) -> list[Any]:
        results = eqn.primitive.bind(*arrays, **eqn.params)
        return list(results) if eqn.primitive.multiple_results else [results]

    return [numbers(result, True) for result in jax.vmap(alone, in_axes=-1, out_axes=-1)(*together)]


def _evaluate(program: Any, constants: Sequence[Any], given: Sequence[Callable], count: int) -> list[np.ndarray]:
    """The program's results. Values are functions, so that an array nobody reads is not taken apart."""
    values: dict[Any, Callable[[], np.ndarray]] = dict(zip(program.invars, given, strict=True))
    for var, constant in zip(program.constvars, constants, strict=True):
        values[var] = lambda constant=constant: numbers(
            constant if isinstance(constant, Tracer) else np.asarray(constant), False
        )
    held = lambda atom: (lambda: numbers(atom.val, False)) if isinstance(atom, core.Literal) else values[atom]
    for eqn in program.eqns:
        if not eqn.outvars:
            continue
        name, shape = eqn.primitive.name, eqn.outvars[0].aval.shape
        if name in _INNER:
            inner = eqn.params[_INNER[name]]
            program_, inner_constants = (inner.jaxpr, inner.consts) if hasattr(inner, "consts") else (inner, ())
            results = _evaluate(program_, inner_constants, [held(atom) for atom in eqn.invars], count)
        elif not eqn.invars:
            with jax.ensure_compile_time_eval():
                results = [numbers(np.asarray(eqn.primitive.bind(**eqn.params)), False)]
        else:
            arrays = [held(atom)() for atom in eqn.invars]
            moved = _shaped(eqn, arrays, shape)
            if moved is not None:
                results = [moved]
            elif _elementwise(eqn, shape):
                wide = [np.broadcast_to(array, shape) for array in arrays]
                results = [each(shape, lambda index: _number(eqn, [array[index] for array in wide]))]  # noqa: B023
            else:
                results = _whole(eqn, arrays, count)
        for var, array in zip(eqn.outvars, results, strict=True):
            values[var] = lambda array=array: array
    return [held(atom)() for atom in program.outvars]


def over_batch(
    function: Callable[..., Any], given: Sequence[Any], batched: Sequence[bool], count: int
) -> list[np.ndarray]:
    """Evaluate a function of one scenario's arrays for `count` scenarios, which are the batched arrays' last axis.

    Its results, a flat sequence of arrays, as arrays of objects: each entry is a vector (count,), an array () that is
    the same for all scenarios, or a number known while tracing.
    """
    given = [jnp.asarray(array) for array in given]
    alone = [
        jax.ShapeDtypeStruct(
            array.shape[:-1] if flag else array.shape, array.dtype, weak_type=jax.typeof(array).weak_type
        )
        for array, flag in zip(given, batched, strict=True)
    ]
    program = jax.make_jaxpr(function)(*alone)
    apart: list[Callable[[], np.ndarray]] = [_once(array, flag) for array, flag in zip(given, batched, strict=True)]
    return _evaluate(program.jaxpr, program.consts, apart, count)


def _once(array: Any, batched: bool) -> Callable[[], np.ndarray]:
    taken: list[np.ndarray] = []

    def take() -> np.ndarray:
        if not taken:
            taken.append(numbers(array, batched))
        return taken[0]

    return take


def _stored(always: Array, work: Callable[..., Any], *given: Any) -> Any:
    """work(*given), with what is given stored before."""
    shapes = jax.eval_shape(work, *given)
    nothing = lambda *_: jax.tree.map(lambda shape: jnp.full(shape.shape, jnp.nan, shape.dtype), shapes)
    return jax.lax.cond(always, work, nothing, *given)


def _batch_step(
    field: Callable, count: int, flags: list[bool], leaves: list[Array], t0: Array, h: Array, y0: Array
) -> Any:
    """(y1, error, bends) with scenarios last; y0 (states, count); t0, h (count,); leaves, scenarios last where `flags`."""
    n = y0.shape[0]
    always = t0[0] < jnp.inf
    wide = lambda number: jnp.broadcast_to(jnp.asarray(number, y0.dtype), (count,))

    def slopes(t: Array, y: Array, *leaves: Array) -> tuple[Array, Array]:
        _, push = jax.linearize(lambda t, y: field(leaves, t, y), t, y)
        columns = jax.vmap(lambda unit: push(np.zeros(()), unit), out_axes=1)(np.eye(n))
        return push(np.ones(()), np.zeros(n)), columns

    def derivatives(t0: Array, h: Array, y0: Array, leaves: list[Array]) -> Any:
        slope, columns = over_batch(slopes, [t0, y0, *leaves], [True, True, *flags], count)
        diagonal = 1.0 / (GAMMA * h)
        entries = tuple(tuple(wide((diagonal if i == j else 0.0) - columns[i, j]) for j in range(n)) for i in range(n))
        return tuple(map(wide, slope)), entries

    slope, entries = _stored(always, derivatives, t0, h, y0, leaves)
    slope, solve = _stored(
        always,
        lambda slope, entries: (jnp.stack(slope), inverses(jnp.stack([jnp.stack(row) for row in entries]))),
        slope,
        entries,
    )

    def rates(t: Array, y: Array, leaves: list[Array]) -> tuple[Array, ...]:
        (change,) = over_batch(
            lambda t, y, *leaves: (field(leaves, t, y),), [t, y, *leaves], [True, True, *flags], count
        )
        return tuple(map(wide, change))

    def weighted(weights: Array | np.ndarray, ks: Array) -> Array:
        # Term by term: XLA's sum over the first axis would not fill vectors.
        total = weights[0] * ks[0]
        for i in range(1, 8):
            total = total + weights[i] * ks[i]
        return total

    def onward(solve: Array, f: tuple[Array, ...], extra: Array) -> Array:
        right = [f[j] + extra[j] for j in range(n)]
        total = solve[:, 0] * right[0]
        for j in range(1, n):
            total = total + solve[:, j] * right[j]
        return total

    def stage(carry: tuple[Array, Array], coefficients: tuple[Array, ...]) -> tuple[Any, None]:
        ks, _ = carry
        a, c, d, (i, node) = coefficients
        y = y0 + weighted(a, ks)
        extra = h * d * slope + weighted(c, ks) / h
        f = _stored(always, rates, t0 + node * h, y, leaves)
        k = _stored(always, onward, solve, f, extra)
        return (jax.lax.dynamic_update_slice(ks, k[None], (i.astype(int), 0, 0)), y), None

    coefficients = tuple(jnp.asarray(part) for part in TABLEAU)
    (ks, y), _ = jax.lax.scan(stage, (jnp.zeros((8, n, count)), y0), coefficients)
    bends = jnp.stack([weighted(weights, ks) for weights in DENSE])
    return y + ks[-1], ks[-1], bends


class BatchedRodas5P(Rodas5P):
    """Rodas5P that fills vectors with scenarios under `jax.vmap`; not to be differentiated."""

    def step(self, terms: Any, t0: Any, t1: Any, y0: Any, args: Any, solver_state: None, made_jump: Any) -> Any:
        # diffrax keeps the direction of time, an array, in the terms.
        leaves, rest = eqx.partition((terms, args), eqx.is_array)
        leaves, tree = jax.tree.flatten(leaves)
        back = lambda leaves: eqx.combine(jax.tree.unflatten(tree, leaves), rest)

        def field(leaves: Any, t: Array, y: Array) -> Array:
            terms, args = back(leaves)
            return terms.vf(t, y, args)

        @jax.custom_batching.custom_vmap
        def alone(leaves: list[Array], t0: Array, t1: Array, y0: Array) -> tuple[Array, Array, Array]:
            terms, args = back(leaves)
            y1, error, dense, _, _ = Rodas5P.step(self, terms, t0, t1, y0, args, solver_state, None)
            return y1, error, dense["bends"]

        @alone.def_vmap
        def _(count: int, batched: Any, leaves: list[Array], t0: Array, t1: Array, y0: Array) -> Any:
            flags = [bool(flag) for flag in batched[0]]
            last = lambda array, flag: jnp.moveaxis(array, 0, -1) if flag else array
            full = lambda array, flag: jnp.moveaxis(array, 0, -1) if flag else jnp.repeat(array[..., None], count, -1)
            t0, t1, y0 = (full(array, flag) for array, flag in zip((t0, t1, y0), batched[1:], strict=True))
            leaves = [last(array, flag) for array, flag in zip(leaves, flags, strict=True)]
            results = _batch_step(field, count, flags, leaves, t0, t1 - t0, y0)
            return tuple(jnp.moveaxis(array, -1, 0) for array in results), (True, True, True)

        y1, error, bends = alone(leaves, t0, t1, y0)
        return y1, error, {"y0": y0, "y1": y1, "bends": bends}, None, diffrax.RESULTS.successful
