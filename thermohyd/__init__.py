"""Differentiable simulation of electrohydraulic servovalves and actuators in JAX.

The names below are loaded on first use (PEP 562), so that `import thermohyd` and `thermohyd --help` stay free of JAX.
The simulator lives here; records, fits and reports in `thermohyd.identify`; oil presets and samples in `thermohyd.data`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any


if TYPE_CHECKING:
    from .actuator import Actuator as Actuator, seed_actuator as seed_actuator
    from .actuator_performance import Performance as Performance, performance as performance
    from .arguments import ArgumentTypeError as ArgumentTypeError, ArgumentValueError as ArgumentValueError
    from .closed_loop import loop_frequency_response as loop_frequency_response, loop_margins as loop_margins
    from .conditions import Conditions as Conditions, operating_points as operating_points
    from .dynamics.inputs import StepInputs as StepInputs, step_inputs as step_inputs
    from .dynamics.many import simulate_many as simulate_many
    from .dynamics.simulate import StepReadings as StepReadings, simulate_step as simulate_step
    from .dynamics.small_signal import (
        FrequencyResponse as FrequencyResponse,
        frequency_response as frequency_response,
    )
    from .dynamics.walls import Walls as Walls
    from .gains import (
        flow_gain as flow_gain,
        flow_pressure_gain as flow_pressure_gain,
        nondimensional_flow_gain as nondimensional_flow_gain,
        nondimensional_pressure_gain as nondimensional_pressure_gain,
        pressure_gain as pressure_gain,
    )
    from .heat_exchange import (
        HeatExchange as HeatExchange,
        effectiveness as effectiveness,
        eta_from_ntu as eta_from_ntu,
    )
    from .heat_information import EtaIdentifiability as EtaIdentifiability, eta_identifiability as eta_identifiability
    from .oil import Oil as Oil, oil_from_definition as oil_from_definition
    from .oil_definition import OilDefinition as OilDefinition, walther_coefficients as walther_coefficients
    from .performance_derivatives import (
        PerformanceDerivatives as PerformanceDerivatives,
        performance_with_derivatives as performance_with_derivatives,
    )
    from .static_tests import (
        control_flow as control_flow,
        leakage_flow as leakage_flow,
        load_flow as load_flow,
        load_pressure as load_pressure,
        port_pressures as port_pressures,
    )
    from .valve import Valve as Valve
    from .wall_tests import (
        HeatStudy as HeatStudy,
        WallReadings as WallReadings,
        heat_study as heat_study,
        wall_readings as wall_readings,
    )

_HOME = {
    "Actuator": "actuator",
    "ArgumentTypeError": "arguments",
    "ArgumentValueError": "arguments",
    "seed_actuator": "actuator",
    "Performance": "actuator_performance",
    "performance": "actuator_performance",
    "loop_frequency_response": "closed_loop",
    "loop_margins": "closed_loop",
    "Conditions": "conditions",
    "operating_points": "conditions",
    "StepInputs": "dynamics.inputs",
    "step_inputs": "dynamics.inputs",
    "simulate_many": "dynamics.many",
    "StepReadings": "dynamics.simulate",
    "simulate_step": "dynamics.simulate",
    "FrequencyResponse": "dynamics.small_signal",
    "frequency_response": "dynamics.small_signal",
    "Walls": "dynamics.walls",
    "flow_gain": "gains",
    "flow_pressure_gain": "gains",
    "nondimensional_flow_gain": "gains",
    "nondimensional_pressure_gain": "gains",
    "pressure_gain": "gains",
    "HeatExchange": "heat_exchange",
    "effectiveness": "heat_exchange",
    "eta_from_ntu": "heat_exchange",
    "EtaIdentifiability": "heat_information",
    "eta_identifiability": "heat_information",
    "Oil": "oil",
    "oil_from_definition": "oil",
    "OilDefinition": "oil_definition",
    "walther_coefficients": "oil_definition",
    "PerformanceDerivatives": "performance_derivatives",
    "performance_with_derivatives": "performance_derivatives",
    "control_flow": "static_tests",
    "leakage_flow": "static_tests",
    "load_flow": "static_tests",
    "load_pressure": "static_tests",
    "port_pressures": "static_tests",
    "Valve": "valve",
    "HeatStudy": "wall_tests",
    "WallReadings": "wall_tests",
    "heat_study": "wall_tests",
    "wall_readings": "wall_tests",
}
__all__ = [*_HOME]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        # here: the commands import this file before they can listen to Ctrl-C, and metadata takes its time
        from importlib.metadata import version

        return version("thermohyd")
    if name in _HOME:
        return getattr(import_module(f".{_HOME[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
