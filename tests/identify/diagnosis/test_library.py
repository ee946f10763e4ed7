"""What a record's columns can show at all, and which effects share a cheap program."""

from dataclasses import replace

import numpy as np
from helpers.small_bench import REACH, conditions_only

from thermohyd.effects.library import EFFECTS
from thermohyd.identify.fitting.library import coupled, expensive_to_compile, library_for, relative_cost, stores


STORED = {"port_compliance_a", "port_compliance_b"}


def bench_of(**changes):
    return [replace(conditions_only(name), **changes) for name in REACH]


def test_a_full_record_can_show_the_whole_library():
    library = library_for(bench_of())
    assert library.names == tuple(EFFECTS)
    assert not library.impossible


def test_without_time():
    library = library_for(bench_of(time=None, rate=None))
    assert set(library.impossible) == {"flowmeter_lag", "position_lag", *STORED}
    assert "column time" in library.impossible["flowmeter_lag"]
    assert set(library.names) | set(library.impossible) == set(EFFECTS)


def test_one_rate_looks_like_hysteresis():
    tests = [replace(test, rate=1e-5 * np.sign(test.rate)) for test in bench_of() if test.rate is not None]
    library = library_for(tests)
    assert set(library.impossible) == {"position_lag"}
    assert "hysteresis" in library.impossible["position_lag"]


def test_one_direction():
    library = library_for(bench_of(direction=np.ones(256)))
    assert "one direction" in library.impossible["hysteresis"]


def test_tests_that_an_effect_shows_in():
    library = library_for(bench_of()[:1])  # leakage alone
    for name, info in EFFECTS.items():
        assert (name in library.names) == ("leakage" in info.shows), name
    assert all("leakage" not in EFFECTS[name].shows for name in library.impossible)


def test_programs():
    library = library_for(bench_of())
    assert set(library.plain) == {name for name in EFFECTS if not coupled(name) and name not in STORED}
    assert {name for name in EFFECTS if coupled(name)} == {
        "flow_saturation", "supply_droop", "return_back_pressure", "cross_port_leakage"
    }  # fmt: skip
    assert set(library.names) - set(library.cold) == {"throttle_heating", *STORED}
    assert {name for name in EFFECTS if stores(name)} == STORED
    assert set(library.stored) == {*library.plain, *STORED} - {"throttle_heating"}
    assert expensive_to_compile(("throttle_heating", "supply_droop"))
    assert not expensive_to_compile(("throttle_heating", "hysteresis"))
    assert not expensive_to_compile(("supply_droop", "cross_port_leakage"))
    assert expensive_to_compile(("supply_droop", "port_compliance_a"))


def test_what_ties_ports_and_rows_together_costs_more():
    cost = relative_cost
    assert cost(()) == cost(("hysteresis", "throttle_heating")) == 1.0
    lines, stored = ("hysteresis", "supply_droop"), ("hysteresis", "port_compliance_a")
    assert 1.0 < cost(lines) < cost(stored) < cost((*lines, *stored))
