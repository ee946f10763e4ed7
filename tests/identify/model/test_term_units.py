"""Units of typed terms: what a place is shifted by per unit of the variable."""

import pytest

from thermohyd.identify.model.typed_terms import unit_of


@pytest.mark.parametrize(
    ("place", "variable", "law", "unit"),
    [
        ("reading:flow", "flow", "proportional", "1"),
        ("reading:flow", "flow", "square", "1/(m3/s)"),
        ("reading:flow", "flow", "cube", "1/(m3/s)^2"),
        ("reading:flow", "flow", "root", "sqrt(m3/s)"),
        ("reading:flow", "reading_rate", "proportional", "s"),
        ("reading:load_pressure", "pressure", "cube", "1/Pa^2"),
        ("return_pressure", "flow", "square", "Pa/(m3/s)^2"),
        ("flow_into_a", "pressure_rate", "proportional", "m3/Pa"),
        ("flow_from_a_to_b", "load", "laminar", "m3/(s Pa)"),
        ("flow_into_return", "pressure_drop", "root", "m3/s/sqrt(Pa)"),
        ("oil_temperature:return", "pressure_drop", "proportional", "K/Pa"),
        ("oil_temperature", "temperature", "proportional", "1"),
        ("oil_temperature", "constant", "constant", "K"),
        ("position", "rate", "proportional", "s"),
        ("clearance", "opening", "smooth", "m"),
    ],
)
def test_units(place, variable, law, unit):
    assert unit_of(place, variable, law) == unit
