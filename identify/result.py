"""What every result of `thermohyd.identify` can do: show itself, become a dictionary, draw its figures, write its files.

Only standard library here: a result is made and passed on where neither JAX nor matplotlib is wanted. What a method needs
it imports when it is called.
"""

from abc import ABC, abstractmethod
from html import escape
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar


if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from rich.console import Console


WIDTH = 120  # columns of a summary, as of a report that goes to a file


class Result(ABC):
    """The face that fits, diagnoses, predictions and studies share."""

    _command: ClassVar[str]  # that writes the same files: a folder of results knows its files by it

    @abstractmethod
    def print_on(self, console: "Console") -> None:
        """Print what the command shows in a terminal; user text is never read as markup."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """The result as plain Python, SI units, without NaN: what the command writes as JSON."""

    @abstractmethod
    def to_dataframe(self) -> "pd.DataFrame":
        """What the result is a table of, for further work."""

    @abstractmethod
    def figures(self) -> "dict[str, Figure]":
        """Matplotlib figures by file name without ending, in the order of the report. They belong to no pyplot window."""

    @abstractmethod
    def _files(self) -> dict[str, bytes | str]:
        """{file name: content} of everything that `save` writes."""

    def _of(self) -> str:
        """Which record the files are of; empty: of none."""
        return ""

    def summary(self, width: int = WIDTH) -> str:
        """The text that the command shows in a terminal of `width` columns, without escape codes."""
        from thermohyd.identify.report.terminal import PlainConsole

        text = StringIO()
        self.print_on(PlainConsole(file=text, width=width, color_system=None, force_terminal=False))
        return text.getvalue()

    def _repr_html_(self) -> str:
        """How a notebook shows the result: as a terminal does, unless its class knows better."""
        return f"<pre>{escape(self.summary())}</pre>"

    def save(self, folder: str | Path) -> list[Path]:
        """Write the files that the command's --out writes, all of them or none, into a folder that is made if need be.

        Files that an earlier run wrote there of the same kind, and that this one does not, are removed; never yours.
        Returns the paths. Raises OSError where the folder cannot be written.
        """
        from thermohyd.identify.report.files import Writer, write_all

        return write_all(folder, self._files(), Writer(self._command, self._of()))
