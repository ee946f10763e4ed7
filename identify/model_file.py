"""`model.json`: everything that `simulate` needs, readable and editable by hand. Written and checked here; no JAX."""

import json
import math
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ..oil_definition import OilDefinition
from .errors import BenchInputError
from .fit_result import FitResult
from .parameters import heat_retention, identified_by_default
from .record import BenchRecord, ValveData


SCHEMA = "thermohyd-model/1"


@dataclass(frozen=True)
class Model:
    """A fitted (or nominal) valve as plain numbers, SI. `covariance` is over `free`, in that order."""

    valve: ValveData
    oil: OilDefinition
    parameters: dict[str, float]
    free: tuple[str, ...] = ()
    covariance: np.ndarray | None = None


def model_of_fit(result: FitResult) -> Model:
    """The model that a fit found."""
    values = {name: estimate.value for name, estimate in result.parameters.items()}
    return Model(result.record.valve, result.record.oil, values, result.free, result.covariance)


def nominal_model(record: BenchRecord) -> Model:
    """The model that a record describes before any fit: nominal values, or those of its `[start]`."""
    values = {info.name: info.nominal for info in identified_by_default(record.valve).values()}
    values |= {name: start.value for name, start in record.start.items()}
    return Model(record.valve, record.oil, values)


def model_json(result: FitResult) -> dict[str, Any]:
    """The content of `model.json` for a fit."""
    model = model_of_fit(result)
    parameters: dict[str, Any] = {}
    for name, estimate in result.parameters.items():
        parameters[name] = {"value": estimate.value, "unit": estimate.unit, "std": estimate.std}
    return {
        "schema": SCHEMA,
        "units": "SI: m, Pa (gauge), K, m3/s, A, kg/m3, J/(kg K)",
        "record": result.record.name,
        "converged": result.converged,
        "valve": asdict(model.valve),
        "oil": asdict(model.oil),
        "parameters": parameters,
        "covariance": {"of": list(model.free), "matrix": np.asarray(model.covariance).tolist()},
        "effects": {},
    }


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
    except RecursionError:
        raise BenchInputError("is nested too deeply to be a model.json", file=path) from None
    return _Reader(path).model(content)


class _Reader:
    """Checks a decoded `model.json` key by key, so that every message names the key at fault."""

    def __init__(self, path: Path):
        self.path = path

    def fail(self, message: str) -> BenchInputError:
        return BenchInputError(message, file=self.path)

    def table(self, content: Any, key: str) -> dict[str, Any]:
        found = content.get(key)
        if not isinstance(found, dict):
            raise self.fail(f'"{key}" is missing or not a table; thermohyd fit writes one')
        return found

    def number(self, value: Any, key: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self.fail(f"{key} must be a finite number in SI units, not {json.dumps(value)[:40]}")
        return float(value)

    def model(self, content: Any) -> Model:
        if not isinstance(content, dict) or content.get("schema") != SCHEMA:
            raise self.fail(f'is not a model of this version: "schema" must be "{SCHEMA}"')
        effects = content.get("effects", {})
        if not isinstance(effects, dict):
            raise self.fail('"effects" must be a table; leave it empty for the ideal valve')
        if effects:
            raise self.fail(f'"effects" holds {", ".join(effects)}, which this version cannot simulate')
        valve = self.valve(self.table(content, "valve"))
        parameters = self.parameters(self.table(content, "parameters"), valve)
        free, covariance = self.covariance(content.get("covariance"), parameters)
        return Model(valve, self.oil(self.table(content, "oil")), parameters, free, covariance)

    def valve(self, table: dict[str, Any]) -> ValveData:
        known = [field.name for field in fields(ValveData)]
        self.refuse_unknown(table, known, "valve")
        numbers = {
            key: None if table.get(key) is None else self.number(table[key], f'"valve" "{key}"')
            for key in known
            if key not in ("name", "polarity")
        }
        for key in ("stroke", "slot_width"):
            if not numbers[key] or numbers[key] <= 0.0:  # pyright: ignore[reportOptionalOperand]
                raise self.fail(f'"valve" "{key}" must be a positive length in m')
        return ValveData(name=str(table.get("name", "")), polarity=-1 if table.get("polarity") == -1 else 1, **numbers)  # pyright: ignore[reportArgumentType]

    def oil(self, table: dict[str, Any]) -> OilDefinition:
        known = [field.name for field in fields(OilDefinition)]
        self.refuse_unknown(table, known, "oil")
        words = {key: str(table[key]) for key in ("name", "source") if key in table}
        numbers = {
            key: self.number(table[key], f'"oil" "{key}"')
            for key in known
            if key in table and key not in ("name", "source")
        }
        for key in ("viscosity_a", "viscosity_b"):
            if key not in numbers:
                raise self.fail(f'"oil" has no "{key}"')
        for key in ("viscosity_b", "density", "bulk_modulus", "specific_heat"):
            if numbers.get(key, 1.0) <= 0.0:
                raise self.fail(f'"oil" "{key}" must be positive')
        return OilDefinition(**numbers, **words)  # pyright: ignore[reportArgumentType]

    def parameters(self, table: dict[str, Any], valve: ValveData) -> dict[str, float]:
        infos = {**identified_by_default(valve), "heat_retention": heat_retention()}
        self.refuse_unknown(table, list(infos), "parameters")
        values: dict[str, float] = {}
        for name, info in infos.items():
            if name not in table:
                if name == "heat_retention":
                    continue
                raise self.fail(f'"parameters" has no "{name}"')
            entry = table[name]
            value = self.number(entry.get("value") if isinstance(entry, dict) else entry, f'"parameters" "{name}"')
            if not info.lower <= value <= info.upper:
                raise self.fail(
                    f'"parameters" "{name}" is {value:g} {info.unit}, expected {info.lower:g} to {info.upper:g} {info.unit}'
                )
            values[name] = value
        return values

    def covariance(self, table: Any, parameters: dict[str, float]) -> tuple[tuple[str, ...], np.ndarray | None]:
        if table is None:
            return (), None
        names = table.get("of") if isinstance(table, dict) else None
        if not isinstance(names, list) or any(not isinstance(n, str) or n not in parameters for n in names):
            raise self.fail('"covariance" "of" must list names of "parameters"')
        try:
            matrix = np.asarray(table.get("matrix"), dtype=float).reshape(len(names), len(names))
        except (TypeError, ValueError):
            raise self.fail(f'"covariance" "matrix" must be {len(names)} rows of {len(names)} numbers') from None
        if not np.all(np.isfinite(matrix)) or np.any(np.diag(matrix) < 0.0):
            raise self.fail('"covariance" "matrix" must be finite with a diagonal that is not negative')
        return tuple(names), matrix

    def refuse_unknown(self, table: dict[str, Any], known: list[str], where: str) -> None:
        for key in table:
            if key not in known:
                raise self.fail(f'"{where}" has the unknown key "{key}"; known are {", ".join(known)}')
