"""A diagnosis.json of a stranger's: whatever stands in it, the module that is written of it holds the nodes of a benign one, or none is."""

import ast
import json
import math
import random
from functools import cache

import pytest

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.effect_writer import check_name, effect_files
from thermohyd.identify.model.places import PLACES, place_of
from thermohyd.identify.model.term_variables import VARIABLES, asked_with, laws_in_motion
from thermohyd.identify.model.typed_terms import TypedTerm, coefficients_of, unit_of
from thermohyd.identify.report.term_words import term_name
from thermohyd.identify.written_term import TermRead, read_term


FILES = 5000
MARK = "Zq7"  # in every hostile text, and in nothing that is written
HOSTILE = [
    f"{MARK}{text}"
    for text in (
        '"""\nimport os; os.system("id")\n"""', "'''\nraise SystemExit\n'''", '"; import os #', "'; import os #", "\\", '\\"""',
        "\n\nimport os\n", "\r\nimport os\r", "\u2028import os\u2029", "\x0cimport os", "\x85import os", "\x00", "\x1b[31m", "\ud800",
        "{__import__('os')}", "%s%n", "#", '"' * 99, "'" * 99, "\\N{BULLET}", "\\x22\\x22\\x22", "\\u0022\\u0022\\u0022", "a" * 2000,
        "\u202eimport os", "].pop()", "', effect=__import__('os'), unit='",
    )
]  # fmt: skip
NUMBERS = [
    0, -0.0, 1e308, -1e308, 5e-324, 1e-300, 1e101, math.nan, math.inf, -math.inf, 10**400, True, None, "1", "1e-9", [], {}, "nan", [1e-9],
]  # fmt: skip
KEYS = (
    "place", "variable", "law", "unit", "value", "coefficients", "range", "sentence", "confirmed_by", "gap_closed", "moving", "std",
)  # fmt: skip
WORDS = ("unit", "sentence", "confirmed_by")


def _kinds() -> list[tuple[str, str, str, bool]]:
    found = []
    for place in [*PLACES, "reading:leakage_flow", "reading:flows"]:
        for variable in VARIABLES.values():
            if asked_with(place_of(place), variable):
                laws = ["constant"] if variable.name == "constant" else ["proportional", "smooth", "root"]
                laws += ["local"] if variable.name in place_of(place).followed else []
                found += [(place, variable.name, law, False) for law in laws]
            if asked_with(place_of(place, moving=True), variable, moving=True):
                found += [(place, variable.name, law, True) for law in laws_in_motion(variable)]
    return found


def _entry(place: str, variable: str, law: str, moving: bool, coefficients: list[float]) -> dict:
    entry = {
        "place": place, "variable": variable, "law": law, "unit": unit_of(place, variable, law), "value": coefficients[0] or 1e-9,
        "coefficients": coefficients, "range": [-1.0, 2.0], "sentence": "a place: what a test does", "confirmed_by": "another test",
        "gap_closed": 0.9, "std": None,
    }  # fmt: skip
    return entry | ({"moving": True} if moving else {})


def _mangled(entry: dict, chance: random.Random) -> object:
    """The entry with one to three of its values replaced by what a stranger may write there."""
    for key in chance.sample(KEYS if chance.random() < 0.5 else WORDS, chance.randint(1, 3)):
        hostile = chance.choice([*HOSTILE, *NUMBERS])
        if key in ("coefficients", "range") and chance.random() < 0.8 and isinstance(entry[key], list):
            entry[key][chance.randrange(len(entry[key]))] = hostile
        elif key in WORDS:
            entry[key] = chance.choice(HOSTILE)
        elif key in ("place", "variable", "law") and chance.random() < 0.5:
            entry[key] = f"{entry[key]}{hostile}" if chance.random() < 0.5 else f"reading:{hostile}"
        else:
            entry[key] = hostile
    if chance.random() < 0.05:
        entry[chance.choice(HOSTILE)] = chance.choice(HOSTILE)
    return entry if chance.random() < 0.98 else chance.choice([*NUMBERS, *HOSTILE])


class _Masked(ast.NodeTransformer):
    """Values of constants are of no account; a negative number is a number."""

    def visit_Constant(self, node):
        kind = (
            "number"
            if isinstance(node.value, int | float) and not isinstance(node.value, bool)
            else type(node.value).__name__
        )
        return ast.Constant(kind)

    def visit_UnaryOp(self, node):
        return self.visit(node.operand) if isinstance(node.operand, ast.Constant) else self.generic_visit(node)


