"""What the program knows of an effect stands on its entry: elsewhere no line of code names an effect or its class."""

import ast
import re
from collections.abc import Iterator

from test_import_direction import modules

from thermohyd.effects.library import whole_library


EFFECTS = whole_library()
CLASSES = {info.effect_class.__name__ for info in EFFECTS.values()}
NAME = re.compile(rf"\b({'|'.join(EFFECTS)})\b")
# Quantities that a record states in its own tables, [actuator] and [oil], and that an effect of the same name adds to.
OF_THE_RECORD = {
    "thermohyd.actuator": {"coulomb_friction", "jack_leakage"},
    "thermohyd.identify.bench.test_tables": {"coulomb_friction", "jack_leakage"},
    "thermohyd.identify.bench.valve_tables": {"pressure_viscosity"},
    "thermohyd.identify.export.servo_numbers": {"coulomb_friction", "jack_leakage"},
    "thermohyd.identify.model.model_file": {"coulomb_friction", "jack_leakage"},
}


def docstrings(tree: ast.Module) -> set[int]:
    homes = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    first = [node.body[0] for node in ast.walk(tree) if isinstance(node, homes) and node.body]
    return {id(node.value) for node in first if isinstance(node, ast.Expr)}


def named(source: str) -> Iterator[str]:
    """Effects that a source names: as a whole word within any string that is no docstring (the fixed parts of an f-string
    too), or by the class, as a name, an attribute or an import. Attributes such as `oil.pressure_viscosity` are physics."""
    tree = ast.parse(source)
    words = docstrings(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in words:
            yield from NAME.findall(node.value)
        identifier = getattr(node, "id", None) or getattr(node, "attr", None)
        if isinstance(node, ast.alias):
            identifier = node.name
        if identifier in CLASSES:
            yield identifier


def test_no_effect_is_named_outside_the_library():
    elsewhere = {name: file for name, file in modules().items() if not name.startswith("thermohyd.effects.")}
    found = {name: set(named(file.read_text(encoding="utf-8"))) for name, file in elsewhere.items()}
    assert {name: those for name, those in found.items() if those} == OF_THE_RECORD


def test_what_counts_as_naming_an_effect():
    source = '''
"""A docstring may say hysteresis."""
from thermohyd.effects.edges import ThermalClearance
LAG = "flowmeter_lag"
MESSAGE = f"{LAG} looks like hysteresis"
oil.pressure_viscosity, "hysteresis_width"
'''
    assert sorted(named(source)) == ["ThermalClearance", "flowmeter_lag", "hysteresis"]
