"""Every curve of the seed paper in one batched program: both models, two supply pressures, all temperatures, the whole stroke.

A `Claim` is one statement of the paper in our words, beside what these curves say of it.
"""

from dataclasses import dataclass, field
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions, operating_points
from thermohyd.edge import EdgeLaw
from thermohyd.numerics import quickly, require_float64
from thermohyd.oil import walther_viscosity
from thermohyd.static_tests import blocked_port_readings, control_flow
from thermohyd.valve import Valve, true_oil


MODELS = ("HM", "THM")  # isothermal, adiabatic: the first axis of every array
ETA = (0.0, 1.0)  # share of the heat of throttling that the oil keeps in each
# Openings in steps of 1 % of the stroke, and of 0.25 % around null, where the leakage has its shape.
STEP, FINE_STEP, FINE_UP_TO = 0.01, 0.0025, 0.12


@dataclass(frozen=True)
class SeedCurves:
    """Arrays of shape (model, supply, temperature, opening), SI.

    opening: share of the stroke, -1 to 1; temperature [K] and viscosity [m2/s] go together. leakage, flow [m3/s];
    load_pressure [Pa]; pressure_gain K_PX [Pa/m]; flow_gain K_QX [m2/s].
    """

    stroke: float
    supply: np.ndarray
    temperature: np.ndarray
    viscosity: np.ndarray
    opening: np.ndarray
    leakage: np.ndarray
    load_pressure: np.ndarray
    pressure_gain: np.ndarray
    flow: np.ndarray
    flow_gain: np.ndarray
    edge_law: EdgeLaw = "orifice"

    def at_opening(self, share: float) -> int:
        """Index of an opening that the curves contain (ValueError otherwise)."""
        return _index(self.opening, share, 1e-9, "opening")

    @property
    def equidistant(self) -> np.ndarray:
        """Indices of the openings in even steps over the whole stroke, for fits that should weigh it evenly."""
        steps = self.opening / STEP
        return np.flatnonzero(np.abs(steps - np.round(steps)) < 1e-6)

    def at_viscosity(self, viscosity: float) -> int:
        """Index of the temperature at which the oil has a viscosity [m2/s] (ValueError where no curve is)."""
        return _index(np.log(self.viscosity), float(np.log(viscosity)), 1e-3, "viscosity")


def _index(values: np.ndarray, wanted: float, closeness: float, what: str) -> int:
    nearest = int(np.argmin(np.abs(values - wanted)))
    if abs(values[nearest] - wanted) > closeness:
        raise ValueError(f"no curve was computed at this {what}")
    return nearest


def _openings() -> np.ndarray:
    fine = np.arange(-round(1.0 / FINE_STEP), round(1.0 / FINE_STEP) + 1) * FINE_STEP
    coarse = np.arange(len(fine)) % round(STEP / FINE_STEP) == 0
    return fine[coarse | (np.abs(fine) <= FINE_UP_TO + 1e-9)]


@quickly
def _program(valve: Valve, rows: Conditions) -> dict[str, Float[Array, " rows"]]:
    """All readings and their slopes to the position in one compilation; the valve's heat retention may differ by row."""

    def readings(position: Array) -> tuple[Array, ...]:
        moved = eqx.tree_at(lambda c: c.position, rows, position)
        blocked = blocked_port_readings(valve, moved)
        return blocked["leakage_flow"], blocked["load_pressure"], control_flow(valve, moved)

    values, slopes = jax.jvp(readings, (rows.position,), (jnp.ones_like(rows.position),))
    return {
        "leakage": values[0],
        "load_pressure": values[1],
        "flow": values[2],
        "pressure_gain": slopes[1],
        "flow_gain": slopes[2],
    }


def seed_curves(
    valve: Valve, temperatures: np.ndarray, supply_pressures: tuple[float, ...], return_pressure: float = 0.0
) -> SeedCurves:
    """The static tests of a valve and their gains at temperatures [K] (t,) and supply pressures [Pa, gauge].

    Openings are counted from the hydraulic null. Raises RuntimeError in single precision.
    """
    require_float64("the seed paper's curves")
    temperature, supply = np.sort(np.asarray(temperatures, dtype=float)), np.asarray(supply_pressures, dtype=float)
    opening = _openings()
    stroke, null = float(valve.stroke), float(valve.null_bias)
    shape = (len(MODELS), len(supply), len(temperature), len(opening))
    eta, p, t, x = np.meshgrid(ETA, supply, temperature, opening * stroke + null, indexing="ij")
    eta, p, t, x = (jnp.asarray(values.ravel()) for values in (eta, p, t, x))
    rows = operating_points(x, supply_pressure=p, temperature=t, return_pressure=return_pressure)
    # One valve whose eta varies along the rows: tracing two valves by vmap would take longer than running them.
    both = eqx.tree_at(lambda v: v.heat_retention, valve, eta, is_leaf=lambda leaf: leaf is None)
    found = jax.device_get(_program(both, rows))
    arrays = {name: values.reshape(shape) for name, values in found.items()}
    viscosity = np.asarray(jax.jit(walther_viscosity)(true_oil(valve), jnp.asarray(temperature)))
    return SeedCurves(
        stroke=stroke,
        supply=supply,
        temperature=temperature,
        viscosity=viscosity,
        opening=opening,
        edge_law=valve.edge_law,
        **arrays,
    )


Verdict = Literal["holds", "partly", "no"]
LITTLE = 0.05  # the paper's own "less than 5 %"


@dataclass(frozen=True)
class Claim:
    """where: figure or section of the paper. title and short: the claim and its figure in a few words, for a terminal.
    computed: a sentence with the figures; why: what explains a difference, or limits the claim; empty where there is
    nothing to say. values: the figures behind the sentence, by name with unit."""

    key: str
    where: str
    title: str
    claim: str
    holds: Verdict
    short: str
    computed: str
    why: str = ""
    values: dict[str, float] = field(default_factory=dict)


def verdict(holds: bool | np.bool_, partly: bool | np.bool_ = False) -> Verdict:
    """The word for a claim that holds, or holds in part."""
    return "holds" if holds else "partly" if partly else "no"


def percent(share: float, decimals: int = 1, sign: bool = False) -> str:
    """Such as "4.4 %" or, with its sign, "+4.4 %"."""
    return f"{100.0 * share:{'+' if sign else ''}.{decimals}f} %"


def thickest_within(viscosity: np.ndarray, gap: np.ndarray, limit: float = LITTLE) -> float:
    """Viscosity [m2/s] up to which |gap| (same shape) stays below the limit, interpolated in ln nu; the thickest where it
    always does, 0 where it never does."""
    order = np.argsort(viscosity)
    nu, size = viscosity[order], np.abs(gap[order])
    above = np.flatnonzero(size >= limit)
    if not len(above):
        return float(nu[-1])
    i = int(above[0])
    if i == 0:
        return 0.0
    share = (limit - size[i - 1]) / (size[i] - size[i - 1])
    return float(np.exp(np.log(nu[i - 1]) + share * np.log(nu[i] / nu[i - 1])))
