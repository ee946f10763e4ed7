"""What a comparison returns: plain numbers and words, ready for the terminal, for JSON and for the page. No JAX here."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import pandas as pd

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.shown_units import DisplayUnit, display_unit, effect_unit
from thermohyd.identify.diagnosis.result import DiagnosisResult
from thermohyd.identify.result import Result


if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console


State = Literal["differs", "same", "cannot tell"]
Kind = Literal["parameter", "effect", "instrument"]


@dataclass(frozen=True)
class Side:
    """An entry in one record, SI: its value in the joint fit; std: None without an error bar."""

    value: float
    std: float | None
    at_bound: bool = False


@dataclass(frozen=True)
class Difference:
    """One parameter, effect's amount or instrument of both records; second minus first, SI.

    difference, std, ci95: None where there is none, and `why` says the reason. std_apart: of two separate fits. p_value: of a
    difference as large anywhere in the table where nothing differs (max-T). least: what would show with 80 % probability.
    alone, alone_std: if nothing but what differs differs. alternatives: effects that explain both records as well in its place.
    """

    name: str
    kind: Kind
    unit: str
    first: Side | None
    second: Side | None
    state: State
    difference: float | None = None
    std: float | None = None
    ci95: tuple[float, float] | None = None
    std_apart: float | None = None
    p_value: float | None = None
    score: float | None = None
    least: float | None = None
    freedom: float = np.inf
    alone: float | None = None
    alone_std: float | None = None
    why: str = ""
    alternatives: tuple[str, ...] = ()
    meaning: str = ""

    @property
    def shown(self) -> DisplayUnit:
        """The bench unit of its values; of effects those of amounts."""
        return effect_unit(self.name, self.unit) if self.kind == "effect" else display_unit(self.unit)


@dataclass(frozen=True)
class Explanation:
    """Rows whose differences explain both records if no other row differs, which has this probability. values {row: (difference,
    std)}, SI, those of rows that differ for certain included."""

    names: tuple[str, ...]
    p_value: float
    values: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class SharedEntry:
    """What of the bench both records share, SI. p_value: of the two records' own values where they are one."""

    name: str
    unit: str
    value: float
    std: float | None
    prior_std: float | None
    p_value: float
    meaning: str

    @property
    def shown(self) -> DisplayUnit:
        return display_unit(self.unit)


@dataclass(frozen=True)
class ComparisonResult(Result):
    """How two records differ. verdict: "different" where anything differs, "same" where nothing does, else "undecided".

    level: probability of calling anything different where nothing is. critical: score that a difference must reach. same_p: of
    all differences together, those that differ left out. one_of: where that is too small, the fewest further rows that would
    explain it, each set of them by itself; which of them it is, is not sure. gain: error of the difference over that of two
    separate fits, the median of all rows.
    """

    _command: ClassVar[str] = "compare"

    names: tuple[str, str]
    records: tuple[BenchRecord, BenchRecord]
    diagnoses: tuple[DiagnosisResult, DiagnosisResult]
    verdict: Literal["different", "same", "undecided"]
    headline: str
    sentences: tuple[str, ...]
    rows: tuple[Difference, ...]
    shared: tuple[SharedEntry, ...]
    effects: tuple[str, ...]
    level: float
    critical: float
    same_p: float
    one_of: tuple[Explanation, ...]
    reduced_chi2: tuple[float, float]
    same_bench: bool
    converged: bool
    message: str
    seconds: float
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def row(self, name: str) -> Difference:
        """The row of a parameter or an effect; KeyError without one."""
        try:
            return next(row for row in self.rows if row.name == name)
        except StopIteration:
            raise KeyError(name) from None

    @property
    def differing(self) -> tuple[Difference, ...]:
        return tuple(row for row in self.rows if row.state == "differs")

    @property
    def gain(self) -> float:
        known = [row.std / row.std_apart for row in self.rows if row.std and row.std_apart]
        return float(np.median(known)) if known else float("nan")

    def to_dict(self) -> dict[str, Any]:
        """The content of `compare.json`: plain Python, SI units, null for what is not finite."""
        from .report import comparison_json

        return comparison_json(self)

    def to_dataframe(self) -> pd.DataFrame:
        """One row per parameter and effect, by name, SI: kind, unit, first, second, difference, std, ci95_low, ci95_high (NaN:
        none), std_apart, p_value, state, why."""
        found = {}
        number = lambda value: np.nan if value is None else value
        for row in self.rows:
            low, high = row.ci95 or (np.nan, np.nan)
            found[row.name] = {
                "kind": row.kind,
                "unit": row.unit,
                "first": np.nan if row.first is None else row.first.value,
                "second": np.nan if row.second is None else row.second.value,
                "difference": number(row.difference),
                "std": number(row.std),
                "ci95_low": low,
                "ci95_high": high,
                "std_apart": number(row.std_apart),
                "p_value": number(row.p_value),
                "state": row.state,
                "why": row.why,
            }
        return pd.DataFrame.from_dict(found, orient="index").rename_axis("entry")

    def print_on(self, console: "Console") -> None:
        from .report import print_comparison

        print_comparison(self, console)

    def figures(self) -> "dict[str, Figure]":
        """ "differences": every difference with its interval, in its own error of two separate fits."""
        from .figures import comparison_figures

        return comparison_figures(self)

    def _files(self) -> dict[str, bytes | str]:
        from .report import comparison_files

        return comparison_files(self)

    def _of(self) -> str:
        return " | ".join(record.source for record in self.records)
