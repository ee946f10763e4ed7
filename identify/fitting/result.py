"""What a fit returns: plain numbers and words, ready for the terminal, for JSON and for plots. No JAX here.

Methods that need reports, figures or the simulator import them when they are called: the numbers stay light.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pandas as pd
from scipy.special import fdtrc

from thermohyd.identify.bench.columns import reading_unit
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.shown_units import DisplayUnit, display_unit
from thermohyd.identify.bench.test_record import Fault
from thermohyd.identify.noise.two_parts import TwoParts
from thermohyd.identify.result import Result
from thermohyd.identify.uncertainty.result import Knowledge

from .parameters import Relative


if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from thermohyd.identify.model.model import Model
    from thermohyd.identify.model.predict import Simulation


# Reduced chi-square above which the program says that model and bench disagree (about 1.5 noise units RMS).
DISAGREES = 2.0
# Agreement is not claimed where all channels together would show as large a misfit by chance in one record of twenty, beyond a fifth
# of the variance that noise may well be larger than stated.
CHANCE, STATED_TO = 0.05, 1.2


@dataclass(frozen=True)
class ModelForm:
    """What the other law of an edge makes of one parameter (SI; docs/diagnosis.md section 6.1).

    value: with that law, None where the law has no such parameter. chi2: of the record with that law, at this fit's noise.
    std: standard uncertainty by the noise and by the choice of the law, about this fit's value. ci95: holds both laws' 95 %
    intervals; std and ci95 are None where one of the laws gives no error bar. undetermined: the move is far beyond the error
    bar, and the data do not say which law is right.
    """

    law: str
    value: float | None
    chi2: float
    std: float | None
    ci95: tuple[float, float] | None
    undetermined: bool = False


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter after the fit (SI).

    `std` and `ci95` are None where there is no honest error bar; `why_no_error_bar` then says why
    (held fixed, at its bound, no reading depends on it, a flat direction shared with ...). `by_profile`: the interval is
    that of the profile of chi-square, and need not lie evenly about the value; `std` is then the root mean square about
    the value of a normal law in two pieces with these sides, and at a bound there is an interval without a `std`.
    `averaged_over`: error bar and interval also span these names, in the place of named ones or as suspects (`diagnosis/model_average.py`).
    `conditional_on`: parameters at their bounds, which std and interval take to stay there. `std` and `ci95` know the noise
    alone; `model_form` also knows the other law of an edge, where that was asked.
    """

    name: str
    value: float
    unit: str  # SI, pint spelling: "m", "dimensionless", ...
    std: float | None
    ci95: tuple[float, float] | None
    start: float
    lower: float
    upper: float
    at_bound: bool = False
    fixed: bool = False
    prior_std: float | None = None
    why_no_error_bar: str = ""
    by_profile: bool = False
    conditional_on: tuple[str, ...] = ()
    model_form: ModelForm | None = None
    averaged_over: tuple[str, ...] = ()  # models that explain the record alike, which std and interval span
    relative: Relative | None = None  # the data do not scale it: a report gives it in these units
    prior_because: str = ""  # why the program put its prior there, and what changes it; empty where `[start]` did

    @property
    def reported(self) -> "ParameterEstimate":
        """As results state it: where the data do not scale it, in the units of what would; else as it is."""
        if self.relative is None:
            return self
        size = self.relative.size
        of = lambda value: None if value is None else value / size
        numbers = {key: of(getattr(self, key)) for key in ("value", "std", "start", "lower", "upper", "prior_std")}
        ends = lambda pair: None if pair is None else (pair[0] / size, pair[1] / size)
        form = self.model_form
        if form is not None:
            form = replace(form, value=of(form.value), std=of(form.std), ci95=ends(form.ci95))
        return replace(self, **numbers, ci95=ends(self.ci95), unit=self.relative.unit, model_form=form)

    @property
    def shown(self) -> DisplayUnit:
        """The bench unit of its values, or what they are relative to."""
        unit = display_unit(self.unit)
        if self.relative is None:
            return unit
        if self.relative.to == "discharge_coefficient":
            return DisplayUnit(f"C_q {unit.label}", unit.factor / self.relative.size)
        return DisplayUnit(self.relative.unit, 1.0 / self.relative.size)


