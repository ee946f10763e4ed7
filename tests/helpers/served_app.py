"""`thermohyd app` as a process of its own on a port of this machine, and how it ended."""

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


PATIENCE = 60.0  # s
# A shell that starts this with & ignores SIGINT, and so would its children: the test's own shell does not matter.
START = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
{change}
from thermohyd.identify.__main__ import main
main()
"""


class Served:
    """address: of the page. After `interrupt`: status, and what it said on stdout and stderr."""

    def __init__(self, process: subprocess.Popen, port: int) -> None:
        self._process, self.address = process, f"http://127.0.0.1:{port}"
        self.status, self.out, self.errors = None, "", ""

    @property
    def answers(self) -> bool:
        try:
            with urllib.request.urlopen(f"{self.address}/_stcore/health", timeout=5) as answer:
                return answer.read() == b"ok"
        except OSError:
            return False

    def interrupt(self) -> None:
        """Ctrl-C, once."""
        self._process.send_signal(signal.SIGINT)
        self.out, self.errors = self._process.communicate(timeout=PATIENCE)
        self.status = self._process.returncode

    def kill(self) -> None:
        """kill -9. Returns when nothing is left that could say something."""
        self._process.kill()
        self._process.communicate(timeout=PATIENCE)


@contextmanager
def served_app(home: Path, change: str = "", where: Path | None = None) -> Iterator[Served]:
    """The page, served. home: where its user's files and temporary folders are; change: code that runs before the program; where: it is
    started."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    command = [sys.executable, "-P", "-c", START.format(change=change), "app", "--no-browser", "--port", str(port)]
    environment = os.environ | {"HOME": str(home), "TMPDIR": str(home)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, env=environment, cwd=where, **pipes) as process:
        served = Served(process, port)
        try:
            end = time.monotonic() + PATIENCE
            while not served.answers and time.monotonic() < end and process.poll() is None:
                time.sleep(0.1)
            yield served
        finally:
            if process.poll() is None:
                process.terminate()
                process.communicate(timeout=PATIENCE)
