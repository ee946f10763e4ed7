"""Large programs that run once, a handful of temperatures each: compiled quickly is enough."""

import numpy as np
import pytest
from helpers.commands import command
from helpers.quick_compile import quick_compile

from thermohyd.identify.sensitivity.settings import Settings
from thermohyd.identify.sensitivity.source import Source
from thermohyd.identify.servo.request import Request
from thermohyd.identify.servo.study import ServoStudy, servo_study
from thermohyd.identify.servo.subject import subject_of


NEAR = 0.05  # K: of two temperatures around the third, for differences
TEMPERATURES = (253.15, 313.15 - NEAR, 313.15, 313.15 + NEAR)


@pytest.fixture(autouse=True, scope="package")
def quick():
    with quick_compile():
        yield


@pytest.fixture(scope="package")
def study(quick) -> ServoStudy:
    """Of the seed paper's valve; commands at as many temperatures share its programs."""
    return servo_study(subject_of(Source(Settings()), Request(TEMPERATURES, 2e-3)))


@pytest.fixture(scope="package")
def stiffer(study) -> ServoStudy:
    """The same loop with thirty times the gain, from 0 to 70 degC: beyond its margins."""
    warm = tuple(np.array([0.0, 20.0, 40.0, 70.0]) + 273.15)
    return servo_study(subject_of(Source(Settings()), Request(warm, 5e-3, amplifier_gain=0.9)))


@pytest.fixture
def run(monkeypatch):
    return command(monkeypatch, "servo", 80)
