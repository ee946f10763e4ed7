"""Write several files whole or not at all, and remove what earlier runs left: no half-written report is ever taken for a result.

Each folder of results holds a small file with the names and the hashes of what each command wrote there. A run removes
what the same command wrote there before and does not write now. `fit` and `diagnose` take the place of each other's files
too where those are of another record. A file that somebody changed, or made, is never removed.

A folder that is not there yet is written beside its place and gets its name in one step. In one that is there, which may hold others'
files, all former files go aside before the first new one comes, by a plan that is on the disk first: whoever is killed on the way leaves
old results or new ones, some of them missing at worst, never one beside the other; and the next call goes through with the plan.
"""

import contextlib
import errno
import hashlib
import json
import os
import platform
import re
import secrets
import shutil
import time
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.interruption import unbroken, whole_files


MANIFEST = ".thermohyd.json"
SCHEMA = "thermohyd-files/1"
# Of a folder for what is not whole yet, with machine and process behind it; and what may lie in one.
STAGING = ".writing-"
STAGED = re.compile(r"\d+\.(new|former|old)|whole|plan\.new|plan\.json|back\.json")
PLAN, BACK = "plan.json", "back.json"  # files are being put in place; or former ones back
LARGEST = 1_000_000  # bytes of a plan
A_DAY = 86_400.0  # s, after which what another machine left counts as left for good
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


def _hash_of(path: Path) -> str | None:
    """Of a file's content; None where there is none."""
    return _hash(path.read_bytes()) if path.is_file() else None


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
                with _staging(folder):
                    pass
            finally:
                _remove_folders(made)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BenchInputError(f"--out cannot be written ({reason})", file=folder) from None
    return folder


def write_all(folder: Path | str, files: Mapping[str, bytes | str], writer: Writer | None = None) -> list[Path]:
    """Write {name: content} into a folder, which is made where it is missing; names may contain subfolders.

    Whatever fails on the way leaves the folder as it was: new files are removed, replaced files put back; Ctrl-C waits until all
    are there, and a kill leaves no mixture (see above). What killed processes left is settled first. Text is UTF-8 with \\n line
    ends. With a `writer`, a list of what was written stays in the folder, and files of earlier runs that would pass for this
    one's are removed: see `outdated`. Returns the paths, in order. Raises OSError.
    """
    folder = Path(folder)
    raw = {name: content.encode() if isinstance(content, str) else content for name, content in files.items()}
    with whole_files(folder):
        made: list[Path] = []
        try:
            _make_folder(folder.parent, made)
            _settle(folder.parent)
            if folder.exists():
                _settle(folder)
                _write_into(folder, raw, writer, made)
            else:
                _write_new(folder, raw, writer)
        except BaseException:
            _remove_folders(made)
            raise
    return [folder / name for name in raw]


def _listed(folder: Path, raw: dict[str, bytes], writer: Writer | None) -> dict[str, bytes]:
    return raw if writer is None else raw | {MANIFEST: manifest(folder, writer.command, writer.of, raw)}


def _write_new(folder: Path, raw: dict[str, bytes], writer: Writer | None) -> None:
    """A folder that is not there yet: all of it, or nothing."""
    with _staging(folder.parent) as staging:
        whole = staging / "whole"
        whole.mkdir()
        for name, content in _listed(folder, raw, writer).items():
            path = whole / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        whole.rename(folder)


@dataclass(frozen=True)
class _Step:
    """What becomes of one file: hashes of what it was (None: it was not there) and of what it will be (None: it goes)."""

    name: str
    former: str | None
    new: str | None


def _write_into(folder: Path, raw: dict[str, bytes], writer: Writer | None, made: list[Path]) -> None:
    """A folder that may hold files of others, which stay where they are."""
    old = [] if writer is None else outdated(folder, writer.command, writer.of, set(raw))
    # inside the folder, so that a rename never crosses file systems
    with _staging(folder) as staging:
        steps = []
        for number, (name, content) in enumerate(_listed(folder, raw, writer).items()):
            target = folder / name
            if target.exists() and not target.is_file():
                raise IsADirectoryError(errno.EISDIR, "is a folder, not a file", str(target))
            _make_folder(target.parent, made)
            (staging / f"{number}.new").write_bytes(content)
            steps.append(_Step(name, _hash_of(target), _hash(content)))
        steps += [_Step(path.relative_to(folder).as_posix(), _hash_of(path), None) for path in old]
        unnamed = staging / "plan.new"
        unnamed.write_text(json.dumps([asdict(step) for step in steps]), encoding="utf-8")
        unnamed.rename(staging / PLAN)
        try:
            _forward(folder, staging, steps)
        except BaseException:
            (staging / PLAN).rename(staging / BACK)
            _back(folder, staging, steps)
            raise


