"""Every figure of a diagnosis, in the order in which a report shows them."""

from dataclasses import replace

from matplotlib.figure import Figure

from ..dynamic.plots import dynamic_figure
from ..fit_result import FitResult
from ..plots import test_figures
from ..record import DYNAMIC_TESTS
from .before_after_plot import before_after_figure, same_rows
from .candidate_plot import candidate_figure, exchange_figure
from .diagnosis_content import changed
from .evidence_plot import evidence_figure
from .residual_map import residual_map
from .result import DiagnosisResult
from .variation_plot import variation_figure


def diagnosis_figures(result: DiagnosisResult) -> dict[str, Figure]:
    """{file name without ending: figure}; a model that stayed as it was is drawn once, not before and after."""
    names = {name: test.run_names for name, test in result.record.all_tests.items()}
    figures = _tests(result, names)
    before, after = (_static(fit) for fit in (result.before, result.after))
    if before.channels:
        figures["residual_map"] = residual_map(before, after if _comparable(result) else None, names)
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


def _static(fit: FitResult) -> FitResult:
    """The channels of static tests, which have a map; a time history shows its residuals itself."""
    return replace(fit, channels=tuple(c for c in fit.channels if c.test not in DYNAMIC_TESTS))


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
    pairs = list(zip(result.before.channels, result.after.channels, strict=True))
    for test in dict.fromkeys(after.test for _, after in pairs if after.test in DYNAMIC_TESTS):
        own = [pair for pair in pairs if pair[1].test == test]
        figures[test] = dynamic_figure(own, run_names.get(test, ()), (words, "plain model"))
    for before, after in pairs:
        if after.test in DYNAMIC_TESTS:
            continue
        alone = sum(fit.test == before.test for fit in result.before.channels) == 1
        name = before.test if alone else f"{before.test}_{before.channel}"
        figures[name] = before_after_figure(before, after, words, run_names.get(before.test, ()))
    return figures
