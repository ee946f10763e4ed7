"""What the second tier told of one record, as the leave-one-out tables keep it."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def terms_beside(opened: Callable[[tuple[str, ...]], Any], folder: Path, hidden: tuple[str, ...]) -> dict[str, Any]:
    """The terms that are told with an empty library, and what the hidden effects themselves leave on the rows held out.

    opened: the case of the record without the effects of these names.
    """
    from thermohyd.effects.library import whole_library
    from thermohyd.identify.diagnosis.held_out import split_rows
    from thermohyd.identify.diagnosis.typed_terms import terms_of

    everything = tuple(whole_library())
    case = opened(everything)
    began, cpu = time.perf_counter(), time.process_time()
    split = split_rows(case.fitted.tests)
    found = terms_of(case.problem, case.base, split)
    took = {"seconds": time.perf_counter() - began, "cpu": time.process_time() - cpu}
    own = left_by(opened(tuple(n for n in everything if n not in hidden)), case, hidden, split) if hidden else None
    return {
        **took,
        "own": own,
        "record": folder.name,
        "headline": " | ".join(f"{f.fitted.term.place} {f.fitted.term.variable} {f.gap_closed:.2f}" for f in found) or "none",
        "verdict": "",
        "named": [],
        "before": case.base.chi2 / len(case.base.residual),
        "terms": [
            {
                "place": f.fitted.term.place, "variable": f.fitted.term.variable, "law": f.fitted.term.law, "value": f.size[0],
                "std": f.size[1], "p": f.p_value, "gap_closed": f.gap_closed, "proof": f.proof, "holds": f.holds,
                "after": f.fitted.fit.chi2 / len(case.base.residual), "alternatives": [list(a) for a in f.alternatives],
                "held_out": list(f.held_out),
            }
            for f in found
        ],
    }  # fmt: skip


def left_by(case: Any, noise_of: Any, effects: tuple[str, ...], split: Any) -> float:
    """Mean square misfit of the rows held out beside a fit of the others with these effects, in the noise of another case."""
    from thermohyd.identify.diagnosis.final_model import mean_square

    problem = case.problem.with_noise(noise_of.problem.noise)
    fitted = problem.with_rows(~split.held).fit(effects, noise_of.base.values, hop_basins=True)
    return mean_square(problem, fitted, split)


def terms_of_a_diagnosis(folder: Path, effects: tuple[str, ...]) -> dict[str, Any]:
    """A whole diagnosis with the hidden effect out of the library."""
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.diagnosis.diagnose import diagnose

    result = diagnose(read_record(folder), without=effects, model_form=False)
    return {
        "record": folder.name,
        "headline": result.headline,
        "verdict": result.verdict,
        "named": [e.name for e in result.effects],
        "acting": [list(pair) for e in result.effects for pair in e.places],
        "before": result.gap_before,
        "seconds": result.seconds,
        "cpu": None,
        "terms": [
            {
                "place": t.place, "variable": t.variable, "law": t.law, "value": t.value, "std": t.std, "p": t.p_value,
                "gap_closed": t.gap_closed, "proof": t.proof, "holds": t.holds, "after": None,
                "alternatives": [list(a) for a in t.alternatives],
                "held_out": None,
            }
            for t in result.terms
        ],
    }  # fmt: skip
