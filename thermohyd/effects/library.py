"""The library of effects: name, unit, limits, usual size and where each shows, one entry per effect.

Plain data: importing it imports no JAX, as each entry names its class and imports it on first use. An effect is one class
in this folder and one entry here; a user's own class stands in any module, and `register_effect` takes its entry. Effects
that only an actuator in motion shows inherit from the abstract classes of `dynamics.machine`: static tests, and what
looks at static records, pass them by.
"""

import inspect
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from importlib import import_module
from typing import Any, TypeVar

from thermohyd.own_effects import own_effects

from .effect_info import EffectInfo


V = TypeVar("V")
_PERCENT = ("%", 100.0)  # of pure numbers that say by which share something changes
_MILLISECONDS = ("ms", 1e3)  # of delays, where a lag takes seconds

_LEAK, _PRESSURE, _FLOW = ("leakage",), ("pressure_gain",), ("flow_gain", "load_flow")
_FLOWS, _ALL = (*_LEAK, *_FLOW), (*_LEAK, *_PRESSURE, *_FLOW)
_STEP, _MOTION = ("step",), ("step", "frequency")

_STATIC = (
    EffectInfo(
        name="supply_edge_wear",
        effect="thermohyd.effects.edges:SupplyEdgeWear",
        unit="m",
        lower=0.0,
        upper=200e-6,
        typical=(1e-6, 20e-6),
        scale=5e-6,
        shows=_ALL,
        sentence="the supply edges are worn round",
        exchanged="return_edge_wear",
        elsewhere="sources",
    ),
    EffectInfo(
        name="return_edge_wear",
        effect="thermohyd.effects.edges:ReturnEdgeWear",
        unit="m",
        lower=0.0,
        upper=200e-6,
        typical=(1e-6, 20e-6),
        scale=5e-6,
        shows=_ALL,
        sentence="the return edges are worn round",
        exchanged="supply_edge_wear",
        elsewhere="sources",
    ),
    EffectInfo(
        name="edge_wear_pa",
        effect="thermohyd.effects.edges:EdgeWearPA",
        unit="m",
        lower=0.0,
        upper=200e-6,
        typical=(1e-6, 20e-6),
        scale=5e-6,
        shows=_ALL,
        sentence="the edge from the supply to port A is worn round",
        exchanged="edge_wear_bt",
        elsewhere="sources",
    ),
    EffectInfo(
        name="edge_wear_pb",
        effect="thermohyd.effects.edges:EdgeWearPB",
        unit="m",
        lower=0.0,
        upper=200e-6,
        typical=(1e-6, 20e-6),
        scale=5e-6,
        shows=_ALL,
        sentence="the edge from the supply to port B is worn round",
        exchanged="edge_wear_at",
        elsewhere="sources",
    ),
    EffectInfo(
        name="edge_wear_at",
        effect="thermohyd.effects.edges:EdgeWearAT",
        unit="m",
        lower=0.0,
        upper=200e-6,
        typical=(1e-6, 20e-6),
        scale=5e-6,
        shows=_ALL,
        sentence="the edge from port A to the return is worn round",
        exchanged="edge_wear_pb",
        elsewhere="sources",
    ),
    EffectInfo(
        name="edge_wear_bt",
        effect="thermohyd.effects.edges:EdgeWearBT",
        unit="m",
        lower=0.0,
        upper=200e-6,
        typical=(1e-6, 20e-6),
        scale=5e-6,
        shows=_ALL,
        sentence="the edge from port B to the return is worn round",
        exchanged="edge_wear_pa",
        elsewhere="sources",
    ),
    EffectInfo(
        name="unequal_underlap",
        effect="thermohyd.effects.edges:UnequalUnderlap",
        unit="m",
        lower=-50e-6,
        upper=50e-6,
        typical=(1e-6, 10e-6),
        scale=3e-6,
        shows=_ALL,
        sentence="the return edges have another lap than the supply edges",
        also_in_motion=True,
        caveat="the same with the other sign fits as well unless both port pressures are measured",
        settled_by=("pressure_a", "pressure_b"),
        mirrored_in="underlap",
        elsewhere="sources",
    ),
    EffectInfo(
        name="eccentricity",
        effect="thermohyd.effects.edges:Eccentricity",
        unit="1",
        lower=0.0,
        upper=1.0,
        typical=(0.3, 1.0),
        scale=0.5,
        shows=_ALL,
        sentence="the spool lies off the middle of its sleeve",
        even=True,
        elsewhere="sources",
    ),
    EffectInfo(
        name="land_leakage",
        effect="thermohyd.effects.edges:LandLeakage",
        unit="1",
        lower=0.0,
        upper=200.0,
        typical=(1.0, 30.0),
        scale=10.0,
        shows=_ALL,
        sentence="oil leaks over the lands between the slots",
        elsewhere="sources",
    ),
    EffectInfo(
        name="null_shift_temperature",
        effect="thermohyd.effects.edges:NullShiftTemperature",
        unit="m/K",
        lower=-1e-6,
        upper=1e-6,
        typical=(1e-9, 50e-9),
        scale=10e-9,
        shows=_ALL,
        sentence="the hydraulic null moves with the temperature",
        elsewhere="sources",
    ),
    EffectInfo(
        name="null_shift_pressure",
        effect="thermohyd.effects.edges:NullShiftPressure",
        unit="m/Pa",
        lower=-5e-12,
        upper=5e-12,
        typical=(0.5e-14, 2e-13),
        scale=5e-14,
        shows=_ALL,
        sentence="the hydraulic null moves with the supply pressure",
        elsewhere="sources",
    ),
    EffectInfo(
        name="thermal_clearance",
        effect="thermohyd.effects.edges:ThermalClearance",
        unit="m/K",
        lower=-50e-9,
        upper=50e-9,
        typical=(1e-9, 20e-9),
        scale=5e-9,
        shows=_ALL,
        sentence="the clearance changes with the temperature",
        elsewhere="sources",
    ),
    EffectInfo(
        name="pressure_clearance",
        effect="thermohyd.effects.edges:PressureClearance",
        unit="m/Pa",
        lower=0.0,
        upper=5e-13,
        typical=(0.5e-14, 5e-14),
        scale=2e-14,
        shows=_ALL,
        sentence="the clearance grows with the pressure",
        costly=True,
        elsewhere="sources",
    ),
    EffectInfo(
        name="flow_saturation",
        effect="thermohyd.effects.oil_and_lines:FlowSaturation",
        unit="Pa/(m3/s)^2",
        lower=0.0,
        upper=1e16,
        typical=(5e12, 2e14),
        scale=2e13,
        shows=_FLOW,
        sentence="the passages inside the valve choke large flows",
        elsewhere="sources",
    ),
    EffectInfo(
        name="supply_droop",
        effect="thermohyd.effects.oil_and_lines:SupplyDroop",
        unit="Pa/(m3/s)",
        lower=0.0,
        upper=1e12,
        typical=(1e9, 2e10),
        scale=2e9,
        shows=_ALL,  # the leakage draws through that line, too
        sentence="the supply pressure at the valve falls with the flow",
        elsewhere="sources",
    ),
    EffectInfo(
        name="return_back_pressure",
        effect="thermohyd.effects.oil_and_lines:ReturnBackPressure",
        unit="Pa/(m3/s)^2",
        lower=0.0,
        upper=1e16,
        typical=(5e12, 4e14),
        scale=3e13,
        shows=_FLOW,
        sentence="the return pressure at the valve rises with the flow",
        elsewhere="sources",
    ),
    EffectInfo(
        name="throttle_heating",
        effect="thermohyd.effects.oil_and_lines:ThrottleHeating",
        unit="1",
        lower=0.0,
        upper=1.0,
        typical=(0.1, 1.0),
        scale=0.5,
        shows=_ALL,
        sentence="the oil keeps part of its throttling heat",
        shown=_PERCENT,
        adds_to="heat_retention",
        elsewhere="valve",
    ),
    EffectInfo(
        name="pressure_viscosity",
        effect="thermohyd.effects.oil_and_lines:PressureViscosity",
        unit="1/Pa",
        lower=0.0,
        upper=1e-7,
        typical=(1e-8, 2.5e-8),
        scale=1e-8,
        shows=_ALL,
        sentence="the oil thickens under pressure",
        costly=True,
        elsewhere="sources",
    ),
    EffectInfo(
        name="viscosity_shift",
        effect="thermohyd.effects.oil_and_lines:ViscosityShift",
        unit="1",
        lower=-0.9,
        upper=5.0,
        typical=(0.02, 0.3),
        scale=0.1,
        shows=_ALL,
        sentence="the oil is thicker or thinner than its data sheet",
        shown=_PERCENT,
        factor_on="viscosity",
        elsewhere="sources",
    ),
    EffectInfo(
        name="temperature_offset",
        effect="thermohyd.effects.instruments:TemperatureOffset",
        unit="K",
        lower=-30.0,
        upper=30.0,
        typical=(0.5, 10.0),
        scale=3.0,
        shows=_ALL,
        sentence="the thermometer reads another temperature than the oil has",
        elsewhere="bench",
    ),
    EffectInfo(
        name="pilot_leakage",
        effect="thermohyd.effects.edges:PilotLeakage",
        unit="m3/s/sqrt(Pa)",
        lower=0.0,
        upper=1e-7,
        typical=(1e-10, 5e-9),
        scale=1e-9,
        shows=_LEAK,
        sentence="the first stage takes its own flow",
        elsewhere="sources",
    ),
    EffectInfo(
        name="bushing_leakage",
        effect="thermohyd.effects.edges:BushingLeakage",
        unit="m3/(s Pa)",
        lower=0.0,
        upper=1e-10,
        typical=(1e-14, 1e-12),
        scale=2e-13,
        shows=_LEAK,
        sentence="oil leaks around the bushing",
        elsewhere="sources",
    ),
    EffectInfo(
        name="cross_port_leakage",
        effect="thermohyd.effects.edges:CrossPortLeakage",
        unit="m3/(s Pa)",
        lower=0.0,
        upper=1e-10,
        typical=(1e-14, 1e-12),
        scale=2e-13,
        shows=(*_PRESSURE, *_LEAK, "load_flow"),
        sentence="oil leaks from one port to the other",
        elsewhere="sources",
    ),
    EffectInfo(
        name="port_compliance_a",
        effect="thermohyd.effects.edges:PortComplianceA",
        unit="m3/Pa",
        lower=0.0,
        upper=1e-10,
        typical=(2e-14, 3e-12),
        scale=5e-13,
        shows=(*_LEAK, *_PRESSURE),
        sentence="what is trapped at port A stores oil",
        needs=("time",),
        elsewhere="bench",
    ),
    EffectInfo(
        name="port_compliance_b",
        effect="thermohyd.effects.edges:PortComplianceB",
        unit="m3/Pa",
        lower=0.0,
        upper=1e-10,
        typical=(2e-14, 3e-12),
        scale=5e-13,
        shows=(*_LEAK, *_PRESSURE),
        sentence="what is trapped at port B stores oil",
        needs=("time",),
        elsewhere="bench",
    ),
    EffectInfo(
        name="flowmeter_offset",
        effect="thermohyd.effects.instruments:FlowmeterOffset",
        unit="m3/s",
        lower=-1e-3,
        upper=1e-3,
        typical=(1e-8, 1e-6),
        scale=1e-7,
        shows=_FLOWS,
        sentence="the flowmeter's zero is off",
        elsewhere="bench",
    ),
    EffectInfo(
        name="flowmeter_scale",
        effect="thermohyd.effects.instruments:FlowmeterScale",
        unit="1",
        lower=-0.9,
        upper=5.0,
        typical=(0.002, 0.05),
        scale=0.02,
        shows=_FLOWS,
        sentence="the flowmeter's calibration is off",
        shown=_PERCENT,
        elsewhere="bench",
    ),
    EffectInfo(
        name="flowmeter_lag",
        effect="thermohyd.effects.instruments:FlowmeterLag",
        unit="s",
        lower=0.0,
        upper=60.0,
        typical=(0.05, 2.0),
        scale=0.5,
        shows=_FLOWS,
        sentence="the flowmeter lags behind the flow",
        needs=("time",),
        elsewhere="bench",
    ),
    EffectInfo(
        name="position_scale",
        effect="thermohyd.effects.instruments:PositionScale",
        unit="1",
        lower=-0.5,
        upper=1.0,
        typical=(0.005, 0.05),
        scale=0.02,
        shows=_ALL,
        sentence="the position transducer's calibration is off",
        shown=_PERCENT,
        also_in_motion=True,
        needs=("measured_spool",),
        elsewhere="bench",
    ),
    EffectInfo(
        name="hysteresis",
        effect="thermohyd.effects.hysteresis:Hysteresis",
        unit="m",
        lower=0.0,
        upper=100e-6,
        typical=(0.2e-6, 5e-6),
        scale=1e-6,
        shows=_ALL,
        sentence="the position depends on the way it was reached",
        needs=("both_directions",),
        elsewhere="valve",
    ),
    EffectInfo(
        name="position_lag",
        effect="thermohyd.effects.hysteresis:PositionLag",
        unit="s",
        lower=0.0,
        upper=60.0,
        typical=(0.05, 2.0),
        scale=0.5,
        shows=_ALL,
        sentence="the spool lags behind the position that is read",
        needs=("rate", "several_rates"),
        looks_like="hysteresis",
        elsewhere="bench",
    ),
    EffectInfo(
        name="pressure_offset",
        effect="thermohyd.effects.instruments:PressureOffset",
        unit="Pa",
        lower=-50e5,
        upper=50e5,
        typical=(0.1e5, 5e5),
        scale=1e5,
        shows=(*_PRESSURE, "load_flow"),
        sentence="the differential pressure gauge's zero is off",
        elsewhere="bench",
    ),
    EffectInfo(
        name="load_pressure_scale",
        effect="thermohyd.effects.instruments:LoadPressureScale",
        unit="1",
        lower=-0.5,
        upper=1.0,
        typical=(0.002, 0.03),
        scale=0.01,
        shows=(*_PRESSURE, "load_flow"),
        sentence="the pressure gauge's calibration is off",
        shown=_PERCENT,
        elsewhere="bench",
    ),
)
_DYNAMIC = (
    EffectInfo(
        name="coulomb_friction",
        effect="thermohyd.effects.motion:CoulombFriction",
        unit="N",
        lower=0.0,
        upper=1e5,
        typical=(20.0, 1000.0),
        scale=100.0,
        shows=_MOTION,
        sentence="dry friction brakes the piston",
        elsewhere="sources",
    ),
    EffectInfo(
        name="stribeck_friction",
        effect="thermohyd.effects.motion:StribeckFriction",
        unit="N",
        lower=0.0,
        upper=1e5,
        typical=(20.0, 1000.0),
        scale=100.0,
        shows=_MOTION,
        sentence="the piston sticks before it slides",
        elsewhere="sources",
    ),
    EffectInfo(
        name="backlash",
        effect="thermohyd.effects.motion:Backlash",
        unit="m",
        lower=0.0,
        upper=100e-6,
        typical=(0.5e-6, 10e-6),
        scale=2e-6,
        shows=_STEP,
        sentence="there is play between the command and the spool",
        elsewhere="play",
    ),
    EffectInfo(
        name="entrained_air",
        effect="thermohyd.effects.motion:EntrainedAir",
        unit="1",
        lower=0.0,
        upper=0.5,
        typical=(0.002, 0.05),
        scale=0.01,
        shows=_MOTION,
        sentence="air bubbles soften the oil in the chambers",
        shown=_PERCENT,
        elsewhere="sources",
    ),
    EffectInfo(
        name="jack_leakage",
        effect="thermohyd.effects.motion:JackLeakage",
        unit="m3/(s Pa)",
        lower=0.0,
        upper=1e-9,
        typical=(1e-14, 1e-11),
        scale=1e-12,
        shows=_MOTION,
        sentence="oil leaks past the piston",
        elsewhere="sources",
    ),
    EffectInfo(
        name="flow_force",
        effect="thermohyd.effects.motion:FlowForce",
        unit="m/N",
        lower=0.0,
        upper=1e-4,
        typical=(1e-8, 2e-6),
        scale=2e-7,
        shows=_MOTION,
        sentence="the jets' force closes the spool",
        elsewhere="sources",
    ),
    EffectInfo(
        name="spool_delay",
        effect="thermohyd.effects.motion:SpoolDelay",
        unit="s",
        lower=0.0,
        upper=1.0,
        typical=(0.2e-3, 10e-3),
        scale=1e-3,
        shows=_MOTION,
        sentence="the command acts with a delay",
        shown=_MILLISECONDS,
        elsewhere="command",
    ),
    EffectInfo(
        name="wall_heat",
        effect="thermohyd.effects.motion:WallHeat",
        unit="W/K",
        lower=0.0,
        upper=1e5,
        typical=(1.0, 100.0),
        scale=10.0,
        shows=_MOTION,
        sentence="the chambers' oil exchanges heat with the metal",
        needs=("warm_chambers",),
        elsewhere="sources",
    ),
)

