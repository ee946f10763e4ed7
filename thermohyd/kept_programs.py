"""Compiled programs that outlive their process: what was compiled once is not even traced again.

JAX's own cache keeps what XLA made, under a key that only tracing and lowering yield: three quarters of the time that a process
takes whose programs are all in it. Here a program is kept under what decides it before any tracing: the function, everything in its
arguments that is no array, the shapes of the arrays, the source of this library, the releases and the processor. Where one of
these cannot be put into words that mean the same in another process, nothing is kept and the program is compiled as always.

Off until `keep_in` names a folder: the command line does that, importing the library never. Off, too, while an effect of the user's
own is in the library: what its code stands on is not known here.
"""

import ctypes
import dataclasses
import functools
import hashlib
import json
import os
import tempfile
import threading
import weakref
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jax.experimental import serialize_executable

from .kept_answers import Place, answering, in_words, of_words
from .lean_executables import lean
from .own_effects import own_effects
from .own_files import NotOwnError, check_own_folder, read_own_file, say_not_own
from .program_words import CannotKeepError, said, surroundings


ENDING = ".program"
# A process has no more than this of them loaded at a time; what is longest unused is read again when it is needed, in a sixteenth of a
# second for each megabyte. Loaded, XLA's structures take some ten times what the file holds before it is compressed (measured with
# jaxlib 0.10). A diagnosis of three static tests needs 15 MB of them in all, one of a bench's logs up to 25.
MOST_LOADED = 24 * 1000**2  # bytes
LARGEST = 64 * 1024**2  # bytes of one, before it is compressed and after: those of a diagnosis have 15 MB in all
# What is read more often in one piece of work (`begin_work`) is part of a larger round: from then on there is room for it beside the
# others.
MOST_READS = 3

_changing = threading.Lock()  # of what several threads may change: which programs there are, and which are loaded
_compiling = threading.RLock()  # one program at a time: a large one takes a gigabyte
_folder: Path | None = None
_programs: "weakref.WeakSet[KeptProgram]" = weakref.WeakSet()


def keep_in(folder: Path | None) -> None:
    """Keep compiled programs in a folder which is there; None: keep none. What lies there is run as code: in a folder that is not the
    user's own (`own_files`) none are kept, with a warning on stderr."""
    global _folder
    try:
        if folder is not None:
            check_own_folder(folder)
    except NotOwnError as error:
        say_not_own(error)
        folder = None
    _folder = folder


def forget() -> None:
    """Let the programs of this process go; those on disk stay."""
    global _loaded
    for program in _programs:
        program.kept.clear()
        program.unkept.clear()
    for loaded in _loaded.programs:  # what is bound may hold it still
        loaded.run = None
    _loaded = _Loaded()


def begin_work() -> None:
    """Say that another piece of work begins, such as another record: what went round in the last one has no more room than any other.

    Over dozens of records every program is read often in the end, and all would stay: a process that diagnosed 27 had 1.9 GB.
    """
    _loaded.room = MOST_LOADED
    for program in _loaded.read:
        program.reads = 0
    _loaded.read.clear()


def give_memory_back() -> None:
    """Return memory that is not in use to the system: compiling and loading leave hundreds of megabytes behind."""
    with suppress(OSError, AttributeError):  # another C library than glibc
        ctypes.CDLL("libc.so.6").malloc_trim(0)


def made_once[**Given, Made](make: Callable[Given, Made]) -> Callable[Given, Made]:
    """`functools.cache` that calls a function once for each of its arguments, whichever threads ask at the same time: of two programs
    of one function each would be compiled. The arguments come by position."""
    kept, making = functools.cache(make), threading.RLock()

    @functools.wraps(kept)
    def asked(*args: Given.args, **kwargs: Given.kwargs) -> Made:
        with making:
            return kept(*args, **kwargs)

    return asked


