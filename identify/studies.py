"""The functions of the public face that take whatever a user holds: a record, a fit, a model, a path, or nothing.

What they need is imported when they are called: naming them costs neither JAX nor pandas.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING


if TYPE_CHECKING:
    from thermohyd.actuator import Actuator
    from thermohyd.identify.bench.record import BenchRecord
    from thermohyd.identify.diagnosis.result import DiagnosisResult
    from thermohyd.identify.fitting.result import FitResult
    from thermohyd.identify.model.model import Model
    from thermohyd.identify.model.predict import Simulation
    from thermohyd.identify.sensitivity.result import SensitivityResult
    from thermohyd.identify.sensitivity.settings import Settings
    from thermohyd.identify.sensitivity.source import Source
    from thermohyd.identify.servo.study import ServoStudy


Progress = Callable[[str], None]


def predict(model: "Model", record: "BenchRecord", *, progress: Progress | None = None) -> "Simulation":
    """Each row of a record predicted by a model, with the record's own oil, stroke and slot width; no readings are needed.

    `.tables`: {test: DataFrame of the record's columns with "<reading>_predicted [unit]" and "<reading>_predicted_std
    [unit]" added}; the standard deviation is that which the model's covariance causes, NaN where it has none. `.notes` and
    `.outside` name rows outside what the model was fitted to. Raises BenchInputError where the record lacks a column that
    an effect of the model needs, RuntimeError in single precision.
    """
    from thermohyd.identify.model.predict import simulate

    return simulate(record, model, progress=progress)


def sensitivity_study(
    source: "BenchRecord | FitResult | DiagnosisResult | Model | str | Path | None" = None,
    *,
    model: "Model | str | Path | None" = None,
    settings: "Settings | str | Path | None" = None,
    actuator: "Actuator | None" = None,
    evaluations: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> "SensitivityResult":
    """Which parameter matters: sensitivities, drift with temperature and its causes, Sobol indices, and the next test.

    source: a record (with readings and without a model it is fitted first), the result of a fit or of a diagnosis, a
    model, the path of a record or of a model.json; None: the seed paper's valve. model: to study at a record's conditions
    in the place of a fit. settings: tolerances, noise and conditions, or the path of a TOML file with them
    (`read_study_settings`); without conditions there a model stands in the middle of what it was fitted to. actuator:
    whose performance is followed over the temperature; else that of the settings, of the record, of the model; where
    nobody describes one with its controller, none is. evaluations: of the three static tests in the Sobol study. seed:
    of its samples.

    Raises BenchInputError, RuntimeError where the fit does not converge or JAX runs in single precision.
    """
    from thermohyd.identify.sensitivity import study
    from thermohyd.identify.sensitivity.source import actuator_of

    given = _source(source, model, settings, progress)
    subject = given.subject(progress or _silent)
    return study.sensitivity(
        subject,
        given.settings,
        actuator=actuator_of(given, subject) if actuator is None else actuator,
        evaluations=study.EVALUATIONS if evaluations is None else evaluations,
        seed=seed,
        progress=progress,
    )


def servo_study(
    source: "BenchRecord | FitResult | DiagnosisResult | Model | str | Path | None" = None,
    *,
    temperatures: Sequence[float] | None = None,
    step: float = 5e-3,
    supply_pressure: float | None = None,
    amplifier_gain: float | None = None,
    model: "Model | str | Path | None" = None,
    settings: "Settings | str | Path | None" = None,
    progress: Progress | None = None,
) -> "ServoStudy":
    """What temperature does to the position loop: step responses, margins, bandwidth and their drift, in HM and THM.

    source, model, settings: as in `sensitivity_study`. temperatures: of the oil [K], twelve at most; None: those of the
    settings, else -40 to 70 degC. step: of the setpoint from mid stroke [m]. supply_pressure [Pa]: None, the record's, else
    210 bar. amplifier_gain [A/V]: None, the record's, else 0.03.

    Raises BenchInputError, RuntimeError where a fit does not converge, a run fails or JAX runs in single precision.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> from thermohyd import identify
    >>> study = identify.servo_study(temperatures=[273.15, 313.15])
    >>> print((1e3 * study.steps["THM"].figures.time_to_90).round())
    [175.  95.]
    """
    from thermohyd.identify.bench.errors import BenchInputError
    from thermohyd.identify.servo.request import COLDEST, HOTTEST, MOST, request_of
    from thermohyd.identify.servo.study import servo_study as study_of
    from thermohyd.identify.servo.subject import subject_of

    given = _source(source, model, settings, progress)
    warm = None
    if temperatures is not None:
        warm = tuple(sorted({float(kelvin) for kelvin in temperatures}))
        if not 1 <= len(warm) <= MOST or not COLDEST < warm[0] <= warm[-1] < HOTTEST:
            raise BenchInputError(f"temperatures: one to {MOST} of {COLDEST:g} to {HOTTEST:g} K")
    if not abs(step) < float("inf") or step == 0.0:
        raise BenchInputError(f"step: must be a length other than 0, not {step}")
    for name, value in (("supply_pressure", supply_pressure), ("amplifier_gain", amplifier_gain)):
        if value is not None and not 0.0 < value < float("inf"):
            raise BenchInputError(f"{name}: must be positive, not {value}")
    request = request_of(given.settings, warm, float(step), supply_pressure, amplifier_gain)
    return study_of(subject_of(given, request, progress or _silent), progress=progress)


def _silent(words: str) -> None:
    """Progress that nobody asked for."""


def _source(
    source: "BenchRecord | FitResult | DiagnosisResult | Model | str | Path | None",
    model: "Model | str | Path | None",
    settings: "Settings | str | Path | None",
    progress: Progress | None,
) -> "Source":
    """Whatever was given, as the studies take it. Raises BenchInputError, TypeError where it is nothing of the kind."""
    from thermohyd.identify.bench.record import BenchRecord
    from thermohyd.identify.diagnosis.result import DiagnosisResult
    from thermohyd.identify.fitting.result import FitResult
    from thermohyd.identify.model.model import Model
    from thermohyd.identify.model.model_file import load_model
    from thermohyd.identify.sensitivity.settings import Settings, read_settings
    from thermohyd.identify.sensitivity.source import Source, read_source

    own = Settings() if settings is None else settings if isinstance(settings, Settings) else read_settings(settings)
    chosen = load_model(model) if isinstance(model, str | Path) else model
    if source is None or isinstance(source, str | Path):
        found = read_source(None if source is None else Path(source), None, None, progress or _silent)
        if chosen is not None and found.model_file is not None:
            raise TypeError("source is a model already; give model only with a record")
        return replace(found, settings=own, model=chosen)
    if isinstance(source, BenchRecord):
        return Source(own, source, model=chosen)
    if chosen is not None:
        raise TypeError("source has a model already; give model only with a record")
    if isinstance(source, Model):
        return Source(own, model=source)
    if isinstance(source, DiagnosisResult):
        return Source(own, source.record, model=source.model)
    if isinstance(source, FitResult):
        return Source(own, source.record, fit=source)
    raise TypeError(f"source is {type(source).__name__}; expected a record, a result, a model, a path or None")
