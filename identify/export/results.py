"""Results of a fit or a diagnosis as plain tables: CSV, Parquet, or the sheets of one spreadsheet. No JAX.

parameters   name, value, unit (SI), std, ci95, bounds ...; named effects are among them
correlation  of the free ones
readings     of every test and channel: points, noise, residuals
effects      of a diagnosis: named effects with their evidence
record       the files, with their hashes
<test>       curves: the record's rows with the model's prediction, where a record is given
"""

import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from thermohyd.identify.bench.errors import BenchInputError, one_line, quoted
from thermohyd.identify.optional_parts import install


FORMATS = ("csv", "parquet", "xlsx")
LARGEST = 50_000_000  # bytes of a result's JSON
LONGEST_SHEET = 31  # letters of a sheet's name, as spreadsheets have it


def load_result(path: Path) -> dict[str, Any]:
    """A fit.json or a diagnosis.json. Raises BenchInputError."""
    try:
        if path.stat().st_size > LARGEST:
            raise BenchInputError(f"is larger than {LARGEST:,} bytes: not a fit.json", file=path)
        content = _in_one_line(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise BenchInputError(f"cannot be read ({error.strerror or error})", file=path) from None
    except (ValueError, RecursionError):
        raise BenchInputError("is not JSON; give the fit.json or diagnosis.json of a result", file=path) from None
    fit = content.get("fit", content) if isinstance(content, dict) else None
    if not isinstance(fit, dict) or not isinstance(fit.get("parameters"), dict):
        raise BenchInputError("holds no parameters; give the fit.json or diagnosis.json of a result", file=path)
    return content


def _in_one_line(value: Any) -> Any:
    """The content with texts that a spreadsheet, a terminal and UTF-8 can hold."""
    if isinstance(value, dict):
        return {one_line(key): _in_one_line(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_in_one_line(entry) for entry in value]
    return one_line(value) if isinstance(value, str) else value


def result_tables(content: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """{name: table} of a result's JSON."""
    fit = content.get("fit", content)
    tables: dict[str, pd.DataFrame] = {"parameters": _parameters(fit["parameters"])}
    correlation = fit.get("correlation") or {}
    if correlation:
        names = list(correlation)
        rows = [[1.0 if a == b else correlation[a].get(b) for b in names] for a in names]
        table = pd.DataFrame(rows, columns=names)
        table.insert(0, "parameter", names)
        tables["correlation"] = table
    channels = [
        {
            "test": test,
            "channel": channel,
            **{key: value for key, value in about.items() if not isinstance(value, dict | list)},
        }
        for test, each in (fit.get("channels") or {}).items()
        for channel, about in each.items()
    ]
    if channels:
        tables["readings"] = pd.DataFrame(channels)
    if content.get("effects"):
        tables["effects"] = pd.DataFrame([_effect(effect) for effect in content["effects"]])
    files = (content.get("record") or fit.get("record") or {}).get("files")
    if files:
        tables["record"] = pd.DataFrame(files)
    return tables


def _parameters(given: Mapping[str, Mapping[str, Any]]) -> pd.DataFrame:
    rows = []
    for name, about in given.items():
        low, high = about.get("ci95") or (None, None)
        lower, upper = about.get("bounds") or (None, None)
        rows.append(
            {
                "parameter": name,
                "value": about.get("value"),
                "unit": about.get("unit"),
                "std": about.get("std"),
                "ci95_low": low,
                "ci95_high": high,
                "at_bound": about.get("at_bound"),
                "fixed": about.get("fixed"),
                "start": about.get("start"),
                "lower": lower,
                "upper": upper,
                "why_no_error_bar": about.get("why_no_error_bar") or "",
            }
        )
    return pd.DataFrame(rows)


def _effect(about: Mapping[str, Any]) -> dict[str, Any]:
    amount = about.get("parameter") or {}
    low, high = amount.get("ci95") or (None, None)
    return {
        "effect": about.get("name"),
        "value": amount.get("value"),
        "unit": amount.get("unit"),
        "std": amount.get("std"),
        "ci95_low": low,
        "ci95_high": high,
        "p_value": about.get("p_value"),
        "gap_closed": about.get("gap_closed"),
        "alternatives": ", ".join(about.get("alternatives") or ()),
        "sentence": about.get("sentence") or "",
    }


def result_files(tables: Mapping[str, pd.DataFrame], formats: Iterable[str]) -> dict[str, bytes]:
    """{file name: content}: a file per table, of a spreadsheet one for all. Raises BenchInputError."""
    files: dict[str, bytes] = {}
    for form in formats:
        if form not in FORMATS:
            raise BenchInputError(f"--format: unknown format {quoted(form)}; known: {', '.join(FORMATS)}")
        if form == "csv":
            files |= {
                f"{name}.csv": _without_formulas(table).to_csv(index=False, lineterminator="\n").encode()
                for name, table in tables.items()
            }
        elif form == "parquet":
            files |= {f"{name}.parquet": _parquet(table) for name, table in tables.items()}
        else:
            files["results.xlsx"] = _spreadsheet(tables)
    return files


def _parquet(table: pd.DataFrame) -> bytes:
    try:
        import pyarrow  # noqa: F401  # pandas writes by it
    except ImportError:
        raise BenchInputError(
            f"Parquet needs the package pyarrow: {install('parquet')}; or take --format csv"
        ) from None
    packed = io.BytesIO()
    table.to_parquet(packed, index=False)
    return packed.getvalue()


def _without_formulas(table: pd.DataFrame) -> pd.DataFrame:
    """The table with an apostrophe before what a spreadsheet would compute: it stays a text. "-" alone is a unit."""
    computed = lambda cell: isinstance(cell, str) and len(cell) > 1 and cell[0] in "=+-@"
    return table.map(lambda cell: f"'{cell}" if computed(cell) else cell)


def _spreadsheet(tables: Mapping[str, pd.DataFrame]) -> bytes:
    packed = io.BytesIO()
    with pd.ExcelWriter(packed, engine="openpyxl") as book:
        for name, table in tables.items():
            _without_formulas(table).to_excel(book, sheet_name=name[:LONGEST_SHEET], index=False, freeze_panes=(1, 0))
    return packed.getvalue()
