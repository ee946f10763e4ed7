"""A folder of Parquet files that holds a fleet's results: one file per record as it is computed, fewer ones once a run has ended.

    STORE/store.json                                  which version of the schema
    STORE/results/type=MOOG%2076/year=2026/*.parquet  results
    STORE/failures/*.parquet                          records without a result, and why
    STORE/reports/IDENTITY/                           a record's own report, where they were asked for

A file is written under another name and renamed, so that it is there whole or not at all; its name is the result's identity, so that
a result that is computed twice is there once. Raw records stay where they are.
"""

import contextlib
import errno
import fcntl
import json
import os
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import pyarrow as pa
import pyarrow.parquet as pq

from thermohyd.identify.bench.errors import BenchInputError, one_line
from thermohyd.identify.report.files import write_all

from .rows import UNKNOWN_TYPE
from .schema import FAILURES, RESULTS, SCHEMA, migrated, with_version


NAME = "store.json"
UNDATED = "__HIVE_DEFAULT_PARTITION__"  # a year that is null, as Hive, DuckDB and Spark write it
WRITING = ".writing-"  # what is not whole yet
TOGETHER_NAME = "together-"
WHOLE = pa.schema([*RESULTS, ("type", pa.string()), ("year", pa.int32())])  # with what the folders say
TOGETHER = 64  # results of one type and year that are worth a file of their own


class StoreError(Exception):
    """The store cannot be written, whatever the record: a run ends."""


