"""A headless Chromium that tests talk to over a pipe: pages opened, scripts run, keys and mouse moved as a user would.

The protocol is Chromium's own (DevTools), one JSON message after another with a zero byte between them: nothing to install.
"""

import base64
import itertools
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


PROGRAM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--no-first-run", "--disable-extensions",
    "--disable-background-networking", "--force-color-profile=srgb", "--hide-scrollbars", "--disable-dev-shm-usage",
)  # fmt: skip
# Chromium reads the descriptor 3 and writes to 4, whatever numbers they have here.
WITH_PIPES = """
import fcntl, os, sys
for place, number in zip((3, 4), [fcntl.fcntl(int(one), fcntl.F_DUPFD, 10) for one in sys.argv[1:3]]):
    os.dup2(number, place)
os.execv(sys.argv[3], sys.argv[3:])
"""
AXE = (
    Path(__file__).parents[2] / "build" / "axe" / "package" / "axe.min.js"
)  # `make axe` takes it from the npm registry
PATIENCE = 60.0  # s, of a busy machine


class Browser:
    """One tab. `said`: what its console holds that is no plain log line, and what the network was asked for."""

    def __init__(self, process: subprocess.Popen, read: int, write: int):
        self._process, self._read, self._write = process, read, write
        self._ids, self._buffer, self._session = itertools.count(1), b"", ""
        self.said: list[str] = []
        self.asked: list[str] = []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        """What Chromium answers; raises RuntimeError where it refuses."""
        number = next(self._ids)
        message = {"id": number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while (found := self._next()).get("id") != number:
            self._notice(found)
        if "error" in found:
            raise RuntimeError(f"{method}: {found['error']['message']}")
        return found["result"]

    def _next(self) -> dict[str, Any]:
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._buffer:
            if not select.select([self._read], [], [], max(0.0, end - time.monotonic()))[0]:
                raise RuntimeError("Chromium does not answer")
            part = os.read(self._read, 1 << 20)
            if not part:
                raise RuntimeError(f"Chromium has ended with status {self._process.poll()}")
            self._buffer += part
        text, _, self._buffer = self._buffer.partition(b"\0")
        return json.loads(text)

    def _notice(self, event: dict[str, Any]) -> None:
        params, method = event.get("params", {}), event.get("method")
        if method == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.said.append(details.get("exception", {}).get("description") or details["text"])
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
            self.said.append(str([part.get("value") for part in params["args"]]))
        elif method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            self.said.append(params["entry"]["text"])
        elif method == "Page.javascriptDialogOpening":
            self.said.append(f"dialog: {params['message']}")
        elif method == "Network.requestWillBeSent":
            self.asked.append(params["request"]["url"])

    def open(self, page: Path, width: int = 1280, height: int = 900, *, dark: bool = False) -> None:
        """A page from the disk, in a window of that size; waits until its scripts have run."""
        self.said, self.asked = [], []
        self.resize(width, height, dark=dark)
        self.send("Page.navigate", url=page.resolve().as_uri())
        end = time.monotonic() + PATIENCE
        while self.run("document.readyState + location.protocol") != "completefile:" and time.monotonic() < end:
            time.sleep(0.02)

    def visit(self, address: str, width: int = 1280, height: int = 900, *, dark: bool = False) -> None:
        """A page from a server of this machine; what it draws later is waited for with `wait`."""
        self.said, self.asked = [], []
        self.resize(width, height, dark=dark)
        self.send("Page.navigate", url=address)

    def wait(self, script: str) -> Any:
        """The value of a script once it is true; raises RuntimeError with what the page shows where it stays false."""
        end = time.monotonic() + PATIENCE
        while not (found := self.run(script)):
            if time.monotonic() > end:
                raise RuntimeError(
                    f"never true: {script}; the page shows: {self.run('document.body.innerText')[-2000:]}"
                )
            time.sleep(0.1)
        return found

    def click(self, words: str) -> None:
        """The button that begins with these words, once it is there and may be pressed."""
        begins = f"one.innerText.trim().startsWith({json.dumps(words)})"
        found = f"[...document.querySelectorAll('button')].find(one => !one.disabled && {begins})"
        self.wait(f"!!{found}")
        self.run(f"{found}.click()")

    def give(self, selector: str, *files: Path) -> None:
        """Choose files, or a folder, in an input of files."""
        root = self.send("DOM.getDocument")["root"]["nodeId"]
        node = self.send("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
        self.send("DOM.setFileInputFiles", nodeId=node, files=[str(file) for file in files])

    def write(self, selector: str, text: str) -> None:
        """Into a field, in the place of what it holds, and leave it."""
        field = f"document.querySelector({json.dumps(selector)})"
        self.wait(f"{field} !== null")
        self.run(f"{field}.focus(), {field}.select()")
        self.send("Input.insertText", text=text)
        self.run("document.activeElement.blur()")

    def resize(self, width: int, height: int, *, dark: bool = False, media: str = "screen") -> None:
        phone = width < 600
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=phone)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", media=media, features=[scheme])

    def run(self, script: str) -> Any:
        """The value of a script, which may be a promise."""
        found = self.send(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True, userGesture=True
        )
        if "exceptionDetails" in found:
            raise RuntimeError(found["exceptionDetails"].get("exception", {}).get("description", "?"))
        return found["result"].get("value")

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """With the left button of the mouse."""
        mouse = lambda kind, at, **more: self.send("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], **more)
        mouse("mouseMoved", start)
        mouse("mousePressed", start, button="left", buttons=1, clickCount=1)
        for share in (0.3, 0.7, 1.0):
            at = tuple(a + share * (b - a) for a, b in zip(start, end, strict=True))
            mouse("mouseMoved", at, button="left", buttons=1)
        mouse("mouseReleased", end, button="left", buttons=0, clickCount=1)

    def hover(self, at: tuple[float, float]) -> None:
        self.send("Input.dispatchMouseEvent", type="mouseMoved", x=at[0], y=at[1])

    def press(self, key: str) -> None:
        for kind in ("keyDown", "keyUp"):
            self.send("Input.dispatchKeyEvent", type=kind, key=key, code=key)

    def picture(self, whole: bool = True) -> bytes:
        return base64.b64decode(self.send("Page.captureScreenshot", captureBeyondViewport=whole)["data"])

    def serious_faults(self) -> list[list[str]]:
        """What axe-core finds of the page that is serious or worse: impact, rule, and the first place. AXE is there."""
        self.run(AXE.read_text(encoding="utf-8") + "; undefined")
        found = self.run(
            "axe.run().then((r) => r.violations.map((v) => [v.impact, v.id, v.nodes[0].html.slice(0, 200)]))"
        )
        return [fault for fault in found if fault[0] in ("serious", "critical")]

    def paper(self) -> bytes:
        """As PDF, on A4, in the system's theme."""
        self.send("Emulation.setEmulatedMedia", media="print")
        found = self.send(
            "Page.printToPDF", printBackground=True, preferCSSPageSize=True, paperWidth=8.27, paperHeight=11.69
        )
        return base64.b64decode(found["data"])


@contextmanager
def browser() -> Iterator[Browser]:
    """A browser of its own, with a profile that is thrown away."""
    assert PROGRAM is not None
    to_read, from_read = os.pipe(), os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen(
            [sys.executable, "-c", WITH_PIPES, str(to_read[0]), str(from_read[1]), PROGRAM, *FLAGS, f"--user-data-dir={profile}"],
            pass_fds=(to_read[0], from_read[1]), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        os.close(to_read[0])
        os.close(from_read[1])
        try:
            yield Browser(process, from_read[0], to_read[1])
        finally:
            os.close(to_read[1])  # its end of the pipe gone, Chromium ends
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, 9)
                process.wait()
            os.close(from_read[0])
