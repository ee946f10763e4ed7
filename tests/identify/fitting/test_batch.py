"""Many records at once: the same answers as one by one, whatever stands among them, and nobody waits for ever."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import thermohyd.data
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting import batch
from thermohyd.identify.fitting.batch import fit_many
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.fitting.result import FitResult


# Of one shape, and so of one program; the third needs profiles, the last one has a shape of its own.
NAMES = ("hidden/bench_26", "hidden/bench_38", "hidden/bench_69", "hidden/bench_76", "seed_valve", "hidden/bench_27")
CLOSE = 1e-6  # standard errors


@pytest.fixture(scope="module")
def records():
    top = Path(thermohyd.data.__file__).parent
    return [read_record(top / name) for name in NAMES]


def test_many_at_once_are_what_each_is_alone(records):
    empty = replace(records[0], tests={})
    ended = {}
    many = fit_many([*records, empty], together=8, starts=1, ended=ended.__setitem__)
    assert isinstance(many[-1], BenchInputError)
    assert ended == dict(enumerate(many))
    for record, found in zip(records, many, strict=False):
        alone = fit(record, starts=1)
        assert isinstance(found, FitResult)
        assert (found.converged, found.verdict) == (alone.converged, alone.verdict)
        for name in alone.free:
            a, b = alone.parameters[name], found.parameters[name]
            assert (a.std is None, a.by_profile, a.at_bound) == (b.std is None, b.by_profile, b.at_bound)
            if a.std is not None:
                assert a.ci95 is not None
                assert b.ci95 is not None
                far = np.abs(np.array([a.value, a.std, *a.ci95]) - np.array([b.value, b.std, *b.ci95])) / a.std
                assert np.all(far < CLOSE), (record.name, name, far)


# Below, the fit of one record is a stand-in: what is asked is who waits for whom.


class Fit(FitResult):
    """A result without figures."""

    def __init__(self, converged):
        object.__setattr__(self, "converged", converged)
        object.__setattr__(self, "seconds", 0.0)


def test_one_that_does_not_converge_is_fitted_again_alone(records, monkeypatch):
    monkeypatch.setattr(batch, "replace", lambda result, **_: result)
    monkeypatch.setattr(batch, "plain_fit", lambda record, **_: (None, Fit(record is not records[1])))
    alone = []
    monkeypatch.setattr(batch, "fit", lambda record, **_: alone.append(record) or Fit(True))
    assert all(isinstance(one, Fit) and one.converged for one in fit_many(records, together=2))
    assert alone == [records[1]]


def test_what_goes_wrong_in_a_batch_is_tried_alone_and_bad_input_is_not(records, monkeypatch):
    wrong = {id(records[0]): BenchInputError("holds nothing"), id(records[1]): ValueError("no room")}

    def plain_fit(record, **_):
        if id(record) in wrong:
            raise wrong[id(record)]
        return None, Fit(True)

    monkeypatch.setattr(batch, "replace", lambda result, **_: result)
    monkeypatch.setattr(batch, "plain_fit", plain_fit)
    monkeypatch.setattr(batch, "fit", lambda record, **_: Fit(True))
    found = fit_many(records[:3], together=3)
    assert isinstance(found[0], BenchInputError)
    assert isinstance(found[1], Fit)


def test_who_stops_it_is_not_kept_waiting(records, monkeypatch):
    monkeypatch.setattr(batch, "replace", lambda result, **_: result)
    monkeypatch.setattr(batch, "plain_fit", lambda record, **_: (None, Fit(True)))

    def full(number, result):
        raise OSError("no room")

    with pytest.raises(OSError, match="no room"):
        fit_many(records, together=2, ended=full)
    with pytest.raises(ValueError, match="at least 1"):
        fit_many(records, together=0)
