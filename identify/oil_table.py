"""The `[oil]` table of a bench.toml as an OilDefinition: a preset or viscosity points, and further properties."""

from dataclasses import replace

from thermohyd.data import oil_preset

from ..oil_definition import OilDefinition, walther_coefficients
from .toml_source import TomlTable


# Properties beside the viscosity, each with its kind of quantity; all at 15 degC and zero gauge pressure.
PROPERTIES = {
    "density": "density",
    "expansion": "thermal expansion",
    "bulk_modulus": "pressure",
    "specific_heat": "specific heat",
    "pressure_viscosity": "compressibility",
}
KEYS = ("preset", "viscosity", *PROPERTIES, "name")


def read_oil(table: TomlTable) -> OilDefinition:
    """The oil, SI; what the table lacks takes the preset's or the model's defaults. Raises BenchInputError."""
    table.refuse_unknown(KEYS)
    preset = table.text("preset")
    if preset is not None and "viscosity" in table:
        raise table.error("both a preset and viscosity points; keep one of them", "viscosity")
    if preset is not None:
        try:
            oil = oil_preset(preset)
        except ValueError as error:
            raise table.error(str(error), "preset") from None
    else:
        oil = _oil_of_points(table)
    # A pressure viscosity of zero is a value of its own: no rise with pressure.
    signs = {key: "not negative" if key == "pressure_viscosity" else "positive" for key in PROPERTIES}
    given = {key: table.quantity(key, kind, sign=signs[key]) for key, kind in PROPERTIES.items()}
    name = table.text("name")
    oil = replace(oil, **{key: value for key, value in given.items() if value is not None})
    return oil if name is None else replace(oil, name=name)


def _oil_of_points(table: TomlTable) -> OilDefinition:
    example = 'viscosity = [["-40 degC", "4000 cSt"], ["70 degC", "30 cSt"]]'
    if "viscosity" not in table:
        raise table.error(f'the oil is missing; write preset = "mil-prf-5606", or points: {example}')
    points = table.data["viscosity"]
    if not isinstance(points, list) or not all(isinstance(p, list) and len(p) == 2 for p in points):
        raise table.error(f"must be a list of points, each a temperature and a viscosity: {example}", "viscosity")
    temperatures = [table.as_quantity("viscosity", p[0], "temperature") for p in points]
    viscosities = [table.as_quantity("viscosity", p[1], "kinematic viscosity") for p in points]
    try:
        law = walther_coefficients(temperatures, viscosities)
    except ValueError as error:
        raise table.error(str(error), "viscosity") from None
    return OilDefinition(
        *law, source="viscosity points of the record", coldest=min(temperatures), hottest=max(temperatures)
    )
