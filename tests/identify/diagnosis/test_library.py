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
    apart = {name for name in EFFECTS if not coupled(name) and name not in STORED}
    costly = {"throttle_heating", "pressure_viscosity", "pressure_clearance"}
    assert set(library.program(())) == set(library.program(("hysteresis",))) == apart - costly
    assert set(library.program((), heat=True)) == set(library.program(("pressure_viscosity",))) == apart
    assert {name for name in EFFECTS if coupled(name)} == {
        "flow_saturation", "supply_droop", "return_back_pressure", "cross_port_leakage"
    }  # fmt: skip
    tied = set(library.program(("supply_droop",)))
    assert set(library.names) - tied == costly | STORED
    assert set(library.program(("supply_droop", "pressure_viscosity"))) == (tied | costly) - {"throttle_heating"}
    assert set(library.program(("supply_droop", "throttle_heating"))) == tied | costly
    assert {name for name in EFFECTS if stores(name)} == STORED
    assert set(library.program(("port_compliance_a",))) == (apart - costly) | STORED
    assert set(library.program(("port_compliance_a", "supply_droop", "throttle_heating"))) == set(library.names)
    assert expensive_to_compile(("throttle_heating", "supply_droop"))
    assert not expensive_to_compile(("throttle_heating", "hysteresis"))
    assert not expensive_to_compile(("supply_droop", "cross_port_leakage"))
    assert expensive_to_compile(("supply_droop", "port_compliance_a"))


def test_what_ties_ports_and_rows_together_costs_more():
    cost = relative_cost
    assert cost(()) == cost(("hysteresis",)) < cost(("hysteresis", "throttle_heating")) == 1.0
    lines, stored = ("hysteresis", "supply_droop"), ("hysteresis", "port_compliance_a")
    assert cost(()) < cost(lines) < cost(stored) < cost((*lines, *stored))
    dear = ("throttle_heating", "pressure_clearance")
    assert cost(("pressure_clearance", *lines)) < cost((*lines, *dear)) < cost((*lines, *stored, *dear))
