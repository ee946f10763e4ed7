"""Every effect by name: what it is, in which unit, between which limits, how large it usually is and where it shows.

Plain data; importing it makes no arrays. A new effect is one class in this folder and one line in `EFFECTS`, or, where only an
actuator in motion shows it, in `DYNAMIC_EFFECTS`: those inherit from `dynamics.motion.AbstractMotionEffect`, and static tests
and what looks at static records pass them by.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from jaxtyping import Array

from thermohyd.dynamics.machine import AbstractMotionEffect
from thermohyd.valve import Valve

from .edges import (
    BushingLeakage,
    CrossPortLeakage,
    Eccentricity,
    LandLeakage,
    PilotLeakage,
    PressureClearance,
    ReturnEdgeWear,
    SupplyEdgeWear,
    ThermalClearance,
    UnequalUnderlap,
)
from .effect import STAGES, AbstractEffect
from .hysteresis import Hysteresis, PositionLag
from .instruments import FlowmeterLag, FlowmeterOffset, FlowmeterScale, PositionScale, PressureOffset, TemperatureOffset
from .motion import (
    Backlash,
    CoulombFriction,
    EntrainedAir,
    FlowForce,
    JackLeakage,
    SpoolDelay,
    StribeckFriction,
    WallHeat,
)
from .oil_and_lines import (
    FlowSaturation,
    PressureViscosity,
    ReturnBackPressure,
    SupplyDroop,
    ThrottleHeating,
    ViscosityShift,
)


@dataclass(frozen=True)
class EffectInfo:
    """What is known of an effect before any data; amounts in `unit` (SI), neutral value 0.

    lower, upper: the box of a fit, `lower = 0` where the sign is known. typical: (small but visible, large), of a valve of
    the seed valve's size. scale: a step that matters. shows: the tests that see it. even: only its square acts, so that
    the derivative at neutral is zero and finite steps are needed.
    """

    effect: type[AbstractEffect]
    unit: str
    lower: float
    upper: float
    typical: tuple[float, float]
    scale: float
    shows: tuple[str, ...]
    sentence: str
    even: bool = False

    @property
    def stages(self) -> tuple[str, ...]:
        """Where it acts (see `thermohyd.effects.effect`; "motion": `thermohyd.dynamics.machine`)."""
        stages = {**STAGES, "motion": AbstractMotionEffect}
        return tuple(name for name, stage in stages.items() if issubclass(self.effect, stage))

    @property
    def dynamic(self) -> bool:
        """Whether only dynamic tests show it, so that static ones need not ask for it."""
        return issubclass(self.effect, AbstractMotionEffect)

    @property
    def rowwise(self) -> bool:
        """Whether readings still depend on the parameters through their own row only."""
        return self.effect.rowwise


_LEAK, _PRESSURE, _FLOW = ("leakage",), ("pressure_gain",), ("flow_gain", "load_flow")
_FLOWS, _ALL = (*_LEAK, *_FLOW), (*_LEAK, *_PRESSURE, *_FLOW)

EFFECTS: dict[str, EffectInfo] = {
    "supply_edge_wear": EffectInfo(
        SupplyEdgeWear, "m", 0.0, 200e-6, (1e-6, 20e-6), 5e-6, _ALL, "the supply edges are worn round"
    ),
    "return_edge_wear": EffectInfo(
        ReturnEdgeWear, "m", 0.0, 200e-6, (1e-6, 20e-6), 5e-6, _ALL, "the return edges are worn round"
    ),
    "unequal_underlap": EffectInfo(
        UnequalUnderlap,
        "m",
        -50e-6,
        50e-6,
        (1e-6, 10e-6),
        3e-6,
        _ALL,
        "the return edges have another lap than the supply edges",
    ),
    "eccentricity": EffectInfo(
        Eccentricity, "1", 0.0, 1.0, (0.3, 1.0), 0.5, _ALL, "the spool lies off the middle of its sleeve", even=True
    ),
    "land_leakage": EffectInfo(
        LandLeakage, "1", 0.0, 200.0, (1.0, 30.0), 10.0, _ALL, "oil leaks over the lands between the slots"
    ),
    "thermal_clearance": EffectInfo(
        ThermalClearance, "m/K", -50e-9, 50e-9, (1e-9, 20e-9), 5e-9, _ALL, "the clearance changes with the temperature"
    ),
    "pressure_clearance": EffectInfo(
        PressureClearance, "m/Pa", 0.0, 5e-13, (0.5e-14, 5e-14), 2e-14, _ALL, "the clearance grows with the pressure"
    ),
    "flow_saturation": EffectInfo(
        FlowSaturation,
        "Pa/(m3/s)^2",
        0.0,
        1e16,
        (5e12, 2e14),
        2e13,
        _FLOW,
        "the passages inside the valve choke large flows",
    ),
    "supply_droop": EffectInfo(
        SupplyDroop,
        "Pa/(m3/s)",
        0.0,
        1e12,
        (1e9, 2e10),
        2e9,
        _FLOW,
        "the supply pressure at the valve falls with the flow",
    ),
    "return_back_pressure": EffectInfo(
        ReturnBackPressure,
        "Pa/(m3/s)^2",
        0.0,
        1e16,
        (5e12, 4e14),
        3e13,
        _FLOW,
        "the return pressure at the valve rises with the flow",
    ),
    "throttle_heating": EffectInfo(
        ThrottleHeating, "1", 0.0, 1.0, (0.1, 1.0), 0.5, _ALL, "the oil keeps part of its throttling heat"
    ),
    "pressure_viscosity": EffectInfo(
        PressureViscosity, "1/Pa", 0.0, 1e-7, (1e-8, 2.5e-8), 1e-8, _ALL, "the oil thickens under pressure"
    ),
    "viscosity_shift": EffectInfo(
        ViscosityShift, "1", -0.9, 5.0, (0.02, 0.3), 0.1, _ALL, "the oil is thicker or thinner than its data sheet"
    ),
    "temperature_offset": EffectInfo(
        TemperatureOffset,
        "K",
        -30.0,
        30.0,
        (0.5, 10.0),
        3.0,
        _ALL,
        "the thermometer reads another temperature than the oil has",
    ),
    "pilot_leakage": EffectInfo(
        PilotLeakage, "m3/s/sqrt(Pa)", 0.0, 1e-7, (1e-10, 5e-9), 1e-9, _LEAK, "the first stage takes its own flow"
    ),
    "bushing_leakage": EffectInfo(
        BushingLeakage, "m3/(s Pa)", 0.0, 1e-10, (1e-14, 1e-12), 2e-13, _LEAK, "oil leaks around the bushing"
    ),
    "cross_port_leakage": EffectInfo(
        CrossPortLeakage,
        "m3/(s Pa)",
        0.0,
        1e-10,
        (1e-14, 1e-12),
        2e-13,
        (*_PRESSURE, *_LEAK, "load_flow"),
        "oil leaks from one port to the other",
    ),
    "flowmeter_offset": EffectInfo(
        FlowmeterOffset, "m3/s", -1e-3, 1e-3, (1e-8, 1e-6), 1e-7, _FLOWS, "the flowmeter's zero is off"
    ),
    "flowmeter_scale": EffectInfo(
        FlowmeterScale, "1", -0.9, 5.0, (0.002, 0.05), 0.02, _FLOWS, "the flowmeter's calibration is off"
    ),
    "flowmeter_lag": EffectInfo(
        FlowmeterLag, "s", 0.0, 60.0, (0.05, 2.0), 0.5, _FLOWS, "the flowmeter lags behind the flow"
    ),
    "position_scale": EffectInfo(
        PositionScale, "1", -0.5, 1.0, (0.005, 0.05), 0.02, _ALL, "the position transducer's calibration is off"
    ),
    "hysteresis": EffectInfo(
        Hysteresis, "m", 0.0, 100e-6, (0.2e-6, 5e-6), 1e-6, _ALL, "the position depends on the way it was reached"
    ),
    "position_lag": EffectInfo(
        PositionLag, "s", 0.0, 60.0, (0.05, 2.0), 0.5, _ALL, "the spool lags behind the position that is read"
    ),
    "pressure_offset": EffectInfo(
        PressureOffset,
        "Pa",
        -50e5,
        50e5,
        (0.1e5, 5e5),
        1e5,
        (*_PRESSURE, "load_flow"),
        "the differential pressure gauge's zero is off",
    ),
}


_STEP, _MOTION = ("step",), ("step", "frequency")

DYNAMIC_EFFECTS: dict[str, EffectInfo] = {
    "coulomb_friction": EffectInfo(
        CoulombFriction, "N", 0.0, 1e5, (20.0, 1000.0), 100.0, _MOTION, "dry friction brakes the piston"
    ),
    "stribeck_friction": EffectInfo(
        StribeckFriction, "N", 0.0, 1e5, (20.0, 1000.0), 100.0, _MOTION, "the piston sticks before it slides"
    ),
    "backlash": EffectInfo(
        Backlash, "m", 0.0, 100e-6, (0.5e-6, 10e-6), 2e-6, _STEP, "there is play between the command and the spool"
    ),
    "entrained_air": EffectInfo(
        EntrainedAir, "1", 0.0, 0.5, (0.002, 0.05), 0.01, _MOTION, "air bubbles soften the oil in the chambers"
    ),
    "jack_leakage": EffectInfo(
        JackLeakage, "m3/(s Pa)", 0.0, 1e-9, (1e-14, 1e-11), 1e-12, _MOTION, "oil leaks past the piston"
    ),
    "flow_force": EffectInfo(
        FlowForce, "m/N", 0.0, 1e-4, (1e-8, 2e-6), 2e-7, _MOTION, "the jets' force closes the spool"
    ),
    "spool_delay": EffectInfo(
        SpoolDelay, "s", 0.0, 1.0, (0.2e-3, 10e-3), 1e-3, _MOTION, "the command acts with a delay"
    ),
    "wall_heat": EffectInfo(
        WallHeat, "W/K", 0.0, 1e5, (1.0, 100.0), 10.0, _MOTION, "the chambers' oil exchanges heat with the metal"
    ),
}


def effect_info(name: str) -> EffectInfo:
    """What is known of the named effect, static or dynamic. Raises KeyError, with the known names, for any other name."""
    for known in (EFFECTS, DYNAMIC_EFFECTS):
        if name in known:
            return known[name]
    raise KeyError(f"unknown effect {name!r}; known: {', '.join((*EFFECTS, *DYNAMIC_EFFECTS))}")


def effect(name: str, amount: float | Array = 0.0) -> AbstractEffect:
    """The named effect with an amount in its SI unit. Raises KeyError, with the known names, for any other name."""
    return effect_info(name).effect(amount)  # pyright: ignore  # every concrete effect has one field, which converts numbers


def with_effects(valve: Valve, amounts: Mapping[str, float | Array]) -> Valve:
    """The valve with the named effects added to those that it has: {name: amount}."""
    return replace(valve, effects=(*valve.effects, *(effect(name, amount) for name, amount in amounts.items())))
