"""What a compiled program answers, as JSON: where its arrays stand in tuples, dictionaries and modules. Reading it runs no code.

A class is said by its name, and has to be one of those that are loaded: a named tuple, an equinox module or an enumeration. Its
fields are set as they are written, and no function of it is called.
"""

import dataclasses
import sys
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax


@dataclasses.dataclass(frozen=True)
class Place:
    """Of an array among those that the program gives."""

    number: int


def answering(answer: Any) -> Callable[[list[Any]], Any]:
    """What puts the arrays that were found into their places in the answer."""
    leaves, tree = jax.tree_util.tree_flatten(answer)
    places = [(i, leaf.number) for i, leaf in enumerate(leaves) if isinstance(leaf, Place)]

    def answered(found: list[Any]) -> Any:
        whole = list(leaves)
        for i, number in places:
            whole[i] = found[number]
        return tree.unflatten(whole)

    return answered


def in_words(answer: Any) -> Any:
    """For `json.dumps`. Raises TypeError where something in it has no words."""
    kind = type(answer)
    if answer is None or kind in (bool, int, float, str):
        return answer
    if kind is Place:
        return {"place": answer.number}
    if kind in (tuple, list):
        return {kind.__name__: [in_words(one) for one in answer]}
    if kind is dict:
        return {"dict": [[in_words(key), in_words(value)] for key, value in answer.items()]}
    if isinstance(answer, type):
        return {"class": _name_of(answer)}
    if issubclass(kind, eqx.Module):
        fields = [[field.name, getattr(answer, field.name)] for field in dataclasses.fields(answer)]
    else:
        fields = list(zip(_field_names(kind), answer, strict=True))
    return {"of": _name_of(kind), "fields": [[name, in_words(value)] for name, value in fields]}


def of_words(words: Any) -> Any:
    """What `in_words` was given. Raises ValueError, TypeError, LookupError or AttributeError where no answer was written so."""
    if not isinstance(words, dict):
        return words
    match words:
        case {"place": int(number)}:
            return Place(number)
        case {"tuple": list(parts)}:
            return tuple(of_words(part) for part in parts)
        case {"list": list(parts)}:
            return [of_words(part) for part in parts]
        case {"dict": list(pairs)}:
            return {of_words(key): of_words(value) for key, value in pairs}
        case {"class": str(name)}:
            return _class_of(name)
        case {"of": str(name), "fields": list(fields)}:
            kind = _class_of(name)
            values = {key: of_words(value) for key, value in fields}
            if issubclass(kind, tuple):
                return tuple.__new__(kind, [values[key] for key in _field_names(kind)])
            made = object.__new__(kind)
            for field in dataclasses.fields(kind):
                object.__setattr__(made, field.name, values[field.name])
            return made
    raise ValueError("no answer of a program is written so")


def _field_names(kind: type) -> tuple[str, ...]:
    names = getattr(kind, "_fields", None)
    if not issubclass(kind, tuple) or names is None:
        raise TypeError(f"{kind.__name__} has no words")
    return names


def _name_of(kind: type) -> str:
    name = f"{kind.__module__}:{kind.__qualname__}"
    if _class_of(name) is not kind:
        raise TypeError(f"{name} is another class")
    return name


def _class_of(name: str) -> Any:
    module, _, path = name.partition(":")
    found: Any = sys.modules[module]
    for part in path.split("."):
        found = vars(found)[part]
    if not isinstance(found, type):
        raise TypeError(f"{name} is no class")
    if not issubclass(found, eqx.Module | eqx.Enumeration) and not (
        issubclass(found, tuple) and hasattr(found, "_fields")
    ):
        raise TypeError(f"{name} is no class of answers")
    return found
