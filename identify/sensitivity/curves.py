"""Local sensitivities of the curves: how leakage, load pressure and flow follow each factor at every position.

All come from one program, which computes the three static tests with all their derivatives row by row.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.numerics import quickly, require_float64
from thermohyd.static_tests import blocked_port_readings, control_flow
from thermohyd.valve import Valve

from .factors import FACTORS, Factor
from .varied import LAWS, by_name, nominal_values, varied


TESTS = ("leakage", "pressure_gain", "flow_gain")
READING = {"leakage": "leakage_flow", "pressure_gain": "load_pressure", "flow_gain": "flow"}
COLUMNS = (*FACTORS, *LAWS)
ROWS = 4096  # rows per evaluation: one compiled program for every study, whose memory stays flat


def three_tests(valve: Valve, conditions: Conditions) -> Float[Array, "3 rows"]:
    """Leakage [m3/s], load pressure [Pa] and control flow [m3/s] at the same operating points: the three static tests."""
    return jnp.concatenate([_blocked(valve, conditions), control_flow(valve, conditions)[None]])


def _blocked(valve: Valve, conditions: Conditions) -> Float[Array, "2 rows"]:
    found = blocked_port_readings(valve, conditions)
    return jnp.stack([found["leakage_flow"], found["load_pressure"]])


@quickly
def readings_and_slopes(
    valve: Valve, conditions: Conditions, values: Float[Array, "columns rows"]
) -> tuple[Float[Array, "3 rows"], Float[Array, "3 columns rows"]]:
    """The three tests and their derivatives to everything in `COLUMNS`, at values of it that may differ from row to row.

    A reading depends on the factors through its own row only. One reverse pass per reading over factors spread over the
    rows therefore gives every column at once, however many there are (forward mode gives the same numbers, a column at
    a time).
    """
    of = lambda test: lambda spread: test(*varied(valve, conditions, by_name(spread, COLUMNS)))
    blocked, pull_blocked = jax.vjp(of(_blocked), values)
    flow, pull_flow = jax.vjp(of(control_flow), values)
    one = jnp.ones_like(flow)
    slopes = jax.vmap(lambda which: pull_blocked(which[:, None] * one)[0])(jnp.eye(2, dtype=one.dtype))
    return jnp.concatenate([blocked, flow[None]]), jnp.concatenate([slopes, pull_flow(one)[0][None]])


def nominal_rows(valve: Valve, rows: int) -> Float[Array, "columns rows"]:
    """Values of `COLUMNS` that change nothing, for so many rows."""
    nominal = nominal_values(valve)
    return jnp.stack([jnp.broadcast_to(nominal[name], (rows,)) for name in COLUMNS])


def slopes_at(
    valve: Valve,
    position: np.ndarray,
    supply_pressure: np.ndarray,
    return_pressure: np.ndarray,
    temperature: np.ndarray,
    values: np.ndarray | None = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """(3, rows) readings and (3, columns, rows) slopes at any number of operating points (SI), piece by piece.

    values: (columns, rows) of `COLUMNS` as `varied` takes them; None: the valve as it is.
    """
    count = len(position)
    given = np.stack([position, supply_pressure, return_pressure, temperature])
    whole = np.asarray(nominal_rows(valve, count)) if values is None else values
    readings, slopes = np.empty((3, count)), np.empty((3, len(COLUMNS), count))
    for first in range(0, count, ROWS):
        if progress is not None and first:
            progress(f"differentiating {first:,} of {count:,} operating points")
        index = np.minimum(np.arange(first, first + ROWS), count - 1)
        rows = slice(first, min(first + ROWS, count))
        found = readings_and_slopes(valve, Conditions(*jnp.asarray(given[:, index])), jnp.asarray(whole[:, index]))
        readings[:, rows], slopes[..., rows] = (np.asarray(part)[..., : rows.stop - first] for part in found)
    return readings, slopes


@dataclass(frozen=True)
class CurveSlopes:
    """Curves of the three static tests on one grid of operating points, and their derivatives (SI).

    position, supply_pressure, return_pressure, temperature: (rows,). value: {test: (rows,)}; slope: {test: (factors, rows)},
    per SI unit of each factor, in the order of `factors`; viscosity and density per unit of their factor on the oil's
    table, supply_pressure per Pa of `factors`' own.
    """

    factors: tuple[Factor, ...]
    position: np.ndarray
    supply_pressure: np.ndarray
    return_pressure: np.ndarray
    temperature: np.ndarray
    value: dict[str, np.ndarray]
    slope: dict[str, np.ndarray]

    def normalised(self, test: str) -> np.ndarray:
        """(factors, rows): d ln y/d ln theta; for a factor that may be zero, the relative change of y per tolerance.

        Leakage has one sign, so it is relative to itself; load pressure and flow go through zero and are relative to
        their largest value on the curve of the same temperature and pressures.
        """
        steps = np.array([factor.step for factor in self.factors])
        return steps[:, None] * self.slope[test] / self.scale(test)

    def scale(self, test: str) -> np.ndarray:
        """What the normalised sensitivities of a test are relative to, row by row: the reading, or its full scale."""
        size = np.abs(self.value[test])
        if test == "leakage":
            return size
        conditions = np.stack([self.supply_pressure, self.return_pressure, self.temperature])
        group = np.unique(conditions, axis=1, return_inverse=True)[1].reshape(-1)
        largest = np.zeros(group.max() + 1)
        np.maximum.at(largest, group, size)
        return largest[group]

    def rows_at(self, temperature: float, supply_pressure: float) -> np.ndarray:
        """Indices of the rows of one condition, in the order of position."""
        same = np.isclose(self.temperature, temperature) & np.isclose(self.supply_pressure, supply_pressure)
        return np.flatnonzero(same)


def curve_slopes(
    valve: Valve,
    factors: tuple[Factor, ...],
    position: np.ndarray,
    *,
    temperatures: Sequence[float] | np.ndarray,
    supply_pressures: Sequence[float] | np.ndarray,
    return_pressure: float = 0.0,
) -> CurveSlopes:
    """All sensitivities of all three curves to all factors, at every position [m], temperature [K] and supply pressure [Pa].

    Raises RuntimeError in single precision.

    >>> from thermohyd.identify.sensitivity.factors import factors_of
    >>> from thermohyd.identify.sensitivity.source import seed_model
    >>> from thermohyd.identify.sensitivity.varied import valve_of_model
    >>> model = seed_model()
    >>> factors = factors_of(model, temperature=313.15, supply_pressure=70e5)
    >>> found = curve_slopes(
    ...     valve_of_model(model), factors, np.array([-100e-6, 0.0, 100e-6]), temperatures=[313.15], supply_pressures=[70e5]
    ... )
    >>> found.slope["leakage"].shape
    (14, 3)
    >>> clearance = found.normalised("leakage")[1]  # d ln(leakage)/d ln(clearance): cubic over the lands
    >>> [round(float(share), 2) for share in clearance]
    [2.97, 0.66, 2.97]
    """
    require_float64("sensitivity")
    t, ps, x = (a.reshape(-1) for a in np.meshgrid(temperatures, supply_pressures, position, indexing="ij"))
    back = np.full(len(x), return_pressure)
    readings, slopes = slopes_at(valve, x, ps, back, t)
    return CurveSlopes(
        factors,
        x,
        ps,
        back,
        t,
        {test: readings[i] for i, test in enumerate(TESTS)},
        {test: columns_of(slopes[i], factors) for i, test in enumerate(TESTS)},
    )


def columns_of(slopes: np.ndarray, factors: tuple[Factor, ...]) -> np.ndarray:
    """(factors, rows) from the columns of `slopes_at`, per SI unit: the supply pressure is a factor there, not Pa."""
    rows = [COLUMNS.index(factor.name) for factor in factors]
    per_unit = [1.0 / factor.value if factor.name == "supply_pressure" else 1.0 for factor in factors]
    return slopes[rows] * np.array(per_unit)[:, None]
