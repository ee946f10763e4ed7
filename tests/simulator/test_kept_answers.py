"""Answers of compiled programs as JSON: what was written is read, and a name leads to no function."""

import collections
import json

import jax
import numpy as np
import optimistix
import pytest
from helpers.valves import seed_valve

from thermohyd.kept_answers import Place, answering, in_words, of_words


Pair = collections.namedtuple("Pair", ["one", "other"])


@pytest.mark.parametrize(
    "answer",
    [
        Place(0),
        (Place(1), [Place(0), None, True, 2, 0.1, "three"], {"a": Place(2), "b": ()}),
        jax.tree_util.tree_map(lambda _: Place(3), seed_valve()),
        {"result": jax.tree_util.tree_map(lambda _: Place(0), optimistix.RESULTS.successful)},
    ],
)
def test_what_was_written_is_read(answer):
    again = of_words(json.loads(json.dumps(in_words(answer))))
    (leaves, tree), (want, same) = map(jax.tree_util.tree_flatten, (again, answer))
    assert tree == same
    assert leaves == want
    assert jax.tree_util.tree_leaves(answering(again)(list(np.arange(4.0)))) == [
        float(leaf.number) if isinstance(leaf, Place) else leaf for leaf in want
    ]


@pytest.mark.parametrize("answer", [print, object(), np.float64(1.0), {1, 2}, (lambda: 0,), int, Pair(1, print)])
def test_what_has_no_words_is_not_written(answer):
    with pytest.raises(TypeError):
        in_words(answer)


@pytest.mark.parametrize(
    "words",
    [
        {"class": "builtins:eval"},
        {"class": "os:system"},
        {"class": "subprocess:Popen"},
        {"class": "no such module:Class"},
        {"class": "optimistix:RESULTS.__init__"},
        {"of": "subprocess:Popen", "fields": [["args", "true"]]},
        {"of": "builtins:tuple", "fields": []},
        {"of": "optimistix._solution:RESULTS", "fields": []},
        {"place": "0"},
        {"tuple": 1},
        {"dict": [[{"list": []}, 1]]},
        {},
        {"other": 1},
    ],
)
def test_what_was_not_written_so_is_refused(words):
    with pytest.raises((ValueError, TypeError, LookupError, AttributeError)):
        of_words(words)
