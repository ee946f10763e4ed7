"""Every figure of a diagnosis, in the order in which a report shows them."""

from matplotlib.figure import Figure

from ..plots import test_figures
from .before_after_plot import before_after_figure, same_rows
from .candidate_plot import candidate_figure, exchange_figure
from .diagnosis_content import changed
from .evidence_plot import evidence_figure
from .residual_map import residual_map
from .result import DiagnosisResult
from .variation_plot import variation_figure


def diagnosis_figures(result: DiagnosisResult) -> dict[str, Figure]:
    """{file name without ending: figure}; a model that stayed as it was is drawn once, not before and after."""
    names = {name: test.run_names for name, test in result.record.tests.items()}
    figures = _tests(result, names)
    figures["residual_map"] = residual_map(result.before, result.after if _comparable(result) else None, names)
    if result.candidates:
        figures["candidates"] = candidate_figure(result)
    for effect in dict.fromkeys(part.effect for part in result.evidence):
        figures[f"evidence_{effect}"] = evidence_figure([part for part in result.evidence if part.effect == effect])
    exchange = exchange_figure(result)
    if exchange is not None:
        figures["exchange"] = exchange
    if result.variations:
        figures["variations"] = variation_figure(result.variations)
    return figures


def _comparable(result: DiagnosisResult) -> bool:
    pairs = zip(result.before.channels, result.after.channels, strict=False)
    return (
        changed(result)
        and len(result.before.channels) == len(result.after.channels)
        and all(same_rows(before, after) for before, after in pairs)
    )


def _tests(result: DiagnosisResult, run_names: dict[str, tuple[str, ...]]) -> dict[str, Figure]:
    if not _comparable(result):
        return test_figures(result.after)
    added = [effect.name for effect in result.effects]
    added += [f"learned {variation.quantity}" for variation in result.variations if variation.learned]
    words = f"with {added[0]}" if len(added) == 1 else f"with {len(added)} effects"
    figures = {}
    for before, after in zip(result.before.channels, result.after.channels, strict=True):
        alone = sum(fit.test == before.test for fit in result.before.channels) == 1
        name = before.test if alone else f"{before.test}_{before.channel}"
        figures[name] = before_after_figure(before, after, words, run_names.get(before.test, ()))
    return figures
