"""Compute a servo study in one call: step responses over temperature, margins with their drift, linear formulas; and its tables.

The tables are in bench units and shared by terminal and page.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from thermohyd.actuator import Actuator
from thermohyd.actuator_performance import performance
from thermohyd.arguments import Heat
from thermohyd.control_loop import loop_margins
from thermohyd.dynamics.temperature_sweep import (
    ROWS,
    LoopSweep,
    StepSweep,
    largest_gain_rise,
    loop_sweep,
    run_lengths,
    step_sweep,
)
from thermohyd.identify.bench.shown_units import BAR, CELSIUS, CST, decibel, significant
from thermohyd.identify.result import Result
from thermohyd.identify.sensitivity.varied import valve_of_model
from thermohyd.oil import walther_viscosity
from thermohyd.valve import Valve

from .subject import Subject


if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from rich.console import Console


MODELS: dict[str, Heat] = {"THM": "adiabatic", "HM": "isothermal"}


@dataclass(frozen=True)
class LinearFormulas:
    """Performance at null by formulas (temperatures,): flow gain K_QX [m2/s], loop_gain K_l, natural_frequency [rad/s], damping
    ratio, gain margin [-], phase margin [deg]; of an unequal jack the flow gain alone, the rest NaN."""

    flow_gain: np.ndarray
    loop_gain: np.ndarray
    natural_frequency: np.ndarray
    damping_ratio: np.ndarray
    gain_margin: np.ndarray
    phase_margin: np.ndarray


@dataclass(frozen=True)
class ServoStudy(Result):
    """Everything that a sweep found, by model ("THM", "HM"); viscosity of the oil supplied at no pressure [m2/s].

    gain_rise: the valve's largest gain over that at null (`largest_gain_rise`).
    """

    _command: ClassVar[str] = "servo"

    subject: Subject
    viscosity: np.ndarray
    loops: dict[str, LoopSweep]
    steps: dict[str, StepSweep]
    linear: dict[str, LinearFormulas]
    gain_rise: dict[str, np.ndarray]
    seconds: float

    def large_margin(self, model: str) -> np.ndarray:
        """Gain margin (temperatures,) that is left at whatever amplitude [-]: at null, over the rise of the gain."""
        return np.asarray(self.loops[model].figures.gain_margin) / self.gain_rise[model]

    @property
    def celsius(self) -> np.ndarray:
        return np.array(self.subject.temperatures) - CELSIUS

    def to_dict(self) -> dict[str, Any]:
        """The content of `servo.json`."""
        from .report import servo_json

        return servo_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """One row per model ("THM", "HM") and temperature [K], SI: the loop's small-signal figures, gain_margin_of_large_motions,
        stable, and the figures of the step response; see `LoopFigures` and `StepFigures`."""
        import pandas as pd

        tables = {}
        for model, loop in self.loops.items():
            columns = {name: np.asarray(getattr(loop.figures, name)) for name in vars(loop.figures)}
            columns |= {"gain_margin_of_large_motions": self.large_margin(model), "stable": np.asarray(loop.stable)}
            columns |= {name: np.asarray(figure) for name, figure in self.steps[model].figures._asdict().items()}
            tables[model] = pd.DataFrame(columns, index=pd.Index(self.subject.temperatures, name="temperature"))
        return pd.concat(tables, names=["model"])

    def print_on(self, console: "Console") -> None:
        from .report import print_servo

        print_servo(self, console)

    def figures(self) -> "dict[str, Figure]":
        from .report import servo_figures

        return servo_figures(self)

    def _files(self) -> dict[str, bytes | str]:
        from .report import servo_files

        return servo_files(self)


def servo_study(subject: Subject, *, rows: int = ROWS, progress: Callable[[str], None] | None = None) -> ServoStudy:
    """Step responses and margins of a position loop over temperature. Raises RuntimeError where a run fails.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> from thermohyd.identify.sensitivity.settings import Settings
    >>> from thermohyd.identify.sensitivity.source import Source
    >>> from thermohyd.identify.servo.request import read_request
    >>> from thermohyd.identify.servo.subject import subject_of
    >>> request = read_request("0 40 degC", "5 mm", None, None, Settings())
    >>> study = servo_study(subject_of(Source(Settings()), request))
    >>> print((1e3 * study.steps["THM"].figures.time_to_90).round())
    [175.  95.]
    """
    began = time.perf_counter()
    say = progress or (lambda _: None)
    valve = valve_of_model(subject.model)
    smooth = {name: a for name, a in subject.model.effects.items() if name not in subject.margins_without}
    still = valve_of_model(replace(subject.model, effects=smooth))
    warm = np.array(subject.temperatures)
    about: dict[str, Any] = {"supply_pressure": subject.supply_pressure, "return_pressure": subject.return_pressure}
    loops, steps, linear, rise = {}, {}, {}, {}
    for model, heat in MODELS.items():
        say(f"margins ({model})")
        loops[model] = loop_sweep(still, subject.actuator, warm, heat=heat, **about)
        say(f"step responses ({model})")
        lengths = run_lengths(loops[model])
        steps[model] = step_sweep(
            valve, subject.actuator, warm, heat=heat, step=subject.step, seconds=lengths, rows=rows, **about
        )
        say(f"linear formulas ({model})")
        linear[model] = _linear_formulas(still, subject.actuator, warm, heat=heat, **about)
        rise[model] = largest_gain_rise(still, warm, heat=heat, **about)
    viscosity = np.asarray(walther_viscosity(valve.oil, jnp.asarray(warm)))
    return ServoStudy(subject, viscosity, loops, steps, linear, rise, time.perf_counter() - began)


def _linear_formulas(valve: Valve, actuator: Actuator, warm: np.ndarray, **about: Any) -> LinearFormulas:
    """The formulas are those of a symmetric jack: of an unequal one only the valve's own flow gain is a number."""
    found = performance(valve, actuator if actuator.symmetric else Actuator(), temperature=warm, **about)
    if not actuator.symmetric:
        none = np.full(warm.shape, np.nan)
        return LinearFormulas(np.asarray(found.flow_gain), none, none, none, none, none)
    margins = loop_margins(found, actuator)
    names = ("flow_gain", "loop_gain", "natural_frequency", "damping_ratio")
    own = {name: np.asarray(getattr(found, name)) for name in names}
    return LinearFormulas(**own, gain_margin=margins.gain_margin, phase_margin=margins.phase_margin)


