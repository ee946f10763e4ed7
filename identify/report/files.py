"""Write several files whole or not at all, and remove what earlier runs left: no half-written report is ever taken for a result.

Each folder of results holds a small file with the names and the hashes of what each command wrote there. A run removes
what the same command wrote there before and does not write now. `fit` and `diagnose` take the place of each other's files
too where those are of another record. A file that somebody changed, or made, is never removed.
"""

import contextlib
import errno
import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.interruption import unbroken, whole_files


MANIFEST = ".thermohyd.json"
SCHEMA = "thermohyd-files/1"
# Of these, one folder holds results of one record: report.html and model.json of the later replace those of the earlier.
OF_ONE_RECORD = frozenset({"fit", "diagnose"})


def manifest(folder: Path, command: str, of: str, files: Mapping[str, bytes]) -> bytes:
    """The new content of the list: this run's files, and those of other commands that stay."""
    entries = {name: entry for name, entry in _entries(folder).items() if not _superseded(name, entry, command, of)}
    entries[command] = {"of": of, "files": {name: _hash(content) for name, content in files.items()}}
    return (json.dumps({"schema": SCHEMA, "written": entries}, indent=1) + "\n").encode()


def outdated(folder: Path, command: str, of: str, new: set[str]) -> list[Path]:
    """Files that earlier runs wrote into the folder and that this one, which writes `new`, leaves no reason to keep."""
    found = {}
    for name, entry in _entries(folder).items():
        if _superseded(name, entry, command, of):
            found |= {file: digest for file, digest in entry["files"].items() if file not in new}
    return [folder / file for file, digest in found.items() if _ours(folder, file, digest)]


def _superseded(name: str, entry: dict[str, Any], command: str, of: str) -> bool:
    return name == command or ({name, command} <= OF_ONE_RECORD and entry["of"] != of)


def _ours(folder: Path, file: str, digest: str) -> bool:
    """Whether the file lies inside the folder, is a plain one, and holds what the program wrote."""
    path = folder / file
    try:
        inside = path.resolve().is_relative_to(folder.resolve())
        return inside and path.is_file() and not path.is_symlink() and _hash(path.read_bytes()) == digest
    except (OSError, ValueError):
        return False


def _entries(folder: Path) -> dict[str, dict[str, Any]]:
    """{command: {"of", "files": {name: hash}}}; empty where there is no list, or none that can be read."""
    try:
        content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    written = content.get("written") if isinstance(content, dict) and content.get("schema") == SCHEMA else None
    if not isinstance(written, dict):
        return {}
    return {name: entry for name, entry in written.items() if _well_formed(entry)}


def _well_formed(entry: object) -> bool:
    return (
        isinstance(entry, dict)
        and isinstance(entry.get("of"), str)
        and isinstance(files := entry.get("files"), dict)
        and all(isinstance(part, str) for pair in files.items() for part in pair)
    )


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@dataclass(frozen=True)
class Writer:
    """Who writes: the command, and the record that its results are of (empty: of none)."""

    command: str
    of: str = ""


def checked_folder(out: str | None) -> Path | None:
    """The folder that --out names, before any work is done for it; None where none is named. Leaves nothing behind.

    Raises BenchInputError where it is empty, a file, or cannot be written.
    """
    if out is None:
        return None
    if not out.strip():
        raise BenchInputError("--out is empty; name a folder for the results")
    folder = Path(out)
    made: list[Path] = []
    try:
        there = folder
        while not os.path.lexists(there) and there != there.parent:
            there = there.parent
        if not there.is_dir():
            what = "is a file" if there.is_file() else "is no folder"
            raise BenchInputError(f"{what}; --out {'takes' if there == folder else 'lies in'} a folder", file=there)
        with unbroken():
            try:
                _make_folder(folder, made)
                with tempfile.TemporaryDirectory(prefix=".writing-", dir=folder):
                    pass
            finally:
                _remove_folders(made)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BenchInputError(f"--out cannot be written ({reason})", file=folder) from None
    return folder


def write_all(folder: Path | str, files: Mapping[str, bytes | str], writer: Writer | None = None) -> list[Path]:
    """Write {name: content} into a folder, which is made where it is missing; names may contain subfolders.

    Everything is first written to a temporary folder inside and then renamed. Whatever fails on the way leaves the folder
    as it was: new files are removed, replaced files put back; Ctrl-C waits until all are there. Text is UTF-8 with \\n line
    ends. With a `writer`, a list of what was written stays in the folder, and files of earlier runs that would pass for this
    one's are removed: see `written_before`. Returns the paths, in order. Raises OSError.
    """
    folder = Path(folder)
    with whole_files(folder):
        return _write_all(folder, files, writer)


def _write_all(folder: Path, files: Mapping[str, bytes | str], writer: Writer | None) -> list[Path]:
    made: list[Path] = []
    raw = {name: content.encode() if isinstance(content, str) else content for name, content in files.items()}
    old: list[Path] = []
    listed = raw
    try:
        _make_folder(folder, made)
        if writer is not None:
            old = outdated(folder, writer.command, writer.of, set(raw))
            listed = raw | {MANIFEST: manifest(folder, writer.command, writer.of, raw)}
        # inside the folder, so that a rename never crosses file systems
        with tempfile.TemporaryDirectory(prefix=".writing-", dir=folder) as staging:
            moves = []
            for number, (name, content) in enumerate(listed.items()):
                target, new = folder / name, Path(staging, f"{number}.new")
                if target.is_dir():
                    raise IsADirectoryError(errno.EISDIR, "is a folder, not a file", str(target))
                _make_folder(target.parent, made)
                new.write_bytes(content)
                moves.append((target, new, new.with_suffix(".former")))
            _move_all(moves, [(path, Path(staging, f"{number}.old")) for number, path in enumerate(old)])
    except BaseException:
        _remove_folders(made)
        raise
    return [folder / name for name in raw]


def _move_all(moves: list[tuple[Path, Path, Path]], removals: list[tuple[Path, Path]]) -> None:
    """Put every new file in its place, or none: (target, new, where the former content waits meanwhile)."""
    try:
        for target, new, former in moves:
            if target.exists():
                os.replace(target, former)
            os.replace(new, target)
        for target, former in removals:
            os.replace(target, former)
    except BaseException:
        for target, former in removals:
            with contextlib.suppress(OSError):
                former.replace(target)
        for target, new, former in moves:
            with contextlib.suppress(OSError):
                if former.exists():
                    former.replace(target)
                elif not new.exists():
                    target.unlink(missing_ok=True)
        raise


def _make_folder(path: Path, made: list[Path]) -> None:
    missing = []
    while not path.exists():
        missing.append(path)
        path = path.parent
    for folder in reversed(missing):
        folder.mkdir()
        made.append(folder)


def _remove_folders(made: list[Path]) -> None:
    for path in reversed(made):
        with contextlib.suppress(OSError):
            path.rmdir()
