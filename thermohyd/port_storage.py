"""Blocked ports that store oil while a sweep moves their pressure: C dp/dt = Q_in - Q_out at each port (docs/physics.md section 5.1).

Gauges, hoses and trapped air at a blocked port give way to its pressure. A sweep is then a chain in time; all its rows are
solved together by Newton's method, each turn of which evaluates the edges everywhere at once and leaves a linear recursion
along the rows (Lim et al., Parallelizing non-linear sequential models over the sequence length, ICLR 2024, have the idea).
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from thermohyd.effects.effect import Coupling

from .chain_in_time import PARTS, Chain, Mesh, Sweep, along_rows, mesh_of, of_rows, sweep_of
from .conditions import Conditions
from .coupled_ports import crossing_conductance, lost_in_lines, ports_with_crossing, with_pressures
from .oil import Oil, density
from .ports import Between, PortFlows, Ports, port_flows, return_temperature
from .valve import Valve, heat_kept, metering_edges, true_conditions


# The search ends where a turn moves every pressure by less than this share of the supply's; the next one squares it.
CLOSE = 3e-6
ROUGH = 1e-3  # the same of the search that only shows where steps are needed
# From the steady state of sweeps of 12 and 60 s: 6 turns where 1e-13 m3/Pa is stored, 12 at 1e-12, 30 at 1e-10.
MOST_TURNS = 40
# A row whose pressure the last turn still moves by a larger share has no solution that was found, and becomes NaN.
FOUND = 1e-6
# A pressure that a turn would move across supply or return, behind what lines lose, keeps this share of its distance instead: flow
# goes with the root of a drop, of which Newton's method makes a swing about the end without end. Nearer than `AT_THE_END`, as a
# share of the pressure between both, flow is laminar and the balance straight.
KEPT = 0.02
AT_THE_END = 1e-6
MOST_BEYOND = 0.1  # of the pressure between both: where a turn may lead beyond supply or return


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

    def state(self, distance: Float[Array, "2 rows"], lost: Float[Array, "2 rows"]) -> tuple[Ports, Conditions]:
        """Ports at these distances, and the conditions inside lines that lose so much (supply, return)."""
        gauges, drops, flows = self.flows.conditions, self.drops(distance), self.flows
        if not self.coupling.lines:
            return ports_with_crossing(flows, drops, self.conductance)[0], gauges
        inside = with_pressures(gauges, gauges.supply_pressure - lost[0], gauges.return_pressure + lost[1])
        behind = Between(drops.supply_drop - lost[0], drops.return_drop - lost[1])
        ports, _, _ = ports_with_crossing(
            eqx.tree_at(lambda f: f.conditions, flows, inside), behind, self.conductance
        )  # fmt: skip
        return ports, inside

    def missing(self, ports: Ports, inside: Conditions, lost: Float[Array, "2 rows"]) -> Float[Array, "2 rows"]:
        """What the lines lose beyond `lost` [Pa]."""
        if not self.coupling.lines:
            return jnp.zeros_like(lost)
        warm = return_temperature(ports, self.flows.oil, self.flows.heat_retention, inside)
        found = lost_in_lines(self.coupling.lines, ports, self.flows.oil, self.flows.conditions, warm)
        return jnp.stack(found) - lost

    def net(self, distance: Float[Array, "2 rows"], lost: Float[Array, "2 rows"]) -> tuple[Array, Array]:
        """What flows into each port beyond what leaves it [m3/s], at the port's pressure and temperature, and what is `missing`."""
        ports, inside = self.state(distance, lost)
        surplus = ports.inflow - ports.outflow
        if ports.crossing is not None:
            surplus = surplus + ports.crossing
        return surplus / density(self.flows.oil, ports.pressure, ports.temperature), self.missing(ports, inside, lost)


def _ties(valve: Valve, oil: Oil, true: Conditions, coupling: Coupling, upper: Bool[Array, "2 rows"]) -> _Ties:
    flows = port_flows(metering_edges(valve, true), oil, heat_kept(valve), true, coupling.inflows)
    crossings = coupling.crossings
    return _Ties(flows, crossing_conductance(crossings, oil, true) if crossings else None, coupling, upper)


