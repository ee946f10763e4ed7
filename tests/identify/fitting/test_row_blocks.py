"""Blocks of rows give what one program of the whole record gives, whatever the record has and lacks, and share programs."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_compile
from helpers.small_bench import small_record

from thermohyd.identify.bench.test_record import Nodes, TestRecord
from thermohyd.identify.fitting import row_blocks, tied_rows
from thermohyd.identify.fitting.library import library_for
from thermohyd.identify.fitting.library_rows import LibraryArgs, filtered, residual_alone, rowwise_valve, split
from thermohyd.identify.fitting.parameters import PARAMETERS, plan_parameters
from thermohyd.identify.fitting.readings import Noise, StaticReadings
from thermohyd.identify.fitting.static_readings import groups_of, predict_group, spread_over_rows
from thermohyd.identify.fitting.tied_rows import FILLED_UP, blocked_tests, of_tests
from thermohyd.identify.noise.correlation import NoiseCorrelation
from thermohyd.identify.noise.whitening import whiten


RECORD = small_record(seed=3)


def without_time(test: TestRecord) -> TestRecord:
    return replace(test, time=None, rate=None)


def reduced(test: TestRecord) -> TestRecord:
    """As if each row were a mean over two nodes."""
    half = np.array([[-0.5, 0.5]])
    weight = np.full((test.rows, 2), 0.5)
    return replace(
        test, nodes=Nodes(half * 1e-7 + np.zeros((test.rows, 1)), 0.01 * half + np.zeros((test.rows, 1)), weight)
    )


def longer(test: TestRecord) -> TestRecord:
    """Three times the rows: more than one block."""
    thrice = lambda column: np.concatenate([column] * 3)
    channels = tuple(replace(c, value=thrice(c.value), std=thrice(c.std)) for c in test.channels)
    names = ("spool_position", "supply_pressure", "return_pressure", "temperature", "run", "direction", "time", "rate")
    columns = {name: thrice(getattr(test, name)) for name in names}
    return replace(test, channels=channels, **columns)


CHANGES = {"as it is": lambda test: test, "without time": without_time, "reduced": reduced, "longer": longer}


def readings_of(change) -> StaticReadings:
    tests = {name: change(test) for name, test in RECORD.tests.items()}
    std = {(t.name, c.name): c.std for t in tests.values() for c in t.channels}
    used = {key: np.arange(len(value)) % 5 > 0 for key, value in std.items()}
    noise = Noise(std, {key: NoiseCorrelation(share=0.6, phi=0.5) for key in std})
    plans = plan_parameters(RECORD.valve, RECORD.start)
    return StaticReadings(RECORD, tests, plans, library_for(tests.values()), noise, used, ())


def point(readings: StaticReadings, program: tuple[str, ...], amounts: dict[str, float]) -> np.ndarray:
    order = readings.order(program)
    return np.array([readings.plans[n].start if n in PARAMETERS else amounts.get(n, 0.0) for n in order])


def whole_program(program: tuple[str, ...], p: np.ndarray, args: LibraryArgs) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and columns of all rows at once, by forward mode."""
    filters = split(program)[1]
    given = len(p) - len(filters)

    def residual(p):
        found, parts = {}, []
        spread = spread_over_rows(p[:given], args.data.conditions)
        for group, tests in groups_of(args.data.conditions).items():
            valve = rowwise_valve(program, group, spread[group], args)
            found |= predict_group(valve, group, tests, args.data.conditions)
        for whitening, channel in zip(args.whitening, args.data.channels, strict=True):
            reading = found[channel.test][channel.reads]
            for name, amount in zip(filters, p[given:], strict=True):
                reading, _ = filtered(name, amount, channel, reading, jnp.zeros((0, len(reading))), args)
            parts.append(whiten(whitening, (args.data.means(channel.test, reading) - channel.value) * channel.weight))
        return jnp.concatenate(parts)

    with quick_compile():
        found = jax.jit(lambda p: (residual(p), jax.jacfwd(residual)(p).T))(jnp.asarray(p))
    return np.asarray(found[0]), np.asarray(found[1])


def test_terms_that_are_all_one_value_are_shared_and_need_no_program_of_their_own():
    """A weak type would be another program; blocks with and without terms have the same."""
    constant, varied = np.ones((2, 3)), np.arange(6.0).reshape(2, 3)
    laid_out = [row_blocks._on_device(values) for values in (constant, constant.copy(), varied)]
    assert laid_out[0] is laid_out[1]
    for values, array in zip((constant, constant, varied), laid_out, strict=True):
        assert np.array_equal(array, values)
        assert (array.dtype, array.weak_type) == (np.float64, False)


