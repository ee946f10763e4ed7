"""Whose position loop a servo study is about: valve, jack and conditions, of a record, a model.json or the seed paper."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

from thermohyd.actuator import Actuator
from thermohyd.dynamics.machine import motion_of
from thermohyd.effects.library import effect, effect_info
from thermohyd.identify.bench.columns import column_unit
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import OF_BOTH_SIDES, ActuatorData, BenchRecord
from thermohyd.identify.bench.shown_units import KINDS
from thermohyd.identify.fitting.motion_readings import actuator_of
from thermohyd.identify.fitting.sensed import gain_name
from thermohyd.identify.model.model import Model
from thermohyd.identify.model.model_file import model_of_fit, nominal_model
from thermohyd.identify.sensitivity.source import Source, conditions_of, fitted, left_out, seed_model

from .request import Request


SUPPLY, RETURN = 210e5, 2e5  # Pa, where nothing else is said
GAIN, SENSOR = 0.03, 100.0  # A/V, V/m: of a jack without a controller of its own


@dataclass(frozen=True)
class Subject:
    """Whose loop a servo study is about, SI.

    margins_without: effects that have no small-signal response, left out of the margins only.
    """

    name: str
    model: Model
    actuator: Actuator
    temperatures: tuple[float, ...]
    step: float
    supply_pressure: float
    return_pressure: float
    margins_without: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def subject_of(source: Source, request: Request, say: Callable[[str], None] = lambda _: None) -> Subject:
    """The sweep's subject; a record with readings and without a model is fitted.

    Raises BenchInputError, and RuntimeError where the fit does not converge.
    """
    model = _model(source, say)
    actuator, notes = _actuator(source, model, request)
    supply, back = _pressures(source.record, request)
    if back >= supply:
        high, low = (KINDS["pressure"].words(pressure, 4) for pressure in (supply, back))
        raise BenchInputError(f"the supply pressure {high} must be above the return pressure {low}")
    half = 0.5 * float(actuator.piston_stroke)
    if abs(request.step) >= half:
        step, most = (column_unit("setpoint").words(length, 4) for length in (request.step, half))
        raise BenchInputError(f"--step: {step} must be smaller than half the piston's stroke, {most}")
    without = tuple(name for name, amount in model.effects.items() if amount and not effect_info(name).small_signal)
    return Subject(
        (source.record.name if source.record else "") or model.valve.name or "valve",
        model,
        actuator,
        request.temperatures,
        request.step,
        supply,
        back,
        without,
        (*notes, *left_out(model), *_about_motion(model, actuator, without)),
    )


def _model(source: Source, say: Callable[[str], None]) -> Model:
    own = source.own_model()
    if own is not None:
        return own
    if source.record is None:
        return seed_model()
    if not all(test.channels for test in source.record.tests.values()):
        return nominal_model(source.record)
    return model_of_fit(source.fit or fitted(source.record, say))


def _actuator(source: Source, model: Model, request: Request) -> tuple[Actuator, list[str]]:
    """(the jack, what was assumed about it): of the record, else of the model, with the settings and the gain on top."""
    own, notes = source.settings.actuator, []
    of_record = source.record.actuator if source.record and source.record.actuator_given else None
    data = of_record or model.actuator
    loop = source.record.sensors.get("piston_position") if source.record else None
    if data is not None and data is of_record and loop is not None and loop.in_loop and loop.gain is None:
        gain = model.sensors.get(gain_name(loop))
        if gain is None:
            raise BenchInputError(
                f"nobody knows {gain_name(loop)}, which [sensors] leaves free and closes the loop: give the model of a fit",
                file=source.record.folder if source.record else None,
            )
        data = replace(data, sensor_gain=1.0 / gain)
    if data is None:
        data = ActuatorData()
        if not own and source.named:
            notes.append(
                "No [actuator] is described: an example jack of 12 cm2 and 50 kg was taken (--settings describes yours)."
            )
    if not data.closed_loop and "amplifier_gain" not in own:
        data = replace(data, amplifier_gain=GAIN, sensor_gain=SENSOR)
        if source.named and request.amplifier_gain is None:
            notes.append(f"No controller is described: {GAIN:g} A/V and {SENSOR:g} V/m were taken.")
    actuator = actuator_of(data, model.valve.rated_current, model.dynamics)
    if request.amplifier_gain is not None:
        own = {**own, "amplifier_gain": request.amplifier_gain}
    # What the settings say of an area or a volume replaces all that was said of it, as one number or as a pair.
    said = tuple(shared for shared in OF_BOTH_SIDES if any(name.startswith(shared) for name in own))
    kept = {f.name: getattr(actuator, f.name) for f in fields(actuator) if not (said and f.name.startswith(said))}
    # Actuator converts on construction, not on replacement.
    return Actuator(**{**kept, **own}), notes


def _pressures(record: BenchRecord | None, request: Request) -> tuple[float, float]:
    """Supply and return pressure: asked for, else the record's (the lowest supply of several), else those of the example."""
    supply, back = SUPPLY, RETURN
    if record is not None:
        _, pressures, back = conditions_of(record.tests.values())
        supply = min(pressures)
    return (
        supply if request.supply_pressure is None else request.supply_pressure,
        back if request.return_pressure is None else request.return_pressure,
    )


def _about_motion(model: Model, actuator: Actuator, without: tuple[str, ...]) -> list[str]:
    notes = [f"{name} has no small-signal response: the margins are those without it." for name in without]
    motion = motion_of(actuator, tuple(effect(name, amount) for name, amount in model.effects.items() if amount))
    sticking = 0.0 if motion.stribeck_friction is None else float(motion.stribeck_friction)
    friction = float(motion.coulomb_friction) + sticking
    if friction > 0.0:
        notes.append(
            f"Dry friction of {friction:.4g} N acts on the margins with its slope at rest; those of a sliding piston "
            "are nearer to the linear formulas."
        )
    if not actuator.symmetric:
        notes.append(
            "The jack's sides are unequal: GM* still takes how the valve's gain rises from connected ports, with equal pressures."
        )
    if motion.spool_delay is not None:
        notes.append("The spool's delay shifts the setpoint and so lies outside the loop: the margins do not see it.")
    return notes
