"""`servo.json`: a sweep as one plain dictionary, SI units."""

from dataclasses import fields
from typing import Any

import numpy as np

from thermohyd.dynamics.broken_loop import LoopFigures

from ..fit_json import plain, rounded
from . import words
from .servo_plots import phase
from .study import MODELS, ServoStudy


SCHEMA = "thermohyd-servo/1"
EVERY = 16  # of the frequency response's pulsations
ROWS = 400  # of a step response


def servo_json(study: ServoStudy) -> dict[str, Any]:
    """The content of `servo.json`; what is not finite becomes null."""
    s = study.subject
    content = {
        "schema": SCHEMA,
        "units": "SI: m, s, Pa (gauge), K, rad/s; margins: factor of gain and degrees; closed loop: factor",
        "name": s.name,
        "conditions": {
            "temperature": s.temperatures,
            "kinematic_viscosity": study.viscosity,
            "supply_pressure": s.supply_pressure,
            "return_pressure": s.return_pressure,
            "step": s.step,
        },
        "actuator": {field.name: float(getattr(s.actuator, field.name)) for field in fields(s.actuator)},
        "models": {model: _model(study, model) for model in MODELS},
        "in_words": words.sentences(study),
        "notes": s.notes,
        "seconds": study.seconds,
    }
    return rounded(plain(content))


def _model(study: ServoStudy, model: str) -> dict[str, Any]:
    loop, step, linear = study.loops[model], study.steps[model], study.linear[model]
    names = [field.name for field in fields(LoopFigures)]
    keep = np.unique(np.linspace(0, step.readings.time.shape[1] - 1, ROWS).astype(int))
    shown = ("time", "piston_position", "spool_position", "pressure_a", "pressure_b", "temperature_a", "temperature_b")
    opened, closed = np.asarray(loop.opened), loop.closed
    return {
        "stable": loop.stable,
        "largest_gain_rise": study.gain_rise[model],
        "gain_margin_of_large_motions": study.large_margin(model),
        "small_signal": {name: np.asarray(getattr(loop.figures, name)) for name in names},
        "per_kelvin": {name: np.asarray(getattr(loop.slope, name)) for name in names},
        "closed_loop_poles": {"real": np.real(loop.poles), "imaginary": np.imag(loop.poles)},
        "step": {
            **step.figures._asdict(),
            "largest_pressure": step.largest_pressure,
            "heating": step.heating,
        },
        "linear_formulas": {field.name: getattr(linear, field.name) for field in fields(linear)},
        "frequency_response": {
            "pulsation": loop.pulsation[::EVERY],
            "open": {"magnitude": np.abs(opened)[:, ::EVERY], "phase": phase(opened)[:, ::EVERY]},
            "closed": {"magnitude": np.abs(closed)[:, ::EVERY], "phase": phase(closed)[:, ::EVERY]},
        },
        "step_response": {name: np.asarray(getattr(step.readings, name))[:, keep] for name in shown},
    }
