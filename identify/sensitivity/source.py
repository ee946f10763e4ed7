"""From what a study was given (a bench record, a model.json, both, or nothing) to its subject: valve, conditions, noise.

Everything is read and checked before JAX starts; a record with readings and no model is fitted. With nothing given, a study is
of the seed paper's valve.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from thermohyd.effects.library import effect_info
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord, ValveData
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.parameters import MICRON, OF_THE_EDGES
from thermohyd.identify.fitting.result import FitResult
from thermohyd.identify.model.fitted_range import static_range
from thermohyd.identify.model.model import Model
from thermohyd.identify.model.model_file import load_model, model_of_fit, nominal_model

from .next_test import ReadingNoise
from .settings import Settings, read_settings


REFERENCE = 313.15  # K, 40 degC
USUAL_TEMPERATURES = (253.15, 283.15, 313.15, 343.15)  # K
COLDEST, HOTTEST = 233.15, 393.15  # K: where a next test may be run
HIGHEST = 350e5  # Pa
APART_T, APART_P = 4.0, 0.06  # K and share: conditions this far apart are two


@dataclass(frozen=True)
class Subject:
    """One study's valve and conditions (SI).

    temperature, supply_pressure, return_pressure: where the study stands. temperatures, supply_pressures: where curves
    are drawn and tests could be run. fit: of the record, where there is one.
    """

    name: str
    model: Model
    temperature: float
    supply_pressure: float
    return_pressure: float
    temperatures: tuple[float, ...]
    supply_pressures: tuple[float, ...]
    noise: ReadingNoise
    fit: FitResult | None = None
    notes: tuple[str, ...] = ()


def seed_model() -> Model:
    """The seed paper's valve and oil (docs/physics.md section 1): the valve of a study that names none."""
    from thermohyd.seed_paper import NOMINAL_FLOW, NOMINAL_PRESSURE, STROKE, seed_oil_definition, seed_valve

    valve = seed_valve()
    body = ValveData(
        "seed valve (MOOG 76101 class)",
        STROKE,
        float(valve.slot_width),
        6900 * MICRON,
        rated_flow=NOMINAL_FLOW,
        rated_pressure_drop=NOMINAL_PRESSURE,
    )
    return Model(body, seed_oil_definition(), {name: float(getattr(valve, name)) for name in OF_THE_EDGES})


def subject_of_model(model: Model, settings: Settings, name: str = "") -> Subject:
    """A study of a model alone, in the middle of what it was fitted to; where it does not say, at 40 degC and its rated pressure drop
    (70 bar where it has none). The settings go first."""
    fitted = {name: static_range(model, name) for name in ("temperature", "supply_pressure", "return_pressure")}
    warm, pressures, back = fitted["temperature"], fitted["supply_pressure"], fitted["return_pressure"]
    usual = model.valve.rated_pressure_drop or 70e5
    supply = settings.supply_pressure or (usual if pressures is None else sum(pressures) / 2.0)
    temperature = settings.temperature
    if temperature is None:
        temperature = REFERENCE if warm is None else sum(warm) / 2.0
    temperatures = USUAL_TEMPERATURES if warm is None else _wider(warm)
    if settings.return_pressure is not None or back is None:
        back = (settings.return_pressure or 0.0,) * 2
    return Subject(
        name or model.valve.name or "valve",
        model,
        temperature,
        supply,
        sum(back) / 2.0,
        _with(settings.temperatures or temperatures, temperature, APART_T),
        _pressures(supply, pressures or (supply,)),
        ReadingNoise(settings.noise, "stated"),
        notes=left_out(model),
    )


