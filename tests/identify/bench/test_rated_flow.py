"""A valve given by its rated flow at a rated drop: the slots that pass it, and what stands in for a stroke that nobody states."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.bench_folder import TOML, write_record

from thermohyd.conditions import Conditions
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting.parameters import plan_parameters
from thermohyd.identify.fitting.relative import effect_plans, with_relatives
from thermohyd.identify.fitting.static_readings import base_valve
from thermohyd.identify.model.model_file import load_model, nominal_model, save_model
from thermohyd.static_tests import control_flow


RATED = 'rated_flow = "40 l/min"\nrated_pressure_drop = "10 bar"\n'


def read(folder, toml: str):
    return read_record(write_record(folder, toml))


def rated(stroke: str = 'stroke = "200 um"\n') -> str:
    return TOML.replace('stroke = "200 um"\n', stroke).replace('slot_width = "12 mm"\n', RATED)


def test_the_valve_passes_its_rated_flow(tmp_path):
    """Through the simulator's own connected ports: half the drop on either edge, sharp edges, 40 degC."""
    record = read(tmp_path, rated())
    assert not record.valve.slot_width_stated
    values = {"edge_radius": 0.0, "clearance": 1e-8, "underlap": 0.0, "null_bias": 0.0}
    valve = base_valve(record, {**values, "discharge_coefficient": 0.7, "transition_number": 100.0})
    one = lambda value: jnp.asarray([value])
    flow = jax.jit(control_flow)(valve, Conditions(one(200e-6), one(10e5), one(0.0), one(313.15)))
    np.testing.assert_allclose(flow, 40.0 / 6e4, rtol=2e-3)


def test_slots_that_are_stated_go_first(tmp_path):
    record = read(tmp_path, TOML.replace('slot_width = "12 mm"\n', 'slot_width = "12 mm"\n' + RATED))
    assert record.valve.slot_width == pytest.approx(12e-3)
    assert record.valve.slot_width_stated
    assert any("rated_flow" in warning for warning in record.warnings)


def test_without_a_stroke_lengths_are_relative(tmp_path):
    record = read(tmp_path, rated(stroke=""))
    assert not record.valve.stroke_stated
    plans = with_relatives(plan_parameters(record.valve, {}), record.tests, record)
    assert {n for n, plan in plans.items() if plan.relative} == {"edge_radius", "clearance", "underlap", "null_bias"}
    relative = plans["underlap"].relative
    assert relative is not None
    assert (relative.to, relative.unit) == ("stroke", "stroke")
    lengths = {
        n for n, plan in effect_plans(("hysteresis", "eccentricity", "land_leakage"), record).items() if plan.relative
    }
    assert lengths == {"hysteresis"}
    # The product of slots and stroke is what the rated flow fixes.
    other = read(tmp_path / "stated", rated())
    assert record.valve.slot_width * record.valve.stroke == pytest.approx(
        other.valve.slot_width * other.valve.stroke, rel=1e-2
    )


def test_half_of_a_rating_is_not_enough(tmp_path):
    toml = TOML.replace('slot_width = "12 mm"\n', 'rated_flow = "40 l/min"\n')
    with pytest.raises(BenchInputError, match=r"slot_width is missing; .* or both rated_flow and rated_pressure_drop"):
        read(tmp_path, toml)


def test_slots_that_nobody_makes(tmp_path):
    with pytest.raises(BenchInputError, match=r"\[valve\]: rated_flow at .* would need slots .* is a unit wrong\?"):
        read(tmp_path, rated().replace("40 l/min", "4000 l/min").replace("200 um", "10 um"))


def test_a_model_remembers_what_was_not_stated(tmp_path):
    model = nominal_model(read(tmp_path, rated(stroke="")))
    again = load_model(save_model(model, tmp_path / "model.json"))
    assert again.valve == model.valve
