"""A fitted valve, or the servo with its actuator, as an FMU of C sources (model exchange and co-simulation), which need no Python.

    valve.fmu: modelDescription.xml, sources/*, documentation/index.html, binaries/<platform>/<model>.so where a compiler was found

The physics and the interface are written once (`sources/`); parameters.h is made here from the model. The same model gives the same
bytes but for what the compiler makes. No JAX.
"""

import hashlib
import io
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from uuid import UUID

import numpy as np

from thermohyd.dynamics.rodas5p import GAMMA, TABLEAU
from thermohyd.identify.bench.errors import BenchInputError, one_line
from thermohyd.identify.model.model import Model

from . import fmi2_description, fmi3_description
from .interface import Interface, servo_interface, valve_interface
from .servo_numbers import servo_numbers
from .valve_numbers import valve_numbers


NODES, LINEAR = 11, 0.65  # of the film between two arcs: `thermohyd.film`
SECONDS_TO_COMPILE = 120


@dataclass(frozen=True)
class Fmu:
    """An FMU. content: the archive; binary: for which platform one is inside, "" where there was no compiler; left_out: effects of
    the bench that the valve does not have."""

    name: str
    content: bytes
    binary: str
    left_out: tuple[str, ...]


def make_fmu(
    model: Model, *, current: bool = False, servo: str | None = None, fmi: int = 2, compiler: str | None = "cc"
) -> Fmu:
    """The FMU of a model. current: a static valve driven by a current [A]; servo: the valve with its actuator, driven by what this
    names ("setpoint", "current", "spool_position"). fmi: 2 or 3. compiler: None makes one of sources alone, as does one that is not there.

    Raises BenchInputError where the model holds what the sources cannot express.
    """
    interface = (
        valve_interface(valve_numbers(model, current=current))
        if servo is None
        else servo_interface(servo_numbers(model, servo))
    )
    if fmi not in (2, 3):
        raise BenchInputError(f"an FMU is of FMI 2 or 3, not {fmi}")
    describe = fmi2_description.description if fmi == 2 else fmi3_description.description
    valve = one_line(model.valve.name)  # XML 1.0 holds no control characters, not even escaped
    name = identifier(valve if servo is None else f"{valve or 'valve'} servo")
    sources = written_sources(interface, fmi)
    guid = _guid(name, sources)
    sources["parameters.h"] = sources["parameters.h"].replace("@GUID@", guid)
    parts: dict[str, bytes] = {
        "modelDescription.xml": describe(name, guid, valve, interface),
        **{f"sources/{file}": text.encode() for file, text in sources.items()},
        "documentation/index.html": _documentation(valve, interface).encode(),
    }
    if fmi == 3:
        parts["sources/buildDescription.xml"] = fmi3_description.build_description(name, interface)
    place, library = compiled(sources, compiler, fmi)
    if library:
        parts[f"binaries/{place}/{name}{_ending()}"] = library
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, content in parts.items():
            archive.writestr(
                zipfile.ZipInfo(path), content, zipfile.ZIP_DEFLATED
            )  # no date: the same model, the same bytes
    return Fmu(name, packed.getvalue(), place if library else "", interface.left_out)


def identifier(name: str) -> str:
    """A C name of the valve's."""
    plain = re.sub(r"[^0-9A-Za-z]+", "_", name).strip("_")[:40] or "valve"
    return plain if re.match(r"[A-Za-z]", plain) else f"valve_{plain}"


def written_sources(interface: Interface, fmi: int) -> dict[str, str]:
    """{file: text} of all C sources; parameters.h with the mark @GUID@ where that goes."""
    folder = files(__package__) / "sources"
    names = (f"fmi{fmi}.c", f"fmi{fmi}.h", *interface.sources)
    made = {"parameters.h": _parameters_h(interface)} | ({"tableau.h": _tableau_h()} if interface.states else {})
    return {**{name: (folder / name).read_text(encoding="utf-8") for name in names}, **made}


