"""Programs on disk: another process takes them without tracing, and whatever decides a program is part of what it is kept under."""

import os
import pickle
import subprocess
import sys
import threading
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.valves import seed_valve

from thermohyd import kept_programs, own_files
from thermohyd.kept_programs import KeptProgram, begin_work, keep_in, made_once
from thermohyd.numerics import linear_recursion
from thermohyd.own_effects import own_effects
from thermohyd.program_words import CannotKeepError, said


LEAST_TIME = "jax_persistent_cache_min_compile_time_secs"
KEEP, SOURCE = np.array([0.5, 0.25, 0.5]), np.array([1.0, 2.0, 3.0])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(kept_programs, "_folder", tmp_path)
    return tmp_path


def programs(folder):
    return sorted(file.name for file in folder.iterdir())


def words(thing) -> list[str]:
    return list(said(thing))


def test_what_was_compiled_once_is_read(folder, monkeypatch):
    want = np.asarray(linear_recursion(jnp.asarray(KEEP), jnp.asarray(SOURCE)))
    assert np.array_equal(KeptProgram(linear_recursion, {})(KEEP, SOURCE), want)
    (file,) = programs(folder)
    assert file.startswith("linear_recursion-")
    with monkeypatch.context() as within:
        within.setattr(kept_programs, "_compiled_and_kept", None)  # would raise
        again = KeptProgram(linear_recursion, {})
        assert np.array_equal(again(KEEP, SOURCE), want)
        assert np.array_equal(
            again.bound(KEEP, SOURCE)(2.0 * KEEP), linear_recursion(2.0 * jnp.asarray(KEEP), jnp.asarray(SOURCE))
        )
    (folder / file).write_bytes((folder / file).read_bytes()[:500])
    assert np.array_equal(KeptProgram(linear_recursion, {})(KEEP, SOURCE), want)
    assert programs(folder) == [file]
    assert (folder / file).stat().st_size > 500


class Planted:
    """Its pickle makes a folder where it is read."""

    def __init__(self, made):
        self.made = made

    def __reduce__(self):
        return os.mkdir, (str(self.made),)


@pytest.mark.parametrize("mode", [0o600, 0o620, 0o602])
def test_a_planted_pickle_is_not_run(folder, tmp_path, monkeypatch, capsys, mode):
    monkeypatch.setattr(own_files, "_said", False)
    want = np.asarray(KeptProgram(linear_recursion, {})(KEEP, SOURCE))
    (name,) = programs(folder)
    planted = zlib.compress(pickle.dumps(Planted(tmp_path / "run")))
    (folder / name).write_bytes(planted)
    (folder / name).chmod(mode)
    for _ in range(2):
        assert np.array_equal(KeptProgram(linear_recursion, {})(KEEP, SOURCE), want)
    assert programs(folder) == [name]  # nothing was made beside it
    warning = capsys.readouterr().err
    if mode == 0o600:  # the user's own, and no program: compiled anew
        assert warning == ""
        assert (folder / name).read_bytes() != planted
    else:
        assert warning.count("\n") == 1
        assert f"{folder / name} is not this user's, or others may write to it; remove it" in warning
        assert (folder / name).read_bytes() == planted
        assert kept_programs._folder is None


def test_a_folder_that_others_may_write_to_keeps_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(own_files, "_said", False)
    monkeypatch.setattr(kept_programs, "_folder", None)
    tmp_path.chmod(0o777)
    keep_in(tmp_path)
    KeptProgram(linear_recursion, {})(KEEP, SOURCE)
    assert programs(tmp_path) == []
    assert "others may write to" in capsys.readouterr().err


def test_what_unpacks_to_more_than_the_largest_program_is_refused(folder, monkeypatch):
    monkeypatch.setattr(kept_programs, "LARGEST", 1000)
    (folder / "large").write_bytes(zlib.compress(bytes(10_000)))
    (folder / "longer").write_bytes(bytes(1001))
    for name in ("large", "longer"):
        with pytest.raises(ValueError, match=r"too large|more than"):
            kept_programs._read(folder / name)


def test_of_several_threads_one_compiles_a_program(folder, monkeypatch):
    made, compiled = [], kept_programs._compiled_and_kept

    def counted(*given):
        made.append(threading.get_ident())
        return compiled(*given)

    monkeypatch.setattr(kept_programs, "_compiled_and_kept", counted)
    usual = getattr(jax.config, LEAST_TIME)
    program = KeptProgram(linear_recursion, {})
    want = np.asarray(linear_recursion(jnp.asarray(KEEP), jnp.asarray(SOURCE)))
    with ThreadPoolExecutor(3) as pool:
        for found in pool.map(lambda _: program(KEEP, SOURCE), range(6)):
            assert np.array_equal(found, want)
        assert len(made) == 1
        # Several, one after another: JAX's own cache is kept out of each, and no longer.
        sizes = [4, 5, 6, 4, 5, 6]
        assert [len(found) for found in pool.map(lambda n: program(np.ones(n), np.ones(n)), sizes)] == sizes
    assert len(made) == 4
    assert getattr(jax.config, LEAST_TIME) == usual


def test_what_several_threads_ask_for_is_made_once():
    made, all_there = [], threading.Barrier(3, timeout=60.0)

    @made_once
    def make(name: str) -> object:
        made.append(name)
        return object()

    def ask(name: str) -> object:
        all_there.wait()
        return make(name)

    with ThreadPoolExecutor(3) as pool:
        assert len(set(pool.map(ask, ["a"] * 3))) == 1
        assert len(set(pool.map(ask, ["a", "b", "b"]))) == 2
    assert made == ["a", "b"]


