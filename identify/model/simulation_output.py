"""What `simulate` shows and writes: a CSV per test, JSON of the same columns, and a summary for the terminal."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.table import Table
from rich.text import Text

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.shown_units import significant
from thermohyd.identify.report.terminal import table

from .fitted_range import Outside, outside_json


def simulation_files(tables: dict[str, pd.DataFrame]) -> dict[str, bytes | str]:
    """{"<test>.csv": text}; nine significant digits, far beyond what a bench reads."""
    return {
        f"{test}.csv": table.to_csv(index=False, float_format="%.9g", lineterminator="\n")
        for test, table in tables.items()
    }


def simulation_json(
    tables: dict[str, pd.DataFrame], notes: Iterable[str] = (), outside: Iterable[Outside] = ()
) -> dict[str, Any]:
    """{test: {column with its unit: values}}, "notes": sentences, "outside_fitted_range": see `outside_json`."""
    columns = {test: {str(name): column.tolist() for name, column in table.items()} for test, table in tables.items()}
    return {**columns, "notes": list(notes), "outside_fitted_range": outside_json(list(outside))}


def note_lines(notes: Iterable[str]) -> list[Text]:
    """The notes for the terminal, one line each."""
    return [Text(f"* {note}", style="yellow") for note in notes]


def simulation_table(tables: dict[str, pd.DataFrame]) -> Table:
    """The range of each prediction and its largest standard deviation."""
    rows = []
    for test, predicted in tables.items():
        for name in (str(column) for column in predicted.columns):
            reading, found, unit = name.partition("_predicted [")
            if found:
                values = predicted[name].to_numpy(dtype=float)
                spread = predicted[f"{reading}_predicted_std [{unit}"].to_numpy(dtype=float)
                figures = ((np.min, values), (np.max, values), (np.max, spread))
                shown = [significant(float(f(v))) if v.size else "" for f, v in figures]
                rows.append((test, reading, unit.rstrip("]"), f"{len(predicted):,}", *shown))
    return table(("test", "reading", "unit", ">rows", ">least", ">greatest", ">std up to"), rows, gap=2)


def spare_the_record(record: BenchRecord, folder: Path | None) -> None:
    """Raises BenchInputError where the predictions, CSVs named after their tests, would overwrite files of the record."""
    own = {test.path.resolve() for test in record.tests.values()}
    for test in record.tests:
        if folder is not None and (folder / f"{test}.csv").resolve() in own:
            raise BenchInputError(
                f"--out would overwrite the record's own {test}.csv; name another folder", file=folder
            )
