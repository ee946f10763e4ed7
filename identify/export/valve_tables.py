"""A fitted valve as tables over two axes, with the error that interpolating between their nodes makes, measured against the model.

    load_flow      over spool position and load pressure: flow from A to B through the load [m3/s]
    leakage_flow   over spool position and supply pressure: flow to the return with closed ports [m3/s]
    load_pressure  over spool position and supply pressure: p_A - p_B with closed ports [Pa]

Nodes stand where the curves bend: from the ends and the null on, one is added where a straight line misses the model most.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from thermohyd.conditions import Conditions
from thermohyd.effects.library import with_effects
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.fitting.static_readings import base_valve
from thermohyd.identify.model.model import Model
from thermohyd.static_tests import blocked_port_readings, load_flow
from thermohyd.valve import Valve

from .valve_numbers import left_on_the_bench


FINE = 1601  # positions of the mesh in which nodes are chosen
FINE_ACROSS = 101
DENSE = 6.0
ASIDE = 0.382  # of a cell: where the error is measured beside its middle, at no node of the mesh
BATCH = 8192  # rows
REACH = 1.0  # of the stroke
LOADS = 0.98  # of the pressure between supply and return
SUPPLIES = (0.5, 1.25)  # of the supply pressure


@dataclass(frozen=True)
class Axis:
    """name, unit (SI) and the nodes of one axis, rising."""

    name: str
    unit: str
    nodes: np.ndarray


@dataclass(frozen=True)
class ValveTable:
    """values (x nodes, y nodes) of a quantity. largest, mean: absolute errors of linear interpolation between the nodes, over all
    cells at points that no node knows; span: of the values."""

    name: str
    unit: str
    words: str
    x: Axis
    y: Axis
    values: np.ndarray
    largest: float
    mean: float

    @property
    def span(self) -> float:
        return float(np.ptp(self.values))


@dataclass(frozen=True)
class ValveTables:
    """All tables of a model at one supply pressure, return pressure and temperature. left_out: effects that stay on the bench."""

    name: str
    supply_pressure: float
    return_pressure: float
    temperature: float
    tables: tuple[ValveTable, ...]
    left_out: tuple[str, ...]


def valve_tables(
    model: Model,
    *,
    supply_pressure: float,
    return_pressure: float = 0.0,
    temperature: float,
    positions: int = 81,
    across: int = 31,
) -> ValveTables:
    """Tables of a model, SI. positions, across: nodes along the spool position and along the other axis.

    A spool with hysteresis is taken in the middle of its loop. Raises BenchInputError for a model with learned terms.
    """
    if model.learned:
        raise BenchInputError("the model holds a learned term, which is empirical; take it out of model.json")
    acting = {name: amount for name, amount in model.effects.items() if amount != 0.0}
    left = left_on_the_bench(acting)
    valve = _valve(model, {name: amount for name, amount in acting.items() if name not in left})
    stroke, span = model.valve.stroke, supply_pressure - return_pressure

    def conditions(x: np.ndarray, supply: np.ndarray | float, load: np.ndarray | None) -> Conditions:
        same = lambda value: jnp.broadcast_to(jnp.asarray(value, dtype=float), x.shape)
        return Conditions(
            jnp.asarray(x), same(supply), same(return_pressure), same(temperature),
            load_pressure=None if load is None else jnp.asarray(load), direction=jnp.zeros(x.shape),
        )  # fmt: skip

    def flow(x: np.ndarray, load: np.ndarray) -> np.ndarray:
        return np.asarray(load_flow(valve, conditions(x, supply_pressure, load)))

    def closed(x: np.ndarray, supply: np.ndarray) -> dict[str, np.ndarray]:
        readings = blocked_port_readings(valve, conditions(x, supply, None))
        return {name: np.asarray(readings[name]) for name in ("leakage_flow", "load_pressure")}

    # Edges close within micrometres of null: the mesh steps there by some nanometres, at full stroke by a micrometre.
    dense = np.sinh(DENSE * np.linspace(-1.0, 1.0, FINE)) / np.sinh(DENSE)
    x = Axis("spool_position", "m", REACH * stroke * dense)
    # The flow goes with the root of what the load leaves of the pressure: its mesh is denser towards both ends.
    ends = np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, FINE_ACROSS))
    loads = Axis("load_pressure", "Pa", LOADS * ends * span)
    supplies = Axis("supply_pressure", "Pa", return_pressure + np.linspace(*SUPPLIES, FINE_ACROSS) * span)
    made = [_table("load_flow", "m3/s", "flow from A to B through the load", x, loads, flow, positions, across)]
    for name, unit, words in (
        ("leakage_flow", "m3/s", "flow to the return with closed ports"),
        ("load_pressure", "Pa", "p_A - p_B with closed ports"),
    ):
        one = lambda x, supply, name=name: closed(x, supply)[name]
        made.append(_table(name, unit, words, x, supplies, one, positions, across))
    return ValveTables(model.valve.name, supply_pressure, return_pressure, temperature, tuple(made), left)


def _valve(model: Model, effects: dict[str, float]) -> Valve:
    from pathlib import Path

    record = BenchRecord(Path(), model.valve.name, model.valve, model.oil, {})
    return with_effects(base_valve(record, model.parameters), effects)


Quantity = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _table(
    name: str, unit: str, words: str, x: Axis, y: Axis, quantity: Quantity, positions: int, across: int
) -> ValveTable:
    """A table of a quantity, a function of (rows,) along x and (rows,) along y."""
    at = lambda xs, ys: _in_batches(quantity, np.repeat(xs, len(ys)), np.tile(ys, len(xs))).reshape(len(xs), len(ys))
    fine = at(x.nodes, y.nodes)
    if not np.isfinite(fine).all():
        raise BenchInputError(f"the model has no {name} at all points of its table; take other pressures")
    rows, columns = chosen_nodes(x.nodes, fine, positions), chosen_nodes(y.nodes, fine.T, across)
    own_x, own_y = replace(x, nodes=x.nodes[rows]), replace(y, nodes=y.nodes[columns])
    values = fine[np.ix_(rows, columns)]
    # Between the nodes: in every cell, at two places along x and two along y.
    between_x, between_y = between_nodes(own_x.nodes), between_nodes(own_y.nodes)
    error = np.abs(interpolated(own_x.nodes, own_y.nodes, values, between_x, between_y) - at(between_x, between_y))
    return ValveTable(name, unit, words, own_x, own_y, values, float(error.max()), float(error.mean()))


def _in_batches(quantity: Quantity, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The quantity at every row, so many rows at once that one compiled program serves all."""
    found = []
    for start in range(0, len(x), BATCH):
        own = [
            np.pad(column[start : start + BATCH], (0, max(0, start + BATCH - len(x))), mode="edge") for column in (x, y)
        ]
        found.append(quantity(*own)[: len(x) - start])
    return np.concatenate(found)


