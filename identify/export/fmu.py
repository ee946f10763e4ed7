"""A fitted valve as an FMU of C sources (FMI 2.0, model exchange and co-simulation): any host can rebuild it, none needs Python.

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
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from uuid import UUID
from xml.etree import ElementTree as ET

import numpy as np

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.model.model import Model

from .valve_numbers import ValveNumbers, valve_numbers


SOURCES = ("fmi2.c", "valve.c", "fmi2.h", "valve.h")
NODES, LINEAR = 11, 0.65  # of the film between two arcs: `thermohyd.film`
FIRST_INPUT, FIRST_OUTPUT = 1000, 2000
SECONDS_TO_COMPILE = 120
# name: (unit, start, description); the start values of pressures and temperature are the bench's where the model says them
INPUTS = {
    "spool_position": ("m", 0.0, "Position of the spool, true; opens P to A where positive"),
    "spool_direction": ("1", 0.0, "Way that the spool last moved: +1, -1; 0: the middle of its loop"),
    "supply_pressure": ("Pa", 70e5, "Supply pressure, gauge"),
    "return_pressure": ("Pa", 0.0, "Return pressure, gauge"),
    "temperature": ("K", 313.15, "Temperature of the oil supplied"),
    "pressure_a": ("Pa", 35e5, "Pressure in port A, gauge"),
    "pressure_b": ("Pa", 35e5, "Pressure in port B, gauge"),
}
OUTPUTS = {
    "flow_a": ("m3/s", "Flow out of port A into the load, volume at the port"),
    "flow_b": ("m3/s", "Flow out of the load into port B, volume at the port"),
    "supply_flow": ("m3/s", "Flow from the supply, volume at supply conditions; leakage beside the spool included"),
    "return_flow": ("m3/s", "Flow to the return, volume at return conditions; leakage beside the spool included"),
    "mass_flow_a": ("kg/s", "Mass flow out of port A into the load"),
    "mass_flow_b": ("kg/s", "Mass flow out of the load into port B"),
    "load_flow": ("m3/s", "Flow through a load that takes pressure_a - pressure_b, the mean as the edges balance it"),
    "blocked_pressure_a": ("Pa", "Pressure in port A with both ports closed"),
    "blocked_pressure_b": ("Pa", "Pressure in port B with both ports closed"),
    "leakage_flow": ("m3/s", "Flow to the return with both ports closed, volume at return conditions"),
}
# Which inputs an output follows: all but those named.
_OF_CLOSED_PORTS = ("blocked_pressure_a", "blocked_pressure_b", "leakage_flow")
INDEPENDENT: dict[str, tuple[str, ...]] = dict.fromkeys(_OF_CLOSED_PORTS, ("pressure_a", "pressure_b"))
# Exponents of kg, m, s, A, K.
BASE_UNITS = {
    "1": {}, "m": {"m": 1}, "Pa": {"kg": 1, "m": -1, "s": -2}, "K": {"K": 1}, "A": {"A": 1}, "m3/s": {"m": 3, "s": -1},
    "kg/s": {"kg": 1, "s": -1}, "kg/m3": {"kg": 1, "m": -3}, "1/K": {"K": -1}, "1/Pa": {"kg": -1, "m": 1, "s": 2},
    "J/(kg.K)": {"m": 2, "s": -2, "K": -1}, "J/(kg.K2)": {"m": 2, "s": -2, "K": -2}, "m/K": {"m": 1, "K": -1},
    "m/Pa": {"kg": -1, "m": 2, "s": 2}, "m/A": {"m": 1, "A": -1}, "Pa/(m3/s)": {"kg": 1, "m": -4, "s": -1},
    "Pa/(m3/s)^2": {"kg": 1, "m": -7}, "m3/(s Pa)": {"kg": -1, "m": 4, "s": 1},
}  # fmt: skip


@dataclass(frozen=True)
class Fmu:
    """An FMU. content: the archive; binary: for which platform one is inside, "" where there was no compiler; left_out: effects of
    the bench that the valve does not have."""

    name: str
    content: bytes
    binary: str
    left_out: tuple[str, ...]


def make_fmu(model: Model, *, current: bool = False, compiler: str | None = "cc") -> Fmu:
    """The FMU of a model. current: driven by a current [A]. compiler: None makes one of sources alone, as does one that is not there.

    Raises BenchInputError where the model holds what the sources cannot express.
    """
    numbers = valve_numbers(model, current=current)
    name = identifier(model.valve.name)
    sources = written_sources(numbers)
    guid = _guid(name, sources)
    sources["parameters.h"] = sources["parameters.h"].replace("@GUID@", guid)
    parts: dict[str, bytes] = {
        "modelDescription.xml": description(name, guid, model, numbers),
        **{f"sources/{file}": text.encode() for file, text in sources.items()},
        "documentation/index.html": _documentation(model, numbers).encode(),
    }
    place, library = compiled(sources, compiler)
    if library:
        parts[f"binaries/{place}/{name}{_ending()}"] = library
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, content in parts.items():
            archive.writestr(
                zipfile.ZipInfo(path), content, zipfile.ZIP_DEFLATED
            )  # no date: the same model, the same bytes
    return Fmu(name, packed.getvalue(), place if library else "", numbers.left_out)


def identifier(name: str) -> str:
    """A C name of the valve's."""
    plain = re.sub(r"[^0-9A-Za-z]+", "_", name).strip("_")[:40] or "valve"
    return plain if re.match(r"[A-Za-z]", plain) else f"valve_{plain}"


