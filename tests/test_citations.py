"""Citations of the pages in docs/: page and section exist, and nothing cites a page that readers do not have."""

import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest


ROOT = Path(__file__).resolve().parents[1]
ENDINGS = (".py", ".md", ".toml")
BUILT = ("build", "dist", "__pycache__", "demo-report")
NUMBER = r"\d+(?:\.\d+)?"
GAP = r"[\s#]+"  # a citation may go on in the next line, also of a comment
PAGE = re.compile(r"\bdocs/[\w.-]+\.md\b")
SECTIONS = re.compile(
    rf"{GAP}(?:section{GAP}({NUMBER})|sections{GAP}({NUMBER}(?:(?:,|{GAP}and|{GAP}to){GAP}{NUMBER})*))"
)
HEADING = re.compile(rf"^##+ ({NUMBER})\.? \S", re.MULTILINE)
# Pages that only ever lay beside the project. A letter in brackets, lest these lines be found.
GONE = re.compile(rf"\bMODE[L](?:\.md\b|{GAP}sections?\b)|\bBENC[H]_FORMAT\b|\bDIAGNOS[E]\.md\b|\bREA[L]_BENCH\b")


@cache
def texts() -> dict[str, str]:
    """{path below the root: content} of the pages and source files; what is hidden or built is left out."""
    found = {}
    for folder, folders, names in os.walk(ROOT):
        inside = [n for n in folders if not n.startswith(".") and n not in BUILT and not n.endswith(".egg-info")]
        folders[:] = sorted(n for n in inside if not Path(folder, n, "pyvenv.cfg").exists())
        for path in (Path(folder, name) for name in sorted(names) if name.endswith(ENDINGS)):
            found[path.relative_to(ROOT).as_posix()] = path.read_text(encoding="utf-8")
    return found


def cited(text: str) -> Iterator[tuple[int, str, list[str]]]:
    """(place, page, sections) of every citation in a text."""
    for page in PAGE.finditer(text):
        said = SECTIONS.match(text, page.end())
        yield page.start(), page[0], [] if said is None else re.findall(NUMBER, said[1] or said[2])


def sections(page: str) -> list[str]:
    """Numbers of a page's headings, in their order."""
    return HEADING.findall(texts()[page])


def line(text: str, place: int) -> int:
    return text.count("\n", 0, place) + 1


def test_cited_pages_and_sections_exist():
    wrong, count = [], 0
    for path, text in texts().items():
        for place, page, numbers in cited(text):
            where, count = f"{path}, line {line(text, place)}", count + 1
            if page not in texts():
                wrong.append(f"{where}: there is no {page}")
            else:
                wrong += [f"{where}: {page} has no section {n}" for n in numbers if n not in sections(page)]
    assert not wrong, "\n".join(wrong)
    assert count > 10  # or the search is broken


def test_nothing_cites_a_page_that_readers_do_not_have():
    gone = [
        f"{path}, line {line(text, old.start())}: {old[0]}"
        for path, text in texts().items()
        for old in GONE.finditer(text)
    ]
    assert not gone, "\n".join(gone)


@pytest.mark.parametrize("page", ["docs/physics.md", "docs/bench_format.md", "docs/diagnosis.md"])
def test_sections_count_up(page):
    chapters = [number for number in sections(page) if "." not in number]
    assert chapters == [str(i) for i in range(1, len(chapters) + 1)]
    for chapter in chapters:
        parts = [number for number in sections(page) if number.startswith(f"{chapter}.")]
        assert parts == [f"{chapter}.{i}" for i in range(1, len(parts) + 1)]


# Put together here, as this file is searched too.
EXISTING, MISSING, OLD = "docs/" + "physics.md", "docs/" + "chemistry.md", "MODE" + "L section"


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        (f"{EXISTING}: a page", []),
        (f"({EXISTING} section 3).", ["3"]),
        (f"{EXISTING} section 9.3;", ["9.3"]),
        (f"see {EXISTING}\n    # section 12 and 70 bar", ["12"]),
        (f"{EXISTING} sections 3, 9.2 and 11 say", ["3", "9.2", "11"]),
        (f"{EXISTING} sections 3 to 5", ["3", "5"]),
    ],
)
def test_what_a_citation_looks_like(text, numbers):
    assert [(page, found) for _, page, found in cited(text)] == [(EXISTING, numbers)]


def test_what_is_no_citation():
    assert list(cited("physics.md section 3, docs/ and section 4")) == []
    assert [page for _, page, _ in cited(f"{MISSING} section 1")] == [MISSING]
    assert GONE.search(f"as in {OLD} 7") is not None
    assert GONE.search("MODE" + "L = seed_model()  # section 7") is None