class KeptProgram:
    """A function compiled for every set of shapes and of what is no array among its arguments, as `equinox.filter_jit` does.

    options: of XLA. stands_on: classes and the like which decide what the function does and are none of its arguments. Within
    another compiled function or a derivative, and where no folder is named, it is `equinox.filter_jit`'s.
    """

    def __init__(self, function: Callable, options: dict[str, Any], stands_on: tuple[Any, ...] = ()) -> None:
        functools.update_wrapper(self, function)
        filter_jit: Any = eqx.filter_jit  # its types do not know the keywords that it hands on to jax.jit
        self.plain = filter_jit(function, compiler_options=options) if options else filter_jit(function)
        self.function, self.options, self.stands_on = function, options, stands_on
        self.kept: dict[Any, _Program | None] = {}
        self.unkept: dict[Any, Callable] = {}
        _programs.add(self)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        if _folder is None or own_effects:
            return self.plain(*args, **kwargs)
        leaves, tree = jax.tree_util.tree_flatten((args, kwargs))
        if any(isinstance(leaf, Tracer) for leaf in leaves):
            return self.plain(*args, **kwargs)
        program = self._program(tree, leaves)
        return self.plain(*args, **kwargs) if program is None else program(list(filter(eqx.is_array, leaves)))

    def bound(self, first: Any, *others: Any) -> Callable[[Any], Any]:
        """What the function gives of another array like `first` beside the same other arguments, which are not looked at again."""
        leaves, tree = jax.tree_util.tree_flatten(((first, *others), {}))
        program = self._program(tree, leaves) if _folder is not None and not own_effects else None
        if program is None:
            key = _key(tree, leaves)
            if key not in self.unkept:
                self.unkept[key] = self._jitted(tree, leaves)
            program = self.unkept[key]
        there = lambda leaf: leaf if isinstance(leaf, jax.Array) else jax.numpy.asarray(leaf)
        rest = [there(leaf) for leaf in leaves[1:] if eqx.is_array(leaf)]
        return lambda value: program([value, *rest])

    def _jitted(self, tree: Any, leaves: list[Any]) -> Callable:
        flat, made = _flat(self.function, tree, leaves, 0)
        jitted = jax.jit(flat, compiler_options=self.options or None)

        def run(arrays: list[Any]) -> Any:
            found = jitted(arrays)
            return made["answered"](found)

        return run

    def _program(self, tree: Any, leaves: list[Any]) -> Callable | None:
        """What takes the arrays among these leaves; None where it cannot be kept."""
        try:
            key = _key(tree, leaves)
            hash(key)
        except TypeError:
            return None
        with _changing:
            if key not in self.kept:
                self.kept[key] = self._of_disk(tree, leaves)
            return self.kept[key]

    def _of_disk(self, tree: Any, leaves: list[Any]) -> "_Program | None":
        assert _folder is not None
        told = [_Shape.of(leaf) if eqx.is_array(leaf) else leaf for leaf in leaves]
        try:
            skeleton = jax.tree_util.tree_unflatten(tree, told)
            words = "\n".join((surroundings(), *said((self.function, self.options, self.stands_on, skeleton))))
        except CannotKeepError:
            return None
        file = _folder / f"{_name_of(self.function)}-{hashlib.sha256(words.encode()).hexdigest()}{ENDING}"
        return _Program(self.function, self.options, tree, told, file)


class _Program:
    """One program of this process, of a list of arrays: read from disk when it is needed, compiled and written there where it is not,
    and let go of when others were used since (`MOST_LOADED`). Of several threads one reads or compiles it, and the others wait."""

    def __init__(self, function: Callable, options: dict[str, Any], tree: Any, told: list[Any], file: Path) -> None:
        self.function, self.options, self.tree, self.told, self.file = function, options, tree, told, file
        self.run: Callable | None = None
        self.size = 0  # bytes of it as it is written; 0: it is not to be had from disk
        self.proven = False
        self.reads = 0
        self.making = threading.Lock()

    def __call__(self, arrays: list[Any]) -> Any:
        run = self.run
        if run is None:
            with self.making:
                run = self.run or self._read()
                if run is None:
                    return self._compiled(arrays)
        _loaded.use(self)
        if self.proven:
            return run(arrays)
        try:
            found = jax.block_until_ready(run(arrays))
        except Exception:  # whatever XLA calls what it cannot run
            self.file.unlink(missing_ok=True)
            with self.making:
                return self._compiled(arrays)
        self.proven = True
        return found

    def _read(self) -> Callable | None:
        try:
            executable, count, answer = _read(self.file)
            self.run = run = _callable(executable, count, answer)
        except NotOwnError as error:
            say_not_own(error)
            keep_in(None)
            return None
        except Exception:  # nothing there, cut short, or of a release that the words do not tell apart
            return None
        self.size = len(executable)
        with _changing:
            self.reads += 1
            _loaded.read.add(self)
            if self.reads > MOST_READS:
                _loaded.room += self.size
        return run

    def _compiled(self, arrays: list[Any]) -> Any:
        """What it answers, compiled; from then on it runs as it was kept, which takes an eighth of the memory."""
        with _compiling:
            found, self.run, self.size = _compiled_and_kept(
                self.function, self.options, self.tree, self.told, self.file, arrays
            )
        self.proven = True
        _loaded.use(self)
        give_memory_back()
        return found


