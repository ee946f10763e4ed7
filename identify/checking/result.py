"""What a check returns: plain numbers and words, ready for the terminal, for JSON and for a picture. No JAX here."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_record import Fault, TestRecord
from thermohyd.identify.result import Result


if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from rich.console import Console


@dataclass(frozen=True)
class CheckedColumn:
    """One column of a test's file. standard: the column that it is taken for, "" where it is left alone. unit: as the header or
    bench.toml has it. least, greatest: of its rows, in that unit; None of texts.
    """

    header: str
    standard: str
    unit: str
    least: float | None
    greatest: float | None


@dataclass(frozen=True)
class CheckedNoise:
    """What is known of a reading's noise before any fit. std: of a row or a reduced point (median), SI; known: not a guess."""

    channel: str
    std: float
    known: bool
    source: str


@dataclass(frozen=True)
class CheckedTest:
    """A test as it was read, and what a fit would see of it.

    conditions: {condition: where from, in words} of those that are no column. read: in the order of its file; seen: reduced and
    without bad rows. turned: readings that a fit takes with their sign turned. notes: how it was reduced.
    """

    name: str
    read: TestRecord
    seen: TestRecord
    columns: tuple[CheckedColumn, ...]
    conditions: dict[str, str]
    noise: tuple[CheckedNoise, ...]
    legs: int
    planned: bool
    turned: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def reduced(self) -> bool:
        """Whether a fit sees points instead of rows."""
        return self.seen.rows_of_log is not None

    @property
    def faults(self) -> tuple[Fault, ...]:
        return self.seen.faults


@dataclass(frozen=True)
class Missing:
    """Something that the record lacks, what that costs, and what to do. key: a word for programs."""

    key: str
    sentence: str


@dataclass(frozen=True)
class CheckResult(Result):
    """What `check` finds. refused: {test: the sentence with which a fit would refuse the record}; without_readings: of these,
    tests that `simulate` and `plan` take. record: of the tests that could be read; None without any.
    """

    _command: ClassVar[str] = "check"

    name: str
    folder: Path
    record: BenchRecord | None
    tests: dict[str, CheckedTest]
    refused: dict[str, str]
    without_readings: tuple[str, ...]
    free: tuple[str, ...]  # parameters that a fit would look for
    missing: tuple[Missing, ...]
    warnings: tuple[str, ...]
    next_command: str

    @property
    def for_predictions_only(self) -> bool:
        """Whether every test lacks its readings, as a record for `simulate` does, or is planned."""
        return bool(self.tests) and all(name in self.without_readings for name in (*self.tests, *self.refused))

    @property
    def trouble(self) -> str:
        """Why a fit would refuse the record, in one sentence; empty where it would not."""
        if not self.refused or self.for_predictions_only:
            return ""
        if list(self.refused) == [""]:
            return (
                "its tests can be read, but the record would be refused: correct what is named there, and check again"
            )
        every = len({*self.tests, *self.refused})
        return (
            f"{len(self.refused)} of {every} {'test' if every == 1 else 'tests'} would be refused ({', '.join(self.refused)}): "
            "correct what is named there, and check again"
        )

    def print_on(self, console: "Console") -> None:
        from .report import print_check

        print_check(self, console)

    def to_dict(self) -> dict[str, Any]:
        """Keys: docs/bench_format.md section 8.10."""
        from .report import check_json

        return check_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """A row per column of a file: test, header, standard, unit, least, greatest."""
        import pandas as pd

        rows = [{"test": name, **vars(column)} for name, test in self.tests.items() for column in test.columns]
        return pd.DataFrame(rows, columns=["test", "header", "standard", "unit", "least", "greatest"])

    def figures(self) -> "dict[str, Figure]":
        from .figure import check_figure

        return {"check": check_figure(self)} if any(test.read.channels for test in self.tests.values()) else {}

    def _of(self) -> str:
        return str(self.folder.resolve())

    def _files(self) -> dict[str, bytes | str]:
        from thermohyd.identify.report.fit_json import json_text
        from thermohyd.identify.report.style import png, style

        files: dict[str, bytes | str] = {"check.json": json_text(self.to_dict())}
        with style():
            for name, figure in self.figures().items():  # a PNG alone: an SVG beside it would take as long again
                files[f"{name}.png"] = png(figure)
        return files
