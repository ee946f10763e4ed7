"""modelDescription.xml of FMI 2.0, from what the FMU takes and gives."""

from importlib.metadata import version
from xml.etree import ElementTree as ET

from .interface import OF_INPUTS, OF_OUTPUTS, OF_RATES, Interface, rate_unit


# Exponents of kg, m, s, A, K.
BASE_UNITS = {
    "1": {}, "m": {"m": 1}, "Pa": {"kg": 1, "m": -1, "s": -2}, "K": {"K": 1}, "A": {"A": 1}, "m3/s": {"m": 3, "s": -1},
    "kg/s": {"kg": 1, "s": -1}, "kg/m3": {"kg": 1, "m": -3}, "1/K": {"K": -1}, "1/Pa": {"kg": -1, "m": 1, "s": 2},
    "J/(kg.K)": {"m": 2, "s": -2, "K": -1}, "J/(kg.K2)": {"m": 2, "s": -2, "K": -2}, "m/K": {"m": 1, "K": -1},
    "m/Pa": {"kg": -1, "m": 2, "s": 2}, "m/A": {"m": 1, "A": -1}, "Pa/(m3/s)": {"kg": 1, "m": -4, "s": -1},
    "Pa/(m3/s)^2": {"kg": 1, "m": -7}, "m3/(s Pa)": {"kg": -1, "m": 4, "s": 1},
    "m2": {"m": 2}, "m3": {"m": 3}, "kg": {"kg": 1}, "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2}, "N": {"kg": 1, "m": 1, "s": -2}, "N.s/m": {"kg": 1, "s": -1}, "Hz": {"s": -1}, "s": {"s": 1},
    "A/V": {"kg": -1, "m": -2, "s": 3, "A": 2}, "V/m": {"kg": 1, "m": 1, "s": -3, "A": -1}, "m/N": {"kg": -1, "s": 2},
    "W/K": {"kg": 1, "m": 2, "s": -3, "K": -1}, "K/s": {"K": 1, "s": -1}, "Pa/s": {"kg": 1, "m": -1, "s": -3},
}  # fmt: skip


def description(name: str, guid: str, valve: str, interface: Interface) -> bytes:
    """modelDescription.xml. name: of the model in C; valve: as its bench calls it."""
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=name,
        guid=guid,
        description=described(valve, interface),
        generationTool=tool(),
        variableNamingConvention="flat",
        numberOfEventIndicators="0",
    )
    for kind in ("ModelExchange", "CoSimulation"):
        more = {}
        if kind == "CoSimulation":
            more = {"canHandleVariableCommunicationStepSize": "true"}
            more |= {"canInterpolateInputs": "true"} if interface.states else {}
        states = {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
        part = ET.SubElement(root, kind, {"modelIdentifier": name, **states, **more})
        listed = ET.SubElement(part, "SourceFiles")
        for file in ("fmi2.c", *interface.sources):
            if file.endswith(".c"):
                ET.SubElement(listed, "File", name=file)
    add_units(root, interface)
    ET.SubElement(root, "DefaultExperiment", EXPERIMENT)
    variables = ET.SubElement(root, "ModelVariables")

    def variable(
        reference: int, name: str, unit: str, words: str, start: float | None, real: dict, **kind: str
    ) -> None:
        about = {"name": name, "valueReference": str(reference), "description": words, **kind}
        made = ET.SubElement(variables, "ScalarVariable", about)
        ET.SubElement(made, "Real", {"unit": unit, **({} if start is None else {"start": repr(float(start))}), **real})

    fixed = {"causality": "parameter", "variability": "fixed"}
    for i, number in enumerate(interface.numbers):
        variable(i, number.name, number.unit, number.description, number.value, {}, **fixed)
    for i, (own, (unit, start, words)) in enumerate(interface.inputs.items()):
        variable(OF_INPUTS + i, own, unit, words, start, {}, causality="input", variability="continuous")
    for i, (own, (unit, words)) in enumerate(interface.outputs.items()):
        variable(OF_OUTPUTS + i, own, unit, words, None, {}, causality="output", variability="continuous")
    first = len(interface.numbers) + 1
    outputs = [first + len(interface.inputs) + i for i in range(len(interface.outputs))]
    rates = [outputs[-1] + 1 + i for i in range(interface.states)]
    for i, (own, (unit, _)) in enumerate(list(interface.outputs.items())[: interface.states]):
        of = {"derivative": str(outputs[i])}
        words = f"Rate of change of {own}"
        variable(
            OF_RATES + i, f"der({own})", rate_unit(unit), words, None, of, causality="local", variability="continuous"
        )
    structure = ET.SubElement(root, "ModelStructure")
    unknowns = {"Outputs": outputs, "Derivatives": rates, "InitialUnknowns": [*outputs, *rates]}
    for block, indices in unknowns.items():
        listed = ET.SubElement(structure, block) if indices else structure
        for index in indices:
            follows = {}
            if not interface.states:
                of = interface.followed(list(interface.outputs)[index - outputs[0]])
                follows = {"dependencies": " ".join(str(first + j) for j in of)}
            ET.SubElement(listed, "Unknown", {"index": str(index), **follows})
    return written(root)


EXPERIMENT = {"startTime": "0.0", "stopTime": "1.0", "stepSize": "0.001"}


def described(valve: str, interface: Interface) -> str:
    return f"{interface.words} {valve}, fitted to bench curves"


def tool() -> str:
    return f"thermohyd {version('thermohyd')}"


def add_units(root: ET.Element, interface: Interface) -> None:
    """The definitions of the units in use, which both versions write alike."""
    units = ET.SubElement(root, "UnitDefinitions")
    for unit in interface.units:
        defined = ET.SubElement(units, "Unit", name=unit)
        if unit in BASE_UNITS:
            ET.SubElement(defined, "BaseUnit", {base: str(power) for base, power in BASE_UNITS[unit].items()})


def written(root: ET.Element) -> bytes:
    """The document, as indented UTF-8."""
    ET.indent(root, space=" ")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="utf-8") + b"\n"
