"""What `simulate` shows and writes: a CSV per test, JSON of the same columns, and a summary for the terminal."""

from typing import Any

import numpy as np
import pandas as pd
from rich import box
from rich.table import Table
from rich.text import Text


def simulation_files(tables: dict[str, pd.DataFrame]) -> dict[str, bytes | str]:
    """{"<test>.csv": text}; nine significant digits, far beyond what a bench reads."""
    return {
        f"{test}.csv": table.to_csv(index=False, float_format="%.9g", lineterminator="\n")
        for test, table in tables.items()
    }


def simulation_json(tables: dict[str, pd.DataFrame]) -> dict[str, Any]:
    """{test: {column with its unit: values}}"""
    return {test: {str(name): column.tolist() for name, column in table.items()} for test, table in tables.items()}


def simulation_table(tables: dict[str, pd.DataFrame]) -> Table:
    """The range of each prediction and its largest standard deviation."""
    summary = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False)
    for title in ("test", "prediction", "rows", "least", "greatest", "largest std"):
        summary.add_column(title, justify="left" if title in ("test", "prediction") else "right")
    for test, table in tables.items():
        for name in (str(column) for column in table.columns):
            if "_predicted [" not in name:
                continue
            values = table[name].to_numpy(dtype=float)
            spread = table[name.replace("_predicted [", "_predicted_std [")].to_numpy(dtype=float)
            figures = [
                f"{f(v):.4g}" if v.size else "" for f, v in ((np.min, values), (np.max, values), (np.max, spread))
            ]
            cells = (test, name.replace("_predicted", ""), f"{len(table):,}", *figures)
            summary.add_row(*[Text(cell) for cell in cells])
    return summary
