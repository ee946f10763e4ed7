"""The lines of a CSV file as a table: split fast where nothing is quoted; rows of another length are set aside."""

import csv
import io

import pandas as pd

from .bad_cells import BadCell
from .cells import Cells
from .csv_lines import CsvLines, split_cells


def csv_cells(source: CsvLines, texts: tuple[int, ...] = ()) -> Cells:
    """`texts`: columns that stay as they are written (run names). Raises BenchInputError where most rows are uneven."""
    source, bad_rows = _even_rows(source)
    width = len(source.header)
    body = "\n".join(source.lines)
    # A comma that separates nothing is a decimal one: then everything is read as text first, and no thousands
    # separator can pass for a decimal point.
    decimal_comma = source.separator != "," and "," in body
    if '"' in body:
        rows = [
            split_cells(line, source.separator, source.path, number)
            for line, number in zip(source.lines, source.numbers, strict=True)
        ]
        frame = pd.DataFrame(rows, columns=range(width), dtype=str)
    else:
        frame = pd.read_csv(
            io.StringIO(body),
            header=None,
            names=list(range(width)),
            index_col=False,
            sep=source.separator,
            quoting=csv.QUOTE_NONE,
            skipinitialspace=True,
            na_filter=False,
            low_memory=False,
            dtype=str if decimal_comma else dict.fromkeys(texts, str),
        )
    return Cells(source, frame, decimal_comma=decimal_comma, separator=source.separator, bad_rows=bad_rows)


def _even_rows(source: CsvLines) -> tuple[CsvLines, tuple[BadCell, ...]]:
    """(the rows with as many cells as there are headers, what is wrong with the others); quoted rows are counted cell by cell."""
    width, separator = len(source.header), source.separator
    if source.header_text not in source.lines and {line.count(separator) for line in source.lines} == {width - 1}:
        return source, ()
    bad: dict[int, BadCell] = {}
    for row, (line, number) in enumerate(zip(source.lines, source.numbers, strict=True)):
        found = line.count(separator) + 1
        if found != width and '"' in line:
            found = len(split_cells(line, separator, source.path, number))
        if found != width:
            what = f"the row has {found} {'cell' if found == 1 else 'cells'}, but there are {width} headers"
            bad[row] = _bad_row(source, number, what, "is the line cut off, or the separator wrong?")
        elif line == source.header_text:
            remedy = "are these two logs in one file? Remove the line, and give each log its own run"
            bad[row] = _bad_row(source, number, "the headers stand here again", remedy)
    if not bad:
        return source, ()
    first = next(iter(bad.values()))
    if len(bad) == len(source.lines):
        raise source.error(f"{first.what}; {first.remedy}", number=first.number)
    return source.only(lambda row: row not in bad), tuple(bad.values())


def _bad_row(source: CsvLines, number: int, what: str, remedy: str) -> BadCell:
    return BadCell(source.path, source.word, number, None, what, remedy)
