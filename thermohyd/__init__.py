"""Differentiable simulation of electrohydraulic servovalves and actuators in JAX.

The names below are loaded on first use (PEP 562), so that `import thermohyd` and `thermohyd --help` stay free of JAX.
The simulator lives here; records, fits and reports in `thermohyd.identify`; oil presets and samples in `thermohyd.data`.
These names, those of `thermohyd.identify` and of `thermohyd.data` are the public ones; modules below them may move.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any


if TYPE_CHECKING:
    from .actuator import Actuator, seed_actuator
    from .actuator_performance import Performance, performance
    from .arguments import ArgumentTypeError, ArgumentValueError
    from .conditions import Conditions, operating_points
    from .control_loop import (
        closed_loop,
        load_response,
        loop_frequency_response,
        loop_margins,
        loops,
        open_loop,
        state_space,
    )
    from .data import oil_preset, oil_presets, sample_record
    from .dynamics.inputs import StepInputs, step_inputs
    from .dynamics.linear import FrequencyResponse, frequency_response
    from .dynamics.machine import Walls
    from .dynamics.simulate import StepReadings, simulate_step
    from .dynamics.simulate_many import simulate_many
    from .dynamics.temperature_sweep import loop_sweep
    from .effects.effect_info import EffectInfo
    from .effects.library import EFFECTS, register_effect, unregister_effect, with_effects
    from .heat import HeatExchange, effectiveness, eta_from_ntu
    from .oil import Oil, oil_from_definition
    from .oil_definition import OilDefinition, walther_coefficients
    from .performance_derivatives import PerformanceDerivatives, performance_with_derivatives
    from .seed_paper import seed_valve
    from .static_tests import (
        control_flow,
        flow_gain,
        flow_pressure_gain,
        leakage_flow,
        load_flow,
        load_pressure,
        nondimensional_flow_gain,
        nondimensional_pressure_gain,
        port_pressures,
        pressure_gain,
    )
    from .valve import Valve
    from .wall_tests import HeatStudy, WallReadings, heat_study, wall_readings

# module: the public names that it defines
_HOME = {
    "actuator": (
        "Actuator",
        "seed_actuator",
    ),
    "actuator_performance": (
        "Performance",
        "performance",
    ),
    "arguments": (
        "ArgumentTypeError",
        "ArgumentValueError",
    ),
    "conditions": (
        "Conditions",
        "operating_points",
    ),
    "control_loop": (
        "closed_loop",
        "load_response",
        "loop_frequency_response",
        "loop_margins",
        "loops",
        "open_loop",
        "state_space",
    ),
    "data": (
        "oil_preset",
        "oil_presets",
        "sample_record",
    ),
    "dynamics.inputs": (
        "StepInputs",
        "step_inputs",
    ),
    "dynamics.linear": (
        "FrequencyResponse",
        "frequency_response",
    ),
    "dynamics.machine": ("Walls",),
    "dynamics.simulate": (
        "StepReadings",
        "simulate_step",
    ),
    "dynamics.simulate_many": ("simulate_many",),
    "dynamics.temperature_sweep": ("loop_sweep",),
    "effects.effect_info": ("EffectInfo",),
    "effects.library": (
        "EFFECTS",
        "register_effect",
        "unregister_effect",
        "with_effects",
    ),
    "heat": (
        "HeatExchange",
        "effectiveness",
        "eta_from_ntu",
    ),
    "oil": (
        "Oil",
        "oil_from_definition",
    ),
    "oil_definition": (
        "OilDefinition",
        "walther_coefficients",
    ),
    "performance_derivatives": (
        "PerformanceDerivatives",
        "performance_with_derivatives",
    ),
    "seed_paper": ("seed_valve",),
    "static_tests": (
        "control_flow",
        "flow_gain",
        "flow_pressure_gain",
        "leakage_flow",
        "load_flow",
        "load_pressure",
        "nondimensional_flow_gain",
        "nondimensional_pressure_gain",
        "port_pressures",
        "pressure_gain",
    ),
    "valve": ("Valve",),
    "wall_tests": (
        "HeatStudy",
        "WallReadings",
        "heat_study",
        "wall_readings",
    ),
}
_MODULE = {name: module for module, names in _HOME.items() for name in names}
__all__ = [*_MODULE]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        # here: the commands import this file before they can listen to Ctrl-C, and metadata takes its time
        from importlib.metadata import version

        return version("thermohyd")
    if name in _MODULE:
        found = getattr(import_module(f".{_MODULE[name]}", __name__), name)
        globals()[name] = found
        return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_MODULE])
