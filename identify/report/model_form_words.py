"""What the other law of an edge makes of a fit, as text in bench units: the terminal and both pages show exactly this."""

from dataclasses import dataclass

from thermohyd.identify.bench.shown_units import beside, effect_unit, significant
from thermohyd.identify.fitting.result import FitResult, OtherLaw, ParameterEstimate


@dataclass(frozen=True)
class ModelFormRow:
    """A parameter or an effect with either law, in bench units; empty where there is nothing to say."""

    name: str
    value: str
    own: str  # with its standard error
    other: str
    unit: str
    move: str  # in standard errors
    interval: str
    status: str


def title(result: FitResult) -> str:
    """What the table is headed with; empty where the other law was not asked."""
    return "" if result.other_law is None else f"With the {result.other_law.law} law of the edge"


def model_form_rows(result: FitResult) -> list[ModelFormRow]:
    """A row per parameter that the other law was asked of."""
    return [_row(estimate) for estimate in result.parameters.values() if estimate.model_form is not None]


def _row(estimate: ParameterEstimate) -> ModelFormRow:
    form = estimate.model_form
    assert form is not None
    unit = effect_unit(estimate.name, estimate.unit)
    shown = lambda value, std: (
        "" if value is None else beside(value * unit.factor, None if std is None else std * unit.factor)
    )
    std = f" +/- {shown(estimate.std, estimate.std)}" if estimate.std else ""
    interval = ""
    if form.ci95 is not None:
        interval = " to ".join(shown(end, form.std or estimate.std) for end in form.ci95)
    return ModelFormRow(
        name=estimate.name,
        value=shown(estimate.value, estimate.std),
        own=f"{shown(estimate.value, estimate.std)}{std}",
        other="has none" if form.value is None else shown(form.value, estimate.std),
        unit=unit.label,
        move="" if form.value is None or not estimate.std else _in_std((form.value - estimate.value) / estimate.std),
        interval=interval,
        status="NOT DETERMINED" if form.undetermined else "",
    )


def _in_std(move: float) -> str:
    return f"{move:+.1f}" if abs(move) < 100.0 else f"{move:+.0f}"


def model_form_sentences(result: FitResult) -> list[str]:
    """Which law the data prefer, then each parameter that they leave open; nothing where the other law was not asked."""
    asked = result.other_law
    if asked is None:
        return []
    sentences = [preference(asked)]
    if result.record.dynamic_tests:
        sentences.append("The other law was fitted to the static tests alone.")
    for estimate in result.parameters.values():
        form = estimate.model_form
        if form is None or not form.undetermined or form.value is None or not estimate.std:
            continue
        row = _row(estimate)
        label = "" if row.unit in ("", "-") else f" {row.unit}"
        other = significant(form.value * effect_unit(estimate.name, estimate.unit).factor, 2)
        sentences.append(
            f"{estimate.name}: {row.own}{label}; {other} with the {form.law} law: this record does not determine it."
        )
    return sentences


def preference(asked: OtherLaw) -> str:
    """Which of the two laws the data prefer, in one sentence."""
    if not asked.converged:
        return f"With the {asked.law} law of the edge the fit did not converge ({asked.message}): nothing is known of what it would change."
    if not asked.own_converged and asked.preferred is None:
        return f"With the {asked.own} law of the edge the fit did not converge: the two laws cannot be compared."
    both = {asked.own: asked.own_chi2, asked.law: asked.chi2}
    words = lambda law: f"{both[law]:,.0f} with the {law} law"
    if asked.preferred is not None:
        worse = asked.law if asked.preferred == asked.own else asked.own
        advice = (
            ""
            if asked.preferred == asked.own
            else f'; edge_law = "{asked.preferred}" in [valve] makes it the record\'s own'
        )
        return f"The data prefer the {asked.preferred} law of the edge: chi-square {words(asked.preferred)}, {words(worse)}{advice}."
    figures = f"chi-square {words(asked.own)}, {words(asked.law)}"
    if asked.misfit:
        return f"Neither law of the edge explains the record ({figures}), so the data do not say which is right."
    return f"Both laws of the edge explain the record about as well ({figures}): the data do not say which is right."
