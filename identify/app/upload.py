"""Files that a browser sent, in a temporary folder of their own: no name leads out of it, none meets a file of the program's own, and
it goes when the page goes.

A browser names the files of a folder by their paths in it, and may send any name at all: every part is checked, and where it would
lead is checked again on the disk. What bench.toml names as its tests' files must lie in the folder too.
"""

import shutil
import tempfile
import unicodedata
import weakref
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from thermohyd.identify.bench.errors import BenchInputError, quoted
from thermohyd.identify.bench.read import NAME
from thermohyd.identify.bench.toml_file import TomlSource


LONGEST_PART = 200  # bytes: file systems take 255
DEEPEST = 8
MOST_FILES, MOST_BYTES = 1000, 1_000_000_000  # of one drop
LARGEST_TOML = 100_000  # bytes: every look at the page reads it
UNNAMED = "record"  # a record whose files came without a folder


class TemporaryHome:
    """A folder that only this user can read. It is removed with this object, and at the latest when the program ends.

    dropped: the folder in which the record's folder lies, and nothing else. own: the program's files.
    """

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="thermohyd-app-")).resolve()
        self.dropped, self.own = self.folder / "dropped", self.folder / "own"
        self.dropped.mkdir()
        self.own.mkdir()
        self._remove = weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)

    def remove(self) -> None:
        """Remove it now; a second time nothing happens."""
        self._remove()

    def words(self, text: str) -> str:
        """A message as the user knows the files: by their places in the record."""
        return text.replace(f"{self.dropped}/", "").replace(f"{self.dropped}\\", "")


@dataclass(frozen=True)
class Uploaded:
    """A record's folder, its files by their places in it (with "/"), and names that are no part of the record."""

    record: Path
    files: tuple[str, ...]
    left_out: tuple[str, ...]

    @property
    def described(self) -> bool:
        """Whether a bench.toml was among them."""
        return NAME in self.files


def safe_parts(name: str) -> tuple[str, ...]:
    """Folders and file of the name under which a file was sent. Raises BenchInputError where it is none, or leads elsewhere."""
    parts = tuple(part for part in name.replace("\\", "/").split("/") if part not in ("", "."))
    if name[:1] in ("/", "\\") or ".." in parts:
        raise BenchInputError(f"{quoted(name)} leads out of the folder; a file's name says where it lies inside")
    if not parts or not name.isprintable() or len(parts) > DEEPEST:
        raise BenchInputError(f"{quoted(name)} is no name of a file; rename it, and drop the folder again")
    if any(len(part.encode(errors="replace")) > LONGEST_PART for part in parts):
        raise BenchInputError(f"{quoted(name)} is too long for a file's name; rename it, and drop the folder again")
    return parts


def write_upload(sent: Iterable[tuple[str, bytes]], home: TemporaryHome) -> Uploaded:
    """Write what was sent, (name, content) each, as the folder of one record. Raises BenchInputError.

    Of files in folders the record is the one that holds the uppermost bench.toml; without any it is the dropped folder.
    """
    files: dict[tuple[str, ...], bytes] = {}
    left_out, there, size = [], set(), 0
    for number, (name, content) in enumerate(sent, 1):
        parts, size = safe_parts(name), size + len(content)
        if number > MOST_FILES or size > MOST_BYTES:
            raise BenchInputError(
                f"is more than {MOST_FILES:,} files or {MOST_BYTES:,} bytes; drop the folder of one record, and no other files with it"
            )
        one_name = unicodedata.normalize("NFC", "/".join(parts)).casefold()  # as a file system may take it
        if any(part.startswith(".") or part == "__MACOSX" for part in parts):
            left_out.append("/".join(parts))
        elif one_name in there:
            raise BenchInputError(f"{quoted(name)} came twice, or in other capitals; take one of them away")
        elif parts[-1] == NAME and len(content) > LARGEST_TOML:
            raise BenchInputError(
                f"{quoted(name)} is larger than {LARGEST_TOML:,} bytes; thermohyd check in a terminal reads it"
            )
        else:
            there.add(one_name)
            files[parts] = content
    if not files:
        raise BenchInputError("holds no file of a record")
    base = _base(list(files))
    left_out += ["/".join(parts) for parts in files if parts[: len(base)] != base]
    record = home.dropped / (base[-1].lstrip("-") or UNNAMED if base else UNNAMED)
    written = []
    try:
        record.mkdir()
        for parts, content in files.items():
            if parts[: len(base)] == base:
                inside = parts[len(base) :]
                _write(record, inside, content)
                written.append("/".join(inside))
    except (OSError, ValueError) as error:
        raise BenchInputError(f"cannot be written ({getattr(error, 'strerror', None) or error})") from None
    return Uploaded(record, tuple(sorted(written)), tuple(left_out))


def _base(files: list[tuple[str, ...]]) -> tuple[str, ...]:
    """The folder of the record among those that were sent."""
    described = [parts[:-1] for parts in files if parts[-1] == NAME]
    if not described:
        first = files[0][:-1]
        same = [
            all(other[: n + 1] == first[: n + 1] and len(other) > n + 1 for other in files) for n in range(len(first))
        ]
        return first[: same.index(False) if False in same else len(first)]
    depth = min(map(len, described))
    upper = sorted(folder for folder in described if len(folder) == depth)
    if len(upper) > 1:
        names = ", ".join("/".join(folder) for folder in upper[:4])
        raise BenchInputError(f"holds {len(upper)} records ({names}); drop the folder of one of them")
    return upper[0]


def _write(record: Path, inside: tuple[str, ...], content: bytes) -> None:
    target = record.joinpath(*inside)
    if not target.resolve().is_relative_to(record.resolve()):  # a drive, or what else a system reads into a name
        raise ValueError(f"{quoted('/'.join(inside))} leads out of the folder")
    target.parent.mkdir(parents=True, exist_ok=True)
    with target.open("xb") as file:
        file.write(content)


def refuse_files_elsewhere(record: Path) -> None:
    """Raise BenchInputError where the record's bench.toml is none, or names a file of a test that lies outside its folder."""
    root = TomlSource(record / NAME).root
    tests: Any = root.data.get("tests")
    for name, test in tests.items() if isinstance(tests, dict) else ():
        file = test.get("file") if isinstance(test, dict) else None
        if isinstance(file, str) and not _inside(record, file):
            table = root.table("tests")
            own = None if table is None else table.table(name)
            assert own is not None
            raise own.error(f"{quoted(file)} lies outside the folder that was dropped; name a file inside it", "file")


def _inside(record: Path, file: str) -> bool:
    try:
        return (record / file).resolve().is_relative_to(record.resolve())
    except (OSError, ValueError):
        return False
