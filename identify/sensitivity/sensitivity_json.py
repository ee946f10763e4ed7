"""`sensitivity.json`: a study as one plain dictionary, SI units."""

from dataclasses import fields
from typing import Any

import numpy as np

from ..fit_json import plain, rounded
from .drift import CAUSES
from .result import InformationStudy, PosteriorStudy, SensitivityResult
from .row_slopes import READING, TESTS


SCHEMA = "thermohyd-sensitivity/1"
BINS = 24


def sensitivity_json(result: SensitivityResult) -> dict[str, Any]:
    """The content of `sensitivity.json`; what is not finite becomes null."""
    s = result.subject
    content = {
        "schema": SCHEMA,
        "units": "SI: m, Pa (gauge), K, m3/s; gains Pa/m, m2/s, m3/(s Pa); viscosity and density in units of the oil's table",
        "name": s.name,
        "conditions": {
            "temperature": s.temperature,
            "supply_pressure": s.supply_pressure,
            "return_pressure": s.return_pressure,
            "temperatures": s.temperatures,
            "supply_pressures": s.supply_pressures,
        },
        "ranking": [{"factor": result.factors[i].name, "mean_total_index": result.weight(i)} for i in result.ranking()],
        "factors": {
            f.name: {
                "value": f.value,
                "unit": f.unit,
                "tolerance": f.tolerance,
                "interval": [f.low, f.high],
                "normalised": "relative" if f.relative else "per tolerance",
                "meaning": f.meaning,
            }
            for f in result.factors
        },
        "figures": _figures(result),
        "actuator": {field.name: float(getattr(result.actuator, field.name)) for field in fields(result.actuator)},
        "temperature": _temperature(result),
        "curves": _curves(result),
        "curve_total_indices": {
            "share_of_stroke": result.tolerances.shares,
            **{
                test: {f.name: result.tolerances.along[test][i] for i, f in enumerate(result.factors)} for test in TESTS
            },
        },
        "sobol": {
            "evaluations": result.tolerances.sobol.evaluations,
            "base_samples": result.tolerances.sobol.base,
            "derivative_samples": result.tolerances.derivative.samples,
            "inputs": "uniform over each factor's interval, independent",
            "confidence": "half widths of 95 % bootstrap intervals",
        },
        "posterior": None if result.posterior is None else _posterior(result.posterior, result),
        "information": _information(result.information, s.model.valve.stroke),
        "noise": s.noise.words(),
        "seconds": result.seconds,
        "notes": result.notes,
    }
    return rounded(plain(content))


def _figures(result: SensitivityResult) -> dict[str, Any]:
    sobol, derivative = result.tolerances.sobol, result.tolerances.derivative
    elasticity = result.elasticity()
    return {
        output.name: {
            "meaning": output.meaning,
            "value": result.nominal[o],
            "unit": output.unit,
            "mean_over_tolerances": sobol.mean[o],
            "std_over_tolerances": np.sqrt(sobol.variance[o]),
            "factors": {
                f.name: {
                    "slope": result.slope[i, o],
                    "normalised": elasticity[i, o],
                    "first_order": sobol.first[o, i],
                    "first_order_ci": sobol.first_ci[o, i],
                    "total": sobol.total[o, i],
                    "total_ci": sobol.total_ci[o, i],
                    "derivative_measure": derivative.nu[o, i],
                    "mean_slope": derivative.mean_slope[o, i],
                    "bound_of_total": derivative.bound[o, i],
                    "bound_of_total_ci": derivative.bound_ci[o, i],
                }
                for i, f in enumerate(result.factors)
            },
        }
        for o, output in enumerate(result.outputs)
    }


def _temperature(result: SensitivityResult) -> dict[str, Any]:
    return {
        name: {
            "unit": drift.unit,
            "temperature": drift.temperature,
            "value": drift.value,
            "per_kelvin": drift.slope,
            "relative_per_kelvin": drift.relative,
            "parts_per_kelvin": dict(zip(CAUSES, drift.parts, strict=True)),
        }
        for name, drift in result.drifts.items()
    }


def _curves(result: SensitivityResult) -> dict[str, Any]:
    c, at = result.curves, result.subject
    found: dict[str, Any] = {}
    for test in TESTS:
        conditions = []
        normalised = c.normalised(test)
        for temperature in at.temperatures:
            rows = c.rows_at(temperature, at.supply_pressure)
            conditions.append(
                {
                    "temperature": temperature,
                    "supply_pressure": at.supply_pressure,
                    "position": c.position[rows],
                    "value": c.value[test][rows],
                    "normalised": {f.name: normalised[i, rows] for i, f in enumerate(c.factors)},
                }
            )
        found[test] = {
            "reading": READING[test],
            "relative_to": "the reading" if test == "leakage" else "the largest reading of the curve",
            "at": conditions,
        }
    return found


def _posterior(study: PosteriorStudy, result: SensitivityResult) -> dict[str, Any]:
    p = study.posterior
    return {
        "of": [factor.name for factor in p.factors],
        "std": p.std,
        "directions": [
            {"name": name, "in_units_of_std": direction, "spread": spread}
            for name, direction, spread in zip(p.names, p.directions, p.spread, strict=True)
        ],
        "evaluations": study.sobol.evaluations,
        "figures": {
            output.name: {
                "unit": output.unit,
                "std": study.std[o],
                "linear_std": study.linear_std[o],
                "first_order": study.sobol.first[o],
                "total": study.sobol.total[o],
                "total_ci": study.sobol.total_ci[o],
            }
            for o, output in enumerate(result.outputs)
        },
    }


def _information(study: InformationStudy, stroke: float) -> dict[str, Any]:
    m = study.measurements
    edges = np.linspace(-1.0, 1.0, BINS + 1)
    place = np.sign(m.position) * np.sqrt(np.abs(m.position) / stroke)
    keys = list(zip(m.test.tolist(), m.temperature.tolist(), m.supply_pressure.tolist(), strict=True))
    tests = {}
    for test in dict.fromkeys(m.test.tolist()):
        rows = m.test == test
        binned = {
            name: np.histogram(place[rows], edges, weights=study.share[rows, i])[0]
            for i, name in enumerate(m.parameters)
        }
        tests[test] = {"share": {name: float(b.sum()) for name, b in binned.items()}, "by_position": binned}
    by_condition: dict[tuple, np.ndarray] = {}
    if len(set(keys)) <= 60:
        for key, share in zip(keys, study.share, strict=True):
            by_condition[key] = by_condition.get(key, 0.0) + share
    return {
        "of": study.of,
        "position_edges": np.sign(edges) * edges**2 * stroke,
        "tests": tests,
        "conditions": [
            {
                "test": k[0],
                "temperature": k[1],
                "supply_pressure": k[2],
                "share": dict(zip(m.parameters, v, strict=True)),
            }
            for k, v in by_condition.items()
        ],
        "known_std": study.known,
        "known_from": study.source,
        "next_tests": [
            {
                "test": choice.test,
                "temperature": choice.temperature,
                "supply_pressure": choice.supply_pressure,
                "log_det_gain": choice.gain,
                "std_after": choice.std,
            }
            for choice in study.tests
        ],
        "d_optimal_points": [
            {"test": test, "temperature": t, "supply_pressure": p, "position": x, "readings": int(n)}
            for test, t, p, x, n in zip(
                study.points.test.tolist(),
                study.points.temperature.tolist(),
                study.points.supply_pressure.tolist(),
                study.points.position.tolist(),
                study.repeats,
                strict=True,
            )
        ],
    }
