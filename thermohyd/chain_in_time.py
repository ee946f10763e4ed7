"""A chain of implicit steps in time, solved everywhere at once: the mesh of a sweep, a step's stages, and how steps follow each other."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .conditions import Conditions, sweep_direction
from .flow_balance import eliminate
from .numerics import linear_recursion, recursion_in_blocks


# Radau IIA of order 5 (Hairer and Wanner, Solving Ordinary Differential Equations II, table IV.5.6): stiffly accurate, so that
# the last stage is the end of the step and a port without storage is in balance at every row.
_ROOT = np.sqrt(6.0)
STAGES = np.array(
    [
        [(88 - 7 * _ROOT) / 360, (296 - 169 * _ROOT) / 1800, (-2 + 3 * _ROOT) / 225],
        [(296 + 169 * _ROOT) / 1800, (88 + 7 * _ROOT) / 360, (-2 - 3 * _ROOT) / 225],
        [(16 - _ROOT) / 36, (16 + _ROOT) / 36, 1 / 9],
    ]
)
PARTS = STAGES.sum(axis=1)  # of a step, where its stages are
# Of the embedded step of order 3 (IV.8 there): gamma_0, and what multiplies the stages' changes.
GAMMA = 1.0 / 3.6378342527444957
EMBEDDED = np.array([-13.0 - 7.0 * _ROOT, -13.0 + 7.0 * _ROOT, -1.0]) / 3.0
# One row in so many is cut into `substeps` steps, one in so many into a quarter of them, and the others into an eighth.
ONE_IN_MOST, ONE_IN_SOME = 16, 2
SMALLEST_FLOW = 1e-30  # m3/s, to divide by
SHORTEST = 1e-6  # s: rows at one and the same time


class Mesh(eqx.Module):
    """Steps of a sweep: `owner`, the row at whose end or before it a step ends, and where it begins and how long it is as
    shares of the time since the row before. `last`: of each row; `place`: of a step among its row's."""

    owner: Int[Array, " steps"]
    begin: Float[Array, " steps"]
    width: Float[Array, " steps"]
    place: Int[Array, " steps"]
    last: Int[Array, " rows"]

    def share(self) -> Float[Array, "nodes steps"]:
        """Where the stages lie, as shares of the time since the row before."""
        return self.begin + PARTS[:, None] * self.width

    def spread(self, tree: Any) -> Any:
        """What is given row by row beside every step; single numbers stay such.

        Column by column: all of them stacked and picked at once took half as long again to run, and no less to compile.
        """
        rows = self.last.size
        return jax.tree.map(lambda leaf: leaf[..., self.owner] if leaf.ndim and leaf.shape[-1] == rows else leaf, tree)


