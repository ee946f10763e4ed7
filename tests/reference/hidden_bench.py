"""A random but plausible bench for a hidden-effect record: valve, oil, conditions, sweeps and noise, all from one seed."""

from dataclasses import dataclass

import numpy as np

from reference import static_tests
from reference.oil import Oil, walther
from reference.valve import Effects, Rows, Valve


STROKE = 213e-6  # m
REACH = {"leakage": 1.0, "pressure_gain": 0.3, "flow_gain": 1.0}  # of the sweep, as a share of the stroke
CHANNELS = {
    "leakage": ("leakage_flow",),
    "pressure_gain": ("load_pressure", "pressure_a", "pressure_b"),
    "flow_gain": ("flow",),
}
ROWS = 2600  # aimed at, of a record

# The oils of [oil] in bench.toml: how it names them, and the same coefficients for the reference (docs/physics.md section 2).
OILS = {
    "mil-prf-5606": ('preset = "mil-prf-5606"', Oil(6.454, 2.553, 849.2, 8.00754e-4, 1.79e9, specific_heat=1880.6)),
    "mil-prf-83282": ('preset = "mil-prf-83282"', Oil(8.728, 3.470, 849.2, 8.00754e-4, 2.07e9, specific_heat=2005.6)),
    "iso-vg-32": ('preset = "iso-vg-32"', Oil(9.531, 3.747, 863.3, bulk_modulus=1.72e9)),
    "points": (
        'viscosity = [["-40 degC", "2500 cSt"], ["40 degC", "46 cSt"]]\ndensity = "865 kg/m3"',
        Oil(*walther([[-40.0, 2500.0], [40.0, 46.0]]), density=865.0),
    ),
}
TEMPERATURES = ((-10.0, 15.0, 40.0, 65.0), (0.0, 20.0, 40.0, 60.0), (5.0, 30.0, 60.0), (-15.0, 20.0, 50.0))  # degC
SUPPLIES = ((70.0, 210.0), (70.0, 140.0, 210.0), (100.0, 200.0))  # bar
RATES = ((4.0, 20.0), (5.0, 15.0), (3.0, 25.0))  # um/s, slow and fast


@dataclass(frozen=True)
class Bench:
    """Everything about a record but what is hidden in it. `noise`: {channel: standard deviation, SI}.

    phi: lag-one correlation of the noise by row within a run. Every run is one cycle, up and down; `rows` holds each
    condition once, `copies` says how often it is run (by condition), for all three tests alike but for their reach.
    """

    valve: Valve
    oil_name: str
    temperatures: tuple[float, ...]
    supplies: tuple[float, ...]
    points: int
    rates: tuple[float, ...]  # um/s, by condition
    copies: tuple[int, ...]
    noise: dict[str, float]
    phi: float

    @property
    def oil(self) -> Oil:
        return OILS[self.oil_name][1]

    @property
    def conditions(self) -> list[tuple[float, float]]:
        """(temperature [degC], supply pressure [bar]), in the order of the runs."""
        return [(t, p) for t in self.temperatures for p in self.supplies]

    def rows(self, test: str) -> Rows:
        """Each condition once: positions as written to the file, time from the start of its run."""
        cycle = positions(REACH[test] * STROKE * 1e6, self.points)
        steps = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(cycle)))])
        count = cycle.size
        spread = lambda values: np.repeat(np.asarray(values, dtype=float), count)
        temperature, supply = zip(*self.conditions, strict=True)
        return Rows(
            np.tile(cycle, len(self.rates)) * 1e-6,
            spread(supply) * 1e5,
            np.zeros(count * len(self.rates)),
            spread(temperature) + 273.15,
            time=np.concatenate([np.round(steps / rate, 2) for rate in self.rates]),
            run=np.repeat(np.arange(len(self.rates)), count),
        )

    def ideal(self, valve: Valve, effects: Effects) -> dict[tuple[str, str], np.ndarray]:
        """Noise-free readings [SI] of `rows`, by (test, channel)."""
        return {
            (test, channel): static_tests.TESTS[test](valve, self.oil, self.rows(test), effects)[channel]
            for test, channels in CHANNELS.items()
            for channel in channels
            if channel in self.noise
        }


def positions(reach: float, points: int) -> np.ndarray:
    """One cycle [um] up and down, denser near null; the points of the way down lie between those of the way up."""
    curve = lambda s: reach * np.sinh(3.5 * s) / np.sinh(3.5)
    s = np.linspace(-1.0, 1.0, points)
    between = np.concatenate([s[:1], 0.5 * (s[:-1] + s[1:])])[::-1]
    return np.round(np.concatenate([curve(s), curve(between)]), 2)


def random_bench(random: np.random.Generator, *, correlated: bool, ports_measured: bool) -> Bench:
    """A valve, an oil and a test programme: two of three conditions run twice, slow and fast runs among them."""
    pick = lambda options: options[int(random.integers(len(options)))]
    valve = Valve(
        slot_width=pick((10e-3, 12e-3, 14e-3)),
        edge_radius=random.uniform(3e-6, 20e-6),
        clearance=random.uniform(1.5e-6, 4e-6),
        underlap=random.uniform(0.0, 18e-6),
        discharge_coefficient=random.uniform(0.6, 0.78),
        transition_number=random.uniform(60.0, 150.0),
        null_bias=random.uniform(-3e-6, 3e-6),
    )
    temperatures, supplies = pick(TEMPERATURES), pick(SUPPLIES)
    count = len(temperatures) * len(supplies)
    copies = random.permutation([1 if i % 3 == 2 else 2 for i in range(count)])
    slow_fast = pick(RATES)
    # A chequerboard, so that the rate goes with neither the temperature nor the supply pressure.
    rates = [slow_fast[(i // len(supplies) + i % len(supplies)) % 2] for i in range(count)]
    gauges = ("pressure_a", "pressure_b") if ports_measured else ("load_pressure",)
    gauge_noise = random.uniform(0.3e5, 0.8e5)
    noise = {"leakage_flow": random.uniform(0.003, 0.008) / 6e4, **dict.fromkeys(gauges, gauge_noise)}
    noise["flow"] = random.uniform(0.02, 0.05) / 6e4
    return Bench(
        valve,
        pick(tuple(OILS)),
        temperatures,
        supplies,
        int(np.clip(round(ROWS / (6 * copies.sum())), 24, 40)),
        tuple(rates),
        tuple(int(c) for c in copies),
        noise,
        float(random.uniform(0.5, 0.7)) if correlated else 0.0,
    )


def noise_of(random: np.random.Generator, std: float, phi: float, count: int) -> np.ndarray:
    """One run's stationary AR(1) noise; phi = 0 is white."""
    white = random.standard_normal(count)
    noise = np.empty(count)
    last = white[0]
    for i in range(count):
        last = white[0] if i == 0 else phi * last + np.sqrt(1.0 - phi**2) * white[i]
        noise[i] = last
    return std * noise
