"""What a fit does with bounds, held parameters, priors, noise and records that cannot tell: in the user's terms."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from helpers.records import NOISE, STROKE, synthetic_record
from reference.static_tests import IDEAL
from reference.valve import Valve

from thermohyd.data import sample_record
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.bench.record import StartValue
from thermohyd.identify.fitting.fit import fit


NAMES = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
VALVE = Valve(12e-3, 8e-6, 2.5e-6, 6e-6, 0.68, 90.0, 1.2e-6)


def record_of(valve=VALVE, seed=4, **options):
    return synthetic_record(valve, np.random.default_rng(seed), points=31, **options)


@pytest.mark.parametrize(
    ("name", "truth"),
    [("seed_valve", (15e-6, 2e-6, 15e-6, 0.7, 100.0, 1.5e-6)), ("raw_log", (8e-6, 3e-6, 4e-6, 0.66, 80.0, 2.1e-6))],
)
def test_sample_records_give_back_their_truth(name, truth):
    result = fit(read_record(sample_record(name)))
    assert result.converged
    for parameter, true in zip(result.free, truth, strict=True):
        estimate = result.parameters[parameter]
        print(f"{name} {parameter}: {estimate.value:.4g} +- {estimate.std:.2g}, true {true:.4g}")
        assert estimate.std is not None
        assert abs(estimate.value - true) < 4 * estimate.std
        assert estimate.std < 0.2 * abs(true)


def test_a_parameter_at_its_bound_is_said_to_be_there_and_the_rest_keep_their_error_bars():
    result = fit(record_of(dataclasses.replace(VALVE, edge_radius=4e-6), edge_radius=StartValue(6e-6, lower=5e-6)))
    radius = result.parameters["edge_radius"]
    assert radius.at_bound
    assert radius.value == 5e-6
    assert radius.std is None
    assert "lower bound" in radius.why_no_error_bar
    others = [result.parameters[name] for name in result.free if name != "edge_radius"]
    assert all(other.std is not None and not other.at_bound for other in others)


def test_held_parameters_stay_and_have_no_error_bar():
    result = fit(record_of(discharge_coefficient=StartValue(0.68, fixed=True)))
    held = result.parameters["discharge_coefficient"]
    assert (held.value, held.std, held.fixed, held.why_no_error_bar) == (0.68, None, True, "held fixed")
    assert "discharge_coefficient" not in result.free


def test_a_prior_counts_as_one_more_reading():
    plain = fit(record_of()).parameters["edge_radius"]
    assert plain.std is not None
    prior = plain.value + 2 * plain.std
    tight = fit(record_of(edge_radius=StartValue(prior, prior_std=plain.std))).parameters["edge_radius"]
    assert tight.std is not None
    # Equal weights: half-way between data and prior, with the error bar smaller by sqrt 2.
    assert tight.value == pytest.approx(0.5 * (plain.value + prior), abs=0.1 * plain.std)
    assert tight.std == pytest.approx(plain.std / np.sqrt(2), rel=0.1)


def test_heat_retention_can_be_freed():
    """The truth is isothermal, at the end of eta's range; then one whose oil keeps 60 % of the heat, well inside."""
    none = fit(record_of(heat_retention=StartValue(0.3))).parameters["heat_retention"]
    assert none.ci95 is not None
    assert none.ci95[0] == 0.0
    assert none.ci95[1] < 0.3
    some = fit(record_of(effects=dataclasses.replace(IDEAL, throttle_heating=0.6), heat_retention=StartValue(0.3)))
    eta = some.parameters["heat_retention"]
    assert eta.std is not None
    assert eta.std < 0.1
    assert abs(eta.value - 0.6) < 3.5 * eta.std


def test_unknown_noise_is_taken_from_the_residuals():
    result = fit(record_of(declared=False))
    assert result.reduced_chi2 == pytest.approx(1.0, abs=0.03)
    for channel in result.channels:
        assert channel.noise_source == "taken from the fit's residuals"
        assert channel.noise == pytest.approx(NOISE[channel.test], rel=0.15)


def only(record, test, rows):
    """The record with one test, and of that the given rows."""
    whole = record.tests[test]
    channel = whole.channels[0]
    part = dataclasses.replace(channel, value=channel.value[rows], std=channel.std[rows])
    fields = ("spool_position", "supply_pressure", "return_pressure", "temperature", "run", "direction")
    cut = dataclasses.replace(whole, channels=(part,), **{name: getattr(whole, name)[rows] for name in fields})
    return dataclasses.replace(record, tests={test: cut})


def test_null_leakage_alone_says_what_it_trades_off():
    record = record_of()
    test = record.tests["leakage"]
    result = fit(only(record, "leakage", np.flatnonzero(np.abs(test.spool_position) < 8e-6)))
    words = " ".join((*result.identifiability.weak_directions, *result.identifiability.sentences))
    print(words)
    assert "trade off" in words
    assert result.identifiability.condition_number > 20


def test_rows_at_one_operating_point_leave_flat_directions_named():
    record = record_of()
    test = record.tests["leakage"]
    same = np.abs(test.spool_position) < 0.002 * STROKE
    near = np.flatnonzero(same & (test.temperature == 288.15) & (test.supply_pressure == 70e5))
    result = fit(only(record, "leakage", np.resize(near, 12)))
    blind = [e for e in result.parameters.values() if e.std is None]
    print([(e.name, e.why_no_error_bar) for e in blind], result.message)
    assert blind
    assert all(e.why_no_error_bar for e in blind)


def test_a_reversed_gauge_is_read_the_other_way_round_and_said_so():
    record = record_of()
    test = record.tests["pressure_gain"]
    turned = dataclasses.replace(test.channels[0], value=-test.channels[0].value)
    tests = record.tests | {"pressure_gain": dataclasses.replace(test, channels=(turned,))}
    result = fit(dataclasses.replace(record, tests=tests))
    assert any("load_pressure falls as the spool moves to +x" in warning for warning in result.warnings)
    assert result.parameters["underlap"].value == pytest.approx(6e-6, rel=0.05)


def test_a_wrong_oil_is_called_a_misfit():
    record = record_of()
    thick = dataclasses.replace(record.oil, viscosity_b=record.oil.viscosity_b * 0.8)
    result = fit(dataclasses.replace(record, oil=thick))
    assert result.reduced_chi2 > 2
    assert "does not explain" in result.verdict[0]


def test_refusals():
    record = record_of()
    held = {name: StartValue(getattr(VALVE, name), fixed=True) for name in NAMES}
    with pytest.raises(BenchInputError, match="holds every parameter fixed"):
        fit(dataclasses.replace(record, start=held))
    script = (
        "from thermohyd.identify.fitting.fit import fit\ntry:\n    fit(None)\nexcept RuntimeError as e:\n    print(e)"
    )
    said = subprocess.run([sys.executable, "-P", "-c", script], capture_output=True, text=True, check=True).stdout
    assert said.startswith("fit needs double precision")
