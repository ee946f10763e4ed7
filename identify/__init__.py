"""Bench records, their fits and diagnoses, predictions and studies: what a user imports from here is the public face.

    from thermohyd import identify

    record = identify.read_record("my_valve")  # or BenchRecord.from_arrays, BenchRecord.from_dataframe
    result = identify.fit(record)
    print(result.summary())

The names below are loaded on first use (PEP 562): importing this package brings neither JAX nor pandas. Modules beneath it
are private and may move.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any


if TYPE_CHECKING:
    from .bench.errors import BenchInputError
    from .bench.read import read_record
    from .bench.record import ActuatorData, BenchRecord, StartValue, ValveData
    from .checking.check import check
    from .checking.result import CheckResult
    from .comparison.result import ComparisonResult
    from .comparison.study import compare
    from .diagnosis.case import Case, choose, open_case
    from .diagnosis.conclusion import conclude
    from .diagnosis.diagnose import diagnose
    from .diagnosis.final_model import final_model
    from .diagnosis.result import DiagnosisResult, NamedEffect
    from .fitting.fit import fit
    from .fitting.result import FitResult, ParameterEstimate
    from .fleet.life import fleet_life
    from .fleet.query import query as fleet_query
    from .fleet.store import Store as FleetStore
    from .flow_curve_fit import FlowCurveFit, fit_flow_curve, flow_curve_formulas, flow_curve_json
    from .heat_study import EtaIdentifiability, eta_identifiability, heat_study_figure, identifiability_figure
    from .model.model import Model
    from .model.model_file import load_model, nominal_model, save_model
    from .model.predict import Simulation
    from .planning.result import PlanResult
    from .planning.study import plan
    from .result import Result
    from .seed.study import SeedStudy, seed_study
    from .sensitivity.result import SensitivityResult
    from .sensitivity.settings import Settings as StudySettings, read_settings as read_study_settings
    from .servo.performance_figures import bode_figure, performance_figure
    from .servo.study import ServoStudy
    from .studies import predict, sensitivity_study, servo_study
    from .uncertainty.diagnosed import diagnose_in_depth
    from .uncertainty.posterior import Sampling
    from .uncertainty.result import Knowledge, KnownParameter
    from .uncertainty.study import fit_in_depth
    from .users_effects import load_effects

# module: the public names that it defines; "name as public name" where the two differ
_HOME = {
    "bench.errors": ("BenchInputError",),
    "bench.read": ("read_record",),
    "bench.record": ("ActuatorData", "BenchRecord", "StartValue", "ValveData"),
    "checking.check": ("check",),
    "checking.result": ("CheckResult",),
    "comparison.result": ("ComparisonResult",),
    "comparison.study": ("compare",),
    "diagnosis.case": ("Case", "choose", "open_case"),
    "diagnosis.conclusion": ("conclude",),
    "diagnosis.diagnose": ("diagnose",),
    "diagnosis.final_model": ("final_model",),
    "diagnosis.result": ("DiagnosisResult", "NamedEffect"),
    "fitting.fit": ("fit",),
    "fitting.result": ("FitResult", "ParameterEstimate"),
    "fleet.life": ("fleet_life",),
    "fleet.query": ("query as fleet_query",),
    "fleet.store": ("Store as FleetStore",),
    "flow_curve_fit": ("FlowCurveFit", "fit_flow_curve", "flow_curve_formulas", "flow_curve_json"),
    "heat_study": ("EtaIdentifiability", "eta_identifiability", "heat_study_figure", "identifiability_figure"),
    "model.model": ("Model",),
    "model.model_file": ("load_model", "nominal_model", "save_model"),
    "model.predict": ("Simulation",),
    "planning.result": ("PlanResult",),
    "planning.study": ("plan",),
    "result": ("Result",),
    "seed.study": ("SeedStudy", "seed_study"),
    "sensitivity.result": ("SensitivityResult",),
    "sensitivity.settings": ("Settings as StudySettings", "read_settings as read_study_settings"),
    "servo.performance_figures": ("bode_figure", "performance_figure"),
    "servo.study": ("ServoStudy",),
    "users_effects": ("load_effects",),
    "uncertainty.posterior": ("Sampling",),
    "uncertainty.result": ("Knowledge", "KnownParameter"),
    "uncertainty.diagnosed": ("diagnose_in_depth",),
    "uncertainty.study": ("fit_in_depth",),
    "studies": ("predict", "sensitivity_study", "servo_study"),
}
_PLACE = {
    entry.split(" as ")[-1]: (module, entry.split(" as ")[0]) for module, names in _HOME.items() for entry in names
}
__all__ = [*_PLACE]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name in _PLACE:
        module, own_name = _PLACE[name]
        found = getattr(import_module(f".{module}", __name__), own_name)
        globals()[name] = found
        return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_PLACE])