def inputs_of(numbers: ValveNumbers) -> dict[str, tuple[str, float, str]]:
    """The FMU's inputs by name, in the order of the C struct; the current takes the place of the position."""
    if not numbers.driven_by_current:
        return dict(INPUTS)
    inputs = {"current": ("A", 0.0, "Current; its full value moves the spool by its stroke"), **INPUTS}
    del inputs["spool_position"]
    return inputs


def written_sources(numbers: ValveNumbers) -> dict[str, str]:
    """{file: text} of all C sources; parameters.h with the mark @GUID@ where that goes."""
    folder = files(__package__) / "sources"
    fixed = {name: (folder / name).read_text(encoding="utf-8") for name in SOURCES}
    return {**fixed, "parameters.h": _parameters_h(numbers)}


def _parameters_h(numbers: ValveNumbers) -> str:
    x, w = np.polynomial.legendre.leggauss(NODES)
    v = 0.5 * (x + 1.0)
    place, weight = LINEAR * v + (1.0 - LINEAR) * v**3, 0.5 * w * (LINEAR + 3.0 * (1.0 - LINEAR) * v**2)
    entries = " \\\n".join(f"    X({n.name}, {_c(n.value)})" for n in numbers.numbers)
    starts = ", ".join(_c(start) for _, start, _ in inputs_of(numbers).values())
    array = lambda values: ", ".join(_c(float(value)) for value in values)
    return f"""/* Made from a fitted model; names and units as in modelDescription.xml. */
#ifndef THERMOHYD_NUMBERS_H
#define THERMOHYD_NUMBERS_H

#define THERMOHYD_GUID "@GUID@"
#define THERMOHYD_PARAMETERS(X) \\
{entries}
#define THERMOHYD_START_INPUTS {starts}

/* Gauss nodes and weights of the film between two arcs, on 0 ... 1. */
#define THERMOHYD_FILM_NODES {NODES}
static const double film_place[THERMOHYD_FILM_NODES] = {{{array(place)}}};
static const double film_weight[THERMOHYD_FILM_NODES] = {{{array(weight)}}};

#endif
"""


def _c(value: float) -> str:
    """A double that C reads back to the last bit."""
    text = repr(float(value))
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def _guid(name: str, sources: dict[str, str]) -> str:
    """The same for the same model and sources."""
    digest = hashlib.sha256("\0".join([name, *sources.values()]).encode()).digest()
    return f"{{{UUID(bytes=digest[:16], version=4)}}}"


