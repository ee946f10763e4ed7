"""Write, read and check `model.json`: everything that `simulate` needs, readable and editable by hand. No JAX.

Whoever edits the file gets one line for every mistake, which names the key at fault.
"""

import json
import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from thermohyd.effects.library import whole_library
from thermohyd.identify.bench.errors import BenchInputError, one_line, quoted, suggestion
from thermohyd.identify.bench.record import EDGE_LAWS, ActuatorData, BenchRecord, ValveData, at_first_row, misgiven_side
from thermohyd.identify.bench.test_record import DYNAMIC_TESTS, STATIC_TESTS, is_dynamic
from thermohyd.identify.fitting.parameters import IN_MOTION, heat_retention, identified_by_default, identified_in_motion
from thermohyd.identify.fitting.result import FitResult
from thermohyd.identify.fitting.sensed import gain_name, sensor_plans
from thermohyd.oil_definition import OilDefinition

from .fitted_range import QUANTITIES, ranges_of
from .learned_terms import LearnedTerm, learned_json, learned_term
from .model import Model, Ranges
from .typed_term_file import typed_json, typed_term
from .typed_terms import TypedTerm


SCHEMA = "thermohyd-model/1"
STATED = ("slot_width_stated", "stroke_stated")  # of a valve; models of earlier versions say nothing of them
OPTIONAL = ("coldest", "hottest")  # of an oil: null where nobody says
PLAIN_NUMBERS = ("1", "dimensionless")  # units of parameters and of effects name them differently


