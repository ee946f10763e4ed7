"""What a diagnosis returns: plain numbers and words, ready for the terminal, for JSON and for plots. No JAX here.

Methods that need reports, figures or the simulator import them when they are called: the numbers stay light.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import pandas as pd

from thermohyd.identify.bench.columns import reading_unit
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.shown_units import DisplayUnit
from thermohyd.identify.fitting.result import FitResult, ParameterEstimate
from thermohyd.identify.model.learned_terms import LearnedTerm
from thermohyd.identify.model.typed_terms import TypedTerm
from thermohyd.identify.noise.two_parts import TwoParts
from thermohyd.identify.result import Result


if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from thermohyd.identify.model.model import Model
    from thermohyd.identify.model.predict import Simulation


Verdict = Literal["consistent", "named", "ambiguous", "unexplained"]


@dataclass(frozen=True)
class Region:
    """A box of conditions in which the fitted ideal valve misses one channel by more than its noise.

    limits: {column: (low, high)} of the columns that bound it, SI (spool_position, temperature, supply_pressure,
    load_pressure, direction -1 or +1, rate [m/s], run); a column that does not bound it is left out.
    """

    test: str
    channel: str
    limits: dict[str, tuple[float, float]]
    excess_chi2: float  # of the rows inside, above one per row
    share: float  # of the excess of all rows of the record
    rows: int
    mean: float  # measured - model, SI
    rms: float = float("nan")  # of the misfit beyond noise, SI: where it changes sign, the mean says little
    signal: str = ""  # "V" or "count": mean and rms are signals of a sensor of free gain; empty: SI

    @property
    def unit(self) -> DisplayUnit:
        """In which its misfit is shown."""
        return reading_unit(self.channel, self.signal)


@dataclass(frozen=True)
class Alternative:
    """An effect, or a fault of the bench, that explains the data about as well as the named effect in its place.

    where: of a fault, the test, run or condition, in words.
    """

    name: str
    value: float
    unit: str
    chi2_more: float  # chi-square with it instead of the named effect, minus that with the named one
    where: str = ""

    @property
    def words(self) -> str:
        """The name, of a fault with its place."""
        return f"{self.name} ({self.where})" if self.where else self.name


# Times the largest usual amount, from which on an amount is no amount of the effect any more. "Usual" are data sheets and worn valves;
# an oil twice as viscous as stated is 3.3 times that and happens.
MOST_USUAL = 5.0
# Standard errors up to which a suspect alone is no misfit: a true effect of eight closes something on a quarter of the rows in 98
# cases of 100, one of four in 84; what chance made of the other rows in half of the cases.
WEAK = 8.0


@dataclass(frozen=True)
class Suspect:
    """An effect that the search found and that is not named: it does not predict the conditions to which it was not fitted, or its
    amount is beyond `MOST_USUAL`.

    Or it is of no use beside a typed term (`outdone_by`, in words), or closes too little of the gap while a misfit is left: `closes`, its
    shares alone and as the last one in. Or it is a label of the bench that would be called wrong, were no misfit left: `fault`, in words.
    value: SI. evidence: 2 ln E on rows left out, of the model with it over the model without it; 10.6 would be a proof.
    times_usual: the amount over the largest that is usual. strength: in standard errors, of the rows that it is fitted to. held_out: of one
    near chance, 2 ln E on the rows that took no part in its choice; None where that was not asked.
    """

    name: str
    value: float
    unit: str
    evidence: float
    times_usual: float
    strength: float
    outdone_by: str = ""
    held_out: float | None = None
    closes: tuple[float, float] | None = None
    fault: str = ""

    @property
    def implausible(self) -> bool:
        return self.times_usual > MOST_USUAL

    @property
    def hint(self) -> bool:
        """Whether it is too weak to stand for a misfit by itself."""
        apart = self.implausible or self.outdone_by or self.closes or self.fault
        return self.strength < WEAK and not apart


@dataclass(frozen=True)
class NamedEffect:
    """An effect that was added to the model. Amounts in `unit`, SI; neutral value 0.

    p_value: of the final model with it taken out, corrected for the size of the library, never below 1/E on rows left out.
    strength: what the free parameters left of it, in noise units (delta). gap_closed: the share of the excess chi-square that is
    lost again without it. top_rows: share of its evidence that the strongest 1 % of the rows hold: near 1, a few bad rows made it.
    either_sign: as much of the other sign, beside other parameters, explains the record as well; `std` and `ci95` span both.
    places: (place, variable) of typed terms that by one amount show what it shows, to first order: whatever acts so reads alike, be it
    in the library or not. Empty too where they were not asked: in motion, and beside oil stored at the ports.
    """

    name: str
    value: float
    unit: str
    std: float | None
    ci95: tuple[float, float] | None
    p_value: float
    strength: float
    gap_closed: float
    sentence: str  # what it is, in plain words
    alternatives: tuple[Alternative, ...] = ()
    at_bound: bool = False
    top_rows: float = float("nan")
    either_sign: bool = False
    places: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class ChannelDiscrepancy:
    """What the final model misses of one channel, as the error bars of its parameters allow for it.

    std: of a reading, beside its noise, SI (or of its signal). of_each_sweep: share of its variance that is not common to the
    sweeps. length: share of a sweep's readings over which it stays alike.
    """

    test: str
    channel: str
    std: float
    of_each_sweep: float
    length: float
    signal: str = ""

    @property
    def unit(self) -> DisplayUnit:
        """In which it is shown."""
        return reading_unit(self.channel, self.signal)


@dataclass(frozen=True)
class Candidate:
    """One effect of the library beside the ideal valve: can this record show it, and does it?

    state: "testable", "absorbed" (the free parameters swallow it), "impossible" (no row depends on it, or a column is
    missing). z: signed score in noise units. estimate: amount by the linearised model. kept: share of its signature that
    the free parameters leave. least: smallest amount that this record would show (80 % power at the search's level).
    gap_closed, p_value: of a refit with this effect alone; nan where none was made.
    """

    name: str
    unit: str
    state: str
    why: str
    z: float
    p_value: float
    estimate: float
    kept: float
    least: float
    gap_closed: float


@dataclass(frozen=True)
class Credit:
    """How much of the gap on rows held out one group of what the final model holds closes.

    group: "names" (effects), "terms" (learned), "faults" (of the bench) or "weights" (readings weighed by what is missed beside their
    noise). first_in: beside the ideal valve; last_in: beside all other groups. share: Shapley's value, which is the mean of both where
    there are two groups; shares add up to `HeldOut.gap_closed`.
    """

    group: str
    first_in: float
    last_in: float
    share: float


@dataclass(frozen=True)
class HeldOut:
    """Rows that took no part in the choice of effects nor in their values.

    before, after: excess of the reduced chi-square over noise alone (reduced chi-square - 1, not below 0), ideal valve
    and final model. exchange: {effect put in the named one's place: gap closed on the same rows}. credit: of each group of what the
    final model holds. valves: reduced chi-square of the ideal valve and of the final model without the faults of the bench, in the rows
    that say which of them to hand over, and how many these are; None where no row does.
    """

    rows: int
    what: str  # which sweeps, in words
    before: float
    after: float
    reduced_chi2_before: float
    reduced_chi2_after: float
    gap_closed: float
    exchange: dict[str, float] = field(default_factory=dict)
    credit: tuple[Credit, ...] = ()
    valves: tuple[float, float, int] | None = None

    def credit_of(self, group: str) -> Credit | None:
        """What a group closes; None where the model holds nothing of it, or where there is no gap."""
        return next((credit for credit in self.credit if credit.group == group), None)


@dataclass(frozen=True)
class Proposal:
    """A measurement in words, the chi-square that it is predicted to show, and the rows and seconds of reading that it takes.

    seconds: of all its runs, without what lies between them; None where the tests have no time.
    """

    words: str
    evidence: float
    rows: int
    seconds: float | None = None


@dataclass(frozen=True)
class NextTest:
    """The measurement that separates what this record cannot, and the chi-square difference it is predicted to show."""

    sentence: str
    evidence: float
    options: tuple[Proposal, ...] = ()  # every measurement considered, the best first


@dataclass(frozen=True)
class Variation:
    """A model quantity that would have to vary smoothly with a variable: empirical, not a cause.

    `curve` is the quantity's change (share of its value, or SI for underlap, null bias and readings; see `unit`) at
    `variable_values` (SI), `band` its standard deviation there.
    """

    quantity: str
    variable: str
    unit: str
    variable_values: np.ndarray
    curve: np.ndarray
    band: np.ndarray
    chi2_gain: float
    p_value: float
    gap_closed: float
    coefficients: tuple[float, ...]  # of Legendre polynomials of degree 0, 1, ... in the scaled variable
    centre: float  # scaled variable = (variable - centre)/reach
    reach: float
    learned: bool = False  # added to the model at the user's word


@dataclass(frozen=True)
class Term:
    """A typed term that would explain what the model still misses: a place of the circuit, shifted by a law of a variable.

    It names a place, not a cause. value, std: of the law's coefficient in `unit`, SI; of a smooth law the spread of the shift over
    what was seen. p_value: of the whole table. gap_closed: of what the model without it leaves on rows held out (`on_held_out`; else of
    all rows, by one linear step). alternatives: (place, variable) that the readings allow as well. proof: 2 ln E, as of an effect; holds:
    whether it predicts rows that it was not fitted to. curve: the shift at `variable_values`, `band` its standard deviation, SI.
    """

    place: str
    variable: str
    law: str
    value: float
    unit: str
    std: float | None
    p_value: float
    gap_closed: float
    alternatives: tuple[tuple[str, str], ...]
    sentence: str
    confirmed_by: str
    coefficients: tuple[float, ...]
    low: float
    high: float
    place_unit: str
    variable_unit: str
    proof: float
    holds: bool
    on_held_out: bool
    variable_values: np.ndarray
    curve: np.ndarray
    band: np.ndarray
    learned: bool = False  # added to the model at the user's word
    moving: bool = False  # of tests in motion


@dataclass(frozen=True)
class Evidence:
    """Where the evidence for a named effect sits: z = sum of `contribution` over the rows of all channels."""

    effect: str
    test: str
    channel: str
    position: np.ndarray
    direction: np.ndarray
    temperature: np.ndarray
    contribution: np.ndarray


@dataclass(frozen=True)
class ParameterShift:
    """What ignoring the named effects would have done to an identified parameter (SI)."""

    name: str
    unit: str
    before: float
    after: float
    std_after: float | None


@dataclass(frozen=True)
class ChannelNoiseFound:
    """Noise of a channel as the diagnosis used it. std SI; correlation of neighbouring rows."""

    test: str
    channel: str
    std: float
    source: str
    correlation: float
    correlation_source: str
    effective_size: float
    rows: int
    parts: TwoParts | None = None  # where it grows with the reading


@dataclass(frozen=True)
class DiagnosisResult(Result):
    """Everything that `diagnose` found. gap_before, gap_after: reduced chi-square of the ideal and of the final model.

    before, after: the fits without and with the effects, row by row. left_over_p: of the smooth lack-of-fit test of the
    final model. seconds: wall time of this record; evaluations: of the model, in all refits. critical_level: |z| that a
    candidate must reach to be named, corrected for the size of the library; None where no search was made. suspects: found, but
    not proven on rows left out.
    """

    _command: ClassVar[str] = "diagnose"

    record: BenchRecord
    verdict: Verdict
    headline: str
    sentences: tuple[str, ...]
    where: tuple[Region, ...]
    where_after: tuple[Region, ...]
    effects: tuple[NamedEffect, ...]
    candidates: tuple[Candidate, ...]
    absorbed: tuple[str, ...]
    gap_before: float
    gap_after: float
    held_out: HeldOut | None
    next_test: NextTest | None
    before: FitResult
    after: FitResult
    shifts: tuple[ParameterShift, ...]
    variations: tuple[Variation, ...]
    evidence: tuple[Evidence, ...]
    noise: tuple[ChannelNoiseFound, ...]
    left_over_p: float
    seconds: float
    evaluations: int
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    learned: tuple[
        LearnedTerm | TypedTerm, ...
    ] = ()  # smooth or typed terms that the model of `after` holds: empirical
    critical_level: float | None = None
    suspects: tuple[Suspect, ...] = ()
    terms: tuple[Term, ...] = ()  # where in the circuit and with what, beside the final model; the best first
    # 2 ln E of all effects together on rows left out, each condition once; None where nothing is named.
    proof: float | None = None
    # What the final model misses beside the noise, where a misfit remains: error bars hold it.
    discrepancy: tuple[ChannelDiscrepancy, ...] = ()
    # The ideal valve with widened errors, which is handed over where the final model without the bench's faults predicts worse.
    instead: FitResult | None = None

    @property
    def plain_model(self) -> str:
        """What the record was compared with before anything was added, in words."""
        return "ideal valve" if not self.record.dynamic_tests else "plain model"

    @property
    def open(self) -> bool:
        """Whether `consistent` says less than it seems: the noise is not known, or a parameter ends at its limit."""
        return self.verdict == "consistent" and self.after.standing != "good"

    @property
    def rejected(self) -> tuple[Candidate, ...]:
        """Testable effects that were not named."""
        named = {effect.name for effect in self.effects}
        return tuple(c for c in self.candidates if c.state == "testable" and c.name not in named)

    @property
    def parameters(self) -> dict[str, ParameterEstimate]:
        """The parameters of the final model, effects included (SI)."""
        return self.after.parameters

    @property
    def model(self) -> "Model":
        """What `model.json` holds: the final model, effects and learned terms included, or what is handed over `instead`."""
        from thermohyd.identify.model.model_file import model_of_fit

        return model_of_fit(*self._handed_over)

    @property
    def _handed_over(self) -> tuple[FitResult, tuple[LearnedTerm | TypedTerm, ...]]:
        return (self.after, self.learned) if self.instead is None else (self.instead, ())

    def predict(self, record: BenchRecord) -> "Simulation":
        """Each row of a record, which needs no readings, predicted with `model`; `identify.predict` says more."""
        from thermohyd.identify.model.predict import simulate

        return simulate(record, self.model)

    def to_dict(self) -> dict[str, Any]:
        """The content of `diagnosis.json`: plain Python, SI units, null for what is not finite."""
        from thermohyd.identify.report.diagnosis_json import diagnosis_json

        return diagnosis_json(self)

    def to_dataframe(self) -> pd.DataFrame:
        """One row per named effect, by name, SI: value, unit, std, ci95_low, ci95_high (NaN: no error bar), p_value, strength,
        gap_closed, at_bound, alternatives (names, joined by commas) and sentence. No rows where nothing is named."""
        rows = []
        for effect in self.effects:
            low, high = effect.ci95 or (np.nan, np.nan)
            rivals = ", ".join(rival.name for rival in effect.alternatives)
            std = np.nan if effect.std is None else effect.std
            figures = (effect.p_value, effect.strength, effect.gap_closed)
            head = (effect.name, effect.value, effect.unit, std, low, high)
            rows.append((*head, *figures, effect.at_bound, rivals, effect.sentence))
        columns = ["effect", "value", "unit", "std", "ci95_low", "ci95_high"]
        columns += ["p_value", "strength", "gap_closed", "at_bound", "alternatives", "sentence"]
        return pd.DataFrame(rows, columns=columns).set_index("effect")

    def print_on(self, console: "Console") -> None:
        from thermohyd.identify.report.diagnosis_report import print_summary

        print_summary(self, console)

    def figures(self) -> "dict[str, Figure]":
        """Data and models of each test by its name, and "residual_map", "candidates", "evidence_<effect>", "exchange",
        "variations" where there is something to show, "profile_<parameter>" where draws were asked: matplotlib figures."""
        from thermohyd.identify.report.diagnosis_figures import diagnosis_figures
        from thermohyd.identify.report.uncertainty_figures import knowledge_figures

        return {**diagnosis_figures(self), **knowledge_figures(self.after)}

    def _files(self) -> dict[str, bytes | str]:
        from thermohyd.identify.model.model_file import model_json
        from thermohyd.identify.report.diagnosis_page import diagnosis_files

        return diagnosis_files(self, model_json(*self._handed_over))

    def _of(self) -> str:
        return self.record.source

    def _repr_html_(self) -> str:
        from thermohyd.identify.report.notebook import diagnosis_html

        return diagnosis_html(self)
