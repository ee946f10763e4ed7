"""`diagnosis.json`: a diagnosis as one plain dictionary, SI units; its keys: docs/bench_format.md section 8.3."""

from typing import Any

import numpy as np

from thermohyd.identify.bench.provenance import record_json
from thermohyd.identify.diagnosis.result import (
    Candidate,
    DiagnosisResult,
    Evidence,
    NamedEffect,
    Region,
    Term,
    Variation,
)

from .fit_json import fields_of, fit_json, parts_of, plain


NOISE = ("test", "channel", "std", "source", "correlation", "correlation_source", "effective_size", "rows")
DISCREPANCY = ("test", "channel", "std", "of_each_sweep", "length")
SUSPECT = (
    "name",
    "value",
    "unit",
    "evidence",
    "times_usual",
    "strength",
    "hint",
    "held_out",
    "outdone_by",
    "closes",
    "fault",
)
CREDIT = ("group", "first_in", "last_in", "share")
HELD_OUT = ("before", "after", "gap_closed", "rows", "what", "reduced_chi2_before", "reduced_chi2_after", "exchange")


def diagnosis_json(result: DiagnosisResult) -> dict[str, Any]:
    """The content of `diagnosis.json`; what is not finite becomes null, so that any JSON reader can read it.

    A rival that the data cannot tell from a named effect stands under `alternatives`, never under `rejected`.
    """
    rivals = {rival.name for effect in result.effects for rival in effect.alternatives}
    after = fit_json(result.after)
    content = {
        **record_json(result.record),
        "verdict": result.verdict,
        "converged": result.after.converged,
        "judged": result.after.judged,
        **fields_of(result, "headline", "sentences"),
        "where": [_region(region) for region in result.where],
        "where_after": [_region(region) for region in result.where_after],
        "effects": [_effect(effect) for effect in result.effects],
        "rejected": [fields_of(c, "name", "p_value", "gap_closed") for c in result.rejected if c.name not in rivals],
        "suspects": [fields_of(suspect, *SUSPECT) for suspect in result.suspects],
        "proof": result.proof,
        **fields_of(result, "absorbed", "gap_before", "gap_after"),
        "held_out": None if result.held_out is None else fields_of(result.held_out, *HELD_OUT),
        "credit": [] if result.held_out is None else [fields_of(credit, *CREDIT) for credit in result.held_out.credit],
        "handed_over": "final model" if result.instead is None else result.plain_model,
        "next_test": None if result.next_test is None else result.next_test.sentence,
        "next_tests_considered": []
        if result.next_test is None
        else [
            {"test": option.words, "evidence": option.evidence, "rows": option.rows, "seconds": option.seconds}
            for option in result.next_test.options
        ],
        "faults": after["faults"],
        "candidates": [_candidate(candidate) for candidate in result.candidates],
        "critical_level": result.critical_level,
        "terms": [_term(term) for term in result.terms],
        "variations": [_variation(variation) for variation in result.variations],
        "parameter_shifts": [fields_of(s, "name", "unit", "before", "after", "std_after") for s in result.shifts],
        "evidence": [_evidence(evidence) for evidence in result.evidence],
        "noise": [fields_of(noise, *NOISE) | {"parts": parts_of(noise.parts)} for noise in result.noise],
        "discrepancy": [fields_of(found, *DISCREPANCY) for found in result.discrepancy],
        **fields_of(result, "left_over_p", "seconds", "evaluations", "notes", "warnings"),
        "units": "SI: m, Pa (gauge), K, m3/s",
        "fit_before": {
            "parameters": {
                name: fields_of(p.reported, "value", "unit", "std") for name, p in result.before.parameters.items()
            },
            "reduced_chi2": result.before.reduced_chi2,
        },
        # without the plain fit's own sentences: they speak of the ideal valve
        "fit": {key: value for key, value in after.items() if key != "verdict"},
    }
    return plain(content)


def _region(region: Region) -> dict[str, Any]:
    limits = {column: list(limits) for column, limits in region.limits.items()}
    return {
        **fields_of(region, "test", "channel"),
        "region": limits,
        **fields_of(region, "excess_chi2", "share", "rows", "mean", "rms"),
    }


def _effect(effect: NamedEffect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "parameter": fields_of(effect, "value", "unit", "std", "ci95"),
        **fields_of(effect, "p_value", "gap_closed"),
        "alternatives": [rival.name for rival in effect.alternatives],
        "alternative_fits": [
            fields_of(rival, "name", "where", "value", "unit", "chi2_more") for rival in effect.alternatives
        ],
        "places": [list(pair) for pair in effect.places],
        **fields_of(effect, "strength", "top_rows", "at_bound", "either_sign", "sentence"),
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    return {
        **fields_of(candidate, "name", "state", "why", "z", "p_value", "estimate"),
        "least_detectable": candidate.least,
        **fields_of(candidate, "unit", "kept", "gap_closed"),
    }


def _term(term: Term) -> dict[str, Any]:
    return {
        **fields_of(term, "place", "variable", "law", "value", "unit", "std", "p_value", "gap_closed"),
        "alternatives": [list(pair) for pair in term.alternatives],
        **fields_of(term, "sentence", "confirmed_by", "coefficients"),
        "range": [term.low, term.high],
        **fields_of(term, "place_unit", "variable_unit", "proof", "holds", "on_held_out", "learned", "moving"),
    }


def _variation(variation: Variation) -> dict[str, Any]:
    return {
        **fields_of(variation, "quantity", "variable", "unit"),
        "values": variation.variable_values,
        "curve": variation.curve,
        "std": variation.band,
        **fields_of(variation, "chi2_gain", "p_value", "gap_closed"),
        "legendre": fields_of(variation, "coefficients", "centre", "reach"),
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
