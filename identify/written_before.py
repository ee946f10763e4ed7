"""Which files of a folder are leftovers of an earlier run: those that the program wrote itself, unchanged since.

Each folder of results holds a small file with the names and the hashes of what each command wrote there. A run removes
what the same command wrote there before and does not write now. `fit` and `diagnose` take the place of each other's files
too where those are of another record. A file that somebody changed, or made, is never removed.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any


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
