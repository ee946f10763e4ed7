"""Numbers in bench units, wrong signs, other types and single precision: one sentence where the object is made, never inside jit."""

import json
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.valves import seed_valve

import thermohyd
from thermohyd.arguments import ArgumentTypeError, ArgumentValueError, heat_of_chambers, share_of_heat
from thermohyd.conditions import Conditions, operating_points
from thermohyd.oil_definition import walther_coefficients
from thermohyd.static_tests import leakage_flow


# As a user meets them: without the type checks that these tests run under.
SETUP = """
import json, sys
import jax
jax.config.update("jax_enable_x64", sys.argv[1] == "double")
import numpy as np
import thermohyd as th
from thermohyd.data import oil_preset
points = lambda **k: th.operating_points(**{"position": [0.0, 1e-5], "supply_pressure": 70e5, "temperature": 313.15, **k})
inputs = lambda kind="setpoint", **k: th.step_inputs(np.array([0.0, 1.0]), kind=kind, **{"command": 0.0, "supply_pressure": 210e5,
    "temperature": 313.15, **k})
def valve(**k):
    oil = th.oil_from_definition(oil_preset("mil-prf-5606"))
    return th.Valve(**{"oil": oil, "stroke": 213e-6, "slot_width": 12e-3, "edge_radius": 15e-6, "clearance": 2e-6, "underlap": 0.0, **k})
found = {}
for call in json.load(sys.stdin):
    try:
        found[call] = ["", type(eval(call)).__name__]
    except Exception as error:
        found[call] = [type(error).__name__, str(error)]
print(json.dumps(found))
"""

VALUE, TYPE = "ArgumentValueError", "ArgumentTypeError"
MISUSE = {
    "points(temperature=40)": (VALUE, "temperature: temperatures are in kelvin; 40 looks like degC: use 313.15"),
    "points(temperature=-40.0)": (VALUE, "temperature: temperatures are in kelvin; -40 looks like degC: use 233.15"),
    "points(temperature=[300.0, 900.0])": (
        VALUE,
        "temperature: temperatures are in kelvin; 900 is beyond the 700 K of any oil",
    ),
    "points(temperature=np.nan)": (VALUE, "temperature must be finite, not nan"),
    "points(supply_pressure=70)": (VALUE, "supply_pressure: pressures are in Pa; 70 looks like bar: use 70e5"),
    "points(supply_pressure=np.array([70.0, 210.0]))": (
        VALUE,
        "supply_pressure: pressures are in Pa; 210 looks like bar: use 210e5",
    ),
    "points(return_pressure=2)": (VALUE, "return_pressure: pressures are in Pa; 2 looks like bar: use 2e5"),
    "points(return_pressure=-2e5)": (
        VALUE,
        "return_pressure: pressures are in Pa; -200000 is below absolute vacuum; they are gauge",
    ),
    "points(position=50)": (VALUE, "position: lengths are in m; 50 looks like um: use 50e-6"),
    "points(position='50 um')": (
        TYPE,
        'position must be a number or an array of numbers in SI units, not the text "50 um"',
    ),
    "points(temperature=np.full(3, 300.0))": (
        VALUE,
        "operating points need numbers or arrays of one shape, not position (2,), supply_pressure (), return_pressure (), "
        "temperature (3,)",
    ),
    "valve(oil='mil-prf-5606')": (
        TYPE,
        'oil must be a thermohyd.Oil, not the text "mil-prf-5606": oil_from_definition(oil_preset(...)) makes one',
    ),
    "valve(oil=oil_preset('mil-prf-5606'))": (
        TYPE,
        "oil must be a thermohyd.Oil, not an OilDefinition: oil_from_definition(oil_preset(...)) makes one",
    ),
    "th.oil_from_definition('mil-prf-5606')": (
        TYPE,
        'oil_from_definition takes an OilDefinition, not the text "mil-prf-5606": '
        'thermohyd.data.oil_preset("mil-prf-5606") is one',
    ),
    "valve(clearance=-1e-6)": (VALUE, "clearance must be zero or positive, not -1e-06"),
    "valve(edge_radius=-1e-6)": (VALUE, "edge_radius must be zero or positive, not -1e-06"),
    "valve(stroke=-213e-6)": (VALUE, "stroke must be positive, not -0.000213"),
    "valve(slot_width=0.0)": (VALUE, "slot_width must be positive, not 0"),
    "valve(stroke=213)": (VALUE, "stroke: lengths are in m; 213 looks like um: use 213e-6"),
    "valve(slot_width=12)": (VALUE, "slot_width: lengths are in m; 12 looks like mm: use 12e-3"),
    "valve(edge_radius='15 um')": (
        TYPE,
        'edge_radius must be a number or an array of numbers in SI units, not the text "15 um"',
    ),
    "valve(edge_radius=None)": (TYPE, "edge_radius must be a number or an array of numbers in SI units, not None"),
    "valve(heat_retention=50)": (VALUE, "heat_retention cannot be 50: it is the share of the heat kept, 0 to 1"),
    "valve(effects={'hysteresis': 1e-6})": (
        TYPE,
        "effects must be a tuple of effects, not a dict: "
        "thermohyd.effects.library.with_effects(valve, {name: amount}) adds them by name",
    ),
    "th.leakage_flow(points(), valve())": (
        TYPE,
        "the first argument must be a thermohyd.Valve, not a Conditions: the second one is its operating_points",
    ),
    "th.leakage_flow(valve(), {'position': 0.0})": (
        TYPE,
        "the second argument must be a thermohyd.Conditions, not a dict: operating_points(...) makes them",
    ),
    "th.Oil(9.0, 3.5, bulk_modulus_15degC=1.7)": (
        VALUE,
        "bulk_modulus_15degC cannot be 1.7: bulk moduli are in Pa, such as 1.7e9",
    ),
    "th.Actuator(piston_area=12)": (VALUE, "piston_area cannot be 12: areas are in m2: 12 cm2 is 12e-4"),
    "th.Actuator(piston_area_a=12e-4)": (
        VALUE,
        "piston_area_b is missing: piston_area_a and piston_area_b are given together",
    ),
    "th.Actuator(chamber_volume=60e-6, chamber_volume_a=60e-6, chamber_volume_b=40e-6)": (
        VALUE,
        "give chamber_volume, of both sides, or chamber_volume_a and chamber_volume_b, not all three",
    ),
    "th.Actuator(piston_area_a=12e-4, piston_area_b=8)": (
        VALUE,
        "piston_area_b cannot be 8: areas are in m2: 12 cm2 is 12e-4",
    ),
    "th.Actuator(moving_mass=-1)": (VALUE, "moving_mass must be positive, not -1"),
    "th.Actuator(piston_stroke=50)": (
        VALUE,
        "piston_stroke 50 sweeps far more than the chamber_volume 6e-05 m3 holds: lengths are in m, 50 mm is 50e-3",
    ),
    "inputs(temperature=40)": (VALUE, "temperature: temperatures are in kelvin; 40 looks like degC: use 313.15"),
    "inputs(supply_pressure=210)": (VALUE, "supply_pressure: pressures are in Pa; 210 looks like bar: use 210e5"),
    "inputs('current', command=25)": (VALUE, "command cannot be 25: currents are in A: 25 mA is 25e-3"),
    "inputs(command='5 mm')": (TYPE, 'command must be a number or one per row, in SI units, not the text "5 mm"'),
    "th.performance(valve(), th.Actuator(), temperature=40, supply_pressure=70e5)": (
        VALUE,
        "temperature: temperatures are in kelvin; 40 looks like degC: use 313.15",
    ),
    "th.performance(valve(), th.Actuator(), temperature=300.0, supply_pressure=70e5, heat='warm')": (
        VALUE,
        'heat must be "adiabatic", "isothermal" or a share from 0 to 1, not the text "warm"',
    ),
    **{
        f"{call}, heat=0.5)": (
            VALUE,
            'heat must be "adiabatic" (1) or "isothermal" (0) here, not 0.5: between the two, chambers exchange heat with '
            "their walls (walls=), and edges keep the valve's heat_retention",
        )
        for call in (
            "th.simulate_step(valve(), th.Actuator(), inputs()",
            "th.simulate_many(valve(), th.Actuator(), inputs()",
            "th.frequency_response(valve(), th.Actuator(), inputs(), np.array([1.0])",
        )
    },
}
# What looks odd and is meant: overlap, a supply that is off, ramps, noise about zero, a load either way, a long jack.
LEGAL = {
    "valve(underlap=-15e-6)": "Valve",
    "valve(edge_radius=0.0, clearance=0)": "Valve",
    "valve(heat_retention=1.0)": "Valve",
    "points(supply_pressure=0.0)": "Conditions",
    "points(supply_pressure=[0.0, 70e5])": "Conditions",
    "points(return_pressure=[-30.0, 20.0])": "Conditions",
    "points(return_pressure=500.0)": "Conditions",
    "points(load_pressure=[-60e5, 60e5])": "Conditions",
    "points(temperature=[200.0, 500.0])": "Conditions",
    "th.Actuator(piston_stroke=50.0, chamber_volume=3.0, piston_area=0.1)": "Actuator",
}
SINGLE = {
    "th.operating_points(0.0, supply_pressure=70e5, temperature=313.15)": "operating_points",
    "th.oil_from_definition(oil_preset('mil-prf-5606'))": "an Oil",
    "th.Actuator()": "an Actuator",
    "inputs()": "step_inputs",
    "th.Conditions(*(np.zeros(1),) * 4)": "operating_points",
}


