"""The settings file: what it may say, and what is said of a mistake."""

from dataclasses import replace

import pytest

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import ActuatorData
from thermohyd.identify.model.model import Model
from thermohyd.identify.sensitivity.factors import FACTORS, factors_of
from thermohyd.identify.sensitivity.settings import Settings, factors_with, read_settings
from thermohyd.identify.sensitivity.source import Source, actuator_of, seed_model, subject_of_model
from thermohyd.identify.sensitivity.words import actuator_sentence


WHOLE = """
[conditions]
temperature = "20 degC"
temperatures = ["0 degC", "60 degC"]
supply_pressure = "210 bar"
return_pressure = "1 bar"
[tolerances]
clearance = "0.3 um"
viscosity = "5 %"
temperature = "2 K"
[noise]
leakage = "0.01 l/min"
[actuator]
piston_area = "20 cm^2"
chamber_volume = "100 cm^3"
controller = { amplifier_gain = "0.02 A/V", sensor_gain = "100 V/m" }
"""


def settings_of(tmp_path, text: str) -> Settings:
    path = tmp_path / "settings.toml"
    path.write_text(text)
    return read_settings(path)


def test_everything_arrives(tmp_path):
    settings = settings_of(tmp_path, WHOLE)
    subject = subject_of_model(seed_model(), settings)
    assert subject.temperature == pytest.approx(293.15)
    assert subject.temperatures == pytest.approx((273.15, 293.15, 333.15))
    assert subject.supply_pressures == pytest.approx((105e5, 210e5, 315e5))
    assert subject.return_pressure == pytest.approx(1e5)
    assert subject.noise.absolute == pytest.approx({"leakage": 0.01 / 6e4})
    assert settings.actuator == pytest.approx(
        {"piston_area": 20e-4, "chamber_volume": 100e-6, "amplifier_gain": 0.02, "sensor_gain": 100.0}
    )
    tolerance = {f.name: f.tolerance for f in factors_with(settings, seed_model(), 293.15, 210e5, 1e5)}
    assert tolerance["clearance"] == pytest.approx(0.3e-6)
    assert tolerance["viscosity"] == pytest.approx(0.05)
    assert tolerance["temperature"] == pytest.approx(2.0)
    assert tolerance["underlap"] == pytest.approx(3e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[tolerances]\nclearence = '1 um'", 'did you mean "clearance"?'),
        ("[tolerances]\nclearance = '1 bar'", "is a pressure"),
        ("[tolerances]\nclearance = '-1 um'", "must be positive"),
        ("[tolerances]\nclearance = 1", "has no unit"),
        ("[tolerances]\ntemperature = '5 degC'", 'such as "5 K"'),
        ("[conditions]\ntemperatures = '20 degC'", "must be a list"),
        ("[conditions]\ntemperature = '300 degC'", "must lie between"),
        ("[conditions]\nsupply_pressure = '10 bar'\nreturn_pressure = '20 bar'", "must be below"),
        ("[noise]\nleakage = '1 bar'", "is a pressure"),
        ("[actuator]\npiston_area = '1 m'", "is a length"),
        ("[actuator]\npiston_area_a = '12 cm^2'", "piston_area_b is missing"),
        ("[noises]\n", 'did you mean "noise"?'),
    ],
)
def test_mistakes_are_named(tmp_path, text, words):
    with pytest.raises(BenchInputError, match=r"settings\.toml, line \d, ") as error:
        settings_of(tmp_path, text)
    assert words in str(error.value)


def test_intervals_are_cut_where_a_factor_cannot_go():
    factors = {f.name: f for f in factors_of(seed_model(), 313.15, 70e5)}
    assert tuple(factors) == FACTORS
    assert (factors["heat_retention"].low, factors["heat_retention"].high) == (0.0, 1.0)
    assert (factors["return_pressure"].low, factors["return_pressure"].high) == (0.0, 1e5)
    with pytest.raises(ValueError, match="no factor"):
        factors_of(seed_model(), 313.15, 70e5, tolerances={"clearence": 1e-6})


def fitted_model(**ranges: tuple[float, float]) -> Model:
    """A model that was fitted to a leakage test in these ranges, and to a step test elsewhere."""
    elsewhere = {name: (0.1 * low, 9.0 * high) for name, (low, high) in ranges.items()}
    return replace(seed_model(), fitted={"leakage": ranges, "step": elsewhere})


def test_a_model_is_studied_in_the_middle_of_what_it_was_fitted_to():
    model = fitted_model(temperature=(300.0, 340.0), supply_pressure=(140e5, 210e5), return_pressure=(1e5, 3e5))
    subject = subject_of_model(model, Settings())
    assert (subject.temperature, subject.supply_pressure, subject.return_pressure) == pytest.approx((320.0, 175e5, 2e5))
    assert subject.temperatures == pytest.approx((275.0, 300.0, 320.0, 340.0, 365.0))
    assert min(subject.supply_pressures) >= 140e5
    stated = subject_of_model(model, Settings(temperature=313.0, supply_pressure=200e5, return_pressure=0.0))
    assert (stated.temperature, stated.supply_pressure, stated.return_pressure) == (313.0, 200e5, 0.0)
    assert subject_of_model(seed_model(), Settings()).supply_pressure == seed_model().valve.rated_pressure_drop


def test_no_actuator_is_shown_that_nobody_stated():
    model = fitted_model(supply_pressure=(140e5, 210e5))
    source = Source(Settings(), model=model)
    subject = source.subject()
    assert actuator_of(source, subject) is None
    assert "No actuator with a controller is stated" in actuator_sentence(None)
    open_loop = replace(model, actuator=ActuatorData())
    closed = replace(model, actuator=ActuatorData(amplifier_gain=0.02, sensor_gain=100.0))
    assert actuator_of(Source(Settings(), model=open_loop), replace(subject, model=open_loop)) is None
    jack = actuator_of(Source(Settings(), model=closed), replace(subject, model=closed))
    assert jack is not None
    assert float(jack.amplifier_gain) == 0.02


def test_a_jack_of_unequal_sides_is_a_subject_too(tmp_path):
    settings = settings_of(tmp_path, "[actuator]\npiston_area_a = '12 cm^2'\npiston_area_b = '8 cm^2'")
    assert settings.actuator == pytest.approx({"piston_area_a": 12e-4, "piston_area_b": 8e-4})
    source = Source(settings)
    jack = actuator_of(source, source.subject())
    assert jack is not None
    assert not jack.symmetric
    sentence = actuator_sentence(jack)
    assert "piston 12 and 8 cm2" in sentence
    assert "thermohyd servo has the margins" in sentence
