"""What a plan returns: plain numbers and words, ready for the terminal, for JSON and for the page. No JAX here."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pandas as pd

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.shown_units import DisplayUnit, display_unit, effect_unit
from thermohyd.identify.result import Result


if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console


@dataclass(frozen=True)
class PlannedEffect:
    """One effect of the library in the planned tests, amounts SI.

    least: found in 90 % of records; None where not even five times the largest usual amount is. usual: (small but visible, largest)
    usual amounts. kept: share of its change that the free parameters leave. alone: the amount from which on no other effect does as
    well in its place; None where that is beyond five times the largest usual one, or where it is not seen. confused: what is not
    told from it even in its largest usual amount. strength: score of the largest usual amount. why: of one that is not seen.
    """

    name: str
    unit: str
    least: float | None
    usual: tuple[float, float]
    kept: float
    alone: float | None
    confused: tuple[str, ...]
    strength: float
    sentence: str
    why: str = ""

    @property
    def shown(self) -> DisplayUnit:
        return effect_unit(self.name, self.unit)

    @property
    def seen(self) -> bool:
        """Whether its largest usual amount is found."""
        return self.least is not None and self.least <= self.usual[1]


@dataclass(frozen=True)
class PlannedParameter:
    """The standard error that a fit of the planned tests will give a free parameter, SI; None where it will give none."""

    name: str
    unit: str
    value: float
    std: float | None
    why: str

    @property
    def shown(self) -> DisplayUnit:
        return display_unit(self.unit)


@dataclass(frozen=True)
class PlannedReading:
    """A channel of the planned tests. noise: standard deviation of a row, the largest where rows differ; source in words."""

    test: str
    channel: str
    rows: int
    noise: float
    source: str


@dataclass(frozen=True)
class Addition:
    """Runs to add: what they take and bring. seconds: None without a time; per_hour: by thousand rows then."""

    words: str
    rows: int
    seconds: float | None
    shows: tuple[str, ...]
    separates: tuple[tuple[str, str], ...]
    per_hour: float


@dataclass(frozen=True)
class PlanResult(Result):
    """What planned tests will show. level, critical: of the diagnosis, over the whole library (max-T).

    correlation: of what the parameters leave of the effects `order`, each in its least visible amount. groups: effects of which no
    two are told apart in any usual amount.
    """

    _command: ClassVar[str] = "plan"

    record: BenchRecord
    headline: str
    sentences: tuple[str, ...]
    effects: tuple[PlannedEffect, ...]
    parameters: tuple[PlannedParameter, ...]
    readings: tuple[PlannedReading, ...]
    order: tuple[str, ...]
    correlation: np.ndarray
    groups: tuple[tuple[str, ...], ...]
    added: tuple[Addition, ...]
    level: float
    critical: float
    power: float
    reading_seconds: float | None
    seconds: float
    notes: tuple[str, ...] = ()

    def effect(self, name: str) -> PlannedEffect:
        """The row of an effect; KeyError without one."""
        found = {effect.name: effect for effect in self.effects}
        return found[name]

    def to_dict(self) -> dict[str, Any]:
        """The content of `plan.json`: plain Python, SI units, null for what is not finite."""
        from .report import plan_json

        return plan_json(self)

    def to_dataframe(self) -> pd.DataFrame:
        """One row per effect, by name, SI: unit, least, usual_low, usual_high, kept, alone (NaN: none), seen, confused, why."""
        number = lambda value: np.nan if value is None else value
        rows = {
            e.name: {
                "unit": e.unit,
                "least": number(e.least),
                "usual_low": e.usual[0],
                "usual_high": e.usual[1],
                "kept": e.kept,
                "alone": number(e.alone),
                "seen": e.seen,
                "confused": ", ".join(e.confused),
                "why": e.why,
            }
            for e in self.effects
        }
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("effect")

    def print_on(self, console: "Console") -> None:
        from .report import print_plan

        print_plan(self, console)

    def figures(self) -> "dict[str, Figure]":
        """ "least": the least visible amounts beside the usual ones; "confusion": which effects look alike."""
        from .figures import plan_figures

        return plan_figures(self)

    def _files(self) -> dict[str, bytes | str]:
        from .report import plan_files

        return plan_files(self)

    def _of(self) -> str:
        return self.record.source
