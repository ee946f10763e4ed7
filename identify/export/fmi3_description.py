"""modelDescription.xml and buildDescription.xml of FMI 3.0, from what the FMU takes and gives."""

from xml.etree import ElementTree as ET

from .fmi2_description import EXPERIMENT, add_units, described, tool, written
from .interface import OF_INPUTS, OF_OUTPUTS, OF_RATES, Interface, rate_unit


OF_TIME = 4000  # the value reference of time


def description(name: str, token: str, valve: str, interface: Interface) -> bytes:
    """modelDescription.xml. name: of the model in C; valve: as its bench calls it."""
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=name,
        instantiationToken=token,
        description=described(valve, interface),
        generationTool=tool(),
        variableNamingConvention="flat",
    )
    states = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
    ET.SubElement(root, "ModelExchange", {"modelIdentifier": name, **states})
    steps = {"canHandleVariableCommunicationStepSize": "true"}
    ET.SubElement(root, "CoSimulation", {"modelIdentifier": name, **states, **steps})
    add_units(root, interface)
    ET.SubElement(root, "DefaultExperiment", EXPERIMENT)
    variables = ET.SubElement(root, "ModelVariables")

    def variable(reference: int, name: str, words: str, **more: str) -> None:
        about = {"name": name, "valueReference": str(reference), "description": words, **more}
        ET.SubElement(variables, "Float64", about)

    variable(OF_TIME, "time", "Time", causality="independent", variability="continuous", unit="s")
    for i, number in enumerate(interface.numbers):
        fixed = {
            "causality": "parameter",
            "variability": "fixed",
            "unit": number.unit,
            "start": repr(float(number.value)),
        }
        variable(i, number.name, number.description, **fixed)
    for i, (own, (unit, start, words)) in enumerate(interface.inputs.items()):
        variable(
            OF_INPUTS + i, own, words, causality="input", variability="continuous", unit=unit, start=repr(float(start))
        )
    for i, (own, (unit, words)) in enumerate(interface.outputs.items()):
        variable(OF_OUTPUTS + i, own, words, causality="output", variability="continuous", unit=unit)
    for i, (own, (unit, _)) in enumerate(list(interface.outputs.items())[: interface.states]):
        of = {"derivative": str(OF_OUTPUTS + i), "unit": rate_unit(unit)}
        variable(
            OF_RATES + i, f"der({own})", f"Rate of change of {own}", causality="local", variability="continuous", **of
        )
    structure = ET.SubElement(root, "ModelStructure")
    rates = [OF_RATES + i for i in range(interface.states)]
    outputs = [OF_OUTPUTS + i for i in range(len(interface.outputs))]
    for block, references in (
        ("Output", outputs),
        ("ContinuousStateDerivative", rates),
        ("InitialUnknown", [*outputs, *rates]),
    ):
        for reference in references:
            follows = {}
            if not interface.states:
                of = interface.followed(list(interface.outputs)[reference - OF_OUTPUTS])
                follows = {"dependencies": " ".join(str(OF_INPUTS + i) for i in of)}
            ET.SubElement(structure, block, {"valueReference": str(reference), **follows})
    return written(root)


def build_description(name: str, interface: Interface) -> bytes:
    """sources/buildDescription.xml: what a host compiles."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=name)
    listed = ET.SubElement(build, "SourceFileSet", language="C99")
    for file in ("fmi3.c", *interface.sources):
        if file.endswith(".c"):
            ET.SubElement(listed, "SourceFile", name=file)
    return written(root)
