"""Work done at the same time gives what it gives one after another: answers, their order, errors; settings come along."""

import threading

import jax
import jax.numpy as jnp
import pytest

from thermohyd.side_by_side import MOST_THREADS, LastAsked, by_name, each, threads


DEVICE = "jax_default_device"


@pytest.fixture
def three(monkeypatch):
    monkeypatch.setenv("NPROC", "3")


def test_so_many_at_a_time_as_the_process_may_use_cores(monkeypatch):
    monkeypatch.setenv("NPROC", "3")
    assert threads() == 3
    monkeypatch.setenv("NPROC", "500")
    assert threads() == MOST_THREADS
    monkeypatch.delenv("NPROC")
    assert 1 <= threads() <= MOST_THREADS


def test_answers_come_in_the_order_of_the_items(three):
    met = threading.Barrier(3, timeout=60.0)  # none gets by before three are under way

    def ask(number: int) -> tuple[int, int]:
        met.wait()
        return number, threading.get_ident()

    found = each(ask, range(6))
    assert [number for number, _ in found] == list(range(6))
    assert threading.get_ident() not in {thread for _, thread in found}


@pytest.mark.parametrize(("cores", "items"), [("1", 5), ("3", 1), ("3", 0)])
def test_one_core_or_one_item_needs_no_thread(monkeypatch, cores, items):
    monkeypatch.setenv("NPROC", cores)
    assert each(lambda _: threading.get_ident(), range(items)) == [threading.get_ident()] * items


def test_within_such_work_one_after_another(three):
    inner = each(lambda _: (threading.get_ident(), each(lambda _: threading.get_ident(), range(4))), range(3))
    assert all(set(within) == {outer} for outer, within in inner)
    # And of one item alone what is within it may still be done at the same time.
    assert threading.get_ident() not in each(lambda _: each(lambda _: threading.get_ident(), range(4)), [0])[0]


def test_an_error_of_any_is_raised_and_what_waits_is_not_begun(three):
    begun = []

    def ask(number: int) -> int:
        begun.append(number)
        if number == 1:
            raise ValueError("of the second")
        threading.Event().wait(0.05)
        return number

    with pytest.raises(ValueError, match="of the second"):
        each(ask, range(200))
    assert len(begun) < 200


def test_settings_of_the_callers_own_thread_hold_there_too(three):
    with jax.enable_x64(False):
        assert {str(kind) for kind in each(lambda _: jnp.zeros(1).dtype, range(3))} == {"float32"}
    with jax.default_device(jax.devices()[0]):
        assert each(lambda _: getattr(jax.config, DEVICE), range(3)) == [jax.devices()[0]] * 3
    assert {str(kind) for kind in each(lambda _: jnp.zeros(1).dtype, range(3))} == {"float64"}


def test_answers_by_name(three):
    assert list(by_name(str.upper, iter("cab")).items()) == [("c", "C"), ("a", "A"), ("b", "B")]


def test_what_a_thread_asked_last_is_its_own(three):
    last, made = LastAsked(), []

    def ask(number: int) -> list[int]:
        work_out = lambda: made.append(number) or number
        return [last.of(number, work_out), last.of(number, work_out)]

    assert each(ask, [1, 2, 3]) == [[1, 1], [2, 2], [3, 3]]
    assert sorted(made) == [1, 2, 3]
    assert [last.of(key, lambda key=key: key) for key in (1, 2, 1)] == [1, 2, 1]
