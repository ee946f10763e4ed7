"""What a dynamic fit frees and what it holds: the four parameters of motion, and static ones only at the user's word."""

from collections.abc import Mapping
from dataclasses import replace

from ..parameters import ParameterPlan, Prior, heat_retention, identified_by_default, identified_in_motion
from ..record import ActuatorData, StartValue, ValveData


def plan_motion(
    valve: ValveData, actuator: ActuatorData, start: Mapping[str, StartValue], known: Mapping[str, float] | None = None
) -> dict[str, ParameterPlan]:
    """{parameter: plan}: of motion first, free unless held in `[start]`; static ones held unless freed there.

    known: static values that a fit of the record's static tests found; all of them are then held.
    """
    plans = {info.name: _plan(info, start.get(info.name), False) for info in identified_in_motion(actuator).values()}
    for info in (*identified_by_default(valve).values(), heat_retention()):
        chosen = start.get(info.name)
        held = known is not None or chosen is None or not chosen.freed
        plan = _plan(info, chosen, held)
        if known is not None and info.name in known:
            value = known[info.name]
            plan = replace(plan, start=value, lower=min(plan.lower, value), upper=max(plan.upper, value), given=True)
        plans[info.name] = plan
    return plans


def _plan(info, chosen: StartValue | None, held: bool) -> ParameterPlan:
    if chosen is None:
        return ParameterPlan(info, info.nominal, held, info.lower, info.upper)
    lower = info.lower if chosen.lower is None else chosen.lower
    upper = info.upper if chosen.upper is None else chosen.upper
    prior = Prior(chosen.value, chosen.prior_std) if chosen.prior_std else None
    lower, upper = min(lower, chosen.value), max(upper, chosen.value)
    return ParameterPlan(info, chosen.value, held or chosen.fixed, lower, upper, prior, given=True)
