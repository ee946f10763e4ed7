"""Was the right fault named, or the right effect? What counts as found in records of a real bench (`reference.real_bench_records`).

A name counts where the verdict is "named" or "ambiguous"; what `unexplained` lists are suspects.
"""

import re
from dataclasses import dataclass, replace
from typing import Any

from _hidden_scores import Case


FIRM = ("named", "ambiguous")


@dataclass(frozen=True)
class BenchCase(Case):
    suspects_count: bool = False

    @property
    def effects(self) -> list[dict[str, Any]]:
        firm = self.suspects_count or self.answer["verdict"] in FIRM
        return self.answer["effects"] if firm else []

    @property
    def with_suspects(self) -> "BenchCase":
        return replace(self, suspects_count=True)

    @property
    def kind(self) -> str:
        return self.truth["kind"]

    @property
    def unexplained(self) -> bool:
        return self.answer["verdict"] == "unexplained"

    @property
    def faults(self) -> list[dict[str, Any]]:
        """What the program said of the bench."""
        return self.answer.get("faults") or []

    @property
    def fault_right(self) -> bool:
        """Every fault of the bench named, at the right place."""
        return all(any(is_right(said, true) for said in self.faults) for true in self.truth["faults"])

    @property
    def fault_inside(self) -> bool:
        """The same, or its name among the alternatives of an effect."""
        others = {a["name"] for effect in self.effects for a in effect["alternatives"]}
        return all(
            any(is_right(f, true) for f in self.faults) or true["name"] in others for true in self.truth["faults"]
        )

    @property
    def false_faults(self) -> list[str]:
        return [f["name"] for f in self.faults if not any(is_right(f, true) for true in self.truth["faults"])]

    @property
    def effect_hit(self) -> bool:
        """Every hidden effect hit by a named one."""
        return all(any(self.hit(effect, name) for effect in self.effects) for name in self.hidden)

    @property
    def false_names(self) -> int:
        return sum(not any(self.hit(effect, name) for name in self.hidden) for effect in self.effects)

    @property
    def right(self) -> bool:
        """All that is wrong, and nothing else."""
        if self.kind == "outside":
            return self.unexplained or self.really_closed
        said_enough = self.effect_hit and self.fault_right and not self.unexplained
        return said_enough and not self.false_names and not self.false_faults

    def size(self, name: str) -> float:
        """Noise units that an effect or a fault leaves, by the truth."""
        return self.truth["delta_of"][name]


def is_right(said: dict[str, Any], true: dict[str, Any]) -> bool:
    """Same name and channel, and a test, run or condition in common; what is not said at all may be anywhere."""
    if said["name"] != true["name"]:
        return False
    if true["channel"] and said.get("channel") and said["channel"] != true["channel"]:
        return False
    if said.get("test") and said["test"] not in true["tests"]:
        return False
    words = set(re.findall(r"[^\s,;]+", str(said.get("run") or "")))
    if not words or words & set(true["runs"]):
        return True
    # A condition instead of runs: by its temperature or its supply pressure, as they are or as they are labelled.
    wrong = {"wrong_temperature": (1.0, 0.0), "wrong_supply": (0.0, 1e-5)}.get(true["name"], (0.0, 0.0))
    values = [
        value + by * share * true["amount"]
        for condition in true["conditions"]
        for value, share in zip(condition, wrong, strict=True)
        for by in (0.0, 1.0)
    ]
    return any({f"{value:g}", f"{value:.0f}"} & words for value in values)
