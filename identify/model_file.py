"""`model.json`: everything that `simulate` needs, readable and editable by hand. Written and read here; no JAX."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from .diagnosis.variation_terms import LearnedTerm
from .errors import BenchInputError
from .fit_result import FitResult
from .fitted_range import ranges_of
from .learned_terms import learned_json
from .model import Model
from .model_reader import SCHEMA, ModelReader
from .parameters import IN_MOTION, heat_retention, identified_by_default, identified_in_motion
from .record import BenchRecord


def model_of_fit(result: FitResult, learned: Iterable[LearnedTerm] = ()) -> Model:
    """The model that a fit found; what it fitted beside the valve's own parameters are effects."""
    own, dynamic = _parameter_names(result), result.record.dynamic
    moving = () if dynamic is None else IN_MOTION
    values = {name: estimate.value for name, estimate in result.parameters.items()}
    return Model(
        result.record.valve,
        result.record.oil,
        {name: value for name, value in values.items() if name in own},
        result.free,
        result.covariance,
        {name: value for name, value in values.items() if name not in own and name not in moving},
        tuple(learned),
        None if dynamic is None else dynamic.actuator,
        {name: values[name] for name in moving if name in values},
        ranges_of(result.record.all_tests),
    )


def nominal_model(record: BenchRecord) -> Model:
    """The model that a record describes before any fit: nominal values, or those of its `[start]`."""
    values = {info.name: info.nominal for info in identified_by_default(record.valve).values()}
    values |= {name: start.value for name, start in record.start.items() if name not in IN_MOTION}
    if record.dynamic is None:
        return Model(record.valve, record.oil, values)
    moving = {info.name: info.nominal for info in identified_in_motion(record.dynamic.actuator).values()}
    moving |= {name: start.value for name, start in record.start.items() if name in IN_MOTION}
    return Model(record.valve, record.oil, values, actuator=record.dynamic.actuator, dynamics=moving)


def model_json(result: FitResult, learned: Iterable[LearnedTerm] = ()) -> dict[str, Any]:
    """The content of `model.json` for a fit, of a plain valve or with effects, and for smooth terms learned beside it."""
    model = model_of_fit(result, learned)
    entries = {
        name: {"value": estimate.value, "unit": estimate.unit, "std": estimate.std}
        for name, estimate in result.parameters.items()
    }
    content = {
        "schema": SCHEMA,
        "units": "SI: m, Pa (gauge), K, m3/s, A, kg/m3, J/(kg K)",
        "record": result.record.name,
        "converged": result.converged,
        "valve": asdict(model.valve),
        "oil": asdict(model.oil),
        "parameters": {name: entries[name] for name in model.parameters},
        "covariance": {"of": list(model.free), "matrix": np.asarray(model.covariance).tolist()},
        "effects": {name: entries[name] for name in model.effects},
    }
    if model.actuator is not None:
        content["actuator"] = asdict(model.actuator)
        content["dynamics"] = {name: entries[name] for name in model.dynamics}
    if model.fitted:
        content["fitted_range"] = {
            test: {name: list(ends) for name, ends in ranges.items()} for test, ranges in model.fitted.items()
        }
    if model.learned:
        content["learned"] = [learned_json(term) for term in model.learned]
    return content


def _parameter_names(result: FitResult) -> set[str]:
    return {*identified_by_default(result.record.valve), heat_retention().name}


def load_model(path: Path | str) -> Model:
    """Read and check a `model.json`; raises BenchInputError with one line that says what is wrong and where."""
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BenchInputError(f"cannot be read ({error.strerror})", file=path) from None
    except UnicodeDecodeError:
        raise BenchInputError("is not UTF-8 text; expected a model.json written by thermohyd fit", file=path) from None
    except json.JSONDecodeError as error:
        raise BenchInputError(f"is not valid JSON: {error.msg}", file=path, line=error.lineno) from None
    except ValueError:
        raise BenchInputError("holds a number of thousands of digits", file=path) from None
    except RecursionError:
        raise BenchInputError("is nested too deeply to be a model.json", file=path) from None
    return ModelReader(path).model(content)
