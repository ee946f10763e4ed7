"""One record on a page: its files in a temporary folder, the text of its bench.toml, what a check says of it, and the command that runs."""

import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import NAME
from thermohyd.identify.bench.test_file import read_source
from thermohyd.identify.checking.check import check
from thermohyd.identify.checking.result import CheckResult

from .command_run import CommandRun
from .draft import Headers, described_tests, first_draft, with_likely_tests
from .upload import TemporaryHome, refuse_files_elsewhere, write_upload


RESULTS = "results"  # the folder that --out names, among the program's own files
BESIDE = "../own/"  # from where the record lies, and its command runs, to these files
JOBS = {"fit": "fit.json", "diagnose": "diagnosis.json"}


class Work:
    """What was dropped. Raises BenchInputError where that is no folder of a record, or cannot be written."""

    def __init__(self, sent: Iterable[tuple[str, bytes]], begun: "Work | None" = None) -> None:
        """begun: the work with fewer files that this one goes on with; what was written there stays, unless bench.toml came now."""
        self.home = TemporaryHome()
        self.uploaded = write_upload(sent, self.home)
        self.run: CommandRun | None = None
        self.ran_on = ""  # the text of bench.toml when it started
        # Each with the text that it was found for: large logs are read once for every change.
        self._checked: tuple[str, CheckResult | str] | None = None
        self._headers: tuple[str, dict[str, Headers | str]] | None = None
        self._curves: tuple[str, tuple[bytes, ...]] | None = None
        described = self.uploaded.described
        goes_on = begun is not None and begun.uploaded.described == described
        if described:
            self.text = (self.record / NAME).read_text(encoding="utf-8-sig", errors="replace")
        if begun is not None and goes_on:
            self.change(begun.text) if described else self._begin(begun.text)
        elif not described:
            self._begin(first_draft(self.record.name))

    def _begin(self, text: str) -> None:
        self.text = with_likely_tests(text, self.record, self.uploaded.files)
        self.write()

    @property
    def record(self) -> Path:
        return self.uploaded.record

    @property
    def running(self) -> bool:
        """Whether a command runs on the record."""
        return self.run is not None and self.run.status is None

    def write(self) -> None:
        """Put the text where the program reads it."""
        (self.record / NAME).write_text(self.text, encoding="utf-8")

    def change(self, text: str) -> None:
        """Another bench.toml, unless a command reads this one."""
        if text != self.text and not self.running:
            self.text = text
            self.write()

    def check(self) -> CheckResult | str:
        """What `thermohyd check` finds, or the sentence with which it refuses the record as a whole."""
        if self._checked is None or self._checked[0] != self.text:
            self._checked = self.text, self._found()
        return self._checked[1]

    def _found(self) -> CheckResult | str:
        try:
            refuse_files_elsewhere(self.record)
            return check(self.record)
        except BenchInputError as error:
            return self.home.words(str(error))

    def headers(self) -> dict[str, Headers | str]:
        """The headers of every test's file, or why they cannot be told; empty where bench.toml names no tests."""
        if self._headers is None or self._headers[0] != self.text:
            self._headers = self.text, self._read_headers()
        return self._headers[1]

    def _read_headers(self) -> dict[str, Headers | str]:
        try:
            refuse_files_elsewhere(self.record)
            tests = described_tests(self.record)
        except BenchInputError:
            return {}  # the check says the same
        found: dict[str, Headers | str] = {}
        for name, test in tests.items():
            if not getattr(test, "planned", False):
                try:
                    found[name] = Headers(test, read_source(test))
                except BenchInputError as error:
                    found[name] = self.home.words(str(error))
        return found

    def curves(self, found: CheckResult) -> tuple[bytes, ...]:
        """The pictures that `thermohyd check --out` draws of what it found, as PNG."""
        if self._curves is None or self._curves[0] != self.text:
            from thermohyd.identify.report.style import png, style

            with style():
                self._curves = self.text, tuple(png(figure) for figure in found.figures().values())
        return self._curves[1]

    def start(self, job: str) -> None:
        """Run `thermohyd fit` or `thermohyd diagnose` on the record; what ran before is stopped, and its results go.

        Raises BenchInputError where bench.toml names files elsewhere.
        """
        refuse_files_elsewhere(self.record)  # a browser can press a button that it was told to grey out
        if self.run is not None:
            self.run.stop()
        shutil.rmtree(self.home.own / RESULTS, ignore_errors=True)
        self.ran_on = self.text
        self.run = CommandRun([job, self.record.name, "--out", f"{BESIDE}{RESULTS}", "--verbose"], self.home)

    def result(self, name: str) -> bytes | None:
        """A file that the command wrote; None where there is none. It names the record by its folder's name, as the user does, not by
        where that lay for a while.
        """
        try:
            content = (self.home.own / RESULTS / name).read_bytes()
        except OSError:
            return None
        for before in (BESIDE, f"{self.home.dropped}{os.sep}", f"{self.home.own}{os.sep}"):
            content = content.replace(before.encode(), b"")
        return content.replace(str(self.home.folder).encode(), b"a temporary folder")

    def close(self) -> None:
        """Stop what runs and remove the folder, now."""
        if self.run is not None:
            self.run.stop()
        self.home.remove()