class _Loaded:
    """The programs of this process that could be read again, the longest unused first."""

    def __init__(self) -> None:
        self.programs: dict[_Program, int] = {}  # and their sizes
        self.size = 0
        self.read: set[_Program] = set()  # in this piece of work
        self.room = MOST_LOADED

    def use(self, program: _Program) -> None:
        """It is the last to go; the longest unused go while there are more than there is room for."""
        if not program.size:
            return
        gone = False
        with _changing:
            self.size += program.size - self.programs.pop(program, 0)
            self.programs[program] = program.size
            while self.size > self.room and len(self.programs) > 1:
                longest_unused = next(iter(self.programs))
                self.size -= self.programs.pop(longest_unused)
                longest_unused.run = None
                gone = True
        if gone:
            give_memory_back()


_loaded = _Loaded()


def _name_of(function: Any) -> str:
    while isinstance(function, functools.partial):
        function = function.func
    return getattr(function, "__name__", "program")


@dataclasses.dataclass(frozen=True)
class _Shape:
    shape: tuple[int, ...]
    dtype: Any
    weak: bool

    @staticmethod
    def of(array: Any) -> "_Shape":
        return _Shape(array.shape, array.dtype, bool(getattr(array, "weak_type", False)))

    @property
    def traced(self) -> jax.ShapeDtypeStruct:
        return jax.ShapeDtypeStruct(self.shape, self.dtype, weak_type=self.weak)


def _key(tree: Any, leaves: list[Any]) -> Any:
    """Of a program in this process."""
    return tree, tuple(
        (leaf.shape, leaf.dtype, getattr(leaf, "weak_type", False)) if eqx.is_array(leaf) else (type(leaf), leaf)
        for leaf in leaves
    )


def _flat(function: Callable, tree: Any, leaves: list[Any], number: int) -> tuple[Callable, dict[str, Any]]:
    """The function of the arrays (or their shapes) among these leaves, which gives a list of arrays with this number behind them, and
    what says under "answer", once it was traced, where they stand, and under "answered" puts them there."""
    there = [eqx.is_array(leaf) or isinstance(leaf, _Shape) for leaf in leaves]
    fixed = [None if array else leaf for array, leaf in zip(there, leaves, strict=True)]
    made: dict[str, Any] = {}

    def flat(arrays: list[Any]) -> list[Any]:
        given = iter(arrays)
        args, kwargs = jax.tree_util.tree_unflatten(
            tree, [next(given) if array else leaf for array, leaf in zip(there, fixed, strict=True)]
        )
        out, out_tree = jax.tree_util.tree_flatten(function(*args, **kwargs))
        arrays_out = [value for value in out if eqx.is_array(value)]
        places = iter(range(len(arrays_out)))
        spoken = [Place(next(places)) if eqx.is_array(value) else value for value in out]
        made["answer"] = jax.tree_util.tree_unflatten(out_tree, spoken)
        made["answered"] = answering(made["answer"])
        return [*arrays_out, np.int64(number)]

    flat.__name__ = flat.__qualname__ = _name_of(function)
    return flat, made


