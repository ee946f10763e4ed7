"""The tables of a valve as three programs read them: Modelica's CombiTable2Ds, Simscape's lookup tables, Amesim's tables."""

import io
import re
from collections.abc import Callable

import numpy as np

from .valve_tables import ValveTable, ValveTables


DIGITS = 17  # of a number in a text: all that a double has


def modelica(tables: ValveTables) -> dict[str, bytes]:
    """One text file: `CombiTable2Ds(tableOnFile=true, tableName="load_flow", fileName=...)`, u1 the position, u2 the other axis."""
    lines = ["#1"]
    for table in tables.tables:
        lines += [f"# {line}" for line in _about(tables, table)]
        lines.append(
            f"# u1: {table.x.name} [{table.x.unit}], u2: {table.y.name} [{table.y.unit}], y: {table.name} [{table.unit}]"
        )
        lines.append(f"double {table.name}({len(table.x.nodes) + 1},{len(table.y.nodes) + 1})")
        lines.append(_numbers([0.0, *table.y.nodes]))
        lines += [_numbers([x, *row]) for x, row in zip(table.x.nodes, table.values, strict=True)]
    return {f"{_stem(tables)}_modelica.txt": ("\n".join(lines) + "\n").encode("ascii")}


def simscape(tables: ValveTables) -> dict[str, bytes]:
    """One .mat file with a struct per table: x and y for the grid vectors of a PS Lookup Table (2D), f for its values (x by y)."""
    from scipy.io import savemat

    content = {
        table.name: {
            "x": table.x.nodes,
            "y": table.y.nodes,
            "f": table.values,
            "about": "; ".join(
                [*_about(tables, table), f"x: {table.x.name} [{table.x.unit}]", f"y: {table.y.name} [{table.y.unit}]",
                 f"f: {table.name} [{table.unit}]"]
            ),
            "largest_error": table.largest,
        }
        for table in tables.tables
    }  # fmt: skip
    packed = io.BytesIO()
    savemat(packed, content, long_field_names=True, do_compression=True)
    return {f"{_stem(tables)}_simscape.mat": _without_date(packed.getvalue())}


def amesim(tables: ValveTables) -> dict[str, bytes]:
    """A .data file per table, "Table format: 2D": sizes, nodes of both axes, then a line of all positions per node of the other."""
    files = {}
    for table in tables.tables:
        lines = ["# Table format: 2D", *(f"# {line}" for line in _about(tables, table))]
        lines += [f"# table_unit = {_amesim_unit(table.unit)}"]
        lines += [f"# axis{i}_unit = {_amesim_unit(axis.unit)}" for i, axis in ((1, table.x), (2, table.y))]
        lines += [f"# axis{i}_title = {axis.name}" for i, axis in ((1, table.x), (2, table.y))]
        lines += [str(len(table.x.nodes)), str(len(table.y.nodes)), _numbers(table.x.nodes), _numbers(table.y.nodes)]
        lines += [_numbers(column) for column in table.values.T]
        files[f"{_stem(tables)}_{table.name}.data"] = ("\n".join(lines) + "\n").encode("ascii")
    return files


WRITERS: dict[str, Callable[[ValveTables], dict[str, bytes]]] = {
    "modelica": modelica,
    "simscape": simscape,
    "amesim": amesim,
}


def error_words(table: ValveTable) -> str:
    """What interpolating makes of it, in words."""
    share = table.largest / table.span if table.span > 0.0 else 0.0
    return (
        f"linear interpolation between the nodes misses the model by at most {table.largest:.3g} {table.unit} "
        f"({100.0 * share:.2g} % of the range), {table.mean:.2g} {table.unit} on average"
    )


def _about(tables: ValveTables, table: ValveTable) -> list[str]:
    return [
        f"{_ascii(tables.name)}: {table.words}",
        f"supply {tables.supply_pressure:.10g} Pa, return {tables.return_pressure:.10g} Pa (gauge), oil {tables.temperature:.10g} K",
        error_words(table),
    ]


def _numbers(values: np.ndarray | list[float]) -> str:
    return " ".join(f"{value:.{DIGITS}g}" for value in values)


def _stem(tables: ValveTables) -> str:
    return re.sub(r"[^0-9A-Za-z]+", "_", tables.name).strip("_")[:40] or "valve"


def _ascii(text: str) -> str:
    return "".join(c if c.isascii() and c.isprintable() else "?" for c in text)


def _amesim_unit(unit: str) -> str:
    return unit.replace("m3", "m**3")


def _without_date(content: bytes) -> bytes:
    """The header of a .mat file is a text with the time of its making: the same tables shall be the same bytes."""
    return b"MATLAB 5.0 MAT-file, made by thermohyd".ljust(116) + content[116:]