def test_what_is_on_disk_and_does_not_run_is_made_anew(folder, monkeypatch):
    want = np.asarray(KeptProgram(linear_recursion, {})(KEEP, SOURCE))
    (file,) = programs(folder)
    before = (folder / file).read_bytes()

    def unsound(*_):
        def run(arrays):
            raise RuntimeError("NOT_FOUND: Function fusion not found")

        return run

    monkeypatch.setattr(kept_programs, "_callable", unsound)
    program = KeptProgram(linear_recursion, {})
    (folder / file).write_bytes(before)
    assert np.array_equal(program(KEEP, SOURCE), want)
    assert np.array_equal(program(KEEP, SOURCE), want)
    assert programs(folder) == [file]


def test_what_is_longest_unused_goes_and_is_read_again(folder, monkeypatch):
    """However many programs a process needs, it has no more loaded than there is room for."""
    loaded = kept_programs._Loaded()
    monkeypatch.setattr(kept_programs, "_loaded", loaded)
    program = KeptProgram(linear_recursion, {})
    bound = program.bound(KEEP[:2], SOURCE[:2])
    want = [np.asarray(program(KEEP[:n], SOURCE[:n])) for n in (1, 2, 3)]
    assert len(loaded.programs) == 3
    loaded.room = sum(each.size for each in loaded.programs) - 1
    program(KEEP[:1], SOURCE[:1])
    assert len(loaded.programs) == 2
    loaded.room = 0
    with monkeypatch.context() as within:
        within.setattr(kept_programs, "_compiled_and_kept", None)  # would raise
        for n in (3, 2, 1):
            assert np.array_equal(program(KEEP[:n], SOURCE[:n]), want[n - 1])
            assert len(loaded.programs) == 1
        assert np.array_equal(bound(KEEP[:2]), want[1])
        while not loaded.room:  # read again and again: there must be room for it
            for n in (1, 2, 3):
                program(KEEP[:n], SOURCE[:n])
        kept = [each for each in program.kept.values() if each is not None]
        assert max(each.reads for each in kept) == kept_programs.MOST_READS + 1
        begin_work()  # another record: what went round in the last one has no more room than any other
        assert loaded.room == kept_programs.MOST_LOADED
        loaded.room = 0
        for n in (1, 2, 3) * kept_programs.MOST_READS:
            program(KEEP[:n], SOURCE[:n])
        assert loaded.room == 0
        assert len(loaded.programs) == 1
    for file in folder.iterdir():
        file.unlink()
    for each in kept:
        each.run = None
    assert np.array_equal(program(KEEP, SOURCE), want[2])
    assert len(programs(folder)) == 1


def test_what_decides_a_program_decides_its_name(folder):
    KeptProgram(linear_recursion, {})(KEEP, SOURCE)
    KeptProgram(linear_recursion, {})(KEEP[:2], SOURCE[:2])
    KeptProgram(linear_recursion, {"xla_llvm_disable_expensive_passes": True})(KEEP, SOURCE)
    KeptProgram(linear_recursion, {}, (int,))(KEEP, SOURCE)
    assert len(programs(folder)) == 4
    assert len({tuple(words(thing)) for thing in (1, True, 1.0, "1", b"1", 0.0, -0.0, (1,), [1])}) == 9
    assert words({2, 1}) == words({1, 2})
    valve = seed_valve()
    assert words(valve) == words(seed_valve()) != words(replace(valve, underlap=2.0 * valve.underlap))


def test_within_a_derivative_it_is_an_ordinary_function(folder):
    program = KeptProgram(linear_recursion, {})
    slope = jax.grad(lambda source: program(jnp.asarray(KEEP), source)[-1])(jnp.asarray(SOURCE))
    np.testing.assert_allclose(slope, [0.125, 0.5, 1.0])
    assert programs(folder) == []


def test_what_has_no_words_is_compiled_and_not_kept(folder):
    program = KeptProgram(lambda a, b: a + b, {})  # no function of ours: its source may change while its name stays
    assert np.array_equal(program(KEEP, SOURCE), KEEP + SOURCE)
    assert np.array_equal(program.bound(KEEP, SOURCE)(SOURCE), 2.0 * SOURCE)
    with pytest.raises(CannotKeepError):
        words(object())
    assert programs(folder) == []


def test_nothing_is_kept_beside_effects_of_the_users_own(folder):
    own_effects.add("mine")
    try:
        KeptProgram(linear_recursion, {})(KEEP, SOURCE)
        KeptProgram(linear_recursion, {}).bound(KEEP, SOURCE)(KEEP)
    finally:
        own_effects.discard("mine")
    assert programs(folder) == []


def test_another_process_takes_it_and_finds_lapack(tmp_path):
    """Names hash otherwise there, and nothing has been lowered that calls LAPACK."""
    code = (
        "import sys, pathlib, jax, numpy as np\n"
        "jax.config.update('jax_enable_x64', True)\n"
        "from thermohyd.kept_programs import KeptProgram, keep_in\n"
        "keep_in(pathlib.Path(sys.argv[1]))\n"
        "solve = KeptProgram(jax.numpy.linalg.solve, {})\n"
        "print(solve(np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([3.0, 4.0])).tolist())"
    )
    for seed in ("1", "2"):
        ran = subprocess.run(
            [sys.executable, "-P", "-c", code, str(tmp_path)],
            check=True,
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        )
        np.testing.assert_allclose(eval(ran.stdout), [1.0, 1.0])
        assert len(programs(tmp_path)) == 1
