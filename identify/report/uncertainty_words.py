"""What is known of each parameter beyond its covariance, as text in bench units: the terminal and the page show exactly this."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.text import Text

from thermohyd.identify.bench.shown_units import BAR, CELSIUS, beside, figure_unit
from thermohyd.identify.fitting.result import FitResult
from thermohyd.identify.uncertainty.result import CoverageOf, KnownParameter, Nested, PredictedFigure

from .terminal import indented, table


TITLE = "What is known of each parameter"
PREDICTIONS = "What that says of the valve"


@dataclass(frozen=True)
class KnowledgeRow:
    """One parameter in bench units; empty where there is nothing to say, or nothing was asked."""

    name: str
    value: str
    unit: str
    std: str
    profile: str
    posterior: str
    prior: str
    bound: str
    verdict: str
    trades: str
    coverage: str
    remedy: str
    doubtful: bool


def knowledge_rows(result: FitResult) -> list[KnowledgeRow]:
    """A row per free parameter, where that was asked."""
    return [] if result.knowledge is None else [_row(result, row) for row in result.knowledge.rows.values()]


def _row(result: FitResult, row: KnownParameter) -> KnowledgeRow:
    unit = result.parameters[row.name].shown
    std = None if row.std is None else row.std * unit.factor
    idea = std if std is not None else _half(row, unit.factor)
    trades = "" if row.trades_with is None else f"{row.trades_with[0]} {row.trades_with[1]:+.2f}"
    remedy = "" if row.remedy is None else f"{row.remedy.words}: error x {row.remedy.factor:.2g}"
    return KnowledgeRow(
        name=row.name,
        value=beside(row.value * unit.factor, idea),
        unit=unit.label,
        std="" if std is None else beside(std, std),
        profile="" if row.profile is None else _ends(row.profile.at(0.95), unit.factor, idea),
        posterior="" if row.posterior is None else _ends(row.posterior.at(0.95), unit.factor, idea),
        prior="" if row.prior_share is None else f"{100.0 * row.prior_share:.0f} %",
        bound=row.bound,
        verdict=row.verdict,
        trades=trades,
        coverage="" if row.coverage is None else _share(row.coverage),
        remedy=remedy,
        doubtful=row.verdict != "identified",
    )


def _half(row: KnownParameter, factor: float) -> float | None:
    """A scale for digits, where there is no standard error."""
    interval = row.profile or row.posterior
    if interval is None:
        return None
    return _scale_of_digits(interval.at(0.95), factor)


def _scale_of_digits(ends: Nested, factor: float) -> float | None:
    return 0.25 * (ends.high - ends.low) * factor or None


def _ends(interval: Nested, factor: float, std: float | None) -> str:
    low, high = (beside(end * factor, std) for end in (interval.low, interval.high))
    low, high = f"[{low}]" if interval.open_low else low, f"[{high}]" if interval.open_high else high
    return f"{low} to {high}"


def _share(found: CoverageOf) -> str:
    return f"{found.held} of {found.records}" if found.records else "none"


@dataclass(frozen=True)
class PredictionRow:
    """One figure of the valve in bench units."""

    name: str
    at: str
    value: str
    unit: str
    std: str
    covariance: str
    profile: str


def prediction_rows(result: FitResult) -> list[PredictionRow]:
    """A row per figure, where profiles were asked."""
    return [] if result.knowledge is None else [_predicted(figure) for figure in result.knowledge.predictions]


def _predicted(figure: PredictedFigure) -> PredictionRow:
    unit = figure_unit(figure.unit)
    std = None if figure.std is None else figure.std * unit.factor
    idea = std if std is not None else _scale_of_digits(figure.profile, unit.factor)
    covariance = "" if figure.ci95 is None else _ends(Nested(0.95, *figure.ci95), unit.factor, idea)
    return PredictionRow(
        name=figure.name,
        at=f"{figure.temperature - CELSIUS:.0f} degC, {figure.supply_pressure * BAR:.0f} bar",
        value=beside(figure.value * unit.factor, idea),
        unit=unit.label,
        std="" if std is None else beside(std, std),
        covariance=covariance,
        profile=_ends(figure.profile, unit.factor, idea),
    )


def on_a_page(result: FitResult, pictures: Iterable[str]) -> dict[str, Any]:
    """What the template of a page takes; nothing is shown where nothing was asked. pictures: names of its figures."""
    rows = knowledge_rows(result)
    columns = [asked(own, rows) for own in ON_A_PAGE]
    return {
        "knowledge_title": TITLE,
        "knowledge": rows,
        "known_columns": columns,
        "known_tips": {ON_A_PAGE[1][key].lstrip(">~"): words for key, words in TIPS.items() if key in columns[1]},
        "predictions_title": PREDICTIONS,
        "predicted": PREDICTED,
        "predictions": prediction_rows(result),
        "knowledge_sentences": knowledge_sentences(result),
        "knowledge_figures": list(pictures),
    }


def print_predictions(result: FitResult, console: Console, wide: bool) -> None:
    """The table of figures."""
    cells = [[getattr(row, key) for key in PREDICTED] for row in prediction_rows(result)]
    console.print(indented(table([*PREDICTED.values()], cells, gap=int(wide))))
    console.print("")


def knowledge_sentences(result: FitResult) -> list[str]:
    """What the table means, and what else is to be said."""
    known = result.knowledge
    if known is None:
        return []
    said = [f"{row.name}: {row.verdict} identified: {row.why}" for row in known.rows.values() if row.why]
    said += [_nested(result, row) for row in known.rows.values() if row.profile is not None]
    said += _pressing(known.rows.values())
    brackets = [
        row.profile for row in known.rows.values() if row.profile is not None and row.profile.shape != "bounded"
    ]
    if brackets:
        said.append("an end in brackets is a limit of the parameter's: the data do not end the interval there")
    for row in known.rows.values():
        if row.averaged:
            said.append(f"{row.name}: error bar and interval also span what it is with {', '.join(row.averaged)}")
    drawn = known.posterior
    if drawn is not None and drawn.parameters:
        least = min(min(p.ess_bulk, p.ess_tail) for p in drawn.parameters.values())
        worst = max(p.r_hat for p in drawn.parameters.values())
        chains, count = drawn.draws.shape[:2]
        how = (
            f"{drawn.proposals} proposals weighed by importance (seed {drawn.seed}), worth at least {least:.0f} draws"
            if drawn.proposals
            else f"{chains} chains of {count} draws (seed {drawn.seed}), none divergent, R-hat at most {worst:.3f}, at least "
            f"{least:.0f} effective draws"
        )
        said.append(f"posterior: {how}; priors: {drawn.prior}")
    if known.simulated:
        failed = f", {known.failed} of which did not converge" if known.failed else ""
        said.append(
            f"coverage: in how many of {known.simulated} records simulated at this fit{failed} the 95 % interval held its value "
            f"(seed {known.seed}); {_expected(known.simulated - known.failed)}"
        )
    return [*said, *known.notes]


def _expected(records: int) -> str:
    """How many of so many exact 95 % intervals hold, in 95 of 100 cases."""
    from scipy.special import bdtr

    counts = range(records + 1)
    low = next((k for k in counts if bdtr(k, records, 0.95) >= 0.025), 0)
    high = next((k for k in counts if bdtr(k, records, 0.95) >= 0.975), records)
    return f"exact intervals hold in {low} to {high}"


def _nested(result: FitResult, row: KnownParameter) -> str:
    assert row.profile is not None
    unit = result.parameters[row.name].shown
    std = None if row.std is None else row.std * unit.factor
    idea = std if std is not None else _half(row, unit.factor)
    parts = [f"{100.0 * n.level:.0f} % {_ends(n, unit.factor, idea)}" for n in row.profile.intervals]
    return f"profile of {row.name} ({row.profile.shape}): {'; '.join(parts)}{'' if unit.label == '-' else f' {unit.label}'}"


def _pressing(rows: Iterable[KnownParameter]) -> list[str]:
    """Along which profiles other parameters press against their limits."""
    said = []
    for row in rows:
        if row.profile is None:
            continue
        within = [p for p in row.profile.points if p.rise <= row.profile.rises[-1]]
        names = sorted({name for point in within for name in point.pressed})
        if names:
            said.append(
                f"along the profile of {row.name}, {', '.join(names)} comes to its limit (ringed in the picture)"
            )
    return said


PREDICTED = {
    "name": "figure",
    "at": "at",
    "value": ">value",
    "std": ">std err",
    "unit": "unit",
    "covariance": ">covariance 95 %",
    "profile": ">profile 95 %",
}
# Two tables, as one does not fit beside 120 columns: what a parameter is, and what that rests on.
FIRST = {
    "name": "name",
    "value": ">value",
    "unit": "unit",
    "profile": ">profile 95 %",
    "posterior": ">posterior 95 %",
    "verdict": "verdict",
}
SECOND = {
    "name": "name",
    "std": ">std err",
    "prior": ">prior's share",
    "bound": "at bound",
    "coverage": ">coverage",
    "trades": "trades with",
}
# A page is wide enough for the test that would tell more.
ON_A_PAGE = (
    {**FIRST, "verdict": "identified?"},
    {**SECOND, "std": ">standard error", "remedy": "~a test that would tell more"},
)


TIPS = {
    "prior": "of all information on the parameter, what priors brought",
    "trades": "the strongest correlation",
    "coverage": "records simulated at this fit whose 95 % interval held its value",
}


def asked(columns: Mapping[str, str], rows: Iterable[KnowledgeRow]) -> dict[str, str]:
    """What was not asked has no column."""
    rows = list(rows)
    return {key: title for key, title in columns.items() if any(getattr(row, key) for row in rows)}


def print_knowledge(result: FitResult, console: Console, wide: bool) -> None:
    """The tables."""
    rows = knowledge_rows(result)
    for columns in (FIRST, SECOND):
        kept = asked(columns, rows)
        cells = [
            [
                Text(row.verdict, style="bold red" if row.doubtful else "") if key == "verdict" else getattr(row, key)
                for key in kept
            ]
            for row in rows
        ]
        console.print(indented(table([*kept.values()], cells, gap=int(wide))))
        console.print("")


def remedy_sentences(result: FitResult) -> list[str]:
    """Which test would narrow which parameter."""
    return [f"{row.name}: {row.remedy} of today's" for row in knowledge_rows(result) if row.remedy]