class _Slopes(eqx.Module):
    """Pressures and net flows at every node, and how they follow the pressures, with the lines in step.

    What lines lose, `lost` (supply, return), are unknowns beside the pressures: to first order it changes by `settle` `missing`
    and by `follows` with the pressures. Eliminated, they leave the net flows and slopes that a `Chain` knows.
    """

    pressure: Float[Array, "nodes 2 steps"]
    net: Float[Array, "nodes 2 steps"]
    slope: Float[Array, "nodes ports 2 steps"]
    lines: tuple[Array, Array, Array, Array] | None = None  # missing, settle, follows; net flows by what lines lose

    @property
    def balance(self) -> Float[Array, "nodes 2 steps"]:
        """The net flows with the lines settled."""
        if self.lines is None:
            return self.net
        missing, settle, _, by_lines = self.lines
        return self.net + _times(by_lines, _times(settle, missing))

    def lost(self, lost: Float[Array, "nodes 2 steps"], moves: Float[Array, "nodes 2 steps"]) -> Float[Array, "..."]:
        """What lines lose behind these changes of the pressures."""
        if self.lines is None:
            return lost
        missing, settle, follows, _ = self.lines
        return lost + _times(settle, missing) + _times(follows, moves)


def _times(
    matrix: Float[Array, "nodes 2 2 steps"], vector: Float[Array, "nodes 2 *columns steps"]
) -> Float[Array, "..."]:
    """Two-by-two matrices (node, row, column, step) times vectors, or times matrices, step by step."""
    return jnp.einsum("kijr,kj...r->ki...r", matrix, vector)


def _inverse(matrix: Float[Array, "nodes 2 2 steps"]) -> Float[Array, "nodes 2 2 steps"]:
    a, b, c, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1]
    return jnp.stack([jnp.stack([d, -b], axis=1), jnp.stack([-c, a], axis=1)], axis=1) / (a * d - b * c)[:, None, None]


def _net(
    ties: _Ties, distance: Float[Array, "nodes 2 rows"], lost: Float[Array, "nodes 2 rows"]
) -> tuple[Array, Array]:
    return jax.vmap(_Ties.net)(ties, distance, lost)


def _slopes(
    ties: _Ties,
    distance: Float[Array, "nodes 2 rows"],
    lost: Float[Array, "nodes 2 rows"],
    away: Float[Array, "2 rows"],
) -> _Slopes:
    """away: d distance/d p, 1 or -1. A port knows of the other through a path or through lines only."""
    pressure, along = jax.vmap(_Ties.pressure)(ties, distance), jnp.broadcast_to(away, distance.shape)
    # One port after the other as the leading axis: under vmap there is one push to compile, not one for each.
    one = along * np.eye(2)[:, None, :, None]
    if ties.coupling.lines:
        (net, missing), push = jax.linearize(functools.partial(_net, ties), distance, lost)
        apart = (jnp.concatenate([one, jnp.zeros_like(one)]), jnp.concatenate([jnp.zeros_like(one), jnp.abs(one)]))
        pushed = [jnp.moveaxis(part, 0, 2) for part in jax.vmap(push)(*apart)]
        (slope, by_lines), (missing_slope, kept) = ((part[:, :, :2], part[:, :, 2:]) for part in pushed)
        settle = _inverse(-kept)
        follows = _times(settle, missing_slope)
        return _Slopes(pressure, net, slope + _times(by_lines, follows), (missing, settle, follows, by_lines))
    net, push = jax.linearize(lambda d: _net(ties, d, lost)[0], distance)
    if ties.coupling.crossings:
        return _Slopes(pressure, net, jnp.moveaxis(jax.vmap(push)(one), 0, 2))
    return _Slopes(pressure, net, push(along)[:, None])


class PortsBefore(eqx.Module):
    """Pressures [Pa] of both ports at the first row, where that row ends a piece of a longer log that came before; without
    `known` the first row is steady, as the start of a run is."""

    pressure: Float[Array, "2"]
    known: Bool[Array, ""]


class StoredPorts(eqx.Module):
    """Ports at every row and the conditions inside the lines, and what the pressures follow: the row before by `carried`
    ((2, 2, rows), or (1, 2, rows) of ports apart), and what depends on the row alone, `source` (2, rows), 0 at the solution."""

    ports: Ports
    inside: Conditions
    source: Float[Array, "2 rows"]
    carried: Float[Array, "ports 2 rows"]


class _Task(eqx.Module):
    """What is to be solved, row by row: the pressure between both ends (`whole`), C with 0 where the ports are steady, the time
    since the row before (`lasts`), the pressures before the first row, those where the search begins and the end that each is
    counted from (`upper`; away: d distance/d p, 1 or -1)."""

    valve: Valve
    oil: Oil
    true: Conditions
    coupling: Coupling
    sweep: Sweep
    whole: Float[Array, " rows"]
    compliance: Float[Array, "2 rows"]
    lasts: Float[Array, " rows"]
    begin: Float[Array, "2"]
    guess: Float[Array, "2 rows"]
    upper: Bool[Array, "2 rows"]
    away: Float[Array, "2 rows"]

    def laid_out(self, mesh: Mesh) -> tuple[_Ties, Chain]:
        """The ports' ties at the stages of every step, and how the steps follow each other."""
        apart = (self.valve, self.oil, self.coupling, self.compliance, self.upper)
        own, thin, tied, heavy, side = mesh.spread(apart)
        ties = jax.vmap(lambda at: _ties(own, thin, true_conditions(own, at), tied, side))(self.sweep.at(mesh))
        return ties, Chain(heavy, self.lasts[mesh.owner] * mesh.width, self.begin)

    def at_rows(self) -> _Ties:
        return _ties(self.valve, self.oil, self.true, self.coupling, self.upper)