COLUMNS = (
    "oil degC", "visc. cSt", "t90 ms", "settles ms", "over %", "GM dB", "GM* dB", "PM deg", "-3dB Hz", "peak dB", "p max bar", "dT K",
)  # fmt: skip
SLOPES = (
    "oil degC",
    "GM dB/K",
    "PM deg/K",
    "-3dB %/K",
    "GM formula dB",
    "PM formula deg",
    "K_l 1/s",
    "f_h Hz",
    "xi_h -",
)
UNSTABLE = "unst."


def rows(study: ServoStudy, model: str) -> list[list[str]]:
    """The table of step and margins: the cells of COLUMNS, a row per temperature; where the loop is unstable, the phase margin says so.

    GM: at null; GM*: left for motions of any size (`largest_gain_rise`).
    """
    loop, step = study.loops[model], study.steps[model]
    f, found = loop.figures, []
    for i, celsius in enumerate(study.celsius):
        found.append(
            [
                f"{celsius:.0f}",
                number(study.viscosity[i] * CST, 3),
                number(step.figures.time_to_90[i] * 1e3, 3),
                number(step.figures.settling_time[i] * 1e3, 3),
                f"{100.0 * step.figures.overshoot[i]:.1f}",
                _fixed(decibel(f.gain_margin[i]), 1),
                _fixed(decibel(study.large_margin(model)[i]), 1),
                _fixed(f.phase_margin[i], 0) if loop.stable[i] else UNSTABLE,
                number(float(f.bandwidth[i]) / (2.0 * np.pi), 3) if loop.stable[i] else "-",
                _fixed(decibel(f.peak[i]), 1) if loop.stable[i] else "-",
                f"{step.largest_pressure[i] * BAR:.0f}",
                f"{step.heating[i]:.1f}",
            ]
        )
    return found


def slope_rows(study: ServoStudy, model: str) -> list[list[str]]:
    """The table of slopes: what a kelvin moves, and the linear formulas' figures."""
    loop, linear, found = study.loops[model], study.linear[model], []
    f, d = loop.figures, loop.slope
    for i, celsius in enumerate(study.celsius):
        found.append(
            [
                f"{celsius:.0f}",
                _signed(20.0 / np.log(10.0) * float(d.gain_margin[i]) / float(f.gain_margin[i])),
                _signed(float(d.phase_margin[i])),
                _signed(100.0 * float(d.bandwidth[i]) / float(f.bandwidth[i])),
                _fixed(decibel(linear.gain_margin[i]), 1),
                _fixed(linear.phase_margin[i], 1),
                number(linear.loop_gain[i], 3),
                number(linear.natural_frequency[i] / (2.0 * np.pi), 3),
                number(linear.damping_ratio[i], 2),
            ]
        )
    return found


def number(value: ArrayLike, digits: int) -> str:
    """A number as text, to so many digits, but never without those before the point."""
    plain = float(np.asarray(value))
    if not np.isfinite(plain):
        return "-"
    return significant(plain, max(digits, len(f"{abs(plain):.0f}")) if abs(plain) < 1e6 else digits)


def _fixed(value: ArrayLike, decimals: int) -> str:
    plain = float(np.asarray(value))
    return f"{plain:.{decimals}f}" if np.isfinite(plain) else "none"


def _signed(value: float) -> str:
    return f"{value:+.2g}" if np.isfinite(value) else "-"