def _compiled_and_kept(
    function: Callable, options: dict[str, Any], tree: Any, told: list[Any], file: Path, given: list[Any]
) -> tuple[Any, Callable, int]:
    """What a program answers to what is given, what runs from then on, and how large that is as it was written, 0 where it could not
    be. told: leaves, shapes where there are arrays."""
    # No other program has this number: what JAX reads from its own cache, XLA writes without its functions.
    flat, made = _flat(function, tree, told, int(file.stem[-15:], 16))
    arrays = [leaf.traced for leaf in told if isinstance(leaf, _Shape)]
    with _out_of_jax_cache():
        compiled = jax.jit(flat, compiler_options=options or None).lower(arrays).compile()
    answer, written, spoken, size = made["answer"], b"", None, 0
    # Written before it has run: what has sorted cannot be any more. Nor can a host callback, or an answer without words: this process
    # has the program all the same.
    with suppress(Exception):
        spoken = in_words(answer)
        written = serialize_executable.serialize(compiled)[0]
    found = jax.block_until_ready(compiled(given))
    answered = made["answered"]
    run: Callable = lambda arrays: answered(compiled(arrays))
    with suppress(Exception):
        if written and _folder is not None:  # it may have turned out to be another's
            shorter = _lean(written, len(arrays), answer, given, found)
            written, run = (written, run) if shorter is None else shorter
            _write(file, written, len(arrays), spoken)
            size = len(written)
    return answered(found), run, size


def _lean(written: bytes, count: int, answer: Any, given: list[Any], found: list[Any]) -> tuple[bytes, Callable] | None:
    """A program without what only a compiler reads, and what runs of it; None unless it answers what was found, bit by bit."""
    try:
        executable = lean(written)
        program, answered = _loadable(executable, count, answer)
        again = jax.block_until_ready(program(given))
    except Exception:  # whatever another release of JAX or XLA calls what it does not know
        return None
    same = all(np.asarray(a).tobytes() == np.asarray(b).tobytes() for a, b in zip(again, found, strict=True))
    return (executable, lambda arrays: answered(program(arrays))) if same else None


@contextmanager
def _out_of_jax_cache() -> Iterator[None]:
    """JAX keeps nothing of what is compiled within: it is kept here. The setting is the process's: one thread at a time."""
    name = "jax_persistent_cache_min_compile_time_secs"
    before = getattr(jax.config, name)
    jax.config.update(name, float("inf"))
    try:
        yield
    finally:
        jax.config.update(name, before)


def _callable(executable: bytes, count: int, answer: Any) -> Callable:
    """What takes a list of so many arrays and gives the answer with those that it has places for."""
    program, answered = _loadable(executable, count, answer)
    return lambda arrays: answered(program(arrays))


def _loadable(executable: bytes, count: int, answer: Any) -> tuple[Callable, Callable]:
    """(what takes a list of so many arrays, what makes the answer of those that it gives)."""
    _ready_for_what_lowering_readies()
    takes = jax.tree_util.tree_structure((([0] * count,), {}))
    places = sum(isinstance(leaf, Place) for leaf in jax.tree_util.tree_leaves(answer))
    gives = jax.tree_util.tree_structure([0] * (places + 1))
    return serialize_executable.deserialize_and_load(executable, takes, gives), answering(answer)


@functools.cache
def _ready_for_what_lowering_readies() -> None:
    """JAX finds LAPACK when it first lowers a call of it; a program that was not lowered here would call what is not there."""
    jax.jit(jax.numpy.linalg.cholesky).lower(jax.ShapeDtypeStruct((2, 2), float))


def _read(file: Path) -> tuple[bytes, int, Any]:
    """(executable, number of arrays that it takes, answer). Raises NotOwnError where others may have written it."""
    unpacking = zlib.decompressobj()
    head, _, executable = unpacking.decompress(read_own_file(file, LARGEST), LARGEST).partition(b"\n")
    if not unpacking.eof:
        raise ValueError("is cut short or too large")
    said = json.loads(head)
    with suppress(OSError):
        os.utime(file)  # the oldest go first
    return executable, int(said["arrays"]), of_words(said["answer"])


def _write(file: Path, executable: bytes, count: int, answer: Any) -> None:
    """A line of JSON and the executable, whole or not at all; another process may write the same."""
    content = json.dumps({"arrays": count, "answer": answer}).encode() + b"\n" + executable
    handle, name = tempfile.mkstemp(dir=file.parent, prefix=file.name)
    try:
        with os.fdopen(handle, "wb") as out:
            out.write(zlib.compress(content, 1))
        os.replace(name, file)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise
