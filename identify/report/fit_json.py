"""`fit.json` as one plain dictionary (its keys: docs/bench_format.md section 8.2), and all files of `fit --out`. SI units.

The files are bytes and text in memory: whole before the first one is written.
"""

import json
import math
from importlib.metadata import version
from typing import Any

import numpy as np

from thermohyd.identify.bench.provenance import record_json
from thermohyd.identify.bench.test_record import Fault
from thermohyd.identify.fitting.result import ChannelFit, FitResult, ParameterEstimate
from thermohyd.identify.model.model_file import model_json
from thermohyd.identify.noise.two_parts import TwoParts

from .fit_figures import fit_figures
from .fit_report import chi2_band
from .model_form_words import model_form_sentences
from .page import html_report
from .style import drawn
from .uncertainty_figures import knowledge_figures
from .uncertainty_json import knowledge_json


def fit_json(result: FitResult) -> dict[str, Any]:
    """The content of `fit.json`; what is not finite becomes null, so that any JSON reader can read it."""
    tests = list(dict.fromkeys(fit.test for fit in result.channels))
    free = list(result.free)
    size = {name: 1.0 if e.relative is None else e.relative.size for name, e in result.parameters.items()}
    sizes = np.array([size[name] for name in free])
    content = {
        **record_json(result.record),
        **fields_of(result, "converged", "message", "verdict", "judged"),
        "parameters": {name: _parameter(estimate) for name, estimate in result.parameters.items()},
        "correlation": {
            a: {b: result.correlation[i, j] for j, b in enumerate(free) if j != i} for i, a in enumerate(free)
        },
        "covariance": {"of": free, "matrix": result.covariance / np.outer(sizes, sizes)},
        "reduced_chi2": result.reduced_chi2,
        "reduced_chi2_band": chi2_band(result.degrees_of_freedom, result.noise_freedom),
        **fields_of(result, "chi2", "degrees_of_freedom"),
        "residual_rms": {test: _rms(result, test, "residual_rms") for test in tests},
        "noise": {test: _rms(result, test, "noise") for test in tests},
        "channels": {
            test: {fit.channel: _channel(fit) for fit in result.channels if fit.test == test} for test in tests
        },
        "identifiability": fields_of(
            result.identifiability, "condition_number", "weak_directions", "singular_values", "sentences"
        ),
        "other_law": _other_law(result),
        "knowledge": knowledge_json(result),
        "starts": [
            {
                "start": {n: v / size[n] for n, v in s.start.items()},
                "chi2": s.cost,
                **fields_of(s, "converged", "message", "steps", "restart"),
            }
            for s in result.starts
        ],
        "faults": [_fault(fault) for fault in result.faults],
        **fields_of(result, "rows", "points", "seconds", "notes", "warnings"),
        "units": "SI: m, Pa (gauge), K, m3/s",
    }
    return plain(content)


def json_text(content: dict[str, Any]) -> str:
    """One JSON document, indented for people, strictly without NaN."""
    return json.dumps(plain(content), indent=2, allow_nan=False) + "\n"


def fields_of(item: object, *names: str) -> dict[str, Any]:
    """{name: value} of the fields named, in that order: the one in which readers of the file find them."""
    return {name: getattr(item, name) for name in names}


def _parameter(estimate: ParameterEstimate) -> dict[str, Any]:
    estimate, relative = estimate.reported, estimate.relative
    return {
        **fields_of(estimate, "value", "unit", "std", "ci95", "at_bound", "fixed", "start"),
        "bounds": [estimate.lower, estimate.upper],
        **fields_of(
            estimate, "prior_std", "prior_because", "why_no_error_bar", "by_profile", "conditional_on", "averaged_over"
        ),
        "model_form": None if estimate.model_form is None else fields_of(estimate.model_form, *MODEL_FORM),
        "relative": relative is not None,
        "relative_to": None if relative is None else relative.to,
        "relative_because": None if relative is None else relative.why,
    }


MODEL_FORM = ("law", "value", "chi2", "std", "ci95", "undetermined")
OTHER_LAW = ("law", "own", "chi2", "own_chi2", "evidence", "preferred", "misfit", "converged", "message")


def _other_law(result: FitResult) -> dict[str, Any] | None:
    asked = result.other_law
    if asked is None:
        return None
    estimates = asked.parameters.items()
    return {
        **fields_of(asked, *OTHER_LAW),
        "parameters": {
            name: fields_of(e, "value", "unit", "std", "ci95", "at_bound", "fixed") for name, e in estimates
        },
        "sentences": model_form_sentences(result),
    }


def _fault(fault: Fault) -> dict[str, Any]:
    runs = {row.run for row in fault.rows}
    return {
        **fields_of(fault, "name", "test"),
        "run": runs.pop() if len(runs) == 1 else fault.run or None,
        **fields_of(fault, "channel", "value", "unit", "std", "p_value", "alternatives", "gap_closed"),
        "rows": [fields_of(row, "file", "line", "sigma") for row in fault.rows],
        **fields_of(fault, "masked", "sentence"),
    }


CHANNEL = ("residual_rms", "noise", "noise_source", "reduced_chi2", "autocorrelation", "effective_size")


def _channel(fit: ChannelFit) -> dict[str, Any]:
    own = {"noise_parts": parts_of(fit.noise_parts), "signal": fit.signal or None}
    return {"points": len(fit.measured), **fields_of(fit, *CHANNEL), **own}


def parts_of(parts: TwoParts | None) -> dict[str, float] | None:
    """Noise that grows with the reading: what is its own (SI), and the share of the reading."""
    return None if parts is None else fields_of(parts, "own", "share")


def _rms(result: FitResult, test: str, figure: str) -> float:
    """A test's figure over its channels (two where port pressures are read apart), weighted by their points."""
    fits = [fit for fit in result.channels if fit.test == test]
    points = np.array([len(fit.measured) for fit in fits], dtype=float)
    values = np.array([getattr(fit, figure) for fit in fits], dtype=float)
    return float(np.sqrt(np.sum(points * values**2) / np.sum(points)))


def plain(value: Any) -> Any:
    """NumPy to Python, tuples to lists, NaN and infinities to None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def rounded(value: Any) -> Any:
    """Numbers in lists to seven digits: they are for drawing."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [float(f"{item:.7g}") if isinstance(item, float) else rounded(item) for item in value]
    return value


def fit_files(result: FitResult) -> dict[str, bytes | str]:
    """{file name: content}: fit.json, model.json, report.html, and a PNG and an SVG per test and for the parameters."""
    vectors, files = drawn(fit_figures(result))
    files["fit.json"] = json_text(fit_json(result))
    files["model.json"] = json_text(model_json(result))
    known_vectors, known_files = knowledge_files(result)
    files |= known_files
    files["report.html"] = html_report(result, vectors, version("thermohyd"), known_vectors)
    return files


def knowledge_files(result: FitResult) -> tuple[dict[str, bytes], dict[str, bytes | str]]:
    """What is known of each parameter as pictures for a page, and as files: the same as PNG and SVG, the draws of a posterior."""
    vectors, files = drawn(knowledge_figures(result))
    if result.knowledge is not None and (posterior := result.knowledge.posterior) is not None and posterior.file:
        files["posterior.nc"] = posterior.file
    return vectors, files
