"""Dynamic bench records of the reference actuator: steps and small-signal responses with noise, as bench.toml and CSVs."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from reference.actuator import SIZES, Dynamic, Jack, Machine, Run
from reference.oil import seed_oil
from reference.sample_text import LABEL, csv_text
from reference.static_tests import IDEAL
from reference.step_test import READINGS, equilibrium, readings
from reference.valve import Effects, Valve


VALVE = Valve(edge_radius=8e-6, clearance=2.5e-6, underlap=6e-6, discharge_coefficient=0.68, transition_number=90.0)
# header, size in SI, format
COLUMNS = {
    "spool_position": ("um", 1e-6, ".4f"),
    "pressure_a": ("bar", 1e5, ".5f"),
    "pressure_b": ("bar", 1e5, ".5f"),
    "piston_position": ("mm", 1e-3, ".6f"),
    "piston_velocity": ("mm/s", 1e-3, ".5f"),
}
NOISE = {"spool_position": 1.0, "pressure_a": 0.5, "pressure_b": 0.5, "piston_position": 0.01, "piston_velocity": 1.0}
STEPS = (1.0, -0.5, 2.0)  # mm, one run each: there, and half the way back


@dataclass(frozen=True)
class Bench:
    """One record: what is hidden in it, and what was measured with which noise (bench units); memory: of AR(1) noise."""

    valve: Valve = VALVE
    jack: Jack = field(default_factory=lambda: Jack(amplifier_gain=0.03))
    dynamic: Dynamic = field(default_factory=Dynamic)
    static: Effects = IDEAL
    adiabatic: bool = True
    steps: tuple[float, ...] = STEPS
    seconds: float = 0.4
    spacing: float = 2e-3
    supply: float = 210.0  # bar
    supplies: tuple[float, ...] = ()  # bar, of the runs in turn, where they differ
    back: float = 2.0
    temperature: float = 40.0  # degC
    force: float = 0.0  # N
    measured: tuple[str, ...] = ("spool_position", "pressure_a", "pressure_b", "piston_position")
    noise: dict[str, float] = field(default_factory=lambda: dict(NOISE))
    memory: float = 0.0
    frequencies: tuple[float, ...] = ()
    output: str = "piston_position"
    declared: bool = True
    seed: int = 0
    # {reading: (bench unit per volt, volts at zero)} of what is logged in volts; with the piston's position its setpoint, too,
    # and the controller then compares the two voltages. area_stated: whether bench.toml says the piston's area.
    volts: dict[str, tuple[float, float]] = field(default_factory=dict)
    area_stated: bool = True

    def signal(self, name: str, value: np.ndarray) -> np.ndarray:
        """What a log holds of values in bench units."""
        gain, zero = self.volts.get(name, (1.0, 0.0))
        return value / gain + zero

    def machine(self, run: Run) -> Machine:
        return Machine(self.valve, seed_oil(), self.jack, run, self.adiabatic, self.dynamic, self.static)

    def run(self, step: float, number: int = 0) -> Run:
        """A setpoint that steps within one row, and half the way back in the middle of the run."""
        supply = self.supplies[number % len(self.supplies)] if self.supplies else self.supply
        time = np.round(np.arange(0.0, self.seconds + 0.5 * self.spacing, self.spacing), 9)
        first, second = 0.05 * self.seconds, 0.55 * self.seconds
        knots = [0.0, first, first + self.spacing, second, second + self.spacing, self.seconds]
        setpoint = np.interp(time, knots, np.array([0.0, 0.0, step, step, 0.5 * step, 0.5 * step]) * 1e-3)
        full = lambda value: np.full(len(time), float(value))
        back, warm = full(self.back * 1e5), full(self.temperature + 273.15)
        return Run("setpoint", time, np.round(setpoint, 12), full(supply * 1e5), back, warm, full(self.force))


def noise(random: np.random.Generator, rows: int, std: float, memory: float) -> np.ndarray:
    """White, or AR(1) of the same standard deviation."""
    white = random.standard_normal(rows)
    out = white.copy()
    for i in range(1, rows):
        out[i] = memory * out[i - 1] + np.sqrt(1.0 - memory**2) * white[i]
    return std * out


def step_table(bench: Bench) -> dict[str, list[str]]:
    random = np.random.default_rng(bench.seed)
    setpoint = f"command [{'V' if 'piston_position' in bench.volts else 'mm'}]"
    table: dict[str, list[str]] = {"time [s]": [], "run": [], setpoint: []}
    for number, step in enumerate(bench.steps, 1):
        run = bench.run(step, number - 1)
        found: dict[str, np.ndarray] = dict(zip(READINGS, readings(bench.machine(run)).T, strict=True))
        table["time [s]"] += [f"{t:.4f}" for t in run.time]
        table["run"] += [str(number)] * len(run.time)
        table[setpoint] += [f"{c:.6f}" for c in bench.signal("piston_position", run.command * 1e3)]
        if bench.supplies:
            table.setdefault("supply_pressure [bar]", []).extend(f"{p / 1e5:g}" for p in run.supply_pressure)
        for name in bench.measured:
            unit, size, fmt = COLUMNS[name]
            read = found[name] / size + noise(random, len(run.time), bench.noise[name], bench.memory)
            unit, fmt = ("V", ".7f") if name in bench.volts else (unit, fmt)
            table.setdefault(f"{name} [{unit}]", []).extend(format(v, fmt) for v in bench.signal(name, read))
    return table


def response(bench: Bench) -> np.ndarray:
    """Complex ratio of the output to the command at bench.frequencies, relative to the lowest asymptote."""
    run = bench.run(0.0)
    machine = bench.machine(run)
    state = equilibrium(machine)
    free = np.array([0, 1, 2, 3, *([4, 5] if bench.adiabatic else []), 6, 7])
    step = 1e-5 * SIZES
    a = np.empty((len(free), len(free)))
    for column, i in enumerate(free):
        up, down = state.copy(), state.copy()
        up[i], down[i] = state[i] + step[i], state[i] - step[i]
        a[:, column] = (machine.rates(0.0, up) - machine.rates(0.0, down))[free] / (2.0 * step[i])
    push = 1e-8
    b = (machine.rates(0.0, state, push) - machine.rates(0.0, state, -push))[free] / (2.0 * push)
    place = {"spool_position": 0, "piston_position": len(free) - 2, "piston_velocity": len(free) - 1}[bench.output]
    scale = SIZES[free]
    a, b = a * scale[None, :] / scale[:, None], b / scale
    eye = np.eye(len(free))
    delay = np.exp(-2j * np.pi * np.array(bench.frequencies) * bench.dynamic.spool_delay)
    gain = np.array([np.linalg.solve(2j * np.pi * f * eye - a, b)[place] for f in bench.frequencies]) * delay
    return gain / abs(np.linalg.solve(-a, b)[place])


def frequency_table(bench: Bench) -> dict[str, list[str]]:
    random = np.random.default_rng(bench.seed + 1000)
    gain = response(bench)
    count = len(gain)
    ratio = np.abs(gain) * (1.0 + 0.01 * random.standard_normal(count))
    phase = np.rad2deg(np.unwrap(np.angle(gain))) + 0.5 * random.standard_normal(count)
    return {
        "frequency [Hz]": [f"{f:.6g}" for f in bench.frequencies],
        "amplitude_ratio [1]": [f"{v:.6f}" for v in ratio],
        "amplitude_ratio_std [1]": [f"{0.01 * abs(g):.6g}" for g in gain],
        "phase [deg]": [f"{v:.4f}" for v in phase],
    }


def step_noise(bench: Bench) -> str:
    """The `noise` line of a step test; empty where the bench does not say."""
    size = lambda n: (
        f"{bench.noise[n] / abs(bench.volts[n][0]):g} V" if n in bench.volts else f"{bench.noise[n]:g} {COLUMNS[n][0]}"
    )
    noises = ", ".join(f'{n} = "{size(n)}"' for n in bench.measured)
    return f"noise = {{ {noises} }}\n" if bench.declared and noises else ""


def _of_sides(name: str, shared: float | None, pair: np.ndarray, size: float, unit: str) -> str:
    """The line of what both sides share, or the two lines of an unequal jack."""
    if shared is not None:
        return f'{name} = "{shared * size:g} {unit}"\n'
    return "".join(f'{name}_{side} = "{value * size:g} {unit}"\n' for side, value in zip("ab", pair, strict=True))


def actuator_table(bench: Bench) -> str:
    j = bench.jack
    sizes = _of_sides("piston_area", j.piston_area, j.areas, 1e4, "cm^2") if bench.area_stated else ""
    sizes += _of_sides("chamber_volume", j.chamber_volume, j.mid_volumes, 1e6, "cm^3")
    in_metres = "" if "piston_position" in bench.volts else f', sensor_gain = "{j.sensor_gain:g} V/m"'
    return f"""[actuator]                        # nominal values: the truth is not written here
{sizes}piston_stroke = "{j.piston_stroke * 1e3:g} mm"
moving_mass = "{j.moving_mass:g} kg"
viscous_friction = "2000 N s/m"
spool_frequency = "100 Hz"
spool_damping = 0.7
external_force = "{bench.force:g} N"
heat = "{"adiabatic" if bench.adiabatic else "isothermal"}"
controller = {{ amplifier_gain = "{j.amplifier_gain:g} A/V"{in_metres} }}
"""


def toml(bench: Bench, comment: str = "", name: str = "servo actuator", extra: str = "") -> str:
    size = 1e6
    said = step_noise(bench)
    v = bench.valve
    held = "".join(
        f'{n} = {{ value = "{getattr(v, n) * size:g} um", fixed = true }}\n'
        for n in ("edge_radius", "clearance", "underlap", "null_bias")
    )
    tests = f'[tests.step]\nfile = "step.csv"\n{said}\n' if bench.steps else ""
    if bench.frequencies:
        tests += (
            f'[tests.frequency]\nfile = "frequency.csv"\noutput = "{bench.output}"\nnoise = {{ phase = "0.5 deg" }}\n\n'
        )
    free = "".join(f'{n} = {{ gain = "free" }}\n' for n in bench.volts)
    tests = f"[sensors]\n{free}\n{tests}" if free else tests
    return f"""{LABEL}
{comment}
[valve]
name = "{name}"
stroke = "213 um"
slot_width = "12 mm"
rated_current = "25 mA"

