"""A sweep in a terminal of 80 columns."""

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from . import tables, words
from .study import MODELS, ServoStudy


def print_servo(study: ServoStudy, console: Console) -> None:
    """The sentences, then a row per temperature and model."""
    title = f"The position loop over temperature: {study.subject.name}, {words.conditions_in_words(study)}"
    console.print(Text(title, style="bold cyan"), highlight=False)
    console.print(Text(words.actuator_in_words(study)))
    for model in MODELS:
        heading = "THM: the oil keeps its heat" if model == "THM" else "HM: isothermal oil"
        console.print(Text(f"\n{heading}", style="bold cyan"), highlight=False)
        console.print(_table(study, model))
    console.print()
    for sentence in words.sentences(study):
        console.print(Text(sentence, style="bold red" if words.alarming(sentence) else ""))
    for note in study.subject.notes:
        console.print(Text(note, style="yellow"))


def _table(study: ServoStudy, model: str) -> Padding:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False, header_style="bold")
    for title in tables.COLUMNS:
        head, _, unit = title.rpartition(" ")
        table.add_column(f"{head}\n{unit}", justify="right", no_wrap=True, vertical="bottom")
    for row in tables.rows(study, model):
        style = "red" if tables.UNSTABLE in row else ""
        table.add_row(*[Text(cell, style=style) for cell in row])
    return Padding(table, (0, 0, 0, 2), expand=False)
