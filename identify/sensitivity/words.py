"""The sentences and tables of a sensitivity study in bench units, shared by terminal and page."""

import math

import numpy as np

from thermohyd.actuator import Actuator
from thermohyd.identify.bench.shown_units import BAR, CELSIUS, KINDS, figure_unit, significant

from .drift import CAUSES
from .factors import Factor
from .next_test import TestChoice
from .result import SensitivityResult


def with_unit(value: float, si_unit: str, digits: int = 4) -> str:
    unit = figure_unit(si_unit)
    return f"{significant(value * unit.factor, digits)} {unit.label}".rstrip()


def factor_value(factor: Factor) -> str:
    """ "15.00 um", "40.0 degC", "table"."""
    if factor.name == "temperature":
        return f"{factor.value - CELSIUS:.1f} degC"
    if factor.name in ("viscosity", "density"):
        return "table" if factor.value == 1.0 else f"{significant(factor.value)} x table"
    return with_unit(factor.value, factor.unit)


def factor_tolerance(factor: Factor) -> str:
    """ "+/- 3 um"; "0 to 1" where the interval is cut at a limit."""
    unit = figure_unit(factor.unit)
    if not math.isclose(factor.high - factor.value, factor.value - factor.low) and factor.name != "temperature":
        low, high = (f"{value * unit.factor:.4g}" for value in (factor.low, factor.high))
        return f"{low} to {high} {unit.label}".rstrip()
    if factor.relative or factor.name in ("viscosity", "density"):
        return f"+/- {100 * factor.tolerance / abs(factor.value):.3g} %"
    return f"+/- {factor.tolerance * unit.factor:.3g} {unit.label}".rstrip()


SHORT = {
    "null_leakage": "leak null",
    "open_leakage": "leak open",
    "null_pressure_gain": "K_PX null",
    "zero_load_pressure": "p_L at 0",
    "null_flow_gain": "K_QX null",
    "half_flow_gain": "K_QX half",
    "full_flow": "full flow",
}
# Figures whose drift is shown; the time constant has that of the loop gain turned round, the load error the static error's.
OF_DRIFT = {
    "null_leakage": "leak null",
    "open_leakage": "leak open",
    "null_flow_gain": "K_QX null",
    "null_pressure_gain": "K_PX null",
    "null_flow_pressure_gain": "K_QP null",
    "full_flow": "full flow",
    "natural_frequency": "omega_h",
    "damping_ratio": "xi_h",
    "loop_gain": "loop gain",
    "stability_ratio": "stability ratio",
    "static_error": "static error",
    "null_consumption": "null power",
}
TEST_WORDS = {"leakage": "leakage", "pressure_gain": "pressure gain", "flow_gain": "flow gain"}
NEGLIGIBLE = 0.005  # a total index below is left out of tables


def conditions_in_words(result: SensitivityResult) -> str:
    s = result.subject
    back = f", return {KINDS['pressure'].words(s.return_pressure, 3)}" if s.return_pressure else ""
    return f"{s.temperature - CELSIUS:.0f} degC, supply {s.supply_pressure * BAR:.0f} bar{back}"


def answer_sentences(result: SensitivityResult) -> list[str]:
    """Which parameter matters, and what temperature alone does."""
    order = result.ranking()
    shares = [
        f"{result.factors[i].name} ({100 * result.weight(i):.0f} %)" for i in order if result.weight(i) >= NEGLIGIBLE
    ]
    said = [
        f"{shares[0]} moves the static figures most over its tolerance"
        + (f", then {', '.join(shares[1:3])}." if shares[1:] else ".")
    ]
    drifts = {}
    for name, drift in result.drifts.items():
        at = int(np.argmin(np.abs(drift.temperature - result.subject.temperature)))
        if name in OF_DRIFT and math.isfinite(drift.relative[at]):
            drifts[OF_DRIFT[name]] = float(drift.relative[at])
    if drifts:
        name = max(drifts, key=lambda key: abs(drifts[key]))
        said.append(
            f"With temperature {name} drifts most: {100 * drifts[name]:+.2g} %/K at {conditions_in_words(result)}."
        )
    return said


# ">" before a heading: its figures stand to the right.
RANKING_COLUMNS = (">", "factor", ">value", "tolerance", ">mean", *(f">{name}" for name in SHORT.values()))


def ranking_rows(result: SensitivityResult) -> list[list[str]]:
    """The cells of RANKING_COLUMNS: a factor's place, then its mean total index and that of each figure in %, with its sign."""
    sobol, mean = result.tolerances.sobol, result.tolerances.derivative.mean_slope
    rows = []
    for place, i in enumerate(result.ranking(), start=1):
        factor = result.factors[i]
        cells = []
        for name in SHORT:
            o = sobol.outputs.index(name)
            share = sobol.total[o, i]
            sign = "-" if mean[o, i] < 0.0 else "+"
            cells.append(f"{sign}{100 * share:.0f}" if share >= NEGLIGIBLE else "")
        rows.append(
            [
                str(place),
                factor.name,
                factor_value(factor),
                factor_tolerance(factor),
                f"{100 * result.weight(i):.0f}",
                *cells,
            ]
        )
    return rows


