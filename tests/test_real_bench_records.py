"""The records of real benches: the same every time, read by the project, and as their truth says."""

import functools
import json

import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_jit
from helpers.valves import NAMES as NAMED
from reference import real_bench_plan, real_bench_records
from reference.real_bench import STORES
from reference.real_bench_faults import NAMES

from thermohyd.conditions import Conditions
from thermohyd.effects.library import EFFECTS, with_effects
from thermohyd.identify.bench.read import read_record
from thermohyd.oil import oil_from_definition
from thermohyd.static_tests import leakage_flow
from thermohyd.valve import Valve


STATIC = {"leakage", "pressure_gain", "flow_gain"}


@functools.cache
def drawn(kind, number):
    """A record of set 1, without the others'."""
    case = next(i for i, found in enumerate(real_bench_plan.cases()) if found == (kind, number))
    return real_bench_plan.draw(1, case)


@pytest.mark.parametrize(("kind", "number"), [("none", 2), ("fault", 0), ("single", 0)])
def test_written_twice_and_read(kind, number, tmp_path):
    hidden = drawn(kind, number)
    for folder in ("a", "b"):
        real_bench_records.write(tmp_path / folder, [("bench_01", hidden)])
    files = [p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file()]
    assert all((tmp_path / "a" / f).read_bytes() == (tmp_path / "b" / f).read_bytes() for f in files)
    truth = json.loads((tmp_path / "a" / "truth.json").read_text(encoding="utf-8"))["bench_01"]
    record = read_record(tmp_path / "a" / "bench_01")
    assert sum(test.rows for test in record.tests.values()) == truth["rows"]
    assert list(record.tests) == truth["tests"]
    assert 600 <= truth["rows"] <= 12_000
    for name, test in record.tests.items():
        assert len({run.rate for run in hidden.bench.runs_of(name)}) >= 2
        assert all((channel.std is not None) == hidden.declared for channel in test.channels)
        assert test.time is not None
        assert np.all(np.diff(test.time) > 0.0)
    text = (tmp_path / "a" / "bench_01" / "bench.toml").read_text(encoding="utf-8")
    assert not any(word in text for word in (*EFFECTS, *NAMES))


def test_an_outlier_stands_where_the_truth_says(tmp_path):
    hidden = drawn("fault", 0)
    (fault,) = hidden.faults
    assert fault.name == "outliers"
    real_bench_records.write(tmp_path, [("bench_01", hidden)])
    (true,) = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))["bench_01"]["faults"]
    channel = next(c for c in read_record(tmp_path / "bench_01").tests[fault.test].channels if c.name == fault.channel)
    felt = real_bench_plan.exact(hidden)[fault.test, fault.channel]
    noise = hidden.scale.effective_noise((fault.test, fault.channel))
    far = np.flatnonzero(np.abs(channel.value - felt) > 7.0 * noise)
    assert [int(row) + 3 for row in far] == true["lines"]


def test_a_set_holds_what_it_should():
    kinds = [kind for kind, _ in real_bench_plan.cases()]
    assert {k: kinds.count(k) for k in dict.fromkeys(kinds)} == {
        "none": 15, "single": 20, "storage": 6, "several": 10, "fault": 14, "fault_with_effect": 9, "outside": 6,
    }  # fmt: skip
    assert set(real_bench_plan.AMOUNTS) | set(STORES) == {n for n, e in EFFECTS.items() if set(e.shows) & STATIC}
    for name, (start, largest) in real_bench_plan.AMOUNTS.items():
        assert 0.0 < start < largest < EFFECTS[name].upper
        assert (EFFECTS[name].lower < 0.0) == (name in real_bench_plan.SIGNED)


def test_sizes_are_in_units_of_the_noise():
    """White noise of one standard deviation, beside the parameters, has one unit of size per reading."""
    scale = drawn("none", 0).scale
    random = np.random.default_rng(1)
    noise = {key: scale.effective_noise(key) * random.standard_normal(v.shape) for key, v in scale.ideal.items()}
    white = scale.whitened(noise)
    assert scale.bench.phi == 0.0
    assert np.mean(white**2) == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / len(white)))


def test_exact_readings_are_those_of_the_project(tmp_path):
    hidden = drawn("single", 0)
    real_bench_records.write(tmp_path, [("bench_01", hidden)])
    read, v, rows = read_record(tmp_path / "bench_01"), hidden.bench.valve, hidden.bench.rows("leakage")
    names = (*NAMED, "null_pressure")
    valve = Valve(
        oil=oil_from_definition(read.oil),
        stroke=read.valve.stroke,
        slot_width=read.valve.slot_width,
        **{name: jnp.asarray(getattr(v, name)) for name in names},
    )
    valve = with_effects(valve, {name: jnp.asarray(amount) for name, amount in hidden.effects.items()})
    columns = (rows.spool_position, rows.supply_pressure, rows.return_pressure, rows.temperature)
    found = np.asarray(quick_jit(leakage_flow)(valve, Conditions(*map(jnp.asarray, columns))))
    expected = real_bench_plan.exact(hidden)["leakage", "leakage_flow"]
    assert np.max(np.abs(found / expected - 1.0)) < 1e-8