def chosen_nodes(place: np.ndarray, curves: np.ndarray, count: int) -> np.ndarray:
    """Which of the places (n,) become nodes, ascending: `count` of them, so that straight lines between miss curves (n, k) least.

    From both ends and the middle on, one is added where a line misses most, as a share of all curves' range.
    """
    nodes = [0, (len(place) - 1) // 2, len(place) - 1]
    error = np.zeros(len(place))

    def missed(a: int, b: int) -> None:
        share = ((place[a : b + 1] - place[a]) / (place[b] - place[a]))[:, None]
        line = curves[a] + share * (curves[b] - curves[a])
        error[a : b + 1] = np.abs(curves[a : b + 1] - line).max(axis=1)

    missed(nodes[0], nodes[1])
    missed(nodes[1], nodes[2])
    while len(nodes) < min(count, len(place)):
        # Where nothing is missed at all, the widest gap is halved.
        worst = int(error.argmax())
        if error[worst] == 0.0 or worst in nodes:
            gaps = np.diff(nodes)
            worst = nodes[int(gaps.argmax())] + int(gaps.max()) // 2
        right = int(np.searchsorted(nodes, worst))
        if nodes[right] == worst:
            break
        a, b = nodes[right - 1], nodes[right]
        nodes.insert(right, worst)
        missed(a, worst)
        missed(worst, b)
    return np.array(nodes)


def between_nodes(nodes: np.ndarray) -> np.ndarray:
    """The middle of every cell, and a place beside it."""
    width = np.diff(nodes)
    return np.sort(np.concatenate([nodes[:-1] + 0.5 * width, nodes[:-1] + ASIDE * width]))


def interpolated(x: np.ndarray, y: np.ndarray, values: np.ndarray, at_x: np.ndarray, at_y: np.ndarray) -> np.ndarray:
    """Bilinear interpolation of values (x, y) at (at_x, at_y): what all three programs do with linear tables."""
    along = np.stack([np.interp(at_x, x, column) for column in values.T], axis=1)
    return np.stack([np.interp(at_y, y, row) for row in along])
