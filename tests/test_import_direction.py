"""Imports run one way: oil -> edge -> valve -> static tests -> identify -> command line."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest


CHAIN = (
    "thermohyd.oil",
    "thermohyd.edge",
    "thermohyd.valve",
    "thermohyd.static_tests",
    "thermohyd.identify.fitting.fit",
)
EFFECTS = "thermohyd.effects.library"
INTERFACE = "thermohyd.effects.effect"  # what a valve must know of effects: the stages that they may join
IDENTIFY = "thermohyd.identify"
ENTRY = f"{IDENTIFY}.__main__"
# Whole packages that a reader of files or results needs without waiting for JAX.
WITHOUT_JAX = (
    "app",
    "bench",
    "checking",
    "reduction",
    "report",
    "export.fmu",
    "export.interface",
    "export.model_space",
    "export.results",
    "export.servo_numbers",
    "export.valve_numbers",
    "result",
    "fitting.result",
    "diagnosis.result",
    "model.model",
    "model.model_file",
    "model.learned_terms",
    "model.fitted_range",
)
# Their methods call what stands above them: a result draws and writes itself, a record reads arrays. Only on a call.
FACES = {
    f"{IDENTIFY}.{name}"
    for name in (
        "bench.record",
        "checking.result",
        "comparison.result",
        "fitting.result",
        "diagnosis.result",
        "planning.result",
        "seed.study",
        "sensitivity.result",
        "servo.study",
    )
}
JAX = {"jax", "jaxtyping", "equinox", "optimistix", "lineax", "diffrax"}
# Each package may import those before it, not those after it.
FLOORS = ("fitting", "diagnosis", "cli")
COMMANDS = ("seed", "sensitivity", "servo")


@cache
def modules() -> dict[str, Path]:
    """{dotted name: file} of the installed package, without the `__init__` files: those only re-export."""
    return _within("thermohyd", Path(str(import_module("thermohyd").__file__)).parent)


def _within(package: str, folder: Path) -> dict[str, Path]:
    found = {}
    for path in sorted(folder.iterdir()):
        if path.suffix == ".py" and path.stem != "__init__":
            found[f"{package}.{path.stem}"] = path
        elif (path / "__init__.py").exists():
            found |= _within(f"{package}.{path.name}", path)
    return found


@cache
def imports(name: str, *, on_call: bool = True) -> frozenset[str]:
    """Dotted names of everything that a module imports, inside functions too where `on_call`; of a face never those."""
    found = set()
    tree = ast.parse(modules()[name].read_text(encoding="utf-8"))
    for node in ast.walk(tree) if on_call and name not in FACES else _at_once(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parents = name.split(".")[: -node.level] if node.level else []
            base = ".".join([*parents, *([node.module] if node.module else [])])
            found |= {f"{base}.{alias.name}" if f"{base}.{alias.name}" in modules() else base for alias in node.names}
    return frozenset(found)


def _at_once(node: ast.AST) -> Iterator[ast.AST]:
    """What runs when the module is imported: nothing inside functions, nothing for type checkers."""
    for child in ast.iter_child_nodes(node):
        typing_only = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
        if not isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef) and not typing_only:
            yield child
            yield from _at_once(child)


@cache
def reachable(name: str, *, on_call: bool = True) -> frozenset[str]:
    """Every module of the project that a module leads to, itself left out unless it stands in a circle."""
    seen: set[str] = set()
    open_ = [m for m in imports(name, on_call=on_call) if m in modules()]
    while open_:
        module = open_.pop()
        if module not in seen:
            seen.add(module)
            open_ += [m for m in imports(module, on_call=on_call) if m in modules()]
    return frozenset(seen)


def test_no_circles():
    assert [name for name in modules() if name in reachable(name)] == []


@pytest.mark.parametrize("level", range(len(CHAIN)))
def test_lower_never_leads_to_higher(level):
    assert not reachable(CHAIN[level]) & set(CHAIN[level + 1 :])


def test_the_chain_is_connected():
    assert set(CHAIN[:-1]) <= reachable(CHAIN[-1])


def test_the_library_of_effects_is_plain_data():
    assert reachable(EFFECTS) == {"thermohyd.effects.effect_info", "thermohyd.own_effects"}


def test_nothing_in_the_simulator_stands_on_effects():
    homes = [name for name in modules() if name.startswith("thermohyd.effects.")]
    assert not any("thermohyd.static_tests" in reachable(name) for name in homes)
    simulator = [name for name in modules() if name.count(".") == 1]
    assert not any(m.startswith("thermohyd.effects") for name in simulator for m in imports(name) - {INTERFACE})


def test_simulator_knows_nothing_of_benches():
    outside = {"pandas", "pint", "matplotlib", "rich", "typer", "jinja2", "platformdirs"}
    known = lambda module: module.split(".")[0] in outside or module.startswith((IDENTIFY, "thermohyd.data"))
    simulator = [name for name in modules() if not name.startswith(f"{IDENTIFY}.")]
    assert [(name, module) for name in simulator for module in imports(name) if known(module)] == []


def within(*packages: str) -> list[str]:
    """Modules of these packages of `identify`, or these modules themselves."""
    heads = tuple(f"{IDENTIFY}.{package}" for package in packages)
    return [name for name in modules() if name in heads or name.startswith(tuple(f"{head}." for head in heads))]


@pytest.mark.parametrize("level", range(len(FLOORS)))
def test_a_package_knows_nothing_of_what_is_made_of_it(level):
    above = set(within(*FLOORS[level + 1 :], *(COMMANDS if FLOORS[level] != "cli" else ())))
    for name in within(FLOORS[level]):
        assert not imports(name) & above, name


def test_reading_and_reporting_need_no_jax():
    needs = lambda name: {m.split(".")[0] for m in imports(name, on_call=False)} & JAX
    waited_for = {name: (name, *reachable(name, on_call=False)) for name in within(*WITHOUT_JAX)}
    assert [(name, module) for name, those in waited_for.items() for module in those if needs(module)] == []


def test_a_class_that_an_entry_names_is_imported_on_first_use_only():
    """What no import statement shows: the library, its entries asked for, and a model.json's reader run without JAX."""
    lines = (
        "import sys",
        "from thermohyd.effects.library import effect_info",
        "import thermohyd.identify.model.model_file, thermohyd.identify.report.diagnosis_json",
        "info = effect_info('hysteresis')",
        "assert info.shows and info.of_sweeps and not {'jax', 'equinox'} & set(sys.modules)",
        "assert info.rowwise and {'jax', 'equinox'} <= set(sys.modules)",
    )
    subprocess.run([sys.executable, "-P", "-c", "\n".join(lines)], check=True)


def test_nothing_imports_the_command_line():
    commands = set(within("cli"))
    assert [name for name in modules() if name not in commands and imports(name) & commands] == [ENTRY]


def test_only_the_page_needs_what_draws_it():
    """`thermohyd app` itself says in one sentence what to install, so it must start without."""
    page = within("app")
    with_streamlit = {found for found in page if reaches_streamlit(found)}
    draws = lambda module: module.split(".")[0] in ("streamlit", "tomlkit") or module in with_streamlit
    others = [name for name in modules() if name not in page]
    assert [(name, module) for name in others for module in imports(name) if draws(module)] == []


def reaches_streamlit(name: str) -> bool:
    found = (name, *reachable(name, on_call=False))
    return any(module.split(".")[0] == "streamlit" for one in found for module in imports(one, on_call=False))


def test_siblings_are_imported_where_they_live():
    """From the module that defines a name, not from the package."""
    assert [name for name in modules() if "thermohyd" in imports(name)] == []


def test_reference_never_imports_what_it_checks():
    for file in sorted((Path(__file__).parent / "reference").glob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            assert not any(module.split(".")[0] in ("thermohyd", "jax") for module in names), file.name