def _parameters_h(interface: Interface) -> str:
    x, w = np.polynomial.legendre.leggauss(NODES)
    v = 0.5 * (x + 1.0)
    place, weight = LINEAR * v + (1.0 - LINEAR) * v**3, 0.5 * w * (LINEAR + 3.0 * (1.0 - LINEAR) * v**2)
    entries = " \\\n".join(f"    X({n.name}, {_c(n.value)})" for n in interface.numbers)
    starts = ", ".join(_c(start) for _, start, _ in interface.inputs.values())
    choices = "\n".join(f"#define THERMOHYD_{name} {number}" for name, number in interface.choices.items())
    return f"""/* Made from a fitted model; names and units as in modelDescription.xml. */
#ifndef THERMOHYD_PARAMETERS_H
#define THERMOHYD_PARAMETERS_H

#define THERMOHYD_GUID "@GUID@"
{choices}
#define THERMOHYD_PARAMETERS(X) \\
{entries}
#define THERMOHYD_START_INPUTS {starts}

/* Gauss nodes and weights of the film between two arcs, on 0 ... 1. */
#define THERMOHYD_FILM_NODES {NODES}
static const double film_place[THERMOHYD_FILM_NODES] = {{{_row(place)}}};
static const double film_weight[THERMOHYD_FILM_NODES] = {{{_row(weight)}}};

#endif
"""


def _tableau_h() -> str:
    a, c, d, nodes = TABLEAU
    matrix = lambda values: ",\n".join(f"    {{{_row(row)}}}" for row in values)
    return f"""/* Coefficients of Rodas5P (Steinebach, 2023). */
static const double tableau_gamma = {_c(GAMMA)};
static const double tableau_a[8][8] = {{
{matrix(a)}
}};
static const double tableau_c[8][8] = {{
{matrix(c)}
}};
static const double tableau_d[8] = {{{_row(d)}}};
static const double tableau_nodes[8] = {{{_row(nodes[:, 1])}}};
"""


def _row(values: np.ndarray) -> str:
    return ", ".join(_c(float(value)) for value in values)


def _c(value: float) -> str:
    """A double that C reads back to the last bit."""
    text = repr(float(value))
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def _guid(name: str, sources: dict[str, str]) -> str:
    """The same for the same model and sources."""
    digest = hashlib.sha256("\0".join([name, *sources.values()]).encode()).digest()
    return f"{{{UUID(bytes=digest[:16], version=4)}}}"


def _documentation(valve: str, interface: Interface) -> str:
    left = ", ".join(interface.left_out) or "none"
    rows = "".join(
        f"<tr><td>{escape(n.name)}</td><td>{n.value:.10g}</td><td>{escape(n.unit)}</td><td>{escape(n.description)}</td></tr>"
        for n in interface.numbers
    )
    what = (
        "A fitted servovalve with its actuator in motion: it starts in equilibrium under its first inputs. "
        if interface.states
        else "Static flows of a fitted servovalve: the oil has no inertia and the ports no volume. "
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(valve)}</title>'
        f"<h1>{escape(valve)}</h1><p>{what}"
        "Pressures are gauge, inputs are what the valve sees: errors of the bench's instruments and what its lines store stay on the "
        f"bench (here: {escape(left)}).</p><table>{rows}</table></html>\n"
    )


def platform_folder(fmi: int) -> str:
    """The folder of binaries that FMI has for this machine; empty where its version knows none."""
    system = {"linux": "linux", "darwin": "darwin", "win32": "win"}.get(sys.platform, "")
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    if fmi == 3:
        return f"{machine}-{ {'win': 'windows'}.get(system, system) }" if system else ""
    known = machine == "x86_64" or (system == "darwin")
    return f"{system}{64 if sys.maxsize > 2**32 else 32}" if system and known else ""


def _ending() -> str:
    return {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def compiled(sources: dict[str, str], compiler: str | None, fmi: int) -> tuple[str, bytes]:
    """(platform, shared library) of the sources; empty bytes where there is no compiler. Raises BenchInputError where it fails."""
    place = platform_folder(fmi)
    found = None if compiler is None else shutil.which(compiler)
    if found is None or not place or sys.platform == "win32":
        return place, b""
    with tempfile.TemporaryDirectory() as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        # No contraction of products and sums: the numbers are those of the library on every machine.
        call = [found, "-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off"]
        call += ["-o", "model", *(name for name in sources if name.endswith(".c")), "-lm"]
        try:
            ran = subprocess.run(call, cwd=folder, capture_output=True, text=True, timeout=SECONDS_TO_COMPILE)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise BenchInputError(
                f"the compiler {found} did not work ({error}); give --compiler none for sources alone"
            ) from None
        if ran.returncode:
            said = (ran.stderr.strip().splitlines() or ["no reason given"])[0]
            raise BenchInputError(f"the compiler {found} failed: {said}; give --compiler none for sources alone")
        return place, (Path(folder) / "model").read_bytes()
