"""May what lies in a folder be run? Only where nobody but the user and root can have put it there.

A folder is the user's own if it, and every folder and link on the way to it, belongs to the user (those on the way: or to root), and
nobody else may write there. In a folder that all may write to and where entries are their owners' (/tmp), the next one is the user's.
A file is the user's own if it is a regular file of the user's that nobody else may write. Where a system does not say whose a file is
(Windows), none is.
"""

import errno
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path


OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
NOT_OWN = "is not this user's, or others may write to it"
_said = False  # one line for a process


class NotOwnError(Exception):
    """Somebody else may have written what lies there; says which folder or file, and why."""


def say_not_own(error: NotOwnError) -> None:
    """Warn on stderr, once in a process."""
    global _said
    if not _said:
        print(f"thermohyd: warning: compiled programs are neither kept nor read: {error}", file=sys.stderr)
    _said = True


def make_own_folder(folder: Path) -> None:
    """Make a folder, each missing one on the way too, for the user alone whatever the umask is.

    Raises NotOwnError where it is not the user's own, OSError where it cannot be made.
    """
    there, missing = folder.absolute(), []
    while not os.path.lexists(there):
        missing.append(there.name)
        there = there.parent
    _check_way(there)
    for name in reversed(missing):
        there = there / name
        try:
            there.mkdir(0o700)
        except FileExistsError:  # another process of the user's
            continue
        there.chmod(0o700)  # a umask may have taken more
    check_own_folder(folder)


def check_own_folder(folder: Path) -> None:
    """Raises NotOwnError where it is not the user's own, OSError where it is not there."""
    _check_way(folder)
    found = folder.stat()
    if found.st_uid != _user() or not stat.S_ISDIR(found.st_mode) or found.st_mode & OTHERS_WRITE:
        raise NotOwnError(f"{folder} {NOT_OWN}")


def check_own_entries(folder: Path) -> None:
    """Of a folder of the user's own into which another program writes under any umask: what others may write is closed to them.

    Raises NotOwnError where something in it, at any depth, is not the user's own, or where others could have come to write to it.
    """
    closed = not folder.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    for at, folders, files in os.walk(folder):
        for entry in (Path(at, name) for name in (*folders, *files)):
            with suppress(FileNotFoundError):  # another process of the user's removes it
                found = entry.lstat()
                plain = stat.S_ISDIR(found.st_mode) or (stat.S_ISREG(found.st_mode) and found.st_nlink == 1)
                if found.st_uid != _user() or not plain or (found.st_mode & OTHERS_WRITE and not closed):
                    raise NotOwnError(f"{entry} {NOT_OWN}; remove it")
                if found.st_mode & OTHERS_WRITE:
                    entry.chmod(found.st_mode & stat.S_IRWXU)


def read_own_file(file: Path, most: int) -> bytes:
    """All of a file in a folder of the user's own, asked whose it is after it was opened.

    Raises NotOwnError where it is not the user's own, ValueError where it has more than `most` bytes, OSError where it cannot be
    read.
    """
    not_own = NotOwnError(f"{file} {NOT_OWN}; remove it")
    try:  # neither follows a link nor waits for whoever writes into a pipe
        handle = os.open(file, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO):  # a link, a socket
            raise not_own from None
        raise
    with os.fdopen(handle, "rb") as opened:
        found = os.fstat(opened.fileno())
        if found.st_uid != _user() or not stat.S_ISREG(found.st_mode) or found.st_mode & OTHERS_WRITE:
            raise not_own
        if found.st_size > most:
            raise ValueError(f"{file} has more than {most} bytes")
        return opened.read(most)


def _check_way(path: Path) -> None:
    user = _user()
    for step in _way_to(path):
        found, above = step.lstat(), step.parent.lstat()
        if found.st_uid != user and (found.st_uid != 0 or above.st_mode & OTHERS_WRITE):
            raise NotOwnError(f"{step} belongs to another user")
        if not stat.S_ISLNK(found.st_mode) and found.st_mode & OTHERS_WRITE and not found.st_mode & stat.S_ISVTX:
            raise NotOwnError(f"others may write to {step}; if they did not, `chmod go-w {step}`")


def _way_to(path: Path) -> Iterator[Path]:
    """Every folder and link that the system passes on the way to a path that is there, the root first, and the path itself."""
    os.path.realpath(path, strict=True)  # no circle of links
    left = list(reversed(path.absolute().parts))
    at = Path(left.pop())
    yield at
    while left:
        part = left.pop()
        at = at.parent if part == ".." else at / part
        yield at
        if at.is_symlink():
            left += reversed(at.readlink().parts)
            at = at.parent


def _user() -> int:
    if not hasattr(os, "geteuid"):
        raise NotOwnError("this system does not say whose a file is")
    return os.geteuid()
