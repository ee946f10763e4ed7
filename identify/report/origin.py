"""Where a page comes from and how to make it again: the command, the program's versions, and a fingerprint of what was read."""

import hashlib
import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from thermohyd.identify.bench.provenance import file_rows
from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.typed_command import arguments, command


# Of what computes: another release of one of these may move a last digit.
PACKAGES = ("jax", "jaxlib", "equinox", "optimistix", "diffrax", "numpy", "scipy")
FILES = ("file", ">rows", ">used", "#SHA-256")


@dataclass(frozen=True)
class Origin:
    """command: the line to type; empty where a program called. instead: what to say then. folder: where it was typed.

    inputs: (name, SHA-256 of all files of a record, or of a file). files: those of the records, rows of `FILES`.
    """

    command: str
    instead: str
    folder: str
    versions: tuple[tuple[str, str], ...]
    inputs: tuple[tuple[str, str], ...]
    files: tuple[tuple[str, ...], ...] = ()


def origin(work: str, records: Sequence[BenchRecord] = ()) -> Origin:
    """Of a page that is being written. work: the command that makes such a page, such as "fit"."""
    typed = command()
    paths = " ".join(str(record.folder) if record.provenance is None else record.provenance.path for record in records)
    by_default = f"thermohyd {work} {paths}".rstrip()
    inputs = [(record.name, fingerprint(record)) for record in records if record.provenance is not None]
    several = len(records) > 1
    files = [
        (f"{record.folder.name}/{name}" if several else name, *rest)
        for record in records
        for name, *rest in file_rows(record)
    ]
    return Origin(
        typed,
        ""
        if typed
        else f"A program of your own made this page; with its defaults this does the same: {by_default} --out DIR",
        os.getcwd() if typed else "",
        (("thermohyd", version("thermohyd")), ("Python", platform.python_version()), *_packages()),
        tuple(inputs) if records else tuple(_named_files()),
        tuple(files),
    )


def fingerprint(record: BenchRecord) -> str:
    """One SHA-256 of a record's files, by their names and contents: equal where the record is the same, wherever it lies."""
    if record.provenance is None:
        return ""
    found = hashlib.sha256()
    description, *tests = record.provenance.files
    for file in (description, *sorted(set(tests), key=lambda file: file.name)):
        found.update(f"{file.name}\0{file.sha256}\n".encode(errors="surrogatepass"))
    return found.hexdigest()


def _named_files() -> list[tuple[str, str]]:
    """Of a study that keeps no record: files that its command names, models, settings and records, as they are now."""
    found = []
    for word in arguments():
        path = Path(word)
        try:
            if (path / "bench.toml").is_file():
                found += [
                    (str(one), _hash(one))
                    for one in sorted(path.iterdir())
                    if one.is_file() and not one.name.startswith(".")
                ]
            elif path.is_file():
                found.append((word, _hash(path)))
        except (OSError, ValueError):
            continue
    return found


def _hash(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _packages() -> list[tuple[str, str]]:
    found = []
    for name in PACKAGES:
        try:
            found.append((name, version(name)))
        except PackageNotFoundError:
            continue
    return found
