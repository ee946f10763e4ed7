"""Does a page show what was printed? All of it, word by word, but for what differs from one machine or day to the next."""

import re
from collections.abc import Callable
from itertools import takewhile
from pathlib import Path


HOME = "/home/you"  # where the reader of a page is
LEFT_OUT = "..."  # a line of its own: here the page leaves out lines
NUMBER = re.compile(r"[(+]*(-?[\d,]*\.?\d+(?:e[-+]?\d+)?)[).,;:]*")
VARYING: tuple[tuple[str, str | Callable[[re.Match[str]], str]], ...] = (
    (r"─+", "─"),
    (r"\d{4}-\d\d-\d\d \d\d:\d\d", "DATE"),
    (r"thermohyd \d+\.\d+[\w.+]*", "thermohyd VERSION"),
    (r"\btime +[\d.]+ s\b", "time TIME"),
    (r"readings, [\d.]+ s\)", "readings, TIME)"),
)


def steady(text: str, folder: Path | str = HOME) -> list[str]:
    """The words of a text, dates, times, versions and the reader's folder replaced."""
    text = " ".join(text.replace(str(folder), HOME).split())
    for pattern, instead in VARYING:
        text = re.sub(pattern, instead, text)
    return text.split()


def alike(said: str, printed: str) -> bool:
    """Whether two words are the same, or two numbers that differ by two in their last digit or by 2 % at most."""
    if said == printed:
        return True
    first, second = NUMBER.fullmatch(said), NUMBER.fullmatch(printed)
    if first is None or second is None:
        return False
    a, b = (float(match[1].replace(",", "")) for match in (first, second))
    digits = len(first[1].partition("e")[0].partition(".")[2])
    return "e" not in first[1] and abs(a - b) <= max(2.5 * 10.0**-digits, 0.02 * abs(b))


def where_it_differs(shown: str, printed: str, folder: Path) -> str:
    """Where a page's block does not show what was printed in a folder; empty where it does."""
    words, place = steady(printed, folder), 0
    parts = [steady(part) for part in re.split(rf"^{re.escape(LEFT_OUT)}$", shown, flags=re.MULTILINE)]
    for number, part in enumerate(parts):
        first, last = number == 0, number == len(parts) - 1
        starts = [place] if first else range(place, len(words) - len(part) + 1)
        if last and not first:
            starts = [len(words) - len(part)]
        lengths = [(_alike_words(part, words[start:]), start) for start in starts if start >= place]
        same, start = max(lengths, default=(0, place))
        if same < len(part):
            return (
                f"the page has {' '.join(part[same : same + 8])!r}, printed was {' '.join(words[start + same :][:8])!r}"
            )
        place = start + len(part)
    return "" if place == len(words) else f"printed was also {' '.join(words[place : place + 12])!r}"


def _alike_words(part: list[str], words: list[str]) -> int:
    """How many words from the first on are alike."""
    return sum(1 for _ in takewhile(lambda pair: alike(*pair), zip(part, words, strict=False)))


def as_shown(printed: str, folder: Path) -> str:
    """What was printed, as a page shows it."""
    text = printed.replace(str(folder), HOME)
    return "\n".join(line.rstrip() for line in text.strip("\n").splitlines()) + "\n"
