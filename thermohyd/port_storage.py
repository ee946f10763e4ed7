"""Blocked ports that store oil while a sweep moves their pressure: C dp/dt = Q_in - Q_out at each port (docs/physics.md section 5.1).

Gauges, hoses and trapped air at a blocked port give way to its pressure. A sweep is then a chain in time; all its rows are
solved together by Newton's method, each turn of which evaluates the edges everywhere at once and leaves a linear recursion
along the rows (Lim et al., Parallelizing non-linear sequential models over the sequence length, ICLR 2024, have the idea).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from thermohyd.effects.effect import Coupling

from .conditions import Conditions, sweep_direction
from .coupled_ports import crossing_conductance, lost_in_lines, ports_with_crossing, with_pressures
from .flow_balance import eliminate
from .numerics import linear_recursion
from .oil import Oil, density
from .ports import Between, PortFlows, Ports, port_flows, return_temperature
from .valve import Valve, heat_kept, metering_edges, true_conditions


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
# The search ends where a turn moves every pressure by less than this share of the supply's; the next one squares it.
CLOSE = 1e-7
# From the steady state of 1080 random sweeps (2, 12 and 60 s, 1e-14 to 1e-10 m3/Pa): 3 to 6 turns by the median, 12 at most.
MOST_TURNS = 40
# A row whose pressure the last turn still moves by a larger share has no solution that was found, and becomes NaN.
FOUND = 1e-6
# A pressure that a turn would move across supply or return keeps this share of its distance instead: flow goes with the root
# of a drop, of which Newton's method makes a swing about the end without end. Nearer than `AT_THE_END`, as a share of the
# pressure between both, flow is laminar and the balance straight.
KEPT = 0.02
AT_THE_END = 1e-6
MOST_BEYOND = 0.1  # of the pressure between both: where a turn may lead beyond supply or return
# Turns of the pressures behind lines: leakage moves them by less than a hundredth, and a turn leaves as much of the error.
LINE_TURNS = 3
SHORTEST = 1e-6  # s: rows at one and the same time


class _Chain(eqx.Module):
    """What the steps of all rows are solved with: C (2, #rows) with 0 at the start of a run, where the ports are steady, and
    the length of a step (rows,)."""

    compliance: Float[Array, "2 rows"]
    step: Float[Array, " rows"]
    starts: Bool[Array, " rows"]
    substeps: int = eqx.field(static=True)

    def before(self, end: Float[Array, "2 rows"]) -> Float[Array, "2 rows"]:
        """What the row before ended with; of no meaning where a run starts."""
        return jnp.concatenate([end[:, :1], end[:, :-1]], axis=1)

    def imbalance(
        self, pressure: Float[Array, "nodes 2 rows"], net: Float[Array, "nodes 2 rows"]
    ) -> Float[Array, "nodes 2 rows"]:
        """C (p - p of the start) - step sum A net [m3] of every stage."""
        parts, start = [], self.before(pressure[-1])
        for own, flow in self._by_step(pressure, net):
            parts.append(self.compliance * (own - start) - self.step * jnp.einsum("kl,lpr->kpr", STAGES, flow))
            start = own[-1]
        return jnp.concatenate(parts)

    def condense(
        self, imbalance: Float[Array, "nodes 2 rows"], slope: Float[Array, "nodes ports 2 rows"]
    ) -> list[tuple[Array, Array]]:
        """For each step the changes of its stages that take the imbalance away, and how they follow the start of the step.

        slope: d net_i/d p_j, (nodes, 2, 2, rows), or (nodes, 1, 2, rows) of each port alone, whose unknowns then stay apart.
        Changes (stages, 2, rows), and (stages, 2, 2, rows) or (stages, 1, 2, rows) by the ports at the start.
        """
        count, ports = len(PARTS), slope.shape[1]
        found = []
        for left, slopes in self._by_step(imbalance, slope):
            # Stage k of port i by stage l of port j, or a port's stages by each other.
            if ports == 2:
                size = 2 * count
                by_port = self.compliance * np.eye(2)[:, :, None]
                matrix = -self.step * jnp.einsum("kl,lijr->kiljr", STAGES, slopes)
                matrix = matrix + np.eye(count)[:, None, :, None, None] * by_port[None, :, None]
                matrix = matrix.reshape(size, size, 1, -1)
                before = jnp.broadcast_to(by_port[None], (count, 2, 2, by_port.shape[-1])).reshape(size, 2, -1)
                right = jnp.concatenate([-left.reshape(size, 1, -1), before], axis=1)
                x = eliminate(jnp.swapaxes(matrix, 0, 1), right).reshape(count, 2, 3, -1)
                found.append((x[:, :, 0], x[:, :, 1:]))
            else:
                alone = -self.step * STAGES[:, :, None, None] * slopes[None, :, 0]
                alone = alone + np.eye(count)[:, :, None, None] * self.compliance
                before = jnp.broadcast_to(self.compliance, left.shape)
                x = eliminate(jnp.swapaxes(alone, 0, 1)[:, :, None], jnp.stack([-left, before], axis=1))
                found.append((x[:, 0], x[:, 1:]))
        return found

    def ends(self, condensed: list[tuple[Array, Array]]) -> tuple[Array, Array]:
        """(change of the pressures at the end of each row's steps where nothing changes before it, how it follows that)."""
        source, carried = condensed[0][0][-1], condensed[0][1][-1]
        for change, follows in condensed[1:]:
            source = change[-1] + _follow(follows[-1], source)
            carried = _chained(follows[-1], carried)
        return source, carried

    def moves(self, condensed: list[tuple[Array, Array]], end: Float[Array, "2 rows"]) -> Float[Array, "nodes 2 rows"]:
        """Changes at every node, from those at the ends of all rows."""
        start = jnp.concatenate([jnp.zeros((2, 1)), end[:, :-1]], axis=1)
        parts = []
        for change, follows in condensed:
            parts.append(change + jnp.stack([_follow(stage, start) for stage in follows]))
            start = parts[-1][-1]
        return jnp.concatenate(parts)

    def _by_step(self, *arrays: Float[Array, "nodes ..."]):
        count = len(PARTS)
        for j in range(self.substeps):
            yield tuple(array[j * count : (j + 1) * count] for array in arrays)


def _follow(follows: Float[Array, "ports 2 rows"], start: Float[Array, "2 rows"]) -> Float[Array, "2 rows"]:
    """(2, 2, rows) times (2, rows), or each port by its own factor (1, 2, rows)."""
    if follows.shape[0] == 1:
        return follows[0] * start
    return jnp.einsum("ijr,jr->ir", follows, start)


def _chained(after: Float[Array, "ports 2 rows"], before: Float[Array, "ports 2 rows"]) -> Float[Array, "ports 2 rows"]:
    return after * before if after.shape[0] == 1 else jnp.einsum("ijr,jkr->ikr", after, before)


def along_rows(carried: Float[Array, "ports 2 rows"], source: Float[Array, "2 rows"]) -> Float[Array, "2 rows"]:
    """y_i = carried_i y_(i-1) + source_i, y = 0 before the first row, by recursive doubling (as `linear_recursion`)."""
    if carried.shape[0] == 1:
        return linear_recursion(carried[0], source)
    rows = source.shape[-1]

    def double(i: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        reach, so_far = carry
        step = 2**i
        before = lambda values: jnp.where(jnp.arange(rows) >= step, jnp.roll(values, step, axis=-1), 0.0)
        return _chained(reach, before(reach)), so_far + _follow(reach, before(so_far))

    doublings = max(rows - 1, 1).bit_length()
    return jax.lax.fori_loop(0, doublings, double, (carried, source))[1]


def _nodes(read: Conditions, substeps: int) -> tuple[Conditions, Bool[Array, " rows"], Float[Array, " rows"]]:
    """Conditions as read at the stages of every row's steps (nodes, rows), starts of runs, and the length of a step [s].

    Positions, pressures and temperatures are linear from row to row. The direction is that of the motion that ends at a
    row, and so is the rate.
    """
    if read.time is None:
        raise ValueError("what blocked ports store needs conditions with the time of every row")
    run = jnp.zeros_like(read.time) if read.run is None else read.run
    direction = read.direction
    if direction is None:
        direction = jax.lax.stop_gradient(sweep_direction(read.position, run))
    starts = jnp.concatenate([jnp.ones(1, dtype=bool), jnp.diff(run) != 0.0])
    share = np.concatenate([(j + PARTS) / substeps for j in range(substeps)])[:, None]

    def before(column: Float[Array, " rows"]) -> Float[Array, " rows"]:
        return jnp.where(starts, column, jnp.concatenate([column[:1], column[:-1]]))

    def between_rows(column: Float[Array, " rows"]) -> Float[Array, "nodes rows"]:
        return column - (1.0 - share) * (column - before(column))

    same = lambda column: jnp.broadcast_to(column, (share.size, column.size))
    nodes = {
        name: between_rows(getattr(read, name))
        for name in ("position", "supply_pressure", "return_pressure", "temperature")
    }
    nodes |= {"direction": same(direction), "run": same(run)}
    if read.rate is not None:
        nodes["rate"] = same(read.rate)
    # Made row by row under vmap, where the columns have the shape that Conditions are checked for.
    at = jax.vmap(lambda columns: Conditions(**columns))(nodes)
    step = jnp.where(starts, 1.0, jnp.maximum(read.time - before(read.time), SHORTEST)) / substeps
    return at, starts, step


class _Ties(eqx.Module):
    """The ports' flows at given pressures, with lines and a path between the ports where there are such.

    A port's pressure is written as its distance from one end, supply (`upper`) or return, where that distance keeps full relative
    precision. It may be negative: the stages of a step swing beyond the end that a pressure runs into, and oil then flows
    backwards.
    """

    flows: PortFlows
    conductance: Float[Array, "..."] | None
    coupling: Coupling
    upper: Bool[Array, "2 rows"]

    def drops(self, distance: Float[Array, "2 rows"]) -> Between:
        """Both drops between the gauges [Pa]."""
        c = self.flows.conditions
        other = c.supply_pressure - c.return_pressure - distance
        return Between(jnp.where(self.upper, distance, other), jnp.where(self.upper, other, distance))

    def pressure(self, distance: Float[Array, "2 rows"]) -> Float[Array, "2 rows"]:
        c = self.flows.conditions
        return jnp.where(self.upper, c.supply_pressure - distance, c.return_pressure + distance)

    def state(self, distance: Float[Array, "2 rows"]) -> tuple[Ports, Conditions]:
        """Ports at these distances, and the conditions inside the lines."""
        gauges, oil = self.flows.conditions, self.flows.oil
        drops, inside, flows = self.drops(distance), gauges, self.flows
        ports, _, _ = ports_with_crossing(flows, drops, self.conductance)
        for _ in range(LINE_TURNS if self.coupling.lines else 0):
            warm = return_temperature(ports, oil, flows.heat_retention, inside)
            lost, gained = lost_in_lines(self.coupling.lines, ports, oil, gauges, warm)
            inside = with_pressures(gauges, gauges.supply_pressure - lost, gauges.return_pressure + gained)
            flows = eqx.tree_at(lambda f: f.conditions, self.flows, inside)
            behind = Between(drops.supply_drop - lost, drops.return_drop - gained)
            ports, _, _ = ports_with_crossing(flows, behind, self.conductance)
        return ports, inside

    def net(self, distance: Float[Array, "2 rows"]) -> Float[Array, "2 rows"]:
        """What flows into each port beyond what leaves it [m3/s], at the port's pressure and temperature."""
        ports, _ = self.state(distance)
        surplus = ports.inflow - ports.outflow
        if ports.crossing is not None:
            surplus = surplus + ports.crossing
        return surplus / density(self.flows.oil, ports.pressure, ports.temperature)


def _ties(valve: Valve, oil: Oil, true: Conditions, coupling: Coupling, upper: Bool[Array, "2 rows"]) -> _Ties:
    flows = port_flows(metering_edges(valve, true), oil, heat_kept(valve), true)
    crossings = coupling.crossings
    return _Ties(flows, crossing_conductance(crossings, oil, true) if crossings else None, coupling, upper)


def _at(ties: _Ties, distance: Float[Array, "nodes 2 rows"]) -> tuple[Array, Array]:
    """Port pressures [Pa] and net flows into the ports [m3/s] at every node, each (nodes, 2, rows)."""
    return jax.vmap(_Ties.pressure)(ties, distance), jax.vmap(_Ties.net)(ties, distance)


def _slopes(
    ties: _Ties, distance: Float[Array, "nodes 2 rows"], away: Float[Array, "2 rows"]
) -> tuple[Array, Array, Array]:
    """Pressures, net flows and their slopes to the pressures (as `_Chain.condense` takes them). away: d distance/d p, 1 or -1.

    A port knows of the other through a path or through lines only.
    """
    net, push = jax.linearize(lambda d: jax.vmap(_Ties.net)(ties, d), distance)
    pressure, along = jax.vmap(_Ties.pressure)(ties, distance), jnp.broadcast_to(away, distance.shape)
    if ties.coupling.lines or ties.coupling.crossings:
        apart = [push(along * np.eye(2)[:, j, None]) for j in range(2)]
        return pressure, net, jnp.stack(apart, axis=2)
    return pressure, net, push(along)[:, None]


class StoredPorts(eqx.Module):
    """Ports at every row and the conditions inside the lines, and what the pressures follow: the row before by `carried`
    ((2, 2, rows), or (1, 2, rows) of ports apart), and what depends on the row alone, `source` (2, rows), 0 at the solution."""

    ports: Ports
    inside: Conditions
    source: Float[Array, "2 rows"]
    carried: Float[Array, "ports 2 rows"]


def stored_ports(
    valve: Valve,
    oil: Oil,
    read: Conditions,
    true: Conditions,
    steady: Ports,
    coupling: Coupling,
    push: Float[Array, "2 rows"] | None = None,
) -> StoredPorts:
    """Both ports closed, with what is stored there.

    steady: the ports without storage, where the search starts. Rows of a run stand together in the order of time; a run
    starts steady. First derivatives, forward and reverse, are those of the solution (implicit function theorem).
    Rows whose pressures were not found are NaN.
    push [Pa]: takes the place of all that pressures follow, so that every row depends on its own parameters, on its own
    `push` and, through `source`, on nothing else: `along_rows` then makes the whole derivative.
    Raises ValueError where the conditions have no time.
    """
    substeps = max(effect.substeps for effect in coupling.storage)
    nodes, starts, step = _nodes(read, substeps)
    span = true.supply_pressure - true.return_pressure
    up, down = true.supply_pressure - steady.pressure, steady.pressure - true.return_pressure
    upper = up < down
    away = jnp.where(upper, -1.0, 1.0)
    ties = jax.vmap(lambda at: _ties(valve, oil, true_conditions(valve, at), coupling, upper))(nodes)
    compliance = sum((effect.compliance() for effect in coupling.storage), start=jnp.zeros((2, 1)))
    chain = _Chain(jnp.where(starts, 0.0, compliance), step, starts, substeps)
    known_ties, known_chain = jax.lax.stop_gradient((ties, chain))
    known_span = jax.lax.stop_gradient(span)

    def going(state: tuple[Array, Array, Array]) -> Array:
        _, largest, turns = state
        return (largest > CLOSE) & (turns < MOST_TURNS)

    def kept_inside(before: Array, after: Array) -> Array:
        """The distance from an end behind a turn."""
        crosses = (before * after < 0.0) & (jnp.abs(before) > AT_THE_END * known_span)
        return jnp.where(crosses, KEPT * before, jnp.maximum(after, -MOST_BEYOND * known_span))

    def turn(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        distance, _, turns = state
        pressure, net, slope = _slopes(known_ties, distance, away)
        condensed = known_chain.condense(known_chain.imbalance(pressure, net), slope)
        source, carried = known_chain.ends(condensed)
        moves = known_chain.moves(condensed, along_rows(carried, source))
        own = kept_inside(distance, distance + away * moves)
        other = known_span - distance
        own = jnp.where(own < 0.5 * known_span, own, known_span - kept_inside(other, known_span - own))
        largest = jnp.max(jnp.abs(own - distance) / known_span)
        return own, largest, turns + 1

    first = jax.lax.stop_gradient(jnp.broadcast_to(jnp.where(upper, up, down), (len(PARTS) * substeps, *upper.shape)))
    begin = (first, jnp.asarray(jnp.inf), jnp.asarray(0))
    distance = jax.lax.stop_gradient(jax.lax.while_loop(going, turn, begin)[0])

    # One turn more, which moves nothing: by it what the imbalances depend on reaches the pressures.
    *_, slope = jax.lax.stop_gradient(_slopes(known_ties, distance, away))
    source, carried = known_chain.ends(known_chain.condense(chain.imbalance(*_at(ties, distance)), slope))
    moved = along_rows(carried, source)
    moved = jnp.where(jnp.abs(moved) < FOUND * span, moved, jnp.nan)
    if push is not None:
        moved = jax.lax.stop_gradient(moved) + push
    ports, inside = _ties(valve, oil, true, coupling, upper).state(distance[-1] + away * moved)
    return StoredPorts(ports, inside, source, carried)