def _forward(folder: Path, staging: Path, steps: list[_Step]) -> None:
    """All former files aside, then all new ones in; goes on where a killed process ended. What is somebody else's by now stays."""
    begun = any(step.new is not None and not (staging / f"{i}.new").exists() for i, step in enumerate(steps))
    for number, step in enumerate([] if begun else steps):
        target, former = folder / step.name, staging / f"{number}.former"
        if step.former is not None and not former.exists() and _hash_of(target) == step.former:
            os.replace(target, former)
    for number, step in enumerate(steps):
        target, new = folder / step.name, staging / f"{number}.new"
        if new.exists() and not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            os.replace(new, target)
    (staging / PLAN).unlink()


def _back(folder: Path, staging: Path, steps: list[_Step]) -> None:
    """New files out again and former ones back; goes on where a killed process ended. What is somebody else's by now stays."""
    for number, step in enumerate(steps):
        target, former = folder / step.name, staging / f"{number}.former"
        with contextlib.suppress(OSError):
            if step.new is not None and not (staging / f"{number}.new").exists() and _hash_of(target) == step.new:
                target.unlink()
            if former.exists() and not target.exists():
                os.replace(former, target)
    if not any(staging.glob("*.former")):
        (staging / BACK).unlink()


@contextlib.contextmanager
def _staging(folder: Path) -> Iterator[Path]:
    """A folder for what is not whole yet, which goes in the end unless it holds what could not be put back."""
    path = folder / f"{STAGING}{_machine()}-{os.getpid()}-{secrets.token_hex(4)}"
    path.mkdir()
    try:
        yield path
    finally:
        if not (path / BACK).exists():
            shutil.rmtree(path, ignore_errors=True)


def _settle(folder: Path) -> None:
    """Go through with what killed processes began here, and remove what they left; nothing that is not ours or still at work."""
    for left in folder.glob(f"{STAGING}*"):
        with contextlib.suppress(OSError, ValueError):
            if left.is_symlink() or not left.is_dir() or _of_another(left) or _at_work(left):
                continue
            inside = {path.name for path in left.iterdir()}
            if not all(map(STAGED.fullmatch, inside)):
                continue
            if BACK in inside:
                _back(folder, left, _steps(folder, left / BACK))
            elif PLAN in inside:
                _forward(folder, left, _steps(folder, left / PLAN))
            if not (left / BACK).exists():
                shutil.rmtree(left, ignore_errors=True)


def _steps(folder: Path, plan: Path) -> list[_Step]:
    """A plan as a killed process left it. Raises ValueError for one that is none, or that reaches out of the folder."""
    if plan.is_symlink() or plan.stat().st_size > LARGEST:
        raise ValueError("no plan")
    try:
        steps = [_Step(**entry) for entry in json.loads(plan.read_text(encoding="utf-8"))]
        names = [step.name for step in steps]
        inside = all((folder / name).parent.resolve().is_relative_to(folder.resolve()) for name in names)
    except (TypeError, RecursionError):
        raise ValueError("no plan") from None
    if not inside or any(".." in Path(name).parts for name in names):
        raise ValueError("a plan that reaches out of its folder")
    return steps


def _machine() -> str:
    return f"{zlib.crc32(platform.node().encode()):08x}"


def _of_another(left: Path) -> bool:
    """Whether somebody else made it, whose plans are not carried out."""
    return os.name == "posix" and left.stat().st_uid != os.geteuid()


def _at_work(left: Path) -> bool:
    """Whether the process that a folder's name names may still be writing. In this one nobody else is: `whole_files` lets in one."""
    machine, _, rest = left.name.removeprefix(STAGING).partition("-")
    number = rest.partition("-")[0]
    if os.name != "posix" or machine != _machine() or not number.isdecimal():
        return time.time() - left.stat().st_mtime < A_DAY
    if int(number) == os.getpid():
        return False
    try:
        os.kill(int(number), 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        pass
    return True


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
