"""Amounts of effects in the units of the bench: every effect of the library has one, and the factors are right."""

import pint
import pytest

from thermohyd.effects.library import EFFECTS
from thermohyd.identify.bench.shown_units import amount, effect_unit


@pytest.mark.parametrize("name", EFFECTS)
def test_typical_amounts_are_readable(name):
    unit = effect_unit(name, EFFECTS[name].unit)
    assert all(1e-5 < typical * unit.factor < 1e4 for typical in EFFECTS[name].typical)


@pytest.mark.parametrize("name", EFFECTS)
def test_factors_agree_with_a_units_library(name):
    unit = effect_unit(name, EFFECTS[name].unit)
    registry = pint.UnitRegistry()

    def size(words: str) -> float:
        spelled = (
            {"-": "1", "%": "0.01"}.get(words, words).replace("sqrt(Pa)", "Pa**0.5").replace("sqrt(bar)", "bar**0.5")
        )
        spelled = (
            spelled.replace("l/min/bar", "(l/min)/bar").replace("um/100 bar", "um/(100 bar)").replace("m3", "m**3")
        )
        return registry.Quantity(spelled).to_base_units().magnitude

    assert size(EFFECTS[name].unit) / size(unit.label) == pytest.approx(unit.factor, rel=1e-12)


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_has_a_bench_unit(name):
    """Kelvins and seconds are read at the bench as they are; everything else would be a forgotten row of the table."""
    unit = EFFECTS[name].unit
    assert effect_unit(name, unit).label != unit or unit in ("K", "s")


def test_amounts_in_words():
    assert amount("pilot_leakage", 2.377e-9, "m3/s/sqrt(Pa)", 3.2e-11) == "0.04510 +/- 0.00061 l/min/sqrt(bar)"
    assert amount("flowmeter_scale", 0.021, "1", 0.0011) == "2.10 +/- 0.11 %"
    assert amount("land_leakage", 12.0, "1") == "12.00"
    assert amount("return_edge_wear", 4e-6, "m", float("nan")) == "4.000 um"
    assert amount("unheard_of", 3.0, "kg") == "3.000 kg"