EFFECTS: dict[str, EffectInfo] = {info.name: info for info in _STATIC}
DYNAMIC_EFFECTS: dict[str, EffectInfo] = {info.name: info for info in _DYNAMIC}


def whole_library() -> dict[str, EffectInfo]:
    """Every effect, the static ones first."""
    return {**EFFECTS, **DYNAMIC_EFFECTS}


def find_effect(name: str) -> EffectInfo | None:
    """What is known of the named effect; None where no effect has that name."""
    return EFFECTS.get(name) or DYNAMIC_EFFECTS.get(name)


def effect_info(name: str) -> EffectInfo:
    """What is known of the named effect, static or dynamic. Raises KeyError, with the known names, for any other name."""
    found = find_effect(name)
    if found is None:
        raise KeyError(f"unknown effect {name!r}; known: {', '.join(whole_library())}")
    return found


def factor_on(quantity: str) -> str | None:
    """The name of the static effect that multiplies this quantity by (1 + amount); None where there is none."""
    return next((name for name, info in EFFECTS.items() if info.factor_on == quantity), None)


def classes_of(names: Iterable[str]) -> tuple[type[Any], ...]:
    """The classes behind the names now: a program compiled for names is that of these classes, and is kept by both."""
    return tuple(effect_info(name).effect_class for name in names)


