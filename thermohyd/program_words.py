"""What decides a compiled program, in words that mean the same in another process: its function, what is no array among its arguments,
the source of this library, the releases that it stands on, and the processor.
"""

import dataclasses
import enum
import functools
import hashlib
import importlib.metadata
import os
import platform
import sys
import types
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import jax
import numpy as np


PACKAGE = __name__.partition(".")[0]
# What a program's meaning stands on beside this library's source; their own code changes with their releases alone.
RELEASES = ("jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy", "jaxtyping", "blackjax")
TRUSTED = {PACKAGE, *RELEASES, "builtins", "functools", "operator", "math", "typing", "collections", "enum"}
SETTINGS = ("jax_enable_x64", "jax_numpy_dtype_promotion", "jax_default_matmul_precision", "jax_debug_nans")
# Packages that read, write, draw and decide: no code of theirs is in a program, or the program is not kept.
HOST_ONLY = {"app", "checking", "cli", "comparison", "diagnosis", "export", "fleet", "planning", "report"}


class CannotKeepError(Exception):
    """Something among a program's arguments has no words that mean the same in another process."""


@functools.cache
def _source(folder: Path) -> str:
    """Of all modules of this library that can have a part in a program."""
    digest = hashlib.sha256()
    for file in sorted(folder.rglob("*.py")):
        if set(file.relative_to(folder).parts) & HOST_ONLY:
            continue
        digest.update(str(file.relative_to(folder)).encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


@functools.cache
def _of_this_machine() -> str:
    """This library, the releases that it stands on, and the processor for which XLA compiles."""
    releases = []
    for name in RELEASES:
        with suppress(importlib.metadata.PackageNotFoundError):
            releases.append(f"{name} {importlib.metadata.version(name)}")
    processor = f"{platform.machine()} {os.cpu_count()}"
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor += next((line for line in lines if line.startswith(("flags", "Features"))), "")
        processor += next((line for line in lines if line.startswith("model name")), "")
    package = sys.modules[PACKAGE].__file__
    assert package is not None
    return "\n".join((_source(Path(package).parent), platform.python_version(), *releases, processor))


def surroundings() -> str:
    """What decides every program beside its own function and arguments."""
    settings = [f"{name} {getattr(jax.config, name)}" for name in SETTINGS]
    named = [f"{name} {os.environ.get(name, '')}" for name in ("XLA_FLAGS", "EQX_ON_ERROR")]
    device = jax.devices()[0]
    return "\n".join(
        (_of_this_machine(), *settings, *named, device.platform, device.device_kind, str(jax.device_count()))
    )


def said(thing: Any) -> Iterator[str]:
    """Words that decide what a thing does in a program, the same in every process. Raises CannotKeepError where there are none."""
    if thing is None or (
        isinstance(thing, (bool, int, float, complex, str, bytes)) and type(thing).__module__ == "builtins"
    ):
        yield f"{type(thing).__name__} {thing!r}"
    elif isinstance(thing, (np.ndarray, np.generic, jax.Array)):
        value = np.asarray(thing)
        yield f"array {value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    elif isinstance(thing, np.dtype):
        yield f"dtype {thing}"
    elif isinstance(thing, enum.Enum):
        yield from _named(type(thing))
        yield thing.name
    elif isinstance(thing, (set, frozenset)):
        yield f"{type(thing).__name__} {len(thing)}"
        yield from sorted("\n".join(said(item)) for item in thing)
    elif isinstance(thing, (dict, types.MappingProxyType)):
        yield f"{type(thing).__name__} {len(thing)}"
        for name, value in thing.items():
            yield from said(name)
            yield from said(value)
    elif isinstance(thing, (tuple, list)):
        yield from _named(type(thing))
        yield f"{len(thing)}"
        for item in thing:
            yield from said(item)
    elif isinstance(thing, type):
        yield from _named(thing)
    elif isinstance(thing, functools.partial):  # jax.tree_util.Partial, too
        yield type(thing).__qualname__
        yield from said((thing.func, thing.args, thing.keywords))
    elif isinstance(thing, types.MethodType):
        yield "method"
        yield from said((thing.__self__, thing.__func__))
    elif isinstance(thing, types.FunctionType):
        yield from _said_of_function(_unchecked(thing))
    elif isinstance(thing, (types.BuiltinFunctionType, np.ufunc)):
        yield f"{getattr(thing, '__module__', 'numpy')}.{thing.__name__}"
    elif dataclasses.is_dataclass(thing):
        yield from _named(type(thing))
        for field in dataclasses.fields(thing):
            yield field.name
            yield from said(getattr(thing, field.name, None))
    elif callable(getattr(thing, "__wrapped__", None)):  # compiled, cached, with derivatives of its own
        yield f"{type(thing).__module__}.{type(thing).__qualname__}"
        yield from said(getattr(thing, "__wrapped__", None))
        yield from said([getattr(thing, rule, None) for rule in ("jvp", "fwd", "bwd")])
    else:
        raise CannotKeepError(f"{type(thing)}")


def _unchecked(function: Any) -> Any:
    """The function without the checks of types that a suite of tests puts around it."""
    checks = ("<@beartype", os.path.join("jaxtyping", "_decorator.py"))
    while hasattr(function, "__wrapped__") and any(part in function.__code__.co_filename for part in checks):
        function = function.__wrapped__
    return function


def _said_of_function(function: types.FunctionType) -> Iterator[str]:
    yield from _named(function)
    code = function.__code__
    yield f"line {code.co_firstlineno} {hashlib.sha256(code.co_code).hexdigest()}"
    yield from said((function.__defaults__, function.__kwdefaults__))
    for cell in function.__closure__ or ():
        try:
            inside = cell.cell_contents
        except ValueError:
            raise CannotKeepError(f"{function.__qualname__} is closed over what is not there yet") from None
        if inside is function:
            raise CannotKeepError(f"{function.__qualname__} is closed over itself")
        yield from said(inside)


def _named(thing: Any) -> Iterator[str]:
    """A class or a function by name, whose source the digest of this library or a release stands for."""
    whose, *packages = thing.__module__.split(".")
    if whose not in TRUSTED or (whose == PACKAGE and HOST_ONLY & set(packages)):
        raise CannotKeepError(f"{thing.__module__}.{thing.__qualname__} is none of ours")
    yield f"{thing.__module__}.{thing.__qualname__}"