def said(precision: str, calls) -> dict[str, list[str]]:
    ran = subprocess.run(
        [sys.executable, "-P", "-c", SETUP, precision],
        input=json.dumps([*calls]),
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(ran.stdout)


@pytest.fixture(scope="module")
def in_double():
    return said("double", [*MISUSE, *LEGAL])


@pytest.mark.parametrize("call", MISUSE)
def test_one_sentence(in_double, call):
    assert tuple(in_double[call]) == MISUSE[call]


@pytest.mark.parametrize("call", LEGAL)
def test_what_is_meant_passes(in_double, call):
    assert in_double[call] == ["", LEGAL[call]]


def test_single_precision_is_refused_where_things_are_made():
    needs = 'needs double precision: call jax.config.update("jax_enable_x64", True) before making any array'
    assert said("single", SINGLE) == {call: ["RuntimeError", f"{what} {needs}"] for call, what in SINGLE.items()}


def test_what_is_traced_is_never_looked_at():
    """A solver may try what no valve has; there it gets a number."""
    cold = lambda x, kelvin: operating_points(x, supply_pressure=kelvin, temperature=kelvin)
    made = jax.make_jaxpr(lambda x, kelvin: Conditions(x, kelvin, kelvin, kelvin))(jnp.ones(2), jnp.full(2, 40.0))
    assert made.eqns == []  # nothing is computed for the checks
    jax.jit(cold)(50.0, 40.0)
    jax.vmap(cold)(jnp.array([50.0, 1e-6]), jnp.array([40.0, 300.0]))
    at = operating_points(0.0, supply_pressure=70e5, temperature=313.15)
    flow = lambda clearance: leakage_flow(seed_valve(clearance=clearance), at).sum()
    assert np.isfinite(jax.grad(flow)(2e-6))


def test_heat_is_a_word_or_the_share_that_it_stands_for():
    assert [heat_of_chambers(heat) for heat in ("adiabatic", 1, 1.0)] == ["adiabatic"] * 3
    assert [heat_of_chambers(heat) for heat in ("isothermal", 0, 0.0)] == ["isothermal"] * 3
    assert [share_of_heat(heat) for heat in ("isothermal", 0.3, "adiabatic", None)] == [0.0, 0.3, 1.0, None]
    with pytest.raises(ArgumentValueError, match='not the text "warm"'):
        heat_of_chambers("warm")


def test_the_types_are_the_usual_ones():
    assert issubclass(ArgumentValueError, ValueError)
    assert issubclass(ArgumentTypeError, TypeError)
    assert thermohyd.ArgumentValueError is ArgumentValueError


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (([40.0, 100.0], [32e-6, 5.4e-6]), "temperatures are in kelvin; 40 looks like degC: use 313.15"),
        (([313.15, 373.15], [32.0, 5.4]), "kinematic viscosities are in m2/s; 32 looks like cSt: use 32e-6"),
        (([313.15, 373.15], [32e-6]), "a viscosity law needs one viscosity per temperature, not 1 for 2"),
    ],
)
def test_viscosity_points_in_bench_units(points, message):
    with pytest.raises(ValueError, match=message):
        walther_coefficients(*points)
