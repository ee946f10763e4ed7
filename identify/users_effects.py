"""Effects that a user names, and those of his own: modules of a folder, and entry points of installed packages. Imports no JAX itself.

What is loaded is the user's code, and runs as such: nothing is loaded that was not asked for by name or installed, and never from the
folder of a record.
"""

import difflib
import importlib.util
import sys
from collections.abc import Callable, Iterable
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from thermohyd.effects.effect_info import EffectInfo
from thermohyd.effects.library import find_effect, register_effect, whole_library
from thermohyd.identify.bench.errors import BenchInputError


GROUP = "thermohyd.effects"  # of entry points: each a module, an EffectInfo, or several


def load_effects(folder: str | Path) -> tuple[str, ...]:
    """Import the modules of a folder and register the effects that stand in them as `EffectInfo`; returns their names.

    Files that begin with "_" or "test_" are left alone. Raises BenchInputError, with the file, for what cannot be loaded.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BenchInputError(
            "is no folder of effects; thermohyd effect NAME --from diagnosis.json --out DIR makes one", file=folder
        )
    files = [file for file in sorted(folder.glob("*.py")) if not file.name.startswith(("_", "test_"))]
    if not files:
        raise BenchInputError("has no module (*.py) with an effect", file=folder)
    found: list[str] = []
    for file in files:
        own = _registered(lambda file=file: _module(file), file)
        if not own:
            raise BenchInputError("has no effect: it must hold an EffectInfo, as CONTRIBUTING shows", file=file)
        found += own
    return tuple(dict.fromkeys(found))


def load_entry_points() -> dict[str, tuple[str, ...]]:
    """{package: names of its effects} of every installed package with an entry point of the group "thermohyd.effects".

    Raises BenchInputError, with the entry point, for what cannot be loaded.
    """
    found: dict[str, tuple[str, ...]] = {}
    for point in entry_points(group=GROUP):
        package = point.dist.name if point.dist is not None else point.module
        own = _registered(point.load, Path(point.value))
        found[package] = (*found.get(package, ()), *own)
    return found


def known_effects(names: Iterable[str]) -> tuple[str, ...]:
    """The names, each once; raises BenchInputError for one that the library does not have."""
    found = tuple(dict.fromkeys(name.strip() for name in names if name.strip()))
    for name in found:
        if find_effect(name) is None:
            near = difflib.get_close_matches(name, whole_library(), n=1, cutoff=0.0)
            raise BenchInputError(f'without: the library has no effect "{name}"; the nearest is "{near[0]}"')
    return found


def loaded_words(names: Iterable[str], source: str) -> str:
    """What is said, once, of effects that are not the program's own."""
    return f"effects of your own from {source}: {', '.join(names)}; that is your code, and it runs in this program"


def _registered(load: Callable[[], Any], source: Path) -> list[str]:
    before = set(whole_library())
    try:
        loaded = load()
        for info in _infos(loaded):
            known = find_effect(info.name)
            if known is None:
                register_effect(info)
            elif known is not info:
                raise ValueError(f"the library has an effect {info.name!r} already; give yours another name")
    except BenchInputError:
        raise
    except Exception as error:  # whatever a user's module raises
        raise BenchInputError(f"cannot be loaded: {type(error).__name__}: {error}", file=source) from None
    own = [info.name for info in _infos(loaded)]
    return list(dict.fromkeys([*own, *(name for name in whole_library() if name not in before)]))


def _infos(loaded: Any) -> list[EffectInfo]:
    if isinstance(loaded, EffectInfo):
        return [loaded]
    if isinstance(loaded, ModuleType):
        return [info for value in vars(loaded).values() for info in _infos_of(value)]
    return _infos_of(loaded)


def _infos_of(value: Any) -> list[EffectInfo]:
    if isinstance(value, EffectInfo):
        return [value]
    several = isinstance(value, (list, tuple)) and value and all(isinstance(one, EffectInfo) for one in value)
    return list(value) if several else []


def _module(file: Path) -> ModuleType:
    """The module of a file, imported once in a process."""
    name = f"thermohyd_users_{abs(hash(str(file.resolve())))}_{file.stem}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