def effect(name: str, amount: Any = 0.0) -> Any:
    """The named effect with an amount in its SI unit. Raises KeyError, with the known names, for any other name."""
    return effect_info(name).effect_class(amount)


def with_effects[V](valve: V, amounts: Mapping[str, Any]) -> V:
    """The valve with the named effects added to those that it has: {name: amount}, each a number or an array."""
    own: Any = valve
    return replace(own, effects=(*own.effects, *(effect(name, amount) for name, amount in amounts.items())))


def register_effect(info: EffectInfo) -> EffectInfo:
    """Add an effect to the library, static or dynamic by its class, and return its entry: fits, diagnoses, predictions and
    reports then know it by its name like any other. `unregister_effect` takes it out again.

    Raises ValueError where the name or the class is taken, TypeError where the class is no effect.
    """
    if not isinstance(info, EffectInfo):
        raise TypeError(f"register_effect takes an EffectInfo(name=..., effect=..., ...), not {info!r}")
    known, effect_class = whole_library(), info.effect_class
    if info.name in known:
        raise ValueError(f"there is an effect {info.name} already; take another name, or unregister_effect it first")
    if info.name in _taken():
        raise ValueError(f"{info.name} is a quantity of the valve or of the actuator; take another name for the effect")
    abstract = import_module("thermohyd.effects.effect").AbstractEffect
    if not isinstance(effect_class, type) or not issubclass(effect_class, abstract) or not info.stages:
        raise TypeError(
            f"{info.name}: {getattr(effect_class, '__name__', effect_class)} must inherit from the abstract class of a stage, such as "
            "thermohyd.effects.effect.AbstractEdgeEffect"
        )
    if inspect.isabstract(effect_class):
        missing = ", ".join(sorted(effect_class.__abstractmethods__))  # pyright: ignore[reportAttributeAccessIssue]
        raise TypeError(f"{info.name}: {effect_class.__name__} lacks {missing}, which its stage asks for")
    twin = next((name for name, other in known.items() if other.effect_class is effect_class), None)
    if twin is not None:
        raise ValueError(
            f"{info.name}: {effect_class.__name__} is the class of {twin} already; each effect needs one of its own"
        )
    if info.factor_on and factor_on(info.factor_on) is not None:
        raise ValueError(f"{info.name}: {factor_on(info.factor_on)} is the factor on the {info.factor_on} already")
    for name in info.shows:
        if info.dynamic != (name in _MOTION):
            kind = "dynamic" if info.dynamic else "static"
            raise ValueError(
                f"{info.name}: shows has {name!r}, but {effect_class.__name__} is an effect of {kind} tests"
            )
    (DYNAMIC_EFFECTS if info.dynamic else EFFECTS)[info.name] = info
    own_effects.add(info.name)
    return info


def unregister_effect(name: str) -> None:
    """Take an effect out of the library that `register_effect` added. Raises ValueError for any other name."""
    if name not in own_effects:
        raise ValueError(f"{name!r} is no effect that register_effect added")
    (EFFECTS if name in EFFECTS else DYNAMIC_EFFECTS).pop(name)
    own_effects.discard(name)


def _taken() -> set[str]:
    """Names that a model's parameters go by."""
    homes = {"thermohyd.valve": "Valve", "thermohyd.actuator": "Actuator"}
    return {field.name for module, name in homes.items() for field in fields(getattr(import_module(module), name))}
