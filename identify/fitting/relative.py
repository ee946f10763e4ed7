"""Which parameters a record fixes only relative to something that nobody states: in what they are then given, and why.

A signal of free gain has no scale of its own. Where no other sensor and no word of the record gives one, what the data determine
is a ratio, and the parameter is reported in that: lengths in strokes, flows per discharge coefficient. No JAX.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace

from thermohyd.identify.bench.record import OF_BOTH_SIDES, BenchRecord
from thermohyd.identify.bench.test_record import DynamicTest, TestRecord

from .parameters import ParameterPlan, Relative, effect_plan
from .sensed import sensed_channels


OF_THE_SPOOL = ("edge_radius", "clearance", "underlap", "null_bias")
OF_THE_PISTON = ("piston_position", "piston_velocity")
FLOWS = ("leakage_flow", "flow")

# Names of parameters, and to what each of them is relative.
Marks = tuple[tuple[str, ...], Callable[[ParameterPlan], Relative]]


def with_relatives(
    plans: Mapping[str, ParameterPlan], tests: Mapping[str, TestRecord], record: BenchRecord
) -> dict[str, ParameterPlan]:
    """The plans, those without a scale marked; the discharge coefficient held where it would be the scale of free meters."""
    found = dict(plans)
    for names, relative in (*_of_the_spool(record), *_of_the_piston(tests, record)):
        for name in names:
            if name in found:
                found[name] = replace(found[name], relative=relative(found[name]))
    coefficient = found.get("discharge_coefficient")
    meters = _free_alone(tests, FLOWS)
    if meters and coefficient is not None and not coefficient.given and not coefficient.fixed:
        found["discharge_coefficient"] = replace(coefficient, fixed=True)
        for name in (f"{meter}_gain" for meter in meters):
            found[name] = replace(found[name], relative=_per_coefficient(found[name], coefficient.start, meters))
    return found


def _free_alone(tests: Mapping[str, TestRecord], channels: tuple[str, ...]) -> tuple[str, ...]:
    """Those of the channels that the tests read, if the gain of each is free; none if one of them has a scale."""
    sensors = {key: behind.sensor for key, behind in sensed_channels(tests).items()}
    read = {(t.name, c.name) for t in tests.values() for c in t.channels if c.name in channels}
    if not read or any(key not in sensors or sensors[key].gain is not None for key in read):
        return ()
    return tuple(dict.fromkeys(name for _, name in sorted(read)))


def _per_coefficient(plan: ParameterPlan, coefficient: float, meters: tuple[str, ...]) -> Relative:
    verb = "has" if len(meters) == 1 else "have"
    why = (
        f"{' and '.join(meters)} {verb} a free gain and no other flow is read: only ratios to the discharge coefficient are "
        f"determined, which is held at {coefficient:g}"
    )
    return Relative("discharge_coefficient", f"discharge_coefficient*{plan.info.unit}", coefficient, why)


def _of_the_spool(record: BenchRecord) -> Iterator[Marks]:
    if record.valve.stroke_stated:
        return
    signals = [f"{column}_gain" for column in ("spool_position", "command") if column in record.sensors]
    yield (*OF_THE_SPOOL, *signals), lambda plan: _in_strokes(plan, record.valve.stroke)


def _in_strokes(plan: ParameterPlan, stroke: float) -> Relative:
    unit = plan.info.unit.replace("m", "stroke", 1)
    return Relative("stroke", unit, stroke, "the stroke of the spool is not stated: its lengths are in strokes")


def effect_plans(names: Iterable[str], record: BenchRecord) -> dict[str, ParameterPlan]:
    """{effect: plan} of amounts that a fit frees; those that are lengths of a spool are in strokes where none is stated."""
    found = {name: effect_plan(name) for name in names}
    if record.valve.stroke_stated:
        return found
    # Every length among the amounts is one of the spool: an edge's radius, a lap, a loop's width, a play; per kelvin, per pascal.
    return {
        name: replace(plan, relative=_in_strokes(plan, record.valve.stroke))
        if plan.info.unit == "m" or plan.info.unit.startswith("m/")
        else plan
        for name, plan in found.items()
    }


def _of_the_piston(tests: Mapping[str, TestRecord], record: BenchRecord) -> Iterator[Marks]:
    jack = record.actuator
    if jack is None or record.piston_area_given or not _free_alone(tests, OF_THE_PISTON) or _setpoint_in_metres(tests):
        return
    sides = [f"piston_area{side}" for side in ("", "_a", "_b")]
    areas = [value for value in (getattr(jack, name) for name in sides) if value is not None]
    area = sum(areas) / len(areas)
    why = (
        f"the sensors of the piston have a free gain and no piston_area is stated ({OF_BOTH_SIDES['piston_area'] * 1e4:g} cm^2 "
        "stands in): the data determine the volume per signal"
    )

    swept = area * jack.piston_stroke

    def of(plan: ParameterPlan) -> Relative:
        if plan.info.name == "viscous_friction":
            unit = "piston_area**2*Pa*s/m**3"
            return Relative("piston_area", unit, area**2, f"{why}, and of the friction that to the area's square")
        unit = plan.info.unit.replace("m", "piston_stroke", 1)
        return Relative(
            "piston_stroke", unit, jack.piston_stroke, f"{why}, so lengths are in strokes of {swept * 1e6:g} cm^3"
        )

    yield (*(f"{name}_gain" for name in OF_THE_PISTON), "viscous_friction"), of


def _setpoint_in_metres(tests: Mapping[str, TestRecord]) -> bool:
    """Whether a setpoint of the loop has a unit of length: a scale that the piston follows."""
    moving = [test for test in tests.values() if isinstance(test, DynamicTest) and test.kind == "step"]
    return any(t.command_kind == "setpoint" and (t.command_sensor is None or t.command_sensor.gain) for t in moving)
