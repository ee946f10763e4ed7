"""Which records are there, and when has a result of one been computed before: the hash of its files, the settings and the program.

Nothing is parsed but bench.toml's list of files: a fleet is looked through before any of it is read. No JAX here.
"""

import glob
import hashlib
import json
import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.input_file import open_input, read_input
from thermohyd.identify.bench.read import NAME, record_folder
from thermohyd.identify.bench.toml_file import LARGEST
from thermohyd.identify.fitting.row_sizes import padded_size


BLOCK = 1 << 20
HIDDEN = (".", "_")  # folders that begin so are no records: somebody is still writing them, or they were put aside


@dataclass(frozen=True)
class Settings:
    """What is done with every record. job: a word of `jobs.JOBS`, or "module:function" of one's own.

    options: keywords of the job. version: of the program; a newer one computes everything again.
    """

    job: str = "fit"
    options: Mapping[str, Any] = field(default_factory=dict)
    version: str = field(default_factory=lambda: version("thermohyd"))

    @property
    def text(self) -> str:
        """As JSON: of the same settings always the same."""
        return json.dumps({"job": self.job, "options": dict(self.options), "version": self.version}, sort_keys=True)


@dataclass(frozen=True)
class Found:
    """A record's folder before it is read. content: hash of its files.

    shape: its files with their rows as a fit pads them, alike for records that share compiled programs.
    """

    folder: str
    content: str
    shape: tuple[tuple[str, int], ...]

    def identity(self, settings: Settings) -> str:
        """Of its result: 32 hexadecimal digits."""
        return hashlib.sha256(f"{self.content}\n{settings.text}".encode()).hexdigest()[:32]


def find_records(where: str | Path | Iterable[str | Path]) -> list[Path]:
    """Folders with a bench.toml: beneath a folder at any depth, or those of a pattern such as "2026/*/SN-4*"; sorted.

    Raises BenchInputError where nothing is found, since then a path is wrong.
    """
    if not isinstance(where, str | Path):
        return sorted({folder for one in where for folder in find_records(one)})
    text = str(where)
    if os.path.isdir(text):
        found = _beneath(text)
    elif any(mark in text for mark in "*?["):
        found = {record_folder(path) for path in glob.glob(text, recursive=True)}
        found = {folder for folder in found if (folder / NAME).is_file()}
    else:
        raise BenchInputError("no such folder; --records takes a folder, or a pattern in quotes", file=text)
    if not found:
        raise BenchInputError(f"holds no record: no folder with a {NAME}", file=text)
    return sorted(found)


def _beneath(top: str) -> set[Path]:
    found = set()
    for folder, inside, files in os.walk(top):
        inside[:] = [name for name in inside if not name.startswith(HIDDEN)]
        if NAME in files:
            found.add(Path(folder))
            inside[:] = []  # a record holds no records
    return found


def look_at(folder: Path) -> Found:
    """Hash and shape of a record. What is missing or no plain file counts as that: whoever reads the record says so."""
    description = folder / NAME
    content, shape = hashlib.sha256(), []
    for name, path in [(NAME, description), *named_files(folder)]:
        digest, lines = _hash(path)
        content.update(f"{name}\0{digest}\n".encode(errors="surrogatepass"))
        if path != description:
            shape.append((path.name.split(".")[0], padded_size(lines)))
    return Found(str(folder), content.hexdigest(), tuple(sorted(shape)))


def named_files(folder: Path) -> list[tuple[str, Path]]:
    """(name, path) of the files that a record's bench.toml names, sorted; empty where it cannot be read."""
    try:
        tables = tomllib.loads(read_input(folder / NAME, LARGEST).decode("utf-8-sig")).get("tests", {})
        names = [table.get("file") for table in tables.values() if isinstance(table, dict)]
    except (BenchInputError, ValueError, RecursionError, AttributeError):
        return []
    return [(name, folder / name) for name in sorted({n for n in names if isinstance(n, str) and "\0" not in n})]


def _hash(path: Path) -> tuple[str, int]:
    """(SHA-256, lines); of a packed file what its size lets expect. A device or a pipe would never end: only plain files."""
    digest, lines = hashlib.sha256(), 0
    try:
        if not path.is_file():
            return "missing", 0
        with open_input(path) as file:
            while block := file.read(BLOCK):
                digest.update(block)
                lines += block.count(b"\n")
        if path.suffix.lower() in (".gz", ".xlsx", ".xlsm", ".parquet", ".mat", ".tdms"):
            lines = path.stat().st_size // 12
    except (BenchInputError, OSError, ValueError):
        return "unreadable", 0
    return digest.hexdigest(), lines
