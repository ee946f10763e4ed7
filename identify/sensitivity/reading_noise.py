"""How well each test's reading can be read: a record's own noise, the user's, or the usual instruments'."""

from dataclasses import dataclass

import numpy as np


# Of good bench instruments: share of the reading, and share of the full scale, added as variances.
FLOWMETER = (0.01, 0.002)
GAUGE = (0.0, 0.005)
POSITION = 0.001  # of the stroke: standard deviation of a position, which steep curves turn into one of the reading
DEFAULTS = {"leakage": FLOWMETER, "pressure_gain": GAUGE, "flow_gain": FLOWMETER}
UNITS = {"leakage": ("l/min", 6e4), "pressure_gain": ("bar", 1e-5), "flow_gain": ("l/min", 6e4)}


@dataclass(frozen=True)
class ReadingNoise:
    """Standard deviation of one reading of each test. absolute: {test: std in SI}; other tests take `DEFAULTS`."""

    absolute: dict[str, float]
    source: str = ""  # where the absolute ones come from

    def std(self, test: str, value: np.ndarray, supply_pressure: np.ndarray, per_stroke: np.ndarray) -> np.ndarray:
        """Row by row (SI). Full scale: the largest flow among `value`, or the largest supply pressure.

        per_stroke: how much the reading changes with the position, times the stroke.
        """
        if test in self.absolute:
            return np.full(len(value), self.absolute[test])
        full = np.max(supply_pressure) if test == "pressure_gain" else np.max(np.abs(value))
        of_reading, of_scale = DEFAULTS[test]
        return np.sqrt((of_reading * value) ** 2 + (of_scale * full) ** 2 + (POSITION * per_stroke) ** 2)

    def words(self) -> dict[str, str]:
        """{test: in words}."""
        found = {}
        for test, (of_reading, of_scale) in DEFAULTS.items():
            if test in self.absolute:
                unit, factor = UNITS[test]
                found[test] = f"{self.absolute[test] * factor:.3g} {unit} ({self.source})"
                continue
            full = "the supply pressure" if test == "pressure_gain" else "full scale"
            parts = [f"{100 * of_reading:g} % of the reading"] if of_reading else []
            parts += [f"{100 * of_scale:g} % of {full}", f"{100 * POSITION:g} % of the stroke in position (assumed)"]
            found[test] = " and ".join(parts)
        return found
