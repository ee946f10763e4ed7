"""The parameters that a fit can free: names, units, nominal values, limits; and from a record's `[start]` which are free or held.

Static tests free six parameters of the valve. Dynamic tests free four of motion, and static ones only at the user's word.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import ActuatorData, BenchRecord, StartValue, ValveData
from thermohyd.identify.bench.test_record import TestRecord

from .bench_faults import info_of


@dataclass(frozen=True)
class ParameterInfo:
    """One identifiable parameter (docs/physics.md section 4.1). `scale` is a natural step: what a fit thinks of as order one."""

    name: str
    unit: str
    nominal: float
    lower: float
    upper: float
    scale: float
    meaning: str


MICRON = 1e-6

# The parameters of a valve by name, those of its edges first: the vector of a search over effects begins with them.
OF_THE_EDGES = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
PARAMETERS = (*OF_THE_EDGES, "heat_retention")
# Those that a run depends on: the heat that stays in the edges does not show in motion.
SEEN_IN_MOTION = OF_THE_EDGES


# What the edges' geometry gives where lubrication theory rules.
_ABSENT = {"lubrication": ("transition_number",)}


def absent_parameters(valve: ValveData) -> tuple[str, ...]:
    """Parameters of the edges that the valve's edge law does not have; its vectors keep their place, with nothing behind it."""
    return _ABSENT.get(valve.edge_law, ())


def identified_by_default(valve: ValveData) -> dict[str, ParameterInfo]:
    """The static parameters of a valve, one fewer with the lubrication law; limits of underlap and null bias follow its stroke."""
    absent = absent_parameters(valve)
    return {name: info for name, info in _of_the_edges(valve).items() if name not in absent}


def _of_the_edges(valve: ValveData) -> dict[str, ParameterInfo]:
    half = 0.5 * valve.stroke
    known = (
        ParameterInfo("edge_radius", "m", 10 * MICRON, 0.0, 200 * MICRON, 5 * MICRON, "radius of the rounded edges"),
        ParameterInfo("clearance", "m", 3 * MICRON, 0.05 * MICRON, 50 * MICRON, 1 * MICRON, "radial clearance"),
        ParameterInfo("underlap", "m", 5 * MICRON, -half, half, 5 * MICRON, "opening between the arc centres at null"),
        ParameterInfo("discharge_coefficient", "dimensionless", 0.7, 0.05, 2.0, 0.1, "C_qmax of the edges"),
        ParameterInfo(
            "transition_number", "dimensionless", 100.0, 1.0, 10000.0, 30.0, "lambda_c, laminar to turbulent"
        ),
        ParameterInfo("null_bias", "m", 0.0, -half, half, 5 * MICRON, "spool position at hydraulic null"),
    )
    return {info.name: info for info in known}


def heat_retention() -> ParameterInfo:
    """eta between the isothermal (0) and the adiabatic (1) model: held at 0 unless a record frees it."""
    return ParameterInfo("heat_retention", "dimensionless", 0.0, 0.0, 1.0, 0.3, "share of the heat that the oil keeps")


# Walls, hoses and air only soften the oil; what is above 1 is the doubt about the oil's own bulk modulus.
STIFFEST_OIL = 1.3

# Identified from motion (docs/physics.md section 9.7); names of `thermohyd.actuator.Actuator`.
IN_MOTION = ("spool_frequency", "spool_damping", "bulk_modulus_factor", "viscous_friction")


def identified_in_motion(actuator: ActuatorData) -> dict[str, ParameterInfo]:
    """The four parameters that dynamic tests identify; they start at the `[actuator]` table's values."""
    hz, xi, f = actuator.spool_frequency, actuator.spool_damping, actuator.viscous_friction
    known = (
        ParameterInfo("spool_frequency", "Hz", hz, 0.02 * hz, 50.0 * hz, 0.3 * hz, "natural frequency of the spool"),
        ParameterInfo("spool_damping", "dimensionless", xi, 0.01, max(20.0, 10.0 * xi), 0.3, "damping of the spool"),
        ParameterInfo(
            "bulk_modulus_factor", "dimensionless", 1.0, 0.01, STIFFEST_OIL, 0.3, "of the chambers' bulk modulus"
        ),
        ParameterInfo("viscous_friction", "N*s/m", f, 0.0, max(1e6, 20.0 * f), max(f, 500.0), "f of the piston"),
    )
    return {info.name: info for info in known}