class ModelReader:
    """Reads the tables of one file."""

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
        if isinstance(value, int | float) and not isinstance(value, bool):
            with suppress(OverflowError):  # an integer of hundreds of digits
                if math.isfinite(value):
                    return float(value)
        raise self.fail(f"{key} must be a finite number in SI units, not {quoted(json.dumps(value)[:40])}")

    def model(self, content: Any) -> Model:
        if not isinstance(content, dict) or content.get("schema") != SCHEMA:
            raise self.fail(f'is not a model of this version: "schema" must be "{SCHEMA}"')
        valve = self.valve(self.table(content, "valve"))
        parameters = self.parameters(self.table(content, "parameters"), valve)
        effects = self.effects(content.get("effects", {}), parameters)
        actuator, dynamics = self.actuator(content)
        sensors = self.sensors(content.get("sensors", {}))
        free, covariance = self.covariance(content.get("covariance"), {**parameters, **effects, **dynamics, **sensors})
        learned = content.get("learned", [])
        if not isinstance(learned, list):
            raise self.fail('"learned" must be a list of terms; leave it empty for a model of physics only')
        terms = tuple(learned_term(entry, i, self.fail, self.number) for i, entry in enumerate(learned, start=1))
        typed = content.get("terms", [])
        if not isinstance(typed, list):
            raise self.fail('"terms" must be a list of typed terms; leave it out for a model of physics only')
        terms += tuple(typed_term(entry, i, free, self.fail, self.number) for i, entry in enumerate(typed, start=1))
        return Model(
            valve,
            self.oil(self.table(content, "oil")),
            parameters,
            free,
            covariance,
            effects,
            terms,
            actuator,
            dynamics,
            self.fitted(content.get("fitted_range", {})),
            sensors,
        )

    def sensors(self, table: Any) -> dict[str, float]:
        """Gains and zeros of sensors; a model of stated ones has none."""
        if not isinstance(table, dict):
            raise self.fail('"sensors" must be a table; leave it out where every gain is stated')
        found = {}
        for name, entry in table.items():
            if not ("_gain" in name or "_zero" in name):
                raise self.fail(f'"sensors" {quoted(name)} must be the name of a gain or a zero, such as "flow_gain"')
            value = entry.get("value") if isinstance(entry, dict) else entry
            found[name] = self.number(value, f'"sensors" "{name}"')
            if name.endswith("_gain") and found[name] == 0.0:
                raise self.fail(f'"sensors" "{name}" must not be zero')
        return found

    def fitted(self, table: Any) -> Ranges:
        """The conditions that were fitted; a model of an earlier version, or one written by hand, may have none."""
        if not isinstance(table, dict):
            raise self.fail('"fitted_range" must be a table of tests; leave it out where nothing was fitted')
        self.refuse_unknown(
            {n: r for n, r in table.items() if not is_dynamic(n)}, [*STATIC_TESTS, *DYNAMIC_TESTS], "fitted_range"
        )
        found: Ranges = {}
        for test, ranges in table.items():
            where = f'"fitted_range" "{test}"'
            if not isinstance(ranges, dict):
                raise self.fail(f"{where} must be a table of quantities, each with its least and greatest value")
            self.refuse_unknown(ranges, list(QUANTITIES), f"fitted_range {test}")
            found[test] = {}
            for name, ends in ranges.items():
                if not isinstance(ends, list) or len(ends) != 2:
                    raise self.fail(f'{where} "{name}" must be a list of its least and greatest value')
                low, high = (self.number(end, f'{where} "{name}"') for end in ends)
                if low > high:
                    raise self.fail(f'{where} "{name}" must have its least value first')
                found[test][name] = low, high
        return found

    def actuator(self, content: dict[str, Any]) -> tuple[ActuatorData | None, dict[str, float]]:
        """The jack and the parameters of motion; neither in a model of static tests."""
        if content.get("actuator") is None:
            return None, {}
        table = self.table(content, "actuator")
        known = [field.name for field in fields(ActuatorData)]
        self.refuse_unknown(table, known, "actuator")
        if table.get("heat", "adiabatic") not in ("adiabatic", "isothermal"):
            raise self.fail('"actuator" "heat" must be "adiabatic" or "isothermal"')
        numbers = {
            key: self.number(table[key], f'"actuator" "{key}"')
            for key in known
            if key != "heat" and table.get(key) is not None
        }
        for key, value in numbers.items():
            free_of_zero = key not in ("viscous_friction", "coulomb_friction", "jack_leakage", "external_force")
            if (free_of_zero and value <= 0.0) or (key != "external_force" and value < 0.0):
                raise self.fail(f'"actuator" "{key}" must be {"positive" if free_of_zero else "zero or more"}')
        if ("amplifier_gain" in numbers) != ("sensor_gain" in numbers):
            raise self.fail('"actuator" needs both "amplifier_gain" and "sensor_gain", or neither')
        if wrong := misgiven_side(numbers):
            raise self.fail(f'"actuator" "{wrong[0]}" {wrong[1]}')
        jack = ActuatorData(**numbers, heat=str(table.get("heat", "adiabatic")))
        given = content.get("dynamics", {})
        if not isinstance(given, dict):
            raise self.fail('"dynamics" must be a table of the parameters of motion')
        infos = identified_in_motion(jack)
        self.refuse_unknown(given, list(infos), "dynamics")
        values = {name: self.amount(given[name], infos[name].unit, f'"dynamics" "{name}"') for name in given}
        for name, value in values.items():
            if value < 0.0 or (value == 0.0 and name != "viscous_friction"):
                raise self.fail(
                    f'"dynamics" "{name}" must be {"zero or more" if name == "viscous_friction" else "positive"}'
                )
        return jack, {name: info.nominal for name, info in infos.items()} | values

    def amount(self, entry: Any, unit: str, where: str) -> float:
        """A plain number in SI, or a table with one in "value", whose "unit" must then be the SI one."""
        if not isinstance(entry, dict):
            return self.number(entry, where)
        said = entry.get("unit", unit)
        if said != unit and not (said in PLAIN_NUMBERS and unit in PLAIN_NUMBERS):
            raise self.fail(f"{where} is in {quoted(said)}; a model.json is in SI units, here {unit}")
        return self.number(entry.get("value"), where)

    def effects(self, table: Any, parameters: dict[str, float]) -> dict[str, float]:
        if not isinstance(table, dict):
            raise self.fail('"effects" must be a table; leave it empty for the ideal valve')
        if not table:
            return {}
        library = whole_library()
        amounts: dict[str, float] = {}
        for name, entry in table.items():
            if name not in library:
                raise self.fail(
                    f'"effects" has no {quoted(name)}; {suggestion(name, library)}; an effect of your own must be registered '
                    "before its model is read (thermohyd.register_effect)"
                )
            info, where = library[name], f'"effects" "{name}"'
            amounts[name] = self.amount(entry, info.unit, where)
            if not info.lower <= amounts[name] <= info.upper:
                limits = f"{info.lower:g} to {info.upper:g} {info.unit}"
                raise self.fail(f"{where} is {amounts[name]:g} {info.unit}, expected {limits}")
        adding = [name for name in amounts if library[name].adds_to == "heat_retention"]
        kept = sum(amounts[name] for name in adding) + parameters.get("heat_retention", 0.0)
        if adding and kept > 1.0:
            names = ", ".join(f'"{name}"' for name in adding)
            raise self.fail(f'"effects" {names} and "heat_retention" add up to {kept:g}, more than all the heat')
        return amounts

    def valve(self, table: dict[str, Any]) -> ValveData:
        known = [field.name for field in fields(ValveData)]
        self.refuse_unknown(table, known, "valve")
        numbers = {
            key: None if table.get(key) is None else self.number(table[key], f'"valve" "{key}"')
            for key in known
            if key not in ("name", "polarity", "edge_law", *STATED)
        }
        for key in ("stroke", "slot_width"):
            if not numbers[key] or numbers[key] <= 0.0:  # pyright: ignore[reportOptionalOperand]
                raise self.fail(f'"valve" "{key}" must be a positive length in m')
        law = table.get("edge_law", EDGE_LAWS[0])  # files of earlier versions have none
        if law not in EDGE_LAWS:
            raise self.fail(f'"valve" "edge_law" must be {" or ".join(json.dumps(word) for word in EDGE_LAWS)}')
        stated = {key: table.get(key) is not False for key in STATED}
        polarity = -1 if table.get("polarity") == -1 else 1
        name = one_line(str(table.get("name", "")))
        return ValveData(name=name, polarity=polarity, edge_law=law, **stated, **numbers)  # pyright: ignore[reportArgumentType]

    def oil(self, table: dict[str, Any]) -> OilDefinition:
        known = [field.name for field in fields(OilDefinition)]
        self.refuse_unknown(table, known, "oil")
        words = {key: one_line(str(table[key])) for key in ("name", "source") if key in table}
        numbers = {
            key: self.number(table[key], f'"oil" "{key}"')
            for key in known
            if key in table and key not in ("name", "source") and not (key in OPTIONAL and table[key] is None)
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
            value = self.amount(table[name], info.unit, f'"parameters" "{name}"')
            if not info.lower <= value <= info.upper:
                raise self.fail(
                    f'"parameters" "{name}" is {value:g} {info.unit}, expected {info.lower:g} to {info.upper:g} {info.unit}'
                )
            values[name] = value
        return values

    def covariance(self, table: Any, known: dict[str, float]) -> tuple[tuple[str, ...], np.ndarray | None]:
        if table is None:
            return (), None
        names = table.get("of") if isinstance(table, dict) else None
        if (
            not isinstance(names, list)
            or any(not isinstance(n, str) or n not in known for n in names)
            or len(set(names)) < len(names)
        ):
            raise self.fail('"covariance" "of" must list names of "parameters" and "effects", each once')
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


def model_of_fit(result: FitResult, learned: Iterable[LearnedTerm | TypedTerm] = ()) -> Model:
    """The model that a fit found; what it fitted beside the valve's own parameters are effects."""
    own, actuator = _parameter_names(result), result.record.actuator
    behind = sensor_plans(result.record.tests, result.record)
    moving = () if actuator is None else IN_MOTION
    values = {name: estimate.value for name, estimate in result.parameters.items()}
    loop = result.record.sensors.get("piston_position")
    if actuator is not None and loop is not None and loop.in_loop and gain_name(loop) in values:
        actuator = replace(actuator, sensor_gain=1.0 / values[gain_name(loop)])
    return Model(
        at_first_row(result.record.valve, result.record.tests),
        result.record.oil,
        {name: value for name, value in values.items() if name in own},
        result.free,
        result.covariance,
        {name: value for name, value in values.items() if name not in own and name not in (*moving, *behind)},
        tuple(learned),
        actuator,
        {name: values[name] for name in moving if name in values},
        ranges_of(result.record.tests),
        {name: values[name] for name in behind if name in values},
    )


def nominal_model(record: BenchRecord) -> Model:
    """The model that a record describes before any fit: nominal values, or those of its `[start]`."""
    values = {info.name: info.nominal for info in identified_by_default(record.valve).values()}
    values |= {name: start.value for name, start in record.start.items() if name not in IN_MOTION}
    if record.actuator is None:
        return Model(record.valve, record.oil, values)
    moving = {info.name: info.nominal for info in identified_in_motion(record.actuator).values()}
    moving |= {name: start.value for name, start in record.start.items() if name in IN_MOTION}
    return Model(record.valve, record.oil, values, actuator=record.actuator, dynamics=moving)


def model_json(result: FitResult, learned: Iterable[LearnedTerm | TypedTerm] = ()) -> dict[str, Any]:
    """The content of `model.json` for a fit, of a plain valve or with effects, and for terms learned beside it."""
    entries = {
        name: {"value": estimate.value, "unit": estimate.unit, "std": estimate.std}
        for name, estimate in result.parameters.items()
    }
    about = {"record": result.record.name, "converged": result.converged}
    return _content(model_of_fit(result, learned), entries, about)


def _content(model: Model, entries: dict[str, dict[str, Any]], about: dict[str, Any]) -> dict[str, Any]:
    """entries: {parameter or effect: its value, unit and standard deviation}. about: what else the file says first."""
    content = {
        "schema": SCHEMA,
        "units": "SI: m, Pa (gauge), K, m3/s, A, kg/m3, J/(kg K)",
        **about,
        "valve": asdict(model.valve),
        "oil": asdict(model.oil),
        "parameters": {name: entries[name] for name in model.parameters},
        "covariance": None
        if model.covariance is None
        else {"of": list(model.free), "matrix": np.asarray(model.covariance).tolist()},
        "effects": {name: entries[name] for name in model.effects},
    }
    if model.sensors:
        content["sensors"] = {name: entries[name] for name in model.sensors}
    if model.actuator is not None:
        content["actuator"] = model.actuator.to_dict()
        content["dynamics"] = {name: entries[name] for name in model.dynamics}
    if model.fitted:
        content["fitted_range"] = {
            test: {name: list(ends) for name, ends in ranges.items()} for test, ranges in model.fitted.items()
        }
    smooth = [term for term in model.learned if isinstance(term, LearnedTerm)]
    typed = [term for term in model.learned if isinstance(term, TypedTerm)]
    if smooth:
        content["learned"] = [learned_json(term) for term in smooth]
    if typed:
        content["terms"] = [typed_json(term) for term in typed]
    return content


def save_model(model: Model, path: Path | str) -> Path:
    """Write a model as a `model.json` that `load_model` and the commands read: whole, or not at all. Returns the path.

    Standard deviations in it are those of the model's covariance. Raises OSError.
    """
    from thermohyd.identify.report.files import write_all

    path = Path(path)
    spread = {} if model.covariance is None else dict(zip(model.free, np.sqrt(np.diag(model.covariance)), strict=True))
    units = _units(model)
    values = {**model.parameters, **model.effects, **model.dynamics}
    entries = {n: {"value": v, "unit": units[n], "std": spread.get(n)} for n, v in values.items()}
    entries |= {n: {"value": v, "std": spread.get(n)} for n, v in model.sensors.items()}
    content = json.dumps(_content(model, entries, {}), indent=2, allow_nan=False) + "\n"
    write_all(path.parent, {path.name: content})
    return path


def _units(model: Model) -> dict[str, str]:
    """{parameter or effect of the model: its SI unit}"""
    infos = [*identified_by_default(model.valve).values(), heat_retention()]
    infos += [] if model.actuator is None else identified_in_motion(model.actuator).values()
    units = {info.name: info.unit for info in infos}
    if model.effects:
        from thermohyd.effects.library import effect_info

        units |= {name: effect_info(name).unit for name in model.effects}
    return units


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