@dataclass(frozen=True)
class OtherLaw:
    """A record's static tests fitted with the other law of an edge, at the noise that the fit with its own law left.

    chi2, own_chi2: of both laws, comparable. evidence: by which Akaike's criterion is lower with the other law, for as many
    readings as the correlated ones are worth; negative where it is higher. preferred: the law that the data prefer, None where
    they do not say. misfit: neither law explains the record, so that the evidence does not count. converged, own_converged: the
    fits with the other law and with the record's own. parameters: with the other law.
    """

    law: str
    own: str
    chi2: float
    own_chi2: float
    evidence: float
    preferred: str | None
    misfit: bool
    converged: bool
    message: str
    parameters: dict[str, ParameterEstimate]
    own_converged: bool = True


@dataclass(frozen=True)
class ChannelFit:
    """One channel of one test beside the fitted model, row by row (SI): what the plots draw and the report sums up."""

    test: str
    channel: str
    position: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    std: np.ndarray  # noise of each point as the fit used it
    predicted_std: np.ndarray  # from the parameters' covariance
    direction: np.ndarray
    run: np.ndarray
    supply_pressure: np.ndarray
    temperature: np.ndarray
    residual_rms: float  # measured - predicted, over the points
    noise: float  # typical noise standard deviation of one point
    noise_source: str  # in words
    reduced_chi2: float  # of this channel alone
    autocorrelation: float  # of neighbouring residuals along the sweep
    effective_size: float  # independent readings that the points are worth
    noise_known: bool = True  # stated, or measured free of any model; else taken from the residuals themselves
    neighbours: float | None = None  # scatter of neighbouring readings about a smooth curve, where that says something
    signal: str = ""  # "V" or "count": the readings are signals of a sensor of free gain; empty: SI
    noise_freedom: float = np.inf  # degrees of freedom from which the noise was estimated; infinite: stated
    noise_parts: TwoParts | None = None  # where it grows with the reading: one of its own, and a share of the reading

    @property
    def unit(self) -> DisplayUnit:
        """In which its readings are shown."""
        return reading_unit(self.channel, self.signal)


def beyond_chance(channels: Sequence[ChannelFit]) -> tuple[ChannelFit, ...]:
    """Channels that the model misses by more than their noise, as far as that is known, leaves by chance (Fisher's F, Bonferroni)."""
    level = CHANCE / max(len(channels), 1)
    p = lambda c: float(fdtrc(max(c.effective_size, 1.0), min(c.noise_freedom, 1e9), c.reduced_chi2))
    return tuple(c for c in channels if c.noise_known and c.reduced_chi2 > STATED_TO and p(c) < level)


@dataclass(frozen=True)
class StartOutcome:
    """What one of the starts of the multi-start came to."""

    start: dict[str, float]
    cost: float  # chi-square reached
    converged: bool
    message: str
    steps: int
    restart: bool = False  # no start of its own: from beside the best end of the others, and lower than all of them


@dataclass(frozen=True)
class Identifiability:
    """How well the data tell the parameters apart, in figures and in words."""

    condition_number: float
    singular_values: tuple[float, ...]
    weak_directions: tuple[str, ...]  # "edge_radius and underlap trade off: +0.71 -0.70"
    sentences: tuple[str, ...] = ()  # further remarks: known degeneracies, high correlations


