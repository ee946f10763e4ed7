"""The `noise` of a test in bench.toml: what the user knows of its readings' scatter."""

from collections.abc import Mapping

from .columns_of_tests import READINGS
from .toml_source import TomlTable


def read_noise(table: TomlTable, readings: Mapping[str, str] | None = None) -> dict[str, float]:
    """{reading: standard deviation, SI} of a `[tests.<name>]` table: one quantity for all readings, or a table.

    readings: {name: kind} where the test's own keys decide it. Raises BenchInputError.
    """
    readings = READINGS[table.path[-1]] if readings is None else readings
    if "noise" not in table:
        return {}
    each = table.table("noise") if isinstance(table.data["noise"], dict) else None
    if each is not None:
        each.refuse_unknown(tuple(readings), "reading")
        return {r: each.as_quantity(r, text, readings[r], sign="positive") for r, text in each.data.items()}
    if len(set(readings.values())) > 1:
        example = ", ".join(f'{reading} = "..."' for reading in list(readings)[:2])
        raise table.error(f"the readings differ in kind; write one value per reading: {{ {example} }}", "noise")
    return {r: table.as_quantity("noise", table.data["noise"], kind, sign="positive") for r, kind in readings.items()}