@cache
def _shape(text: str) -> str:
    return ast.dump(_Masked().visit(ast.parse(text)))


def _benign(kind: tuple[str, str, str, bool], coefficients: tuple[float, ...]) -> dict:
    """One of the same kind and with zeros at the same places, which is no stranger's."""
    return _entry(*kind, [math.copysign(1e-9, c) if c else 0.0 for c in coefficients])


def _texts(read: TermRead, source: str) -> dict[str, str]:
    return {name: str(text) for name, text in effect_files("mine", read, source).items()}


def test_what_is_written_of_5000_hostile_files_has_the_nodes_of_benign_ones(tmp_path):
    chance, kinds = random.Random(51), _kinds()
    path, shapes, written, sentences = tmp_path / "diagnosis.json", {}, 0, []

    def files_of(entry: object, source: str) -> tuple[dict[str, str], TypedTerm]:
        path.write_text(json.dumps({"verdict": "unexplained", "terms": [entry]}), encoding="utf-8")
        read = read_term(path)
        return _texts(read, source), read.term

    for number in range(FILES):
        kind = kinds[number % len(kinds)]
        coefficients = [chance.choice([-1e-9, 2e-9, 0.0]) for _ in range(coefficients_of(kind[2]))]
        try:
            files, term = files_of(_mangled(_entry(*kind, coefficients), chance), "diagnosis.json")
        except BenchInputError as error:
            sentences.append(str(error))
            continue
        assert not any(MARK in text for text in files.values())
        # A sign decides whether a number is a number or minus one, zeros how many powers a curve has.
        key = (kind, tuple(c != 0.0 for c in term.coefficients), term.coefficients[0] > 0.0)
        if key not in shapes:
            benign, _ = files_of(_benign(kind, term.coefficients), "diagnosis.json")
            shapes[key] = [_shape(text) for text in benign.values()]
        assert [_shape(text) for text in files.values()] == shapes[key]
        written += 1
    assert written > 1000
    assert len(sentences) == FILES - written
    assert all("\n" not in sentence and len(sentence) < 2000 for sentence in sentences)


@pytest.mark.parametrize("source", HOSTILE)
def test_the_name_of_the_file_ends_no_docstring(tmp_path, source):
    path = tmp_path / "diagnosis.json"
    path.write_text(
        json.dumps(
            {"verdict": "unexplained", "terms": [_entry("flow_into_a", "pressure", "proportional", False, [-1e-9])]}
        )
    )
    plain, hostile = (_texts(read_term(path), name)["mine.py"] for name in ("diagnosis.json", source))
    assert _shape(hostile) == _shape(plain)
    assert len(hostile.splitlines()) == len(plain.splitlines())
    hostile.encode()


def test_words_and_unit_are_our_own(tmp_path):
    """Those of the file are another's words for what place, variable and law say already."""
    path = tmp_path / "diagnosis.json"
    entry = _entry("flow_into_a", "pressure_rate", "proportional", False, [-2e-12])
    path.write_text(
        json.dumps(
            {"verdict": "unexplained", "terms": [entry | {"unit": "furlong", "sentence": "x", "confirmed_by": "y"}]}
        )
    )
    read = read_term(path)
    text = _texts(read, path.name)["mine.py"]
    assert f"unit={read.term.unit!r}," in text
    assert f"sentence={term_name(read.term)!r}," in text
    assert "furlong" not in text


@pytest.mark.parametrize(
    "content",
    [
        "[" * 100_000,
        '{"verdict": "u", "terms": [{"place": ["flow_into_a"]}]}',
        '{"verdict": "u", "terms": [5]}',
        '{"verdict": "u", "terms": [null]}',
        f'{{"verdict": "u", "terms": [{{"value": {"9" * 5000}}}]}}',
    ],
)
def test_a_file_that_is_no_diagnosis_is_one_sentence(tmp_path, content):
    path = tmp_path / "diagnosis.json"
    path.write_text(content)
    with pytest.raises(BenchInputError, match=r"diagnosis\.json"):
        read_term(path)


@pytest.mark.parametrize(
    "name",
    [
        "a.b",
        "a b",
        "A",
        "_a",
        "1a",
        "",
        "a\n",
        'a"',
        "test_it",
        "none",
        "true",
        "class",
        "ﬁlter",
        "größe",
        "a" * 61,
        "oil",
        "effect_info",
    ],
)
def test_no_other_name_than_a_plain_one(name):
    with pytest.raises(BenchInputError, match="name"):
        check_name(name)