def description(name: str, guid: str, model: Model, numbers: ValveNumbers) -> bytes:
    """modelDescription.xml."""
    inputs = inputs_of(numbers)
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=name,
        guid=guid,
        description=f"Static flows of the servovalve {model.valve.name}, fitted to bench curves",
        generationTool=f"thermohyd {version('thermohyd')}",
        variableNamingConvention="flat",
        numberOfEventIndicators="0",
    )
    for kind in ("ModelExchange", "CoSimulation"):
        more = {"canHandleVariableCommunicationStepSize": "true"} if kind == "CoSimulation" else {}
        states = {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
        part = ET.SubElement(root, kind, {"modelIdentifier": name, **states, **more})
        listed = ET.SubElement(part, "SourceFiles")
        for file in SOURCES:
            if file.endswith(".c"):
                ET.SubElement(listed, "File", name=file)
    units = ET.SubElement(root, "UnitDefinitions")
    used = [number.unit for number in numbers.numbers] + [unit for unit, *_ in (*inputs.values(), *OUTPUTS.values())]
    for unit in dict.fromkeys(used):
        defined = ET.SubElement(units, "Unit", name=unit)
        if unit in BASE_UNITS:
            ET.SubElement(defined, "BaseUnit", {base: str(power) for base, power in BASE_UNITS[unit].items()})
    ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="1.0", stepSize="0.001")
    variables = ET.SubElement(root, "ModelVariables")

    def variable(reference: int, name: str, unit: str, words: str, start: float | None, **kind: str) -> None:
        about = {"name": name, "valueReference": str(reference), "description": words, **kind}
        made = ET.SubElement(variables, "ScalarVariable", about)
        ET.SubElement(made, "Real", {"unit": unit, **({} if start is None else {"start": repr(float(start))})})

    for i, number in enumerate(numbers.numbers):
        variable(
            i, number.name, number.unit, number.description, number.value, causality="parameter", variability="fixed"
        )
    for i, (own, (unit, start, words)) in enumerate(inputs.items()):
        variable(FIRST_INPUT + i, own, unit, words, start, causality="input", variability="continuous")
    for i, (own, (unit, words)) in enumerate(OUTPUTS.items()):
        variable(FIRST_OUTPUT + i, own, unit, words, None, causality="output", variability="continuous")
    structure = ET.SubElement(root, "ModelStructure")
    first = len(numbers.numbers) + 1
    for block in ("Outputs", "InitialUnknowns"):
        listed = ET.SubElement(structure, block)
        for i, output in enumerate(OUTPUTS):
            follows = [first + j for j, own in enumerate(inputs) if own not in INDEPENDENT.get(output, ())]
            place = first + len(inputs) + i
            ET.SubElement(listed, "Unknown", index=str(place), dependencies=" ".join(map(str, follows)))
    ET.indent(root, space=" ")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="utf-8") + b"\n"


def _documentation(model: Model, numbers: ValveNumbers) -> str:
    left = ", ".join(numbers.left_out) or "none"
    rows = "".join(
        f"<tr><td>{escape(n.name)}</td><td>{n.value:.10g}</td><td>{escape(n.unit)}</td><td>{escape(n.description)}</td></tr>"
        for n in numbers.numbers
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(model.valve.name)}</title>'
        f"<h1>{escape(model.valve.name)}</h1><p>Static flows of a fitted servovalve: the oil has no inertia and the ports no volume. "
        "Pressures are gauge, inputs are what the valve sees: errors of the bench's instruments and what its lines store stay on the "
        f"bench (here: {escape(left)}).</p><table>{rows}</table></html>\n"
    )


def platform_folder() -> str:
    """The folder of binaries that FMI 2.0 has for this machine; empty where it knows none."""
    system = {"linux": "linux", "darwin": "darwin", "win32": "win"}.get(sys.platform, "")
    known = platform.machine().lower() in ("x86_64", "amd64") or (system == "darwin")
    return f"{system}{64 if sys.maxsize > 2**32 else 32}" if system and known else ""


def _ending() -> str:
    return {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def compiled(sources: dict[str, str], compiler: str | None) -> tuple[str, bytes]:
    """(platform, shared library) of the sources; empty bytes where there is no compiler. Raises BenchInputError where it fails."""
    place = platform_folder()
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