def _task(
    valve: Valve,
    oil: Oil,
    read: Conditions,
    true: Conditions,
    steady: Ports,
    coupling: Coupling,
    begun: PortsBefore | None,
) -> _Task:
    sweep = sweep_of(read)
    compliance = sum((effect.compliance() for effect in coupling.storage), start=jnp.zeros((2, 1)))
    compliance = jnp.where(sweep.starts, 0.0, compliance)
    guess, lasts, begin = steady.pressure, sweep.span, steady.pressure[:, 0]
    if begun is not None:
        # C (p - p of the start) = 0 with any C, in no time: the first row stays where it was.
        begin = jnp.where(begun.known, begun.pressure, begin)
        compliance = compliance.at[:, 0].set(jnp.where(begun.known, 1.0, compliance[:, 0]))
        guess, lasts = guess.at[:, 0].set(begin), lasts.at[0].set(jnp.where(begun.known, 0.0, lasts[0]))
    upper = true.supply_pressure - guess < guess - true.return_pressure
    whole, away = true.supply_pressure - true.return_pressure, jnp.where(upper, -1.0, 1.0)
    return _Task(valve, oil, true, coupling, sweep, whole, compliance, lasts, begin, guess, upper, away)


def _at_ends(
    upper: Bool[Array, "nodes 2 steps"], lost: Float[Array, "nodes 2 steps"], coupling: Coupling
) -> tuple[Array, Array]:
    """What the lines lose at the end that a port's distance is counted from, and at the other one."""
    if not coupling.lines:
        return jnp.zeros(()), jnp.zeros(())
    supply, return_ = lost[:, :1], lost[:, 1:]
    return jnp.where(upper, supply, return_), jnp.where(upper, return_, supply)


