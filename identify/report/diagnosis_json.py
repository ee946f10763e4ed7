"""`diagnosis.json`: a diagnosis as one plain dictionary, SI units; its keys: docs/bench_format.md section 8.3."""

from typing import Any

import numpy as np

from thermohyd.identify.bench.provenance import record_json
from thermohyd.identify.diagnosis.result import (
    Candidate,
    DiagnosisResult,
    Evidence,
    HeldOut,
    NamedEffect,
    Region,
    Variation,
)

from .fit_json import fit_json, plain


def diagnosis_json(result: DiagnosisResult) -> dict[str, Any]:
    """The content of `diagnosis.json`; what is not finite becomes null, so that any JSON reader can read it.

    A rival that the data cannot tell from a named effect stands under `alternatives`, never under `rejected`.
    """
    rivals = {rival.name for effect in result.effects for rival in effect.alternatives}
    content = {
        **record_json(result.record),
        "verdict": result.verdict,
        "converged": result.after.converged,
        "judged": result.after.judged,
        "headline": result.headline,
        "sentences": list(result.sentences),
        "where": [_region(region) for region in result.where],
        "where_after": [_region(region) for region in result.where_after],
        "effects": [_effect(effect) for effect in result.effects],
        "rejected": [
            {"name": c.name, "p_value": c.p_value, "gap_closed": c.gap_closed}
            for c in result.rejected
            if c.name not in rivals
        ],
        "absorbed": list(result.absorbed),
        "gap_before": result.gap_before,
        "gap_after": result.gap_after,
        "held_out": None if result.held_out is None else _held_out(result.held_out),
        "next_test": None if result.next_test is None else result.next_test.sentence,
        "next_tests_considered": []
        if result.next_test is None
        else [{"test": words, "evidence": evidence} for words, evidence in result.next_test.options],
        "candidates": [_candidate(candidate) for candidate in result.candidates],
        "critical_level": result.critical_level,
        "variations": [_variation(variation) for variation in result.variations],
        "parameter_shifts": [
            {"name": s.name, "unit": s.unit, "before": s.before, "after": s.after, "std_after": s.std_after}
            for s in result.shifts
        ],
        "evidence": [_evidence(evidence) for evidence in result.evidence],
        "noise": [
            {
                "test": n.test,
                "channel": n.channel,
                "std": n.std,
                "source": n.source,
                "correlation": n.correlation,
                "correlation_source": n.correlation_source,
                "effective_size": n.effective_size,
                "rows": n.rows,
            }
            for n in result.noise
        ],
        "left_over_p": result.left_over_p,
        "seconds": result.seconds,
        "notes": list(result.notes),
        "warnings": list(result.warnings),
        "units": "SI: m, Pa (gauge), K, m3/s",
        "fit_before": {
            "parameters": {
                name: {"value": p.value, "unit": p.unit, "std": p.std} for name, p in result.before.parameters.items()
            },
            "reduced_chi2": result.before.reduced_chi2,
        },
        # without the plain fit's own sentences: they speak of the ideal valve
        "fit": {key: value for key, value in fit_json(result.after).items() if key != "verdict"},
    }
    return plain(content)


def _region(region: Region) -> dict[str, Any]:
    return {
        "test": region.test,
        "channel": region.channel,
        "region": {column: list(limits) for column, limits in region.limits.items()},
        "excess_chi2": region.excess_chi2,
        "share": region.share,
        "rows": region.rows,
        "mean": region.mean,
    }


def _effect(effect: NamedEffect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "parameter": {"value": effect.value, "unit": effect.unit, "std": effect.std, "ci95": effect.ci95},
        "p_value": effect.p_value,
        "gap_closed": effect.gap_closed,
        "alternatives": [rival.name for rival in effect.alternatives],
        "alternative_fits": [
            {"name": rival.name, "value": rival.value, "unit": rival.unit, "chi2_more": rival.chi2_more}
            for rival in effect.alternatives
        ],
        "strength": effect.strength,
        "at_bound": effect.at_bound,
        "sentence": effect.sentence,
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    return {
        "name": candidate.name,
        "state": candidate.state,
        "why": candidate.why,
        "z": candidate.z,
        "p_value": candidate.p_value,
        "estimate": candidate.estimate,
        "least_detectable": candidate.least,
        "unit": candidate.unit,
        "kept": candidate.kept,
        "gap_closed": candidate.gap_closed,
    }


def _held_out(held: HeldOut) -> dict[str, Any]:
    return {
        "before": held.before,
        "after": held.after,
        "gap_closed": held.gap_closed,
        "rows": held.rows,
        "what": held.what,
        "reduced_chi2_before": held.reduced_chi2_before,
        "reduced_chi2_after": held.reduced_chi2_after,
        "exchange": dict(held.exchange),
    }


def _variation(variation: Variation) -> dict[str, Any]:
    return {
        "quantity": variation.quantity,
        "variable": variation.variable,
        "unit": variation.unit,
        "values": variation.variable_values,
        "curve": variation.curve,
        "std": variation.band,
        "chi2_gain": variation.chi2_gain,
        "p_value": variation.p_value,
        "gap_closed": variation.gap_closed,
        "legendre": {
            "coefficients": list(variation.coefficients),
            "centre": variation.centre,
            "reach": variation.reach,
        },
        "learned": variation.learned,
        "empirical": True,  # a fitted curve, not a cause
    }


def _evidence(evidence: Evidence) -> dict[str, Any]:
    """Sums only: the rows are in the plot, a JSON of them would be as long as the record."""
    directions = {"rising": evidence.direction > 0, "falling": evidence.direction < 0}
    return {
        "effect": evidence.effect,
        "test": evidence.test,
        "channel": evidence.channel,
        "z": float(np.sum(evidence.contribution)),
        **{f"z_{words}": float(np.sum(evidence.contribution[rows])) for words, rows in directions.items()},
    }
