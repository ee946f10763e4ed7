"""The installed package: complete, in its own namespace only, and silent on import."""

import subprocess
import sys
from importlib.metadata import distribution
from importlib.resources import files
from pathlib import Path


ROOT = Path(__file__).parent.parent
INSIDE = {"thermohyd": "", "identify": "identify/", "data": "data/"}  # source folder: place in the package


def source_files() -> list[tuple[Path, str]]:
    """(file in the source tree, its path in the package) for everything that a wheel must hold."""
    found = []
    for folder, place in INSIDE.items():
        for file in sorted((ROOT / folder).rglob("*")):
            if file.is_file() and "__pycache__" not in file.parts:
                found.append((file, place + file.relative_to(ROOT / folder).as_posix()))
    return found


def test_every_source_file_is_installed_as_it_is():
    as_it_is = lambda source, at: at.is_file() and at.read_bytes() == source.read_bytes()
    another = [place for source, place in source_files() if not as_it_is(source, files("thermohyd").joinpath(place))]
    assert another == [], "install again: make test does"


def test_nothing_outside_the_namespace():
    installed = [Path(file) for file in distribution("thermohyd").files or []]
    tops = {file.parts[0] for file in installed if file.parts[0] != ".." and not file.parts[0].endswith(".dist-info")}
    assert tops <= {"thermohyd"}
    code = "import importlib.util as u; print(u.find_spec('identify'), u.find_spec('data'))"
    ran = subprocess.run([sys.executable, "-P", "-c", code], check=True, capture_output=True, text=True)
    assert ran.stdout.split() == ["None", "None"]


def test_the_command_is_installed():
    (script,) = [entry for entry in distribution("thermohyd").entry_points if entry.group == "console_scripts"]
    assert (script.name, script.value) == ("thermohyd", "thermohyd.identify.__main__:main")


def test_import_is_silent_and_changes_nothing():
    code = (
        "import sys, thermohyd, thermohyd.identify, thermohyd.data\n"
        "assert not {'jax', 'pandas'} & set(sys.modules)\n"
        "import jax\n"
        "flags = dict(jax.config.values)\n"
        "for name in dir(thermohyd):\n"
        "    getattr(thermohyd, name)\n"
        "changed = [n for n, v in jax.config.values.items() if n in flags and flags[n] != v]\n"
        "assert changed == [] and not jax.config.jax_enable_x64\n"
        "import jax._src.xla_bridge as bridge\n"
        "assert not bridge.backends_are_initialized()\n"
    )
    ran = subprocess.run([sys.executable, "-P", "-W", "error", "-c", code], capture_output=True, text=True)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")


def test_identification_is_imported_without_a_backend():
    code = (
        "import importlib, pkgutil, thermohyd, thermohyd.identify\n"
        "for package in (thermohyd, thermohyd.identify):\n"
        "    for module in pkgutil.iter_modules(package.__path__, package.__name__ + '.'):\n"
        "        importlib.import_module(module.name)\n"
        "import jax\n"
        "import jax._src.xla_bridge as bridge\n"
        "assert not bridge.backends_are_initialized() and not jax.config.jax_enable_x64\n"
    )
    ran = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")