def spread_row(result: SensitivityResult) -> list[str]:
    """The standard deviation of each figure of SHORT over the tolerances, in % of its value, or in its unit."""
    sobol = result.tolerances.sobol
    cells = []
    for name in SHORT:
        o = sobol.outputs.index(name)
        std, value = np.sqrt(sobol.variance[o]), result.nominal[o]
        cells.append(
            f"{100 * std / abs(value):.2g} %" if abs(value) > std else with_unit(std, result.outputs[o].unit, 2)
        )
    return cells


def largest_interval(result: SensitivityResult) -> float:
    """The half width of the widest 95 % interval of a total index, in %."""
    return 100.0 * float(result.tolerances.sobol.total_ci.max())


def drift_rows(result: SensitivityResult) -> list[list[str]]:
    """Figure, value, unit, %/K, then the share of each cause in %, at the study's temperature."""
    rows = []
    for name in OF_DRIFT:
        drift = result.drifts.get(name)
        if drift is None:
            continue
        at = int(np.argmin(np.abs(drift.temperature - result.subject.temperature)))
        unit = figure_unit(drift.unit)
        value, relative = drift.value[at], 100.0 * drift.relative[at]
        # Of a figure that does not drift, shares would be rounding.
        parts = 100.0 * drift.parts[:, at] / drift.value[at]
        shares = [f"{part:+.3f}" if abs(part) >= 5e-4 else "0" for part in parts]
        rows.append(
            [
                OF_DRIFT[name],
                significant(value * unit.factor, 4),
                unit.label,
                f"{relative:+.3f}" if abs(relative) >= 5e-4 else "0",
                *shares,
            ]
        )
    return rows


DRIFT_COLUMNS = ("figure", ">value", "unit", ">%/K", *(f">{cause}" for cause in CAUSES))


def actuator_sentence(a: Actuator | None) -> str:
    """Whose performance it is."""
    if a is None:
        return "No actuator with a controller is stated: describe yours in [actuator] of --settings to see its figures drift."
    area, volume = (
        " and ".join(f"{side:g}" for side in np.ravel(values)) for values in (a.areas * 1e4, a.volumes * 1e6)
    )
    gains = f"loop {float(a.amplifier_gain):g} A/V and {float(a.sensor_gain):g} V/m"
    said = f"Actuator: piston {area} cm2, chambers {volume} cm3, mass {float(a.moving_mass):g} kg, {gains}."
    if a.symmetric:
        return said
    return f"{said} With unequal sides there is no formula for omega_h, xi_h and its loop: thermohyd servo has the margins."


def test_in_words(choice: TestChoice) -> str:
    t, p = choice.temperature - CELSIUS, choice.supply_pressure * BAR
    return f"{TEST_WORDS[choice.test]} at {round(t)} degC and {p:.0f} bar"


def next_test_sentences(result: SensitivityResult) -> list[str]:
    """What to measure next, and what it brings."""
    study = result.information
    best = study.tests[0]
    gains = sorted(best.std, key=lambda name: best.std[name] / study.known[name])
    factors = {f.name: f for f in result.factors}
    parts = [
        f"{name} {with_unit(study.known[name], factors[name].unit, 2)} -> {with_unit(best.std[name], factors[name].unit, 2)}"
        for name in gains[:3]
    ]
    sentences = [
        f"Best next sweep (D-optimal, given {study.source}): {test_in_words(best)}. Standard deviations: {'; '.join(parts)}."
    ]
    others = [test_in_words(choice) for choice in study.tests[1:3]]
    if others:
        sentences.append(f"Then: {'; '.join(others)}.")
    return sentences


def information_sentences(result: SensitivityResult) -> list[str]:
    """Per parameter: which test carries most of what is known of it, and where."""
    study, stroke = result.information, result.subject.model.valve.stroke
    m = study.measurements
    if not np.all(np.isfinite(study.share)):
        return [f"{study.of}: they do not determine all the parameters, so no share can be given."]
    found = []
    for i, name in enumerate(m.parameters):
        by_test = {test: float(study.share[m.test == test, i].sum()) for test in dict.fromkeys(m.test.tolist())}
        test = max(by_test, key=lambda key: by_test[key])
        rows = m.test == test
        weight = study.share[rows, i]
        place = np.abs(m.position[rows]) / stroke
        order = np.argsort(place)
        middle = 100.0 * float(place[order][np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())])
        found.append(
            f"{name}: {100 * by_test[test]:.0f} % from {TEST_WORDS[test]}, half of that within {middle:.2g} % of stroke"
        )
    return found


def posterior_sentences(result: SensitivityResult) -> list[str]:
    """What the fit's uncertainty does to the figures."""
    study = result.posterior
    if study is None:
        return []
    found = []
    for name in SHORT:
        o = study.sobol.outputs.index(name)
        output, std = result.outputs[o], study.std[o]
        if not std > 0.0:
            continue
        blame = int(np.argmax(study.sobol.total[o]))
        share = f"{100 * study.sobol.total[o, blame]:.0f} % of it from {study.sobol.inputs[blame]}"
        value = result.nominal[o]
        relative = f" ({100 * std / abs(value):.2g} %)" if abs(value) > std else ""
        found.append(f"{name}: +/- {with_unit(std, output.unit, 2)}{relative}, {share}")
    return found
