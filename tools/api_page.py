"""The page of the public API, docs/api.md, from the docstrings: `make api` writes it, and a test holds that it is current.

Public is what `thermohyd`, `thermohyd.identify` and `thermohyd.data` name. Types of arguments stand in the source and in an editor; the
docstrings say shapes and units.
"""

import inspect
import re
import sys
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

from thermohyd.identify.report.files import write_all


PAGE = Path(__file__).parents[1] / "docs" / "api.md"
MODULES = {
    "thermohyd": "The simulator: valves, actuators, oils, effects. Every function can be jitted, vmapped and differentiated.",
    "thermohyd.identify": "Records, fits, diagnoses and what follows from them; NumPy and pandas in and out.",
    "thermohyd.data": "Oil presets and sample records.",
}
LONGEST = 100
HEAD = """# Public API

<!-- written by `make api` from the docstrings; a test holds that it is current -->

What `thermohyd`, `thermohyd.identify` and `thermohyd.data` name is public, and loaded on first use; modules below them may move. Values
are in SI units unless a docstring says otherwise. At work: [using it](using.md), [the studies](studies.md).
"""


def page() -> str:
    """The whole page."""
    return "\n".join([HEAD, *(section(name, about) for name, about in MODULES.items())])


def section(module: str, about: str) -> str:
    home = import_module(module)
    entries = [entry(name, getattr(home, name)) for name in sorted(home.__all__, key=str.lower)]
    return "\n".join([f"## {module}", "", about, "", *entries])


def silent() -> list[str]:
    """Public functions and classes that do not say what they are."""
    found = []
    for module in MODULES:
        home = import_module(module)
        called = {name: getattr(home, name) for name in home.__all__ if callable(getattr(home, name))}
        said = {name: inspect.getdoc(what) or "" for name, what in called.items()}
        found += [name for name, words in said.items() if not words or words.startswith(f"{name}(")]
    return found


def entry(name: str, what: Any) -> str:
    """A heading, and how it is called with what it says of itself."""
    if not callable(what):
        return f"### {name}\n\n```text\n{name}: {type(what).__name__}\n```\n"
    said = inspect.getdoc(what) or ""
    said = "" if said.startswith(f"{name}(") else said  # what dataclasses write by themselves
    lines = [call(name, what), *([""] if said else []), *said.splitlines()]
    if inspect.isclass(what):
        lines += methods(what)
    body = "\n".join(line.rstrip() for line in lines)
    return f"### {name}\n\n```text\n{body}\n```\n"


def call(name: str, what: Callable) -> str:
    try:
        parameters = [*inspect.signature(what).parameters.values()]
    except (TypeError, ValueError):
        return name
    if not parameters or issubclass_of_exception(what):
        return f"{name}()" if not inspect.isclass(what) else name
    words = [*written(parameters)]
    line = f"{name}({', '.join(words)})"
    return line if len(line) <= LONGEST else f"{name}(\n" + "".join(f"    {word},\n" for word in words) + ")"


def written(parameters: Iterable[inspect.Parameter]) -> Iterable[str]:
    """Names with their defaults, where these can be read."""
    named_only = False
    for one in parameters:
        if one.name == "self":
            continue
        if one.kind is one.KEYWORD_ONLY and not named_only:
            named_only = True
            yield "*"
        stars = {one.VAR_POSITIONAL: "*", one.VAR_KEYWORD: "**"}.get(one.kind, "")
        named_only = named_only or stars == "*"
        yield f"{stars}{one.name}" + ("" if one.default is one.empty else f"={shown(one.default)}")


def shown(default: Any) -> str:
    plain = isinstance(default, str | int | float | bool | None) or default == ()
    return repr(default) if plain else "..."


def issubclass_of_exception(what: Any) -> bool:
    return inspect.isclass(what) and issubclass(what, BaseException)


def methods(what: type) -> list[str]:
    """Public methods and properties of a class with a docstring, each with its first sentence."""
    found = []
    for name in dir(what):
        member = inspect.getattr_static(what, name)
        if name.startswith("_") or issubclass_of_exception(what):
            continue
        kind = member.__func__ if isinstance(member, classmethod | staticmethod) else member
        ours = getattr(getattr(what, name), "__module__", None) or getattr(
            getattr(member, "func", None), "__module__", ""
        )
        is_property = isinstance(member, property) or type(member).__name__ == "cached_property"
        if not (is_property or (callable(kind) and str(ours).startswith("thermohyd"))):
            continue
        said = inspect.getdoc(member) or ""
        if said:
            first = re.split(r"(?<=[.;])\s", said.replace("\n", " "))[0].rstrip(";")
            found.append(f"    .{name}{'' if is_property else '()'}: {first}")
    return ["", *found] if found else []


if __name__ == "__main__":
    write_all(PAGE.parent, {PAGE.name: page()})
    print(f"wrote {PAGE}", file=sys.stderr)
