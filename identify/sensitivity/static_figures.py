"""The figures of the three static tests for many samples of a valve's factors at once, in chunks: what a global study varies."""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.numerics import kept, require_float64
from thermohyd.valve import Valve

from .curves import COLUMNS, columns_of, nominal_rows, slopes_at, three_tests
from .factors import Factor
from .varied import by_name, varied


# Each test is swept over these shares of the stroke, denser near null.
SWEEP = tuple(float(s * abs(s)) for s in np.linspace(-1.0, 1.0, 21))
_ZERO, _HALF, _FULL = 10, 17, 20  # positions 0, 49 % and 100 %
ASIDE = 1e-4  # of the stroke: slopes are taken between positions this much to either side
# Then rows at the hydraulic null and beside it, and beside 49 %.
NULL = (0.0, -ASIDE, ASIDE)
SHARES = np.array([*SWEEP, *NULL, SWEEP[_HALF] - ASIDE, SWEEP[_HALF] + ASIDE])
_AT_NULL, _ASIDE_NULL, _ASIDE_HALF = 21, 22, 24
IS_NULL = np.isin(np.arange(len(SHARES)), range(_AT_NULL, _AT_NULL + 3))
CHUNK = 2048  # samples per evaluation: what the balances need of memory stays flat


@dataclass(frozen=True)
class Output:
    """One figure of the static tests."""

    name: str
    unit: str
    meaning: str


OUTPUTS = (
    Output("null_leakage", "m3/s", "leakage at the hydraulic null"),
    Output("peak_leakage", "m3/s", "largest leakage of the sweep"),
    Output("open_leakage", "m3/s", "leakage at 49 % of the stroke, over the lands"),
    Output("null_pressure_gain", "Pa/m", "K_PX at the hydraulic null"),
    Output("zero_load_pressure", "Pa", "load pressure at position zero"),
    Output("null_flow_gain", "m2/s", "K_QX at the hydraulic null"),
    Output("half_flow_gain", "m2/s", "K_QX at 49 % of the stroke"),
    Output("full_flow", "m3/s", "control flow at full stroke"),
)


@kept
def _readings(
    valve: Valve, base: Float[Array, "3"], names: tuple[str, ...], values: Float[Array, "samples factors"]
) -> Float[Array, "samples 3 rows"]:
    x = valve.stroke * jnp.asarray(SHARES)
    conditions = Conditions(x, *(base[i] * jnp.ones_like(x) for i in (1, 2, 0)))

    def of(one: Float[Array, " factors"]) -> Float[Array, "3 rows"]:
        changes = by_name(one, names)
        # The rows at the null stand where the sample itself has it, so they see neither its bias nor its stroke.
        for name, at_null in (("null_bias", jnp.zeros(())), ("stroke", valve.stroke)):
            own = changes[name] if name in changes else getattr(valve, name)
            changes[name] = jnp.where(jnp.asarray(IS_NULL), at_null, own)
        return three_tests(*varied(valve, conditions, changes))

    return jax.vmap(of)(values)


