"""Write several files whole or not at all: no half-written report is ever taken for a result."""

import contextlib
import errno
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path


def write_all(folder: Path | str, files: Mapping[str, bytes | str]) -> list[Path]:
    """Write {name: content} into a folder, which is made where it is missing; names may contain subfolders.

    Everything is first written to a temporary folder inside and then renamed. Whatever fails on the way,
    Ctrl-C included, leaves the folder as it was: new files are removed, replaced files put back. Text is UTF-8 with
    \\n line ends. Returns the paths, in order. Raises OSError.
    """
    folder = Path(folder)
    made: list[Path] = []
    try:
        _make_folder(folder, made)
        # inside the folder, so that a rename never crosses file systems
        with tempfile.TemporaryDirectory(prefix=".writing-", dir=folder) as staging:
            moves = []
            for number, (name, content) in enumerate(files.items()):
                target, new = folder / name, Path(staging, f"{number}.new")
                if target.is_dir():
                    raise IsADirectoryError(errno.EISDIR, "is a folder, not a file", str(target))
                _make_folder(target.parent, made)
                new.write_bytes(content.encode() if isinstance(content, str) else content)
                moves.append((target, new, new.with_suffix(".former")))
            _move_all(moves)
    except BaseException:
        for path in reversed(made):
            with contextlib.suppress(OSError):
                path.rmdir()
        raise
    return [target for target, _, _ in moves]


def _move_all(moves: list[tuple[Path, Path, Path]]) -> None:
    """Put every new file in its place, or none: (target, new, where the former content waits meanwhile)."""
    try:
        for target, new, former in moves:
            if target.exists():
                os.replace(target, former)
            os.replace(new, target)
    except BaseException:
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
