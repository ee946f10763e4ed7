"""Ask a store by SQL: DuckDB over its Parquet files, which it reads and never writes, in views that a person can name.

records     one row for each record: its last diagnosis, or its last fit where it has none
results     every row: of other settings and earlier versions of the program too
parameters  one row for each parameter of each record, with its error: path, type, serial, date, ..., name, value, std, low, high, unit
effects, faults   the same of what was named
failures    records without a result, and why
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
from pyarrow import dataset, fs

from thermohyd.identify.bench.errors import BenchInputError, one_line

from .schema import FAILURES
from .store import WHOLE, Store, is_of_many


if TYPE_CHECKING:
    import duckdb
    import pandas as pd

# What the long tables repeat of their record.
OF_RECORD = "r.identity, r.path, r.type, r.serial, r.date, r.year, r.operating_hours, r.verdict"
# The last word on a record: a diagnosis says more than a fit, a fit more than a reading; a folder's earlier content is the past.
RANK = "CASE job WHEN 'diagnose' THEN 0 WHEN 'fit' THEN 1 ELSE 2 END, written DESC, identity"
# What is asked may come from anywhere: it sees the views, and no file, network, extension or secret. What DuckDB cannot sort in
# memory it would write into the current folder.
CLOSED = """SET python_enable_replacements = false; SET temp_directory = ''; SET autoinstall_known_extensions = false;
    SET autoload_known_extensions = false; SET enable_external_access = false; SET lock_configuration = true"""


def connect(store: Store) -> "duckdb.DuckDBPyConnection":
    """A DuckDB connection with the views, in memory, closed to all else. pyarrow reads the files of the store when it is asked."""
    import duckdb

    connection = duckdb.connect(":memory:")
    connection.register("files_of_results", _results(store))
    connection.register("files_of_failures", _files(store.failed_files(), FAILURES))
    connection.execute(
        "CREATE VIEW results AS SELECT DISTINCT ON (identity) * FROM files_of_results ORDER BY identity, written DESC"
    )
    connection.execute("CREATE VIEW failures AS SELECT * FROM files_of_failures ORDER BY path")
    connection.execute(
        f"""CREATE VIEW records AS SELECT * EXCLUDE (of_content, of_path) FROM (SELECT *,
        row_number() OVER (PARTITION BY content ORDER BY {RANK}) AS of_content,
        row_number() OVER (PARTITION BY path ORDER BY {RANK}) AS of_path FROM results)
        WHERE of_content = 1 AND of_path = 1"""
    )
    for view in ("parameters", "effects", "faults"):
        connection.execute(
            f"CREATE VIEW {view} AS SELECT {OF_RECORD}, unnest(r.{view}, recursive := true) FROM records AS r"
        )
    connection.execute(CLOSED)
    return connection


def _results(store: Store) -> dataset.Dataset:
    """With the type and the year that their folders say. Files of many results are read as far as a question needs them; those of one
    at once, for of each that it has opened pyarrow keeps 170 kB."""
    of_many = {path: place for path, place in store.places().items() if is_of_many(path)}
    said = []
    for type_, year in of_many.values():
        of_type = dataset.field("type") == type_
        said.append(of_type if year is None else of_type & (dataset.field("year") == year))
    of_one = dataset.dataset(store.rows_of(path for path in store.files() if path not in of_many))
    return dataset.dataset([of_one, _files([*of_many], WHOLE, said)])


def _files(paths: list[Path], schema: pa.Schema, said: list[dataset.Expression] | None = None) -> dataset.Dataset:
    """Of Parquet, of which nothing is read yet. said: of each file what its rows do not say."""
    if not paths:
        return dataset.dataset(schema.empty_table())
    return dataset.FileSystemDataset.from_paths(
        [str(path.absolute()) for path in paths],
        schema=schema,
        format=dataset.ParquetFileFormat(),
        filesystem=fs.LocalFileSystem(),
        partitions=said,
    )


def query(store: Store, sql: str) -> "pd.DataFrame":
    """The answer to one question, of all files that can be read (`store.set_aside` names the others). Raises BenchInputError where it
    is no SQL, asks for what is not there, or for what is no part of the store."""
    import duckdb

    while True:
        connection = connect(store)
        try:
            return connection.execute(sql).df()
        except duckdb.Error as error:
            of_the_question = isinstance(
                error, duckdb.ParserException | duckdb.BinderException | duckdb.CatalogException
            )
            if of_the_question or not store.look_through():
                words = one_line(str(error).strip())[:600]
                raise BenchInputError(f"the question cannot be answered: {words}") from None
        finally:
            connection.close()


def plain_rows(table: "pd.DataFrame") -> list[dict[str, Any]]:
    """The answer as plain Python for JSON: dates as texts, what is missing as None."""
    import json

    return json.loads(str(table.to_json(orient="records", date_format="iso", default_handler=str)))
