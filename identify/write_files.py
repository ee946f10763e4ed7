"""Write several files whole or not at all: no half-written report is ever taken for a result."""

import contextlib
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path


def write_all(folder: Path | str, files: Mapping[str, bytes | str]) -> list[Path]:
    """Write {name: content} into a folder, which is made where it is missing; names may contain subfolders.

    Everything is first written under temporary names beside the targets and then renamed. Whatever fails on the way,
    Ctrl-C included, leaves the folder as it was: new files are removed, replaced files put back. Text is UTF-8 with
    \\n line ends. Returns the paths, in order. Raises OSError.
    """
    folder = Path(folder)
    staged: list[tuple[Path, Path]] = []  # (temporary, target)
    replaced: list[tuple[Path, Path | None]] = []  # (target, where its former content waits)
    made: list[Path] = []
    try:
        _make_folder(folder, made)
        for name, content in files.items():
            target = folder / name
            _make_folder(target.parent, made)
            staged.append((_temporary(target), target))
            staged[-1][0].write_bytes(content.encode() if isinstance(content, str) else content)
        for temporary, target in staged:
            former = None
            if target.exists():
                former = _temporary(target)
                os.replace(target, former)
            replaced.append((target, former))
            os.replace(temporary, target)
    except BaseException:
        for target, former in reversed(replaced):
            with contextlib.suppress(OSError):
                os.replace(former, target) if former is not None else target.unlink(missing_ok=True)
        for temporary, _ in staged:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
        for path in reversed(made):
            with contextlib.suppress(OSError):
                path.rmdir()
        raise
    for _, former in replaced:
        if former is not None:
            former.unlink(missing_ok=True)
    return [target for _, target in staged]


def _make_folder(path: Path, made: list[Path]) -> None:
    missing = []
    while not path.exists():
        missing.append(path)
        path = path.parent
    for folder in reversed(missing):
        folder.mkdir()
        made.append(folder)


def _temporary(target: Path) -> Path:
    """A free name beside the target, with the permissions that a plainly written file would have."""
    if target.is_dir():
        raise IsADirectoryError(21, "is a folder, not a file", str(target))
    handle, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".tmp", dir=target.parent)
    os.close(handle)
    mask = os.umask(0)
    os.umask(mask)
    os.chmod(name, 0o666 & ~mask)
    return Path(name)