class Store:
    """A fleet's results on a disk that all workers see. Opening one makes it, and brings an older one up to date.

    set_aside: {file: why it cannot be read}, of those that were asked for since; the others answer without it. Raises
    BenchInputError where the folder is no store or one of a newer program, StoreError where it cannot be written.
    """

    def __init__(self, folder: str | Path, *, make: bool = True) -> None:
        self.folder = Path(folder)
        self.set_aside: dict[Path, str] = {}
        if not (self.folder / NAME).is_file():
            if not make:
                raise BenchInputError("is no fleet's store; `thermohyd fleet run` makes one", file=self.folder)
            self._make()
        self._bring_up_to_date()

    def _make(self) -> None:
        try:
            if self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
                what = "is a file" if not self.folder.is_dir() else "holds other files"
                raise BenchInputError(
                    f"{what}; a new store takes an empty folder, or one that is not there yet", file=self.folder
                )
            write_all(self.folder, {NAME: json.dumps({"schema": SCHEMA}) + "\n"})
        except OSError as error:
            raise _trouble(error) from None

    # Writing

    def write_result(self, row: Mapping[str, Any]) -> Path:
        """Keep a row of `rows.row_of`; what the record failed with before is forgotten. Raises StoreError."""
        folder = self.folder / "results" / partition(row.get("type"), row.get("date"))
        path = self._write(folder / f"{row['identity']}.parquet", pa.Table.from_pylist([dict(row)], RESULTS))
        self.forget_failures([row["identity"]])
        return path

    def write_failure(self, row: Mapping[str, Any]) -> Path:
        """Keep why a record has no result. Raises StoreError."""
        path = self.folder / "failures" / f"{row['identity']}.parquet"
        return self._write(path, pa.Table.from_pylist([dict(row)], FAILURES))

    def _write(self, path: Path, table: pa.Table) -> Path:
        unfinished = path.parent / f"{WRITING}{uuid.uuid4().hex}"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with unfinished.open("wb") as file:
                pq.write_table(with_version(table), file, compression="zstd")
                file.flush()
                os.fsync(file.fileno())
            unfinished.replace(path)
        except OSError as error:
            raise _trouble(error) from None
        finally:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
        return path

    def forget_failures(self, identities: Iterable[str]) -> None:
        """These records are tried again."""
        for identity in identities:
            with contextlib.suppress(OSError):
                (self.folder / "failures" / f"{identity}.parquet").unlink(missing_ok=True)

    # Reading

    def files(self) -> list[Path]:
        """Of results; whole ones only, without those that are set aside."""
        return self._readable("results/*/*/*.parquet")

    def failed_files(self) -> list[Path]:
        """Of records without a result."""
        return self._readable("failures/*.parquet")

    def _readable(self, pattern: str) -> list[Path]:
        return sorted(path for path in self.folder.glob(pattern) if path not in self.set_aside)

    def results(self, columns: list[str] | None = None) -> pa.Table:
        """All results, sorted by identity, each once; with its type and year in two columns more unless `columns` says which."""
        wanted = WHOLE.names if columns is None else columns
        return _once(self.rows_of(self.files(), [*dict.fromkeys([*wanted, "identity", "written"])])).select(wanted)

    def rows_of(self, files: Iterable[Path], columns: list[str] = WHOLE.names) -> pa.Table:
        """Of files of results, as they stand there."""
        tables = [table for path in files if (table := self._read(_with_place, path, columns)) is not None]
        return pa.concat_tables([WHOLE.empty_table().select(columns), *(table.select(columns) for table in tables)])

    def done(self) -> set[str]:
        """Identities of all results."""
        files = self.files()
        together = [path for path in files if is_of_many(path)]
        found = {path.stem for path in files} - {path.stem for path in together}
        tables = [self._read(_plain, path, ["identity"]) for path in together]
        return found.union(*(table["identity"].to_pylist() for table in tables if table is not None))

    def has(self, identity: str) -> bool:
        """Whether this result was written since the files of a run were last put together: cheap, for a worker."""
        return next((self.folder / "results").glob(f"*/*/{identity}.parquet"), None) is not None

    def failures(self) -> list[dict[str, Any]]:
        """Records without a result, sorted by path."""
        tables = [self._read(_plain, path) for path in self.failed_files()]
        found = [row for table in tables if table is not None for row in table.to_pylist()]
        return sorted(found, key=lambda row: (row["path"], row["identity"]))

    def look_through(self) -> bool:
        """Read every file, one at a time; whether one had to be set aside."""
        before = len(self.set_aside)
        for path in self.files():
            self._read(_with_place, path)
        for path in self.failed_files():
            self._read(_plain, path)
        return len(self.set_aside) > before

    def places(self) -> dict[Path, tuple[str, int | None]]:
        """{file of results: the type and the year that its folders say}"""
        found = {path: self._read(lambda path, _: _place_of(path), path) for path in self.files()}
        return {path: place for path, place in found.items() if place is not None}

    def _read[Read](
        self, read: Callable[[Path, list[str] | None], Read], path: Path, columns: list[str] | None = None
    ) -> Read | None:
        """None, and set aside, where it cannot be read."""
        try:
            return read(path, columns)
        except (OSError, ValueError, pa.ArrowException) as error:
            reason = one_line(str(error).strip().partition("\n")[0])
            self.set_aside[path] = f"cannot be read ({reason}); remove it, and its records are computed again"
            return None

    # Care

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Within, no other run or watch of this store is under way. Raises BenchInputError where one is."""
        with _locked(self.folder / ".run") as free:
            if not free:
                raise BenchInputError(
                    "another run of this store is under way; it holds what this one would compute", file=self.folder
                )
            yield

    def tidy(self, *, all_of_them: bool = False) -> int:
        """Put small files together, one for a type and year, and remove what killed processes left. Returns how many went.

        A reader sees a result in both files for a moment, never in none: whatever reads a store takes each identity once.
        """
        with contextlib.suppress(OSError):
            for left in (self.folder / "results").glob(f"*/*/{WRITING}*"):
                left.unlink(missing_ok=True)
        went = 0
        for folder in sorted({path.parent for path in self.files()}):
            small = [path for path in sorted(folder.glob("*.parquet")) if not is_of_many(path)]
            if len(small) < 2 or (len(small) < TOGETHER and not all_of_them):
                continue
            tables = {path: table for path in small if (table := self._read(_plain, path)) is not None}
            if len(tables) < 2:
                continue
            table = _once(pa.concat_tables(tables.values()))
            self._write(folder / f"{TOGETHER_NAME}{uuid.uuid4().hex}.parquet", table)
            for path in tables:
                with contextlib.suppress(OSError):
                    path.unlink()
            went += len(tables)
        return went

    def _bring_up_to_date(self) -> None:
        try:
            number = json.loads((self.folder / NAME).read_text(encoding="utf-8"))["schema"]
        except (OSError, ValueError, KeyError, TypeError):
            raise BenchInputError(
                "cannot be read: it should say which schema the store has", file=self.folder / NAME
            ) from None
        if not isinstance(number, int) or number > SCHEMA:
            raise BenchInputError(
                f"has schema {number}, but this program knows up to {SCHEMA}: update thermohyd", file=self.folder
            )
        if number < SCHEMA:
            self._migrate()

    def _migrate(self) -> None:
        for path in (*self.files(), *self.failed_files()):
            table = self._read(_brought_up_to_date, path)
            if table is not None:
                self._write(path, table)
        write_all(self.folder, {NAME: json.dumps({"schema": SCHEMA}) + "\n"})


def partition(type_: object, date: Any) -> str:
    """The folders of a type and year; characters that a file system or a URL would not take are written as %XX."""
    year = UNDATED if date is None else str(date.year)
    return f"type={quote(str(type_ or UNKNOWN_TYPE), safe='')}/year={year}"


def is_of_many(path: Path) -> bool:
    """Whether a file of results holds those that were put together."""
    return path.name.startswith(TOGETHER_NAME)


def _once(table: pa.Table) -> pa.Table:
    """Sorted by identity, the last written of several rows that share one."""
    table = table.sort_by([("identity", "ascending"), ("written", "descending")])
    names = table["identity"].to_pylist()
    return table.take([i for i, name in enumerate(names) if i == 0 or name != names[i - 1]])


def _schema_of(path: Path) -> pa.Schema:
    return FAILURES if path.parent.name == "failures" else RESULTS


def _brought_up_to_date(path: Path, columns: list[str] | None = None) -> pa.Table:
    with pq.ParquetFile(path) as file:
        return migrated(file.read(columns), _schema_of(path))


def _plain(path: Path, columns: list[str] | None = None) -> pa.Table:
    with pq.ParquetFile(path) as file:
        if not file.schema_arrow.equals(_schema_of(path)):
            raise ValueError("is no file of a fleet's store")
        return with_version(file.read(columns))


def _with_place(path: Path, columns: list[str] | None = None) -> pa.Table:
    """A file of results with the type and the year that its folders say."""
    table = _plain(path, None if columns is None else [name for name in columns if name in RESULTS.names])
    type_, year = _place_of(path)
    table = table.append_column("type", pa.array([type_] * len(table), pa.string()))
    return table.append_column("year", pa.array([year] * len(table), pa.int32()))


def _place_of(path: Path) -> tuple[str, int | None]:
    """Type and year of a file of results. Raises ValueError where its folder says none."""
    type_, year = (unquote(part.partition("=")[2]) for part in path.parts[-3:-1])
    return type_, None if year == UNDATED else int(year)


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[bool]:
    """Whether the lock is ours. The system takes it back when a process ends, however it ends."""
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise _trouble(error) from None
    try:
        free = True
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            free = False
        except OSError:  # a file system without locks: whoever starts two runs computes some records twice
            pass
        yield free
    finally:
        os.close(handle)


def _trouble(error: OSError) -> StoreError:
    reason = error.strerror or str(error)
    advice = "; free some space, then call again" if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG) else ""
    return StoreError(
        f"the store cannot be written ({reason}{f': {error.filename}' if error.filename else ''}){advice}"
    )