def _searched(
    task: _Task, lost: Float[Array, "2 rows"], substeps: int
) -> tuple[Mesh, Float[Array, "nodes 2 steps"], Float[Array, "nodes 2 steps"]]:
    """A mesh that follows the need, and the distances and what the lines lose at its nodes; lost: what they lose where nothing is
    stored."""
    sweep = task.sweep
    from_end = jnp.where(task.upper, task.true.supply_pressure - task.guess, task.guess - task.true.return_pressure)

    def search(i: Array, state: tuple[Mesh, Array, Array, Array, Array]) -> tuple[Mesh, Array, Array, Array, Array]:
        """From a mesh, pressures at its nodes, what lines lose there and the need for steps row by row to the same on a mesh that
        follows the need, with the distances."""
        before, pressure, _, loss, need = state
        mesh = mesh_of(need, substeps)
        ties, chain = task.laid_out(mesh)
        span, outwards, first = mesh.spread((task.whole, task.away, from_end))
        c = ties.flows.conditions
        found = _interpolated(pressure, before, mesh)
        distance = jnp.where(ties.upper, c.supply_pressure[:, None] - found, found - c.return_pressure[:, None])
        distance = jnp.where(sweep.starts[mesh.owner] | (i == 0), first, distance)
        loss = jnp.where(sweep.starts[mesh.owner] | (i == 0), mesh.spread(lost), _interpolated(loss, before, mesh))
        close = jnp.where(i == 0, ROUGH, CLOSE)

        def going(state: tuple[Array, Array, Array, Array, Array]) -> Array:
            *_, largest, turns = state
            return (largest > close) & (turns < MOST_TURNS)

        def kept_inside(before: Array, after: Array) -> Array:
            """The distance from an end behind a turn."""
            crosses = (before * after < 0.0) & (jnp.abs(before) > AT_THE_END * span)
            return jnp.where(crosses, KEPT * before, jnp.maximum(after, -MOST_BEYOND * span))

        def turn(state: tuple[Array, Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array, Array]:
            distance, loss, _, _, turns = state
            s = _slopes(ties, distance, loss, outwards)
            moves = chain.moves(*chain.condense(chain.imbalance(s.pressure, s.balance), s.slope))
            lost = jnp.clip(s.lost(loss, moves), -MOST_BEYOND * span, span)
            (near, far), (near_then, far_then) = (_at_ends(ties.upper, loss_, task.coupling) for loss_ in (loss, lost))
            own = near_then + kept_inside(distance - near, distance + outwards * moves - near_then)
            other = span - far_then - kept_inside(span - distance - far, span - own - far_then)
            own = jnp.where(own < 0.5 * span, own, other)
            moved = jnp.maximum(jnp.max(jnp.abs(own - distance) / span), jnp.max(jnp.abs(lost - loss) / span))
            return own, lost, chain.error(s.pressure, s.balance, s.slope, span), moved, turns + 1

        begin = (distance, loss, jnp.zeros_like(mesh.width), jnp.asarray(jnp.inf), jnp.asarray(0))
        distance, loss, error, *_ = jax.lax.while_loop(going, turn, begin)
        # A step of twice the length would miss by some four times as much where a flow has a kink.
        need = jax.ops.segment_max(error / mesh.width**2, mesh.owner, num_segments=need.shape[0])
        return mesh, jax.vmap(_Ties.pressure)(ties, distance), distance, loss, jnp.where(sweep.starts, 0.0, need)

    # First where the steady pressures change most, then where that search missed most.
    share = task.guess / task.whole
    need = jnp.where(sweep.starts, 0.0, jnp.max(jnp.abs(jnp.diff(share, prepend=share[:, :1], axis=1)), axis=0))
    mesh = mesh_of(need, substeps)
    none = jnp.zeros((len(PARTS), 2, mesh.owner.size))
    mesh, _, distance, loss, _ = jax.lax.fori_loop(0, 2, search, (mesh, none, none, none, need))
    return mesh, distance, loss


def stored_ports(
    valve: Valve,
    oil: Oil,
    read: Conditions,
    true: Conditions,
    steady: Ports,
    within: Conditions,
    coupling: Coupling,
    push: Float[Array, "2 rows"] | None = None,
    begun: PortsBefore | None = None,
) -> StoredPorts:
    """Both ports closed, with what is stored there.

    steady, within: the ports without storage and the conditions inside the lines, where the search starts. Rows of a run stand
    together in the order of time; a run starts steady. First derivatives, forward and reverse, are those of the solution
    (implicit function theorem).
    Rows whose pressures were not found are NaN.
    push [Pa]: takes the place of all that pressures follow, so that every row depends on its own parameters, on its own
    `push` and, through `source`, on nothing else: `along_rows` then makes the whole derivative.
    begun: the first row goes on from a piece before.
    Raises ValueError where the conditions have no time.
    """
    substeps = max(effect.substeps for effect in coupling.storage)
    # Where nothing is stored the start counts for nothing: no derivative of it need be known.
    steady, within = jax.lax.stop_gradient((steady, within))
    task = _task(valve, oil, read, true, steady, coupling, begun)
    lost = jnp.zeros_like(task.away)
    if coupling.lines:
        lost = task.at_rows().missing(steady, within, lost)
    # Nothing that the search is given has a derivative: loops would carry one for every column of a Jacobian.
    known_task, lost = jax.lax.stop_gradient((task, lost))
    mesh, distance, loss = _searched(known_task, lost, substeps)

    # One turn more, which moves nothing: by it what the imbalances depend on reaches the pressures.
    ties, chain = task.laid_out(mesh)
    known_ties, known_chain = jax.lax.stop_gradient((ties, chain))
    known = _slopes(known_ties, distance, loss, mesh.spread(task.away))
    net, missing = _net(ties, distance, loss)
    pressure, settle = jax.vmap(_Ties.pressure)(ties, distance), None
    if known.lines is not None:
        _, settle, _, by_lines = known.lines
        net = net + _times(by_lines, _times(settle, missing))
    condensed = known_chain.condense(chain.imbalance(pressure, net), known.slope)
    source, carried = of_rows(*condensed, mesh, substeps)
    moved = along_rows(carried, source)
    moved = jnp.where(jnp.abs(moved) < FOUND * task.whole, moved, jnp.nan)
    if push is not None:
        moved = jax.lax.stop_gradient(moved) + push
    at_rows = task.at_rows()
    distance, loss = distance[-1][:, mesh.last] + task.away * moved, loss[-1][:, mesh.last]
    if settle is not None:
        loss = loss + jnp.einsum("ijr,jr->ir", settle[-1][:, :, mesh.last], at_rows.net(distance, loss)[1])
    ports, inside = at_rows.state(distance, loss)
    return StoredPorts(ports, inside, source, carried)


def _interpolated(pressure: Float[Array, "nodes 2 steps"], before: Mesh, mesh: Mesh) -> Float[Array, "nodes 2 steps"]:
    """Pressures at the nodes of a mesh from those of another one of as many steps."""
    along = lambda mesh: (mesh.owner.astype(float) + mesh.share()).T.ravel()
    known = jnp.transpose(pressure, (1, 2, 0)).reshape(2, -1)
    found = jax.vmap(lambda p: jnp.interp(along(mesh), along(before), p))(known)
    return jnp.transpose(found.reshape(2, -1, len(PARTS)), (2, 0, 1))
