"""A command of the program as a process of its own: watched through what it says on stderr, stopped when its user has had enough.

The page computes nothing: what it shows was written by the same `thermohyd fit` or `diagnose` that a terminal runs.
"""

import contextlib
import re
import subprocess
import sys
import time
import weakref
from collections.abc import Sequence

from .upload import TemporaryHome


STOP_WITHIN = 10.0  # s: then the process is killed
# "   12.3 s  fitting": how --verbose says what is going on.
STEP = re.compile(r"\s*\d+\.\d s  (.*)")
SAID = "thermohyd: "
CHILD = (sys.executable, "-P", "-m", "thermohyd.identify.app.child")  # it ends with this process
PROGRAM = (*CHILD, "thermohyd.identify")


class CommandRun:
    """`thermohyd ARGUMENTS`, started where the dropped folder lies; what it says goes beside, among the program's own files.

    It ends with this object, and at the latest when the program ends.
    """

    def __init__(self, arguments: Sequence[str], home: TemporaryHome) -> None:
        self.arguments = tuple(arguments)
        self._home = home  # so that the folder is removed after the process has ended
        self._out, self._err = home.own / "stdout.txt", home.own / "stderr.txt"
        self._began, self._took = time.monotonic(), None
        self.stopped = False
        command = [*PROGRAM, *arguments]
        with self._out.open("wb") as out, self._err.open("wb") as err:
            self._process = subprocess.Popen(command, cwd=home.dropped, stdin=subprocess.PIPE, stdout=out, stderr=err)
        self._end = weakref.finalize(self, _end, self._process)

    @property
    def status(self) -> int | None:
        """The exit status; None while it runs."""
        found = self._process.poll()
        if found is not None and self._took is None:
            self._took = time.monotonic() - self._began
        return found

    @property
    def seconds(self) -> float:
        """Since the start; of a command that has ended, what it took."""
        return time.monotonic() - self._began if self._took is None else self._took

    def lines(self) -> list[str]:
        """What it has said on stderr so far."""
        with contextlib.suppress(OSError):
            return self._err.read_text(encoding="utf-8", errors="replace").splitlines()
        return []

    def step(self) -> str:
        """What it is doing now, in its own words."""
        steps = [found[1] for line in self.lines() if (found := STEP.fullmatch(line))]
        return steps[-1] if steps else "starting"

    def steps(self) -> list[str]:
        """Everything it did, a line each, with the seconds since its start."""
        return [line.strip() for line in self.lines() if STEP.fullmatch(line)]

    def failure(self) -> str:
        """The one line with which it ended, where it did not end well; empty where it did, or still runs."""
        if not self.status:
            return ""
        said = [line.removeprefix(SAID) for line in self.lines() if line.startswith(SAID)]
        own = [line for line in said if not line.startswith("warning: ")]
        return own[-1] if own else f"ended with status {self.status} and said nothing"

    def stop(self) -> None:
        """End it as Ctrl-C would, and wait until it has ended."""
        self.stopped = self.status is None
        self._end()
        assert self.status is not None


def _end(process: subprocess.Popen) -> None:
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(STOP_WITHIN)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    if process.stdin is not None:
        process.stdin.close()