@pytest.mark.parametrize("change", CHANGES)
def test_residuals_and_columns_are_those_of_one_program(change):
    readings = readings_of(CHANGES[change])
    program = readings.program(())
    amounts = {"position_scale": 0.01, "flowmeter_lag": 0.2, "thermal_clearance": 1e-9}
    p = point(readings, program, amounts)
    residual, columns = readings.evaluation(program)(p)
    whole, whole_columns = whole_program(program, p, readings.arguments(program))
    size = np.abs(whole_columns).max(axis=1, keepdims=True) + 1e-300
    np.testing.assert_allclose(residual, whole, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.asarray(columns) / size, whole_columns / size, atol=1e-9)


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("lag", [0.0, 0.2])
def test_some_columns_are_those_of_all_of_them(change, lag):
    """A search asks for those of its free variables; a filter at 0 leaves readings and slopes as they are, to the last bit."""
    readings = readings_of(CHANGES[change])
    program = readings.program(())
    order = readings.order(program)
    if "flowmeter_lag" not in order and lag:
        pytest.skip("without time a lag is not asked for")
    p = point(readings, program, {"position_scale": 0.01, "flowmeter_lag": lag})
    residual, columns = readings.evaluation(program)(p)
    whole = np.asarray(columns)
    evaluated = readings._evaluated(program, p)
    assert np.array_equal(residual, evaluated.whole[0])
    assert np.array_equal(whole, evaluated.whole[1])
    for numbers in ([0, 3], [order.index("position_scale"), 1], [len(order) - 1, 2], []):
        assert np.array_equal(columns[np.array(numbers, dtype=int)], whole[numbers])


def test_records_share_their_programs(monkeypatch):
    readings = readings_of(CHANGES["as it is"])
    readings.evaluation(readings.program(()))(point(readings, readings.program(()), {}))
    monkeypatch.setattr(row_blocks, "jitted", None)  # would raise
    for change in ("without time", "longer", "reduced"):
        other = readings_of(CHANGES[change])
        program = other.program(())
        other.evaluation(program)(point(other, program, {}))


# The steps between rows are given out among the rows of a program: among a test's own, or among those of all blocked tests.
OF_THE_STEPS = 1e-3
# Pressures are found to some 1e-6 of the supply; forward mode differentiates the step that found them, the columns the next one.
OF_THE_SEARCH = 1e-4


@pytest.mark.parametrize("change", ["as it is", pytest.param("reduced", marks=pytest.mark.nightly)])
def test_stored_oil_test_by_test_is_that_of_one_program(change):
    readings = readings_of(CHANGES[change])
    program = readings.program(("port_compliance_a",))
    amounts = {"port_compliance_a": 2e-12, "position_scale": 0.01, "flowmeter_lag": 0.2}
    p = point(readings, program, amounts)
    residual, columns = readings.evaluation(program)(p)
    args = readings.arguments(program)
    whole = np.asarray(jax.jit(lambda p: residual_alone(program, p, args))(jnp.asarray(p)))
    np.testing.assert_allclose(residual, whole, rtol=0.0, atol=OF_THE_STEPS * np.abs(whole).max())
    first = 0
    for test in args.data.conditions:  # one channel each
        own, own_columns = whole_program(program, p, of_tests(args, (test,)))
        rows = slice(first, first := first + len(own))
        size = np.abs(own_columns).max(axis=1, keepdims=True) + 1e-12  # below is rounding
        np.testing.assert_allclose(residual[rows], own, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(np.asarray(columns)[:, rows] / size, own_columns / size, atol=OF_THE_SEARCH)
    assert first == len(residual)


def test_blocked_tests_of_similar_length_share_a_program_of_stored_oil(monkeypatch):
    """And whatever is read of them; one that is much longer has its own."""
    tests = {"leakage": longer(longer(RECORD.tests["leakage"])), "pressure_gain": longer(RECORD.tests["pressure_gain"])}
    sizes = lambda rows: [rows.stored.blocks[name][0].data.conditions["leakage"].position.shape[0] for name in tests]
    readings = readings_of(lambda test: tests.get(test.name, test))
    program = readings.program(("port_compliance_a",))
    laid_out = readings._blocks(program)
    longest, shorter = (len(readings.arguments(program).data.conditions[name].position) for name in tests)
    assert longest > FILLED_UP * shorter
    assert sizes(laid_out) == [longest, shorter]
    monkeypatch.setattr(tied_rows, "FILLED_UP", longest / shorter)
    filled = readings_of(lambda test: tests.get(test.name, test))
    together = filled._blocks(program)
    assert sizes(together) == [longest, longest]
    p = point(readings, program, {"port_compliance_a": 2e-12})
    before, after = (blocks.at(p).residuals for blocks in (laid_out, together))
    np.testing.assert_allclose(after, before, rtol=0.0, atol=OF_THE_STEPS * np.abs(before).max())


def test_what_oil_would_store_is_found_test_by_test():
    readings = readings_of(CHANGES["as it is"])
    amounts = {"port_compliance_a": 1e-12, "port_compliance_b": 0.0}
    program = tuple(name for name in readings.program(tuple(amounts)) if name not in amounts)
    storing = (*program, *amounts)
    p = point(readings, storing, {**amounts, "thermal_clearance": 1e-9})
    found = readings.storage(lambda order: point(readings, program, {"thermal_clearance": 1e-9}), (), amounts)
    args = readings.arguments(program)
    order = readings.order(storing)
    first = 0
    for test in args.data.conditions:  # one channel each
        rows = slice(first, first := first + len(args.data.conditions[test].position))
        if test not in blocked_tests(args):
            assert not np.any(found[0][rows])
            continue
        own, own_columns = whole_program(storing, p, of_tests(args, (test,)))
        own_columns = own_columns[[order.index(name) for name in amounts]]
        for mine, other in zip(found, (own, own_columns), strict=True):
            np.testing.assert_allclose(mine[..., rows], other, rtol=1e-7, atol=1e-7 * np.abs(other).max())