@dataclass(frozen=True)
class FitResult(Result):
    """Everything that `fit` found. `covariance` is over `free` (names in order), SI units."""

    _command: ClassVar[str] = "fit"

    record: BenchRecord
    parameters: dict[str, ParameterEstimate]
    free: tuple[str, ...]
    covariance: np.ndarray
    correlation: np.ndarray
    reduced_chi2: float
    chi2: float
    degrees_of_freedom: float
    channels: tuple[ChannelFit, ...]
    identifiability: Identifiability
    rows: int  # rows of the record as logged
    points: int  # readings that the fit used after reduction
    seconds: float
    converged: bool
    message: str
    starts: tuple[StartOutcome, ...]
    notes: tuple[str, ...] = ()  # what was reduced, where the noise came from, what was left out
    warnings: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()  # of the bench: rows that are no readings of the valve
    noise_freedom: float = np.inf  # degrees of freedom from which the noise was estimated; infinite: stated
    verdict: tuple[str, ...] = field(default=())  # plain sentences: how well the ideal valve fits and where it misses
    other_law: OtherLaw | None = None  # where it was asked
    knowledge: Knowledge | None = None  # beyond the covariance, where that was asked (`fit_in_depth`)

    @property
    def judged(self) -> bool:
        """Whether the noise of every reading is known, so that agreement or misfit can be judged."""
        return all(channel.noise_known for channel in self.channels)

    @property
    def standing(self) -> str:
        """ "good": explained within a known noise; "open": that cannot be judged, or a parameter ends at its limit; "bad"."""
        if not self.converged or any(c.noise_known and c.reduced_chi2 >= DISAGREES for c in self.channels):
            return "bad"
        doubtful = beyond_chance(self.channels) or any(p.at_bound for p in self.parameters.values())
        return "good" if self.judged and not doubtful else "open"

    @property
    def model(self) -> "Model":
        """The valve as `model.json` holds it: parameters, their covariance, and where the tests were run."""
        from thermohyd.identify.model.model_file import model_of_fit

        return model_of_fit(self)

    def predict(self, record: BenchRecord) -> "Simulation":
        """Each row of a record, which needs no readings, predicted with this fit's valve; `identify.predict` says more."""
        from thermohyd.identify.model.predict import simulate

        return simulate(record, self.model)

    def to_dict(self) -> dict[str, Any]:
        """The content of `fit.json`: plain Python, SI units, null for what is not finite."""
        from thermohyd.identify.report.fit_json import fit_json

        return fit_json(self)

    def to_dataframe(self) -> pd.DataFrame:
        """One row per parameter, by name, SI, a relative one in its own unit: value, unit, std, ci95_low, ci95_high (NaN: no
        error bar), start, lower, upper, at_bound, fixed, why_no_error_bar, how the interval was found, relative_to, and
        model_form_value, _std, _low and _high (`ModelForm`)."""
        rows = {}
        for name, estimate in self.parameters.items():
            estimate = estimate.reported
            row = {field.name: getattr(estimate, field.name) for field in fields(estimate)}
            low, high = row.pop("ci95") or (np.nan, np.nan)
            del row["name"]
            relative = row.pop("relative")
            row["relative_to"] = "" if relative is None else relative.to
            form = row.pop("model_form")
            seen = (np.nan,) * 4 if form is None else (form.value, form.std, *(form.ci95 or (np.nan, np.nan)))
            beyond = dict(zip(("value", "std", "low", "high"), seen, strict=True))
            row |= {f"model_form_{key}": np.nan if value is None else value for key, value in beyond.items()}
            std, prior = (np.nan if row.pop(key) is None else getattr(estimate, key) for key in ("std", "prior_std"))
            head = {"value": row.pop("value"), "unit": row.pop("unit"), "std": std, "ci95_low": low, "ci95_high": high}
            rows[name] = {**head, **row, "prior_std": prior}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")

    def print_on(self, console: "Console") -> None:
        from thermohyd.identify.report.fit_report import print_report

        print_report(self, console)

    def figures(self) -> "dict[str, Figure]":
        """Data, model and residuals of each test by its name, "parameters", and "profile_<parameter>" where it was asked:
        matplotlib figures."""
        from thermohyd.identify.report.fit_figures import fit_figures
        from thermohyd.identify.report.uncertainty_figures import knowledge_figures

        return {**fit_figures(self), **knowledge_figures(self)}

    def _files(self) -> dict[str, bytes | str]:
        from thermohyd.identify.report.fit_json import fit_files

        return fit_files(self)

    def _of(self) -> str:
        return self.record.source

    def _repr_html_(self) -> str:
        from thermohyd.identify.report.notebook import fit_html

        return fit_html(self)