def subject_of_fit(fit: FitResult, settings: Settings) -> Subject:
    """A study of a fitted record: its temperatures, pressures and noise, and what the fit left uncertain."""
    record = fit.record
    temperatures, pressures, back = conditions_of(record.static_tests.values())
    temperature = (
        min(temperatures, key=lambda t: abs(t - REFERENCE)) if settings.temperature is None else settings.temperature
    )
    supply = settings.supply_pressure or min(pressures)
    few = {temperatures[0], temperatures[len(temperatures) // 2], temperatures[-1]}
    noise: dict[str, float] = {}
    for channel in fit.channels:
        both = np.sqrt(2.0) if channel.channel in ("pressure_a", "pressure_b") else 1.0
        noise[channel.test] = float(channel.noise) * both
    model = model_of_fit(fit)
    return Subject(
        record.name,
        model,
        temperature,
        supply,
        back if settings.return_pressure is None else settings.return_pressure,
        _with(settings.temperatures or _wider(sorted(few)), temperature, APART_T),
        _pressures(supply, pressures),
        ReadingNoise({**noise, **settings.noise}, "of the record" if not settings.noise else "of the record or stated"),
        fit,
        left_out(model),
    )


def subject_of_record(record: BenchRecord, model: Model, settings: Settings) -> Subject:
    """A study of a model at a record's conditions; the readings are not used."""
    temperatures, pressures, back = conditions_of(record.static_tests.values())
    own = replace(
        settings,
        temperature=settings.temperature or min(temperatures, key=lambda t: abs(t - REFERENCE)),
        supply_pressure=settings.supply_pressure or min(pressures),
        return_pressure=back if settings.return_pressure is None else settings.return_pressure,
    )
    subject = subject_of_model(model, own, record.name)
    return replace(subject, supply_pressures=_pressures(subject.supply_pressure, pressures))


def conditions_of(tests: Collection[TestRecord]) -> tuple[list[float], list[float], float]:
    """The tests' distinct temperatures and supply pressures, rising, and their usual return pressure."""
    temperature = np.sort(np.concatenate([test.temperature for test in tests]))
    supply = np.sort(np.concatenate([test.supply_pressure for test in tests]))
    back = float(np.median(np.concatenate([test.return_pressure for test in tests])))
    return _groups(temperature, APART_T), _groups(supply, APART_P * float(supply[-1])), back


def _groups(values: np.ndarray, apart: float) -> list[float]:
    """The means of sorted values that lie close together; of a continuous range, its ends and middle."""
    parts = np.split(values, np.flatnonzero(np.diff(values) > apart) + 1)
    if len(parts) == 1 and np.ptp(values) > 2.0 * apart:
        return [float(values[0]), float(np.median(values)), float(values[-1])]
    return [float(part.mean()) for part in parts]


def _with(values: tuple[float, ...], own: float, apart: float) -> tuple[float, ...]:
    """Values, rising, the study's own among them in the place of any that is close to it."""
    return tuple(sorted([own, *(v for v in values if abs(v - own) > apart)]))


def _wider(temperatures: Sequence[float]) -> tuple[float, ...]:
    """Rising temperatures, and one beyond each end where a test may be run there."""
    ends = (temperatures[0] - 25.0, temperatures[-1] + 25.0)
    return tuple(sorted({*temperatures, *(t for t in ends if COLDEST <= t <= HOTTEST)}))


def _pressures(supply: float, measured: tuple[float, ...] | list[float]) -> tuple[float, ...]:
    """The study's pressure, the record's highest, and one beyond each end; at most three."""
    high = max(measured)
    others = [high, 1.5 * high, 0.5 * min(measured)] if high > 1.05 * supply else [0.5 * supply, 1.5 * supply]
    allowed = [p for p in others if p <= max(HIGHEST, high)]
    return _with(tuple(allowed[:2]), supply, APART_P * supply)


def left_out(model: Model) -> tuple[str, ...]:
    """What of a model `valve_of_model` leaves out, in words."""
    dropped = [name for name, amount in model.effects.items() if amount and effect_info(name).of_sweeps]
    notes = (
        [f"{', '.join(dropped)} of the model left out: the study asks for single operating points"] if dropped else []
    )
    if model.learned:
        notes.append("learned terms of the model left out: they are no physics")
    return tuple(notes)


if TYPE_CHECKING:
    from thermohyd.actuator import Actuator
    from thermohyd.identify.fitting.result import FitResult


@dataclass(frozen=True)
class Source:
    """What a study was given, read and checked; `model_file` is read when JAX runs, which effects in it need.

    model: in the place of a file; fit: of `record`, which then needs no other.
    """

    settings: Settings
    record: BenchRecord | None = None
    model_file: Path | None = None
    model: Model | None = None
    fit: FitResult | None = None

    @property
    def named(self) -> bool:
        """Whether anything was given; else a study is about the seed paper's valve."""
        return not (self.record is None and self.model_file is None and self.model is None)

    def own_model(self) -> Model | None:
        """The model that was given; None where none was. Raises BenchInputError where its file cannot be read."""
        return self.model if self.model_file is None else load_model(self.model_file)

    def subject(self, say: Callable[[str], None] = lambda _: None) -> "Subject":
        """The study's subject; a record with readings and without a model is fitted.

        Raises BenchInputError, and RuntimeError where the fit does not converge.
        """
        model = self.own_model()
        if self.record is not None and not self.record.static_tests:
            raise BenchInputError(
                "holds dynamic tests only; sensitivity studies a valve at the conditions of its static tests",
                file=self.record.folder,
            )
        if self.record is None:
            return subject_of_model(seed_model() if model is None else model, self.settings)
        if model is not None:
            return subject_of_record(self.record, model, self.settings)
        if not all(test.channels for test in self.record.static_tests.values()):
            return subject_of_record(self.record, nominal_model(self.record), self.settings)
        return subject_of_fit(self.fit or fitted(self.record, say), self.settings)


def fitted(record: BenchRecord, say: Callable[[str], None]) -> "FitResult":
    """The fit that a study starts from. Raises RuntimeError where it does not converge."""
    from thermohyd.identify.fitting.fit import fit

    result = fit(record, progress=say)
    if not result.converged:
        raise RuntimeError(f"the fit did not converge: {result.message}; name a model with --model")
    return result


def actuator_of(source: Source, subject: "Subject") -> "Actuator | None":
    """The actuator with its controller that the settings describe, else the record, else the model, on the valve's own rated current.
    None where none of them does; with nothing given at all, the example's."""
    from thermohyd.actuator import Actuator, seed_actuator
    from thermohyd.identify.fitting.motion_readings import actuator_of as simulated

    current = subject.model.valve.rated_current
    if source.settings.actuator:
        return Actuator(**source.settings.actuator, **({} if current is None else {"rated_current": current}))
    if not source.named:
        return seed_actuator()
    record = source.record
    given = record.actuator if record is not None and record.actuator_given else None
    data = given or subject.model.actuator
    loop = None if record is None else record.sensors.get("piston_position")
    if data is None or not data.closed_loop or (loop is not None and loop.in_loop and loop.gain is None):
        return None
    return simulated(data, current, subject.model.dynamics)


def read_source(
    source: Path | None, model: Path | None, settings: Path | None, say: Callable[[str], None] = lambda _: None
) -> Source:
    """Read what was named on the command line. Raises BenchInputError."""
    own = Settings() if settings is None else read_settings(settings)
    if source is None or source.suffix == ".json":
        if source is not None and model is not None:
            raise BenchInputError("is a model already; give --model only with a record", file=source)
        chosen = model if source is None else source
        if chosen is not None and not chosen.is_file():
            raise BenchInputError("there is no such file", file=chosen)
        return Source(own, model_file=chosen)
    from thermohyd.identify.bench.read import read_record

    say(f"reading {source}")
    return Source(own, read_record(source, readings_required=False), model)