[oil]
viscosity = [["-40 degC", "4000 cSt"], ["70 degC", "30 cSt"]]

[conditions]
supply_pressure = "{bench.supply:g} bar"
return_pressure = "{bench.back:g} bar"
temperature = "{bench.temperature:g} degC"

{actuator_table(bench)}
[start]                           # of the valve: known from its static tests
{held}discharge_coefficient = {{ value = {v.discharge_coefficient:g}, fixed = true }}
transition_number = {{ value = {v.transition_number:g}, fixed = true }}
{extra}
{tests}"""


def write(folder: Path, bench: Bench, comment: str = "", name: str = "servo actuator", extra: str = "") -> Path:
    """The record's files in `folder`, made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bench.toml").write_text(toml(bench, comment, name, extra), encoding="utf-8")
    if bench.steps:
        (folder / "step.csv").write_text(csv_text([], step_table(bench)), encoding="utf-8")
    if bench.frequencies:
        (folder / "frequency.csv").write_text(csv_text([], frequency_table(bench)), encoding="utf-8")
    return folder


def plain(seed: int = 0, **changes) -> Bench:
    """A bench with hidden values of the four identified parameters and no missing effect."""
    jack = replace(
        Jack(amplifier_gain=0.03),
        spool_frequency=85.0,
        spool_damping=0.8,
        bulk_modulus_factor=0.8,
        viscous_friction=2600.0,
    )
    return replace(Bench(jack=jack, seed=seed), **changes)