@dataclass(frozen=True)
class StaticTests:
    """The three static tests of a valve as functions of samples of its factors: (samples, factors), SI.

    Every sample is simulated at the same 26 positions of each test. Slopes (K_PX, K_QX) are taken over 0.02 % of the
    stroke, which for the seed valve differs from the derivative by less than 1e-5.
    """

    valve: Valve
    factors: tuple[Factor, ...]
    temperature: float
    supply_pressure: float
    return_pressure: float

    def __post_init__(self) -> None:
        require_float64("sensitivity")

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(factor.name for factor in self.factors)

    def outputs(
        self, samples: np.ndarray, progress: Callable[[str], None] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """(samples, outputs), and the readings of the sweeps (samples, 3, positions of SWEEP)."""
        values = self._relative(samples)
        base = jnp.asarray([self.temperature, self.supply_pressure, self.return_pressure])
        parts = []
        for first in range(0, len(values), CHUNK):
            if progress is not None and first % (8 * CHUNK) == 0:
                progress(f"simulating valve {first:,} of {len(values):,}")
            rows = values[first : first + CHUNK]
            # A short last chunk is filled up: one size, one compiled program.
            index = np.minimum(np.arange(CHUNK), len(rows) - 1)
            parts.append(np.asarray(_readings(self.valve, base, self.names, jnp.asarray(rows[index])))[: len(rows)])
        readings = np.concatenate(parts)
        found, _ = self._figures(np.moveaxis(readings, 0, -1), self._column("stroke", samples))
        return found.T, readings[..., : len(SWEEP)]

    def slopes(
        self, samples: np.ndarray, progress: Callable[[str], None] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """(samples, outputs), and their derivatives (samples, factors, outputs) per SI unit of each factor."""
        count = len(samples)
        shape = (len(SHARES), count)
        spread = lambda column: np.broadcast_to(column, shape).reshape(-1)
        values = np.array(nominal_rows(self.valve, SHARES.size * count))
        for name, column in zip(self.names, self._relative(samples).T, strict=True):
            values[COLUMNS.index(name)] = spread(column)
        null = spread(IS_NULL[:, None])
        values[COLUMNS.index("null_bias"), null] = 0.0
        values[COLUMNS.index("stroke"), null] = float(self.valve.stroke)
        x = spread(float(self.valve.stroke) * SHARES[:, None])
        supply, back, warm = map(spread, (self.supply_pressure, self.return_pressure, self.temperature))
        readings, slopes = slopes_at(self.valve, x, supply, back, warm, values, progress)
        slopes[:, [COLUMNS.index("null_bias"), COLUMNS.index("stroke")]] *= ~null
        columns = np.stack([columns_of(slopes[i], self.factors) for i in range(3)])
        stroke = self._column("stroke", samples)
        found, peak = self._figures(readings.reshape(3, *shape), stroke)
        steps = columns.reshape(3, len(self.names), *shape)
        derived = np.stack([self._figures(steps[:, i], stroke, peak)[0] for i in range(len(self.names))])
        if "stroke" in self.names:  # the distance of its slope follows the stroke
            half = [output.name for output in OUTPUTS].index("half_flow_gain")
            derived[self.names.index("stroke"), half] -= found[half] / stroke
        return found.T, np.moveaxis(derived, -1, 0)

    def _figures(
        self, readings: np.ndarray, stroke: np.ndarray, peak: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """(outputs, samples) of readings (3, rows, samples), or of their derivatives where the peak's row is given."""
        leakage, load, flow = readings
        leaking = leakage[: _AT_NULL + 1]
        row = np.argmax(leaking, axis=0) if peak is None else peak
        slope = lambda y, first, distance: (y[first + 1] - y[first]) / (2.0 * ASIDE * distance)
        own = float(self.valve.stroke)
        found = [
            leakage[_AT_NULL],
            np.take_along_axis(leaking, row[None], axis=0)[0],
            leakage[_HALF],
            slope(load, _ASIDE_NULL, own),
            load[_ZERO],
            slope(flow, _ASIDE_NULL, own),
            slope(flow, _ASIDE_HALF, stroke),
            flow[_FULL],
        ]
        return np.stack(found), row

    def _column(self, name: str, samples: np.ndarray) -> np.ndarray:
        own = float(getattr(self.valve, name))
        return samples[:, self.names.index(name)] if name in self.names else np.full(len(samples), own)

    def _relative(self, samples: np.ndarray) -> np.ndarray:
        """Samples as `varied` takes them: temperature and return pressure as differences, supply pressure as a factor."""
        origin = {"temperature": self.temperature, "return_pressure": self.return_pressure}
        units = {"supply_pressure": self.supply_pressure}
        shift = np.array([origin.get(name, 0.0) for name in self.names])
        return (np.asarray(samples, dtype=float) - shift) / np.array([units.get(name, 1.0) for name in self.names])
