"""Ask a store by SQL: DuckDB over its Parquet files, in views that a person can name.

records     one row for each record: its last diagnosis, or its last fit where it has none
results     every row: of other settings and earlier versions of the program too
parameters  one row for each parameter of each record, with its error: path, type, serial, date, ..., name, value, std, low, high, unit
effects, faults   the same of what was named
failures    records without a result, and why
"""

from typing import TYPE_CHECKING, Any

from thermohyd.identify.bench.errors import BenchInputError, one_line

from .schema import FAILURES, RESULTS


if TYPE_CHECKING:
    import duckdb
    import pandas as pd

    from .store import Store

# What the long tables repeat of their record.
OF_RECORD = "r.identity, r.path, r.type, r.serial, r.date, r.year, r.operating_hours, r.verdict"
# The last word on a record: a diagnosis says more than a fit, a fit more than a reading; a folder's earlier content is the past.
RANK = "CASE job WHEN 'diagnose' THEN 0 WHEN 'fit' THEN 1 ELSE 2 END, written DESC, identity"


def connect(store: "Store") -> "duckdb.DuckDBPyConnection":
    """A DuckDB connection with the views, in memory. It reads the files of the store when it is asked, and writes none."""
    import duckdb

    connection = duckdb.connect(":memory:")
    if store.files():
        files = _text(str(store.folder / "results/*/*/*.parquet"))
        source = f"read_parquet({files}, hive_partitioning=true, hive_types={{'type': VARCHAR, 'year': INTEGER}})"
        source = f"SELECT DISTINCT ON (identity) * FROM {source} ORDER BY identity, written DESC"
    else:
        connection.register("no_results", RESULTS.empty_table())
        source = "SELECT *, NULL::VARCHAR AS type, NULL::INTEGER AS year FROM no_results"
    connection.execute(f"CREATE VIEW results AS {source}")
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
    if any((store.folder / "failures").glob("*.parquet")):
        failed = f"read_parquet({_text(str(store.folder / 'failures/*.parquet'))}, hive_partitioning=false)"
        connection.execute(f"CREATE VIEW failures AS SELECT * FROM {failed} ORDER BY path")
    else:
        connection.register("no_failures", FAILURES.empty_table())
        connection.execute("CREATE VIEW failures AS SELECT * FROM no_failures")
    return connection


def query(store: "Store", sql: str) -> "pd.DataFrame":
    """The answer to one question. Raises BenchInputError where it is no SQL, or asks for what is not there."""
    import duckdb

    connection = connect(store)
    try:
        return connection.execute(sql).df()
    except duckdb.Error as error:
        raise BenchInputError(f"the question cannot be answered: {one_line(str(error).strip())[:600]}") from None
    finally:
        connection.close()


def _text(value: str) -> str:
    return "'" + value.replace("'", "''") + "'"


def plain_rows(table: "pd.DataFrame") -> list[dict[str, Any]]:
    """The answer as plain Python for JSON: dates as texts, what is missing as None."""
    import json

    return json.loads(str(table.to_json(orient="records", date_format="iso", default_handler=str)))