@dataclass(frozen=True)
class Prior:
    """A Gaussian prior on a free parameter: one more residual, (p - value)/std. why: in words, where the program put it there."""

    value: float
    std: float
    why: str = ""


@dataclass(frozen=True)
class Relative:
    """Of a parameter without a scale (`fitting.relative`): SI value = size * the value to report. to: what sets the scale;
    unit: of the value to report; why: in words."""

    to: str
    unit: str
    size: float
    why: str


@dataclass(frozen=True)
class ParameterPlan:
    """What a fit does with one parameter: hold it at `start`, or free it inside its box."""

    info: ParameterInfo
    start: float
    fixed: bool
    lower: float
    upper: float
    prior: Prior | None = None
    given: bool = False  # the start came from the user
    absent: bool = False  # the valve's edge law does not have it
    relative: Relative | None = None

    @property
    def shown(self) -> bool:
        """Whether a result names it: not what the law lacks, nor the share of the heat where nobody asked for it."""
        return not self.absent and (self.info.name != "heat_retention" or not self.fixed or self.given)


def plan_parameters(valve: ValveData, start: dict[str, StartValue]) -> dict[str, ParameterPlan]:
    """Merge the defaults with a record's `[start]`; a box always contains its start."""
    plans: dict[str, ParameterPlan] = {}
    absent = absent_parameters(valve)
    for info in (*_of_the_edges(valve).values(), heat_retention()):
        chosen = start.get(info.name)
        held = info.name in absent or (info.name == "heat_retention" and chosen is None)
        plans[info.name] = replace(_plan(info, chosen, held), absent=info.name in absent)
    return plans


def plan_motion(
    valve: ValveData, actuator: ActuatorData, start: Mapping[str, StartValue], known: Mapping[str, float] | None = None
) -> dict[str, ParameterPlan]:
    """{parameter: plan}: of motion first, free unless held in `[start]`; static ones held unless freed there.

    known: static values that a fit of the record's static tests found; all of them are then held.
    """
    plans = {info.name: _plan(info, start.get(info.name), False) for info in identified_in_motion(actuator).values()}
    absent = absent_parameters(valve)
    for info in (*_of_the_edges(valve).values(), heat_retention()):
        chosen = start.get(info.name)
        held = known is not None or info.name in absent or chosen is None or not chosen.freed
        plan = _plan(info, chosen, held)
        if known is not None and info.name in known:
            value = known[info.name]
            plan = replace(plan, start=value, lower=min(plan.lower, value), upper=max(plan.upper, value), given=True)
        plans[info.name] = replace(plan, absent=info.name in absent)
    return plans


def free_parameters(
    record: BenchRecord, plans: Mapping[str, ParameterPlan], tests: Mapping[str, TestRecord]
) -> tuple[str, ...]:
    """What a fit of these tests has to find. Raises BenchInputError where there is nothing, or less to find it from."""
    for test in tests.values():
        if not test.channels:
            raise BenchInputError("has no reading to fit", file=test.path)
    free = tuple(name for name, plan in plans.items() if not plan.fixed)
    if not free:
        raise BenchInputError("[start] holds every parameter fixed; free at least one", file=record.folder)
    readings = readings_of(tests)
    if readings < len(free):
        raise BenchInputError(
            f"{readings} readings cannot determine {len(free)} parameters; hold some in [start] or add rows",
            file=record.folder,
        )
    return free


def readings_of(tests: Mapping[str, TestRecord]) -> int:
    """How many numbers the tests' channels hold together."""
    return sum(len(channel.value) for test in tests.values() for channel in test.channels)


def _plan(info: ParameterInfo, chosen: StartValue | None, held: bool) -> ParameterPlan:
    if chosen is None:
        return ParameterPlan(info, info.nominal, held, info.lower, info.upper)
    lower = info.lower if chosen.lower is None else chosen.lower
    upper = info.upper if chosen.upper is None else chosen.upper
    prior = Prior(chosen.value, chosen.prior_std) if chosen.prior_std else None
    lower, upper = min(lower, chosen.value), max(upper, chosen.value)
    return ParameterPlan(info, chosen.value, held or chosen.fixed, lower, upper, prior, given=True)


def effect_plan(name: str) -> ParameterPlan:
    """An effect's amount as a parameter of a fit."""
    info = info_of(name)
    as_parameter = ParameterInfo(name, info.unit, 0.0, info.lower, info.upper, info.scale, info.sentence)
    return ParameterPlan(as_parameter, 0.0, False, info.lower, info.upper)
