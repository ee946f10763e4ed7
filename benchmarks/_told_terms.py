"""What the second tier told of one record, as the leave-one-out tables keep it."""

import time
from pathlib import Path
from typing import Any


def terms_beside(case: Any, folder: Path) -> dict[str, Any]:
    """The terms that are told beside a case's plain model."""
    from thermohyd.identify.diagnosis.held_out import split_rows
    from thermohyd.identify.diagnosis.typed_terms import terms_of

    began, cpu = time.perf_counter(), time.process_time()
    found = terms_of(case.problem, case.base, split_rows(case.fitted.tests))
    return {
        "record": folder.name,
        "headline": " | ".join(f"{f.fitted.term.place} {f.fitted.term.variable} {f.gap_closed:.2f}" for f in found) or "none",
        "verdict": "",
        "named": [],
        "before": case.base.chi2 / len(case.base.residual),
        "seconds": time.perf_counter() - began,
        "cpu": time.process_time() - cpu,
        "terms": [
            {
                "place": f.fitted.term.place, "variable": f.fitted.term.variable, "law": f.fitted.term.law, "value": f.size[0],
                "std": f.size[1], "p": f.p_value, "gap_closed": f.gap_closed, "proof": f.proof, "holds": f.holds,
                "after": f.fitted.fit.chi2 / len(case.base.residual), "alternatives": [list(a) for a in f.alternatives],
            }
            for f in found
        ],
    }  # fmt: skip


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
        "before": result.gap_before,
        "seconds": result.seconds,
        "cpu": None,
        "terms": [
            {
                "place": t.place, "variable": t.variable, "law": t.law, "value": t.value, "std": t.std, "p": t.p_value,
                "gap_closed": t.gap_closed, "proof": t.proof, "holds": t.holds, "after": None,
                "alternatives": [list(a) for a in t.alternatives],
            }
            for t in result.terms
        ],
    }  # fmt: skip
