"""The figures that pages show are those that a command wrote, with commit and date; blocks of other pages are theirs."""

import re
import sys
from pathlib import Path

import pytest


ROOT = Path(__file__).parents[1]
PAGE = "Measured by benchmarks/start_up.py, commit 0123abc, 2026-11-23; 2 cores\n\n| what | figure |\n|---|---|\n| help | 0.1 s |\n"


@pytest.fixture
def figures(of_benchmarks):
    return of_benchmarks("figures")


def test_pages_show_what_the_figures_pages_say(figures):
    shown = figures.with_figures()
    assert {page.name for page in shown} >= {"why.md", "measured.md", "fleet.md"}
    for page in shown:
        text = page.read_text(encoding="utf-8")
        assert figures.with_blocks(text, figures.PAGES) == text, page.name


def test_every_page_of_figures_says_where_and_when(figures):
    for page in figures.PAGES.glob("*.md"):
        text = page.read_text(encoding="utf-8")
        assert page.stem in figures.PARTS
        assert f"make figures PARTS={page.stem}" in text
        assert re.search(r"commit [0-9a-f]{7,}( with changes)?, \d{4}-\d\d-\d\d; ", text), page.name


def test_a_block_is_the_first_table_of_its_page_and_nothing_else_changes(figures, tmp_path):
    (tmp_path / "start-up.md").write_text(f"<!-- by make -->\n{PAGE}\n## More\n\nrest\n", encoding="utf-8")
    text = "before\n<!-- figures: start-up -->\nold\n<!-- end of figures -->\nafter\n"
    shown = figures.with_blocks(text, tmp_path)
    assert shown == f"before\n<!-- figures: start-up -->\n{PAGE}<!-- end of figures -->\nafter\n"
    assert figures.with_blocks(shown, tmp_path) == shown


def test_what_is_printed_stands_in_a_block_unless_it_is_markdown(figures):
    assert "```\n  --help 0.15 s\n```" in figures.page("start-up", "  --help 0.15 s\n", "0123abc")
    assert "```" not in figures.page("hidden-1", "# Set 1\n\n| a | b |\n|---|---|\n", "0123abc")


def test_an_unknown_part_is_refused(figures, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["figures.py", "speeds"])
    with pytest.raises(SystemExit) as stopped:
        figures.main()
    assert stopped.value.code == 2
    assert "there is no part speeds" in capsys.readouterr().err
