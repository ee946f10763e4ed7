"""A fit's Jacobian where blocked ports store oil: every row by itself and a recursion, against forward mode; the meter's line."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from helpers.quick_compile import quick_compile
from helpers.small_bench import VALVE, conditions_only, record_of

from thermohyd.effects.edges import PortComplianceA
from thermohyd.effects.library import with_effects
from thermohyd.identify.fitting import tied_rows
from thermohyd.identify.fitting.library import library_for
from thermohyd.identify.fitting.library_rows import LibraryArgs, RowTerms, order_of, residual_alone
from thermohyd.identify.fitting.parameters import PARAMETERS
from thermohyd.identify.fitting.static_readings import (
    base_valve,
    conditions_of,
    group_rows,
    groups_of,
    predict,
    static_data,
)
from thermohyd.identify.fitting.tied_rows import TiedRows, of_tests, stored_beside
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.noise.whitening import whitening_of
from thermohyd.identify.reduction.monotone_pieces import run_ids


EFFECTS = ("viscosity_shift", "port_compliance_a", "port_compliance_b")
AMOUNTS = (0.02, 6e-13, 2e-13)
SIZE = {"leakage": 1e-7, "pressure_gain": 1e5}


def record():
    """Two slow cycles of each test; the leakage is read in the supply line."""
    tests = {
        "leakage": conditions_only("leakage", (1, 4), meter="supply"),
        "pressure_gain": conditions_only("pressure_gain", (1,)),
    }
    return record_of(tests)


def test_columns_against_forward_mode(monkeypatch):
    monkeypatch.setattr(tied_rows, "FILLED_UP", 1.0)  # the steps between rows are given out among a program's rows
    bench = record()
    std = {(name, test.channels[0].name): np.full(test.rows, SIZE[name]) for name, test in bench.tests.items()}
    data = static_data(bench.tests, std)
    assert [channel.reads for channel in data.channels] == ["supply_flow", "load_pressure"]
    groups = groups_of(data.conditions)
    rows = {group: group_rows(data.conditions, tests) for group, tests in groups.items()}
    one = {g: RowTerms(np.ones((7, n)), np.zeros((7, n)), np.ones(n)) for g, n in rows.items()}
    whitening = tuple(
        whitening_of(NoiseCorrelation(), run_ids(test), data.conditions[name].position.shape[0])
        for name, test in bench.tests.items()
    )
    values = {name: getattr(VALVE, name, 0.0) for name in PARAMETERS}
    valve = replace(base_valve(bench, values), heat_retention=None)
    args = LibraryArgs(valve, data, whitening, one)
    point = jnp.asarray([*values.values(), *AMOUNTS])
    assert order_of(EFFECTS) == (*PARAMETERS, *EFFECTS)

    def plainly(p):
        named = dict(zip(order_of(EFFECTS), p, strict=True))
        own = replace(valve, **{name: named[name] for name in PARAMETERS if name != "heat_retention"})
        own = with_effects(own, {name: named[name] for name in EFFECTS})
        found = {test: predict(own, {test: conditions})[test] for test, conditions in data.conditions.items()}
        return jnp.concatenate([(found[c.test][c.reads] - c.value) * c.weight for c in data.channels])

    counts = {name: len(conditions.position) for name, conditions in data.conditions.items()}
    tied = TiedRows.of(EFFECTS, args, counts)
    neutral = point.at[-2:].set(0.0)
    with quick_compile():
        residual, columns, by_row = tied.evaluate(np.asarray(point))
        before, of_none, _ = tied.evaluate(np.asarray(neutral))
        alone = tied.stored.residuals_alone(np.asarray(point), tuple(counts))
        by_itself = jax.jit(residual_alone, static_argnums=0)
        apart = [by_itself(EFFECTS, point, of_tests(args, (test,))) for test in counts]
        look = lambda c: stored_beside(
            EFFECTS[:1], dict(zip(EFFECTS[1:], c, strict=True)), np.asarray(point[:-2]), args, counts
        )
        seen, of_amounts = look(np.asarray(point[-2:]))
        seen_before, of_neutral = look(np.zeros(2))
        expected, slopes = jax.jit(lambda p: (plainly(p), jax.jacfwd(plainly)(p)))(point)
    largest = float(jnp.max(jnp.abs(expected)))
    np.testing.assert_allclose(residual, expected, atol=1e-6 * largest)
    np.testing.assert_allclose(np.concatenate([alone[test] for test in counts]), residual, atol=1e-9 * largest)
    np.testing.assert_allclose(np.concatenate(apart), residual, atol=1e-9 * largest)
    assert np.all(np.isnan(by_row))
    for name, own, other in zip(order_of(EFFECTS), columns, slopes.T, strict=True):
        size = float(jnp.max(jnp.abs(other)))
        assert np.all(np.isfinite(np.asarray(own)))
        np.testing.assert_allclose(own, other, atol=1e-6 * size if size else 1e-300, err_msg=name)

    # A search looks at stored oil without the program that fits it: the same readings and derivatives, at neutral and beyond.
    for own, other in ((seen, residual), (seen_before, before), (of_amounts, columns[-2:]), (of_neutral, of_none[-2:])):
        np.testing.assert_allclose(own, other, atol=1e-6 * float(jnp.max(jnp.abs(other))))
    assert float(np.max(np.abs(of_neutral))) > 0.0


def test_programs_with_and_without_storage():
    """Only who asks for storage waits for its program; heat and lines stay out of it as long as they may."""
    library = library_for(record().tests.values())
    assert "port_compliance_a" in library.names
    assert not {"port_compliance_a", "supply_droop"} & set(library.program(()))
    assert "port_compliance_a" not in library.program(("supply_droop",))
    stored = library.program(("port_compliance_a",))
    assert "port_compliance_b" in stored
    assert not {"cross_port_leakage", "throttle_heating"} & set(stored)
    timeless = [replace(test, time=None, rate=None) for test in record().tests.values()]
    assert "needs the column time" in library_for(timeless).impossible["port_compliance_a"]


def test_runs_of_two_tests_stay_apart():
    """Rows of the second test do not follow those of the first one."""
    bench = record()
    values = {name: getattr(VALVE, name) for name in PARAMETERS if name != "heat_retention"}
    # One step a row: where more go depends on all rows that are solved together.
    valve = eqx.tree_at(lambda v: v.effects, base_valve(bench, values), (PortComplianceA(6e-13, substeps=1),))
    conditions = {name: conditions_of(test) for name, test in bench.tests.items()}
    with quick_compile():
        both = predict(valve, conditions)
        alone = predict(valve, {"pressure_gain": conditions["pressure_gain"]})
    for channel, value in alone["pressure_gain"].items():
        np.testing.assert_allclose(both["pressure_gain"][channel], value, rtol=1e-9, atol=1e-9 * np.max(np.abs(value)))
