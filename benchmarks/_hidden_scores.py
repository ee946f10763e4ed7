"""Was the hidden effect found? Rates over many records, from what the diagnosis answered and what was really hidden.

`Case` joins one record's truth (tests/reference/hidden_records) and answer (`_hidden_run.answer_of`), both plain JSON.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np


DETECTABLE = 1.05  # reduced chi-square of the ideal valve, refitted
CLOSED = 2.0  # standard deviations of a reduced chi-square above 1 that count as no gap left on held-out data
PARAMETERS = (
    "edge_radius",
    "clearance",
    "underlap",
    "discharge_coefficient",
    "transition_number",
    "null_bias",
)
STRATA = ((0.0, 3.0), (3.0, 5.0), (5.0, 8.0), (8.0, np.inf))

# Exact or nearly exact rivals (docs/physics.md section 8.4); the second group where p_A and p_B are not measured apart.
RIVALS = (
    {"eccentricity", "viscosity_shift", "flowmeter_scale", "position_scale"},
    {"supply_edge_wear", "return_edge_wear"},
    {"flow_saturation", "return_back_pressure"},
)
NEED_ONE_GAUGE = RIVALS[1]


@dataclass(frozen=True)
class Case:
    truth: dict[str, Any]
    answer: dict[str, Any]

    @property
    def effects(self) -> list[dict[str, Any]]:
        return self.answer["effects"]

    @property
    def hidden(self) -> list[str]:
        return list(self.truth["effects"])

    @property
    def detectable(self) -> bool:
        return self.answer["gap_before"] > DETECTABLE

    def is_one_of(self, effect: dict[str, Any], name: str) -> bool:
        """Whether `name` is the named effect or among its alternatives."""
        return name == effect["name"] or name in (a["name"] for a in effect["alternatives"])

    def rivals(self, name: str, other: str) -> bool:
        return any(
            {name, other} <= group and not (group is NEED_ONE_GAUGE and self.truth["ports_measured"])
            for group in RIVALS
        )

    def hit(self, effect: dict[str, Any], name: str) -> bool:
        """Named right: by its name, or by an exact rival's with the truth among the alternatives."""
        named = effect["name"]
        return named == name or (self.rivals(named, name) and self.is_one_of(effect, name))

    @property
    def first_right(self) -> bool:
        return bool(self.effects and self.hidden) and self.hit(self.effects[0], self.hidden[0])

    @property
    def inside(self) -> bool:
        """Every hidden effect among the names and their alternatives."""
        return all(any(self.is_one_of(effect, name) for effect in self.effects) for name in self.hidden)

    @property
    def names(self) -> int:
        """Names that the user has to look at: those named, and their alternatives."""
        return sum(1 + len(effect["alternatives"]) for effect in self.effects)

    @property
    def both_found(self) -> bool:
        """Each of two hidden effects hit by a named effect of its own."""
        first, second = self.hidden
        pairs = [(a, b) for i, a in enumerate(self.effects) for j, b in enumerate(self.effects) if i != j]
        return any(self.hit(a, first) and self.hit(b, second) for a, b in pairs)

    @property
    def really_closed(self) -> bool:
        """The data that took no part in the choice are met to their noise."""
        held = self.answer["held_out"]
        if not held or not self.effects or not held["rows"]:
            return False
        return bool(held["reduced_chi2_after"] <= 1.0 + CLOSED * np.sqrt(2.0 / held["rows"]))

    @property
    def left_over(self) -> float | None:
        """Held-out excess of the reduced chi-square over noise, after over before; 1 where nothing was named."""
        held = self.answer["held_out"]
        if not self.effects:
            return 1.0
        if not held or held["before"] <= 0.0:
            return None
        return held["after"] / held["before"]

    @property
    def model_right(self) -> bool:
        """The final model holds exactly what is hidden."""
        return sorted(e["name"] for e in self.effects) == sorted(self.hidden)

    def mirrored(self) -> "Case":
        """The truth written as (U + d, -d) where the answer took that side of an exact symmetry."""
        true = self.truth["effects"].get("unequal_underlap")
        named = next((e for e in self.effects if e["name"] == "unequal_underlap"), None)
        if true is None or named is None or self.truth["ports_measured"] or true * named["value"] >= 0.0:
            return self
        parameters = {**self.truth["parameters"], "underlap": self.truth["parameters"]["underlap"] + true}
        effects = {**self.truth["effects"], "unequal_underlap": -true}
        return replace(self, truth={**self.truth, "parameters": parameters, "effects": effects})

    def parameters_covered(self) -> list[bool]:
        """Of each identified parameter that has a 95 % interval: does it hold the truth?"""
        case = self.mirrored()
        found = case.answer["parameters"]
        return [_holds(found[n]["ci95"], case.truth["parameters"][n]) for n in PARAMETERS if found[n]["ci95"]]

    def amounts_covered(self) -> list[bool]:
        """The same of each effect that is named by its true name."""
        case = self.mirrored()
        named = [e for e in case.effects if e["name"] in case.hidden and e["ci95"]]
        return [_holds(e["ci95"], case.truth["effects"][e["name"]]) for e in named]

    def covered(self) -> list[bool]:
        return self.parameters_covered() + self.amounts_covered()


def _holds(interval: list[float], value: float) -> bool:
    return interval[0] <= value <= interval[1]


def of_kind(cases: list[Case], kind: str) -> list[Case]:
    return [case for case in cases if case.truth["kind"] == kind]


def share(values: list[bool]) -> str:
    """ "12/14 (86 %)"."""
    return f"{sum(values)}/{len(values)} ({100.0 * np.mean(values):.0f} %)" if values else "none"


def mean_of(values: list[float], digits: int = 2) -> str:
    return f"{np.mean(values):.{digits}f}" if values else "none"


def median_of(values: list[float], digits: int = 2) -> str:
    return f"{np.median(values):.{digits}f}" if values else "none"


def in_stratum(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value < limits[1]


def stratum_name(limits: tuple[float, float]) -> str:
    low, high = limits
    return f"below {high:g}" if low == 0.0 else f"above {low:g}" if np.isinf(high) else f"{low:g} to {high:g}"
