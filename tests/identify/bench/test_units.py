"""Bench units to SI: what engineers write is read, what is wrong is refused in one sentence."""

import subprocess
import sys

import numpy as np
import pytest

from thermohyd.identify.bench.shown_units import KINDS
from thermohyd.identify.bench.units import UnitError, from_si, parse_quantity, parse_unit, to_si


@pytest.mark.parametrize(
    ("text", "kind", "expected"),
    [
        ("213 um", "length", 213e-6),
        ("5µm", "length", 5e-6),  # micro sign
        ("5 μm", "length", 5e-6),  # Greek mu
        ("1 thou", "length", 25.4e-6),
        ("40 degC", "temperature", 313.15),
        ("40 °C", "temperature", 313.15),
        ("104 degF", "temperature", 313.15),
        ("-40 degC", "temperature", 233.15),
        ("12 cm^2", "area", 12e-4),
        ("12 cm2", "area", 12e-4),
        ("12 cm²", "area", 12e-4),
        ("60 cm**3", "volume", 60e-6),
        ("2000 N s/m", "viscous friction", 2000.0),
        ("2000 N*s/m", "viscous friction", 2000.0),
        ("9.8 l/min", "flow", 9.8e-3 / 60.0),
        ("9.8 L/min", "flow", 9.8e-3 / 60.0),
        ("9.8 lpm", "flow", 9.8e-3 / 60.0),
        ("1 gal/min", "flow", 3.785411784e-3 / 60.0),
        ("1 gpm", "flow", 3.785411784e-3 / 60.0),
        ("2980 psi", "pressure", 2980.0 * 6894.757293168361),
        ("70 barg", "pressure", 70e5),
        ("30 cSt", "kinematic viscosity", 30e-6),
        ("1900 J/(kg K)", "specific heat", 1900.0),
        ("1900 J/kg/K", "specific heat", 1900.0),
        ("2e-8 1/Pa", "compressibility", 2e-8),
        ("1e-12 m^3/s/Pa", "leakage conductance", 1e-12),
        ("0.01 A/V", "amplifier gain", 0.01),
        ("1.2e3 m s^-1", "velocity", 1200.0),
        ("0.7", "plain number", 0.7),
        ("70 %", "plain number", 0.7),
        # letter case, and short names that only the kind of the quantity gives a meaning
        ("40 C", "temperature", 313.15),
        ("40 deg C", "temperature", 313.15),
        ("40 ºC", "temperature", 313.15),
        ("40 ℃", "temperature", 313.15),
        ("104 F", "temperature", 313.15),
        ("104 °F", "temperature", 313.15),
        ("300 k", "temperature", 300.0),
        ("2980 PSI", "pressure", 2980.0 * 6894.757293168361),
        ("70 Bar", "pressure", 70e5),
        ("70 bar(g)", "pressure", 70e5),
        ("7 MPA", "pressure", 7e6),
        ("1 GPM", "flow", 3.785411784e-3 / 60.0),
        ("9.8 LPM", "flow", 9.8e-3 / 60.0),
        ("9.8 L/MIN", "flow", 9.8e-3 / 60.0),
        ("3 ML/MIN", "flow", 3e-6 / 60.0),
        ("3 S", "time", 3.0),
        ("3 ma", "current", 3e-3),
        ("5 UM", "length", 5e-6),
    ],
)
def test_quantity(text, kind, expected):
    assert parse_quantity(text, kind) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("3 bar", "flow", '"bar" is a pressure; expected a flow such as l/min'),
        ("40 C", "flow", '"C" is of another dimension; expected a flow such as l/min'),
        ("3", "length", "the unit is missing; expected a length such as um"),
        ("3 l/mn", "flow", '"l/mn" is not a unit; did you mean "l/min"?'),
        (
            "3 PSIA",
            "pressure",
            '"PSIA" is an absolute pressure, but the pressures of a record are gauge; did you mean "psi"?',
        ),
        (
            "3 bar(a)",
            "pressure",
            '"bar(a)" is an absolute pressure, but the pressures of a record are gauge; did you mean "bar"?',
        ),
        (
            "3 psia",
            "pressure",
            '"psia" is an absolute pressure, but the pressures of a record are gauge; did you mean "psi"?',
        ),
        ("9,8 l/min", "flow", '"9,8 l/min" is not a quantity; expected a number with a unit, such as "1.5 l/min"'),
        ("nan um", "length", '"nan um" is not a quantity; expected a number with a unit, such as "1.5 um"'),
        ("um", "length", '"um" is not a quantity; expected a number with a unit, such as "1.5 um"'),
        ("1e999 um", "length", '"1e999 um" is not finite'),
        ("1 dB", "plain number", '"dB" is not a linear unit; expected a plain number such as 1'),
        ("50 %", "length", '"%" is a plain number; expected a length such as um'),
        ("1 m^9^9^9", "length", '"m^9^9^9" is not a unit; expected a length such as um'),
        ("1 min**9**9", "time", '"min**9**9" is not a unit; expected a time such as s'),
        ("1 ((m^9)^9)^9", "length", '"((m^9)^9)^9" is not a unit; expected a length such as um'),
        ("1 m²³²³²³²³", "length", '"m²³²³²³²³" is not a unit; expected a length such as um'),
    ],
)
def test_refused(text, kind, message):
    with pytest.raises(UnitError) as caught:
        parse_quantity(text, kind)
    assert str(caught.value) == message


def test_percent_of_the_stroke():
    assert parse_quantity("50 %", "length", 200e-6) == pytest.approx(100e-6)
    assert parse_unit("%", "length", 200e-6).to_si(np.array([-100.0])) == pytest.approx([-200e-6])


@pytest.mark.parametrize("unit", ["degC", "degF", "l/min", "psi", "%"])
def test_there_and_back(unit):
    values = np.array([-10.0, 0.0, 1.0, 250.0])
    assert from_si(to_si(values, unit), unit) == pytest.approx(values, abs=1e-12)


def test_units_are_not_loaded_before_the_first_one_is_read():
    code = "import sys, thermohyd.identify.bench.units; sys.exit('pint' in sys.modules or 'jax' in sys.modules)"
    subprocess.run([sys.executable, "-P", "-c", code], check=True)


@pytest.mark.parametrize("kind", KINDS)
def test_the_shown_unit_is_read_back(kind):
    unit = KINDS[kind]
    assert parse_quantity(f"{unit.of(300.0)!r} {unit.label}", kind) == pytest.approx(300.0, rel=1e-12)
    assert parse_quantity(f"300 {unit.si or unit.label}", kind) == 300.0