def mesh_of(need: Float[Array, " rows"], substeps: int) -> Mesh:
    """A mesh with the most steps in the rows where `need` is largest."""
    rows = need.shape[0]
    some, least = max(substeps // 4, 1), max(substeps // 8, 1)
    first = -(-rows // ONE_IN_MOST)
    second = min(first + rows // ONE_IN_SOME, rows)
    by_rank = np.repeat([substeps, some, least], [first, second - first, rows - second])
    # Where rows differ by no more than rounding, the first: another program of the same sweep then has the same mesh.
    counts = jnp.zeros(rows, dtype=int).at[jnp.argsort(-need.astype(jnp.float32))].set(by_rank)
    total = int(by_rank.sum())
    owner = jnp.repeat(jnp.arange(rows), counts, total_repeat_length=total)
    ends = jnp.cumsum(counts)
    place = jnp.arange(total) - (ends - counts)[owner]
    width = 1.0 / counts[owner].astype(float)
    return Mesh(owner, place.astype(float) * width, width, place, ends - 1)


class Sweep(eqx.Module):
    """Conditions as read row by row, with directions, starts of runs and the time since the row before [s]."""

    read: Conditions
    starts: Bool[Array, " rows"]
    span: Float[Array, " rows"]

    def at(self, mesh: Mesh) -> Conditions:
        """Conditions as read at the stages of every step (nodes, steps).

        Positions, pressures and temperatures are linear from row to row. The direction is that of the motion that ends at
        a row, and so is the rate.
        """
        share = mesh.share()

        def between_rows(column: Float[Array, " rows"]) -> Float[Array, "nodes steps"]:
            before = jnp.where(self.starts, column, jnp.concatenate([column[:1], column[:-1]]))
            return column[mesh.owner] - (1.0 - share) * (column - before)[mesh.owner]

        same = lambda column: jnp.broadcast_to(column[mesh.owner], share.shape)
        nodes = {
            name: between_rows(getattr(self.read, name))
            for name in ("position", "supply_pressure", "return_pressure", "temperature")
        }
        nodes |= {name: same(column) for name in ("direction", "run", "rate")
                  if (column := getattr(self.read, name)) is not None}  # fmt: skip
        # Made node by node under vmap, where the columns have the shape that Conditions are checked for.
        return jax.vmap(lambda columns: Conditions(**columns))(nodes)


def sweep_of(read: Conditions) -> Sweep:
    """Raises ValueError where the conditions have no time."""
    if read.time is None:
        raise ValueError("what blocked ports store needs conditions with the time of every row")
    run = jnp.zeros_like(read.time) if read.run is None else read.run
    direction = read.direction
    if direction is None:
        direction = jax.lax.stop_gradient(sweep_direction(read.position, run))
    starts = jnp.concatenate([jnp.ones(1, dtype=bool), jnp.diff(run) != 0.0])
    whole = eqx.tree_at(lambda c: (c.run, c.direction), read, (run, direction), is_leaf=lambda leaf: leaf is None)
    span = jnp.maximum(jnp.diff(read.time, prepend=read.time[:1]), SHORTEST)
    return Sweep(whole, starts, jnp.where(starts, 1.0, span))


class Chain(eqx.Module):
    """What all steps are solved with: C (2, #steps) with 0 at the start of a run, where the ports are steady, the length of
    a step [s], and the pressures [Pa] before the first one, of no meaning where C is 0 there."""

    compliance: Float[Array, "2 steps"]
    step: Float[Array, " steps"]
    begin: Float[Array, "2"]

    def imbalance(
        self, pressure: Float[Array, "nodes 2 steps"], net: Float[Array, "nodes 2 steps"]
    ) -> Float[Array, "nodes 2 steps"]:
        """C (p - p of the start) - step sum A net [m3] of every stage."""
        return self.compliance * (pressure - self._start(pressure)) - self.step * jnp.einsum("kl,lpr->kpr", STAGES, net)

    def condense(
        self, imbalance: Float[Array, "nodes 2 steps"], slope: Float[Array, "nodes ports 2 steps"]
    ) -> tuple[Array, Array]:
        """The changes of the stages that take the imbalance away, and how they follow the start of the step.

        slope: d net_i/d p_j, (nodes, 2, 2, steps), or (nodes, 1, 2, steps) of each port alone, whose unknowns then stay apart.
        Changes (nodes, 2, steps), and (nodes, 2, 2, steps) or (nodes, 1, 2, steps) by the ports at the start.
        """
        count, ports = slope.shape[:2]
        # Stage k of port i by stage l of port j, or a port's stages by each other.
        if ports == 2:
            size = 2 * count
            by_port = self.compliance * np.eye(2)[:, :, None]
            matrix = -self.step * jnp.einsum("kl,lijr->kiljr", STAGES, slope)
            matrix = matrix + np.eye(count)[:, None, :, None, None] * by_port[None, :, None]
            matrix = matrix.reshape(size, size, 1, -1)
            start = jnp.broadcast_to(by_port[None], (count, 2, 2, by_port.shape[-1])).reshape(size, 2, -1)
            right = jnp.concatenate([-imbalance.reshape(size, 1, -1), start], axis=1)
            x = eliminate(jnp.swapaxes(matrix, 0, 1), right).reshape(count, 2, 3, -1)
            return x[:, :, 0], x[:, :, 1:]
        alone = -self.step * STAGES[:, :, None, None] * slope[None, :, 0]
        alone = alone + np.eye(count)[:, :, None, None] * self.compliance
        start = jnp.broadcast_to(self.compliance, imbalance.shape)
        x = eliminate(jnp.swapaxes(alone, 0, 1)[:, :, None], jnp.stack([-imbalance, start], axis=1))
        return x[:, 0], x[:, 1:]

    def moves(self, change: Array, follows: Array) -> Float[Array, "nodes 2 steps"]:
        """Changes of all stages, those of the steps before taken along."""
        end = along_rows(follows[-1], change[-1])
        start = _before(end, jnp.zeros(2))
        return change + jnp.stack([_follow(stage, start) for stage in follows])

    def error(
        self,
        pressure: Float[Array, "nodes 2 steps"],
        net: Float[Array, "nodes 2 steps"],
        slope: Float[Array, "nodes ports 2 steps"],
        span: Float[Array, " steps"],
    ) -> Float[Array, " steps"]:
        """How much a step misses, by an embedded one of order 3 (Hairer and Wanner, II, IV.8): the pressure at its end as a share
        of `span`, and the flow that this makes as a share of the largest."""
        start, own = self._start(pressure), slope[-1, 0] if slope.shape[1] == 1 else jnp.einsum("iir->ir", slope[-1])
        defect = self.step * _before(net[-1], net[-1, :, 0]) + self.compliance * jnp.einsum(
            "k,kpr->pr", EMBEDDED, pressure - start
        )
        missed = jnp.abs(defect / (self.compliance / GAMMA - self.step * own))
        largest = jnp.maximum(jnp.max(jnp.abs(net)), SMALLEST_FLOW)
        return jnp.max(missed * (1.0 / span + jnp.abs(own) / largest), axis=0)

    def _start(self, pressure: Float[Array, "nodes 2 steps"]) -> Float[Array, "2 steps"]:
        return _before(pressure[-1], self.begin)


def _before(end: Float[Array, "2 steps"], begin: Float[Array, "2"]) -> Float[Array, "2 steps"]:
    """What the step before ended with, `begin` before the first; of no meaning where a run starts."""
    return jnp.concatenate([begin[:, None], end[:, :-1]], axis=1)


def _follow(follows: Float[Array, "ports 2 rows"], start: Float[Array, "2 rows"]) -> Float[Array, "2 rows"]:
    """(2, 2, rows) times (2, rows), or each port by its own factor (1, 2, rows)."""
    if follows.shape[0] == 1:
        return follows[0] * start
    return jnp.einsum("ijr,jr->ir", follows, start)


def _chained(after: Float[Array, "ports 2 rows"], before: Float[Array, "ports 2 rows"]) -> Float[Array, "ports 2 rows"]:
    return after * before if after.shape[0] == 1 else jnp.einsum("ijr,jkr->ikr", after, before)


def along_rows(carried: Float[Array, "ports 2 rows"], source: Float[Array, "2 rows"]) -> Float[Array, "2 rows"]:
    """y_i = carried_i y_(i-1) + source_i, y = 0 before the first row."""
    if carried.shape[0] == 1:
        return linear_recursion(carried[0], source)
    return recursion_in_blocks(carried, source, jnp.eye(2)[:, :, None], _follow, _chained)


def of_rows(change: Array, follows: Array, mesh: Mesh, substeps: int) -> tuple[Array, Array]:
    """(source, carried) of every row from those at the ends of its steps, by doublings inside the row."""
    source, carried = change[-1], follows[-1]
    reach = 1
    while reach < substeps:
        inside = mesh.place >= reach
        earlier = jnp.roll(source, reach, axis=-1), jnp.roll(carried, reach, axis=-1)
        source = jnp.where(inside, source + _follow(carried, earlier[0]), source)
        carried = jnp.where(inside, _chained(carried, earlier[1]), carried)
        reach *= 2
    return source[:, mesh.last], carried[..., mesh.last]
