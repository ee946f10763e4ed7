"""What a compiled program loses on its way to disk is what nothing reads: it answers as before, bit by bit, or it is kept whole."""

import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, strategies as st
from jax.experimental import serialize_executable

from thermohyd import kept_programs
from thermohyd.kept_programs import KeptProgram
from thermohyd.lean_executables import BYTES, FIXED32, FIXED64, VARINT, _fields, _message, lean, without_fused_bodies
from thermohyd.numerics import linear_recursion


X = np.linspace(0.1, 2.0, 300)
numbers = st.integers(1, 2**29 - 1)
field = st.one_of(
    st.tuples(numbers, st.just(VARINT), st.integers(0, 2**64 - 1)),
    st.tuples(numbers, st.just(BYTES), st.binary(max_size=300)),
    st.tuples(numbers, st.just(FIXED64), st.binary(min_size=8, max_size=8)),
    st.tuples(numbers, st.just(FIXED32), st.binary(min_size=4, max_size=4)),
)


def loops(x):
    """Fused loops, a loop of some steps, sums and what sorts."""
    found = jnp.sqrt(x) * jnp.exp(-x) + jnp.tanh(3.0 * x)
    stepped = jax.lax.fori_loop(0, 7, lambda _, y: 0.5 * (y + x / y), jnp.ones_like(x))
    return [jnp.sort(found), stepped, jnp.sum(found * stepped), linear_recursion(found / 3.0, stepped)]


@pytest.fixture(scope="module")
def written():
    """Compiled anew: what comes from JAX's cache cannot be written."""
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        compiled = jax.jit(loops).lower(X).compile()
    finally:
        jax.config.update("jax_enable_compilation_cache", True)
    return serialize_executable.serialize(compiled)


def test_it_answers_bit_by_bit_what_the_whole_one_does(written):
    whole, takes, gives = written
    short = lean(whole)
    assert len(short) < 0.9 * len(whole)
    answers = [serialize_executable.deserialize_and_load(one, takes, gives)(X) for one in (whole, short)]
    for one, other in zip(*answers, strict=True):
        assert np.asarray(one).tobytes() == np.asarray(other).tobytes()
    np.testing.assert_allclose(answers[1][1], np.sqrt(X), rtol=1e-6)
    assert lean(short) == lean(lean(short))  # nothing more goes


def test_one_body_of_a_fused_loop_stays(written):
    """By its operations XLA tells that a program is worth a thread of its own."""

    def modules(executable):
        return str(serialize_executable.deserialize_and_load(executable, *written[1:]).as_text())

    def bodies(module):
        return sum(line.startswith("%fused_computation") for line in module.splitlines())

    whole, short = modules(written[0]), modules(lean(written[0]))
    assert bodies(whole) > 5
    assert bodies(short) == 1
    assert short.count(" while(") == whole.count(" while(") > 0


def test_it_runs_beside_its_caller(tmp_path, monkeypatch):
    """XLA runs what it takes for trifles while the caller waits, and blocks of rows would no longer run side by side."""
    monkeypatch.setattr(kept_programs, "_folder", tmp_path)
    program, many = KeptProgram(jnp.sinh, {}), jnp.linspace(0.1, 2.0, 1_000_000)
    jax.block_until_ready(program(many))
    begun = [program(many) for _ in range(20)]
    assert not begun[-1].is_ready()
    jax.block_until_ready(begun)


@given(st.lists(field, max_size=20))
def test_fields_are_handed_on_as_they_were(fields):
    assert list(_fields(_message(fields))) == fields


@given(st.binary(max_size=200))
def test_what_is_no_executable_is_refused(anything):
    with pytest.raises(ValueError, match=r"field|number"):
        without_fused_bodies(anything)


@pytest.mark.parametrize("broken", ["an error", "another answer"])
def test_a_program_that_would_answer_otherwise_is_kept_whole(tmp_path, monkeypatch, broken):
    monkeypatch.setattr(kept_programs, "_folder", tmp_path)
    other = []

    def changed(executable):
        if broken == "an error":
            raise ValueError("no field 3 where XLA writes one")
        other.append(executable)
        return other[0]  # the program of the first shape or function that was asked

    monkeypatch.setattr(kept_programs, "lean", changed)
    programs = [KeptProgram(function, {}) for function in (jnp.sinh, jnp.cosh)]
    answers = [np.asarray(program(X)) for program in programs]
    np.testing.assert_allclose(answers, [np.sinh(X), np.cosh(X)], rtol=1e-14)
    assert len(list(tmp_path.iterdir())) == 2
    for function, answer in zip((jnp.sinh, jnp.cosh), answers, strict=True):
        assert np.array_equal(KeptProgram(function, {})(X), answer)  # read from disk


def test_what_sorts_is_kept(tmp_path, monkeypatch):
    """XLA cannot write a program that has sorted once."""
    monkeypatch.setattr(kept_programs, "_folder", tmp_path)
    assert np.array_equal(KeptProgram(jnp.sort, {})(X[::-1]), X)
    (file,) = tmp_path.iterdir()
    assert len(kept_programs._read(file)[0]) > 1000
    with monkeypatch.context() as within:
        within.setattr(kept_programs, "_compiled_and_kept", None)  # would raise
        assert np.array_equal(KeptProgram(jnp.sort, {})(X[::-1]), X)


def test_it_is_written_as_it_was_read():
    """A field that nobody knows stays where it was."""
    body = lambda number, size: (
        3,
        BYTES,
        _message([(2, BYTES, _message([(1, BYTES, b"x")]))] * size + [(5, VARINT, number), (7, VARINT, 1)]),
    )
    call = lambda number: _message(
        [(1, BYTES, b"name"), (2, BYTES, b"fusion"), (9, BYTES, b"?"), (38, BYTES, bytes([number]))]
    )
    gone = _message([(1, BYTES, b"name"), (2, BYTES, b"custom-call"), (28, BYTES, b"a fused loop")])
    main = lambda *calls: (3, BYTES, _message([*((2, BYTES, c) for c in calls), (5, VARINT, 1), (77, VARINT, 3)]))
    first, last = (1, BYTES, b"a module"), (98, FIXED32, b"1234")
    inner = _message([first, body(2, 3), (99, VARINT, 7), body(3, 5), main(call(2), call(3)), last])
    executable = _message([(1, BYTES, _message([(1, BYTES, inner)])), (5, VARINT, 2)])
    head = pickle.dumps("JAX's own")
    assert len(head) < 128
    whole = bytes([len(head)]) + head + _message([(1, BYTES, executable)])
    without = _message([first, (99, VARINT, 7), body(3, 5), main(gone, call(3)), last])
    want = _message([(1, BYTES, _message([(1, BYTES, _message([(1, BYTES, without)])), (5, VARINT, 2)]))])
    assert without_fused_bodies(whole) == bytes([len(head)]) + head + want
