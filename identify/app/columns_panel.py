"""The part of the page about files and their columns: which test a file holds, what each header is taken for, and the clicks that
change it."""

import pandas as pd
import streamlit as st

from thermohyd.identify.bench.errors import listed
from thermohyd.identify.bench.sheets import MOST_ROWS
from thermohyd.identify.bench.test_tables import PARTS
from thermohyd.identify.checking.report import column_rows, noise_words, size_words
from thermohyd.identify.checking.result import CheckedTest, CheckResult

from .draft import LEFT_OUT, TESTS, Headers, held_by, is_table, value_at, with_test, with_value
from .widgets import bound_text, current, plain, shown, spoken
from .work import Work


NO_TEST, AS_FILE_SAYS, UNKNOWN = "no test", "as the file says", "not recognised: choose"
MOST_HEADERS = 40  # to click on; more of them are told in bench.toml


def files_panel(work: Work) -> None:
    """A choice for every file: the test whose rows it holds."""
    st.header("Files")
    tables = [file for file in work.uploaded.files if is_table(file) or held_by(work.text, file)]
    if not tables:
        st.warning("No file with rows is among them: CSV, .xlsx, .mat, .parquet or .tdms.")
    columns = st.columns(3)
    for number, file in enumerate(tables):
        holds = held_by(work.text, file)
        with columns[number % 3]:
            if len(holds) > 1:
                st.markdown(f"{plain(file)} holds {plain(', '.join(holds))}")
                continue
            key = f"file|{file}"
            st.session_state[key] = holds[0] if holds else NO_TEST
            options = list(dict.fromkeys((NO_TEST, *TESTS, *holds)))
            st.text(f"{file} holds")
            st.selectbox(
                f"Test of {spoken(file)}",
                options,
                key=key,
                on_change=_choose_test,
                args=(file, key),
                label_visibility="collapsed",
            )


def _choose_test(file: str, key: str) -> None:
    work, chosen = current(), st.session_state[key]
    work.change(with_test(work.text, file, None if chosen == NO_TEST else chosen))


def tests_panel(work: Work, found: CheckResult | str) -> None:
    """Every test: what is wrong with it, its columns with units and ranges, and what each header is taken for."""
    headers = work.headers()
    checked = {} if isinstance(found, str) else found.tests
    refused = {} if isinstance(found, str) else found.refused
    names = list(dict.fromkeys([*headers, *checked, *(name for name in refused if name)]))
    if names:
        st.header("Columns")
    for name in names:
        own = headers.get(name)
        trouble = refused.get(name) or (own if isinstance(own, str) else "")
        unknown = own.unknown if isinstance(own, Headers) else []
        title = "not readable yet" if trouble else f"{len(unknown)} headers not recognised" if unknown else "recognised"
        with st.expander(f"**{plain(name)}**: {title}", expanded=bool(trouble or unknown)):
            if trouble:
                st.error(shown(work, trouble))
            if name in checked:
                _columns(work, checked[name])
            if isinstance(own, Headers):
                _meanings(work, name, own)
            if own is not None:
                _layout(work, name)


def _columns(work: Work, test: CheckedTest) -> None:
    st.markdown(plain(size_words(test)))
    st.dataframe(
        pd.DataFrame(column_rows(test), columns=["header", "read as", "from", "to", "unit"]),
        hide_index=True,
        height="content",
    )
    said = [f"{name}: {words}" for name, words in test.conditions.items()]
    said += [f"{noise.channel}: {noise_words(test, noise.channel)}" for noise in test.noise]
    for sentence in (*said, *test.read.notes, *test.notes):
        st.markdown(shown(work, sentence))
    for fault in test.faults:
        st.warning(shown(work, fault.sentence))


def _meanings(work: Work, name: str, own: Headers) -> None:
    """A row for each header: what it is taken for, and its unit where it says none."""
    guesses = own.guesses()
    if guesses:
        words = listed([f"{own.header[place]} is {column}" for place, column in guesses.items()], 6)
        st.button(f"Take the proposals: {plain(words)}", key=f"{name}|guesses", on_click=_take_guesses, args=(name,))
    for place, header in enumerate(own.header[:MOST_HEADERS]):
        taken = own.taken_for[place]
        left, middle, right = st.columns([2, 2, 1], vertical_alignment="center")
        left.text(header)
        key, unit_key = f"{name}|{place}|is", f"{name}|{place}|unit"
        st.session_state[key] = taken or UNKNOWN
        options = [*([] if taken else [UNKNOWN]), *own.meanings, LEFT_OUT]
        middle.selectbox(
            f"What {spoken(header)} is",
            options,
            key=key,
            on_change=_mean,
            args=(name, place),
            label_visibility="collapsed",
        )
        if taken not in ("", LEFT_OUT) and own.needs_unit(place, taken):
            stated = own.stated_unit(place) or AS_FILE_SAYS
            st.session_state[unit_key] = stated
            right.selectbox(
                f"Unit of {spoken(header)}",
                list(dict.fromkeys((AS_FILE_SAYS, *own.units(taken), stated))),
                key=unit_key,
                on_change=_mean,
                args=(name, place),
                accept_new_options=True,
                label_visibility="collapsed",
            )
    if len(own.header) > MOST_HEADERS:
        st.markdown(f"{len(own.header) - MOST_HEADERS} more headers: bench.toml below can name them.")


def _mean(name: str, place: int) -> None:
    work = current()
    own = work.headers().get(name)
    if isinstance(own, Headers):
        chosen = st.session_state[f"{name}|{place}|is"]
        unit = st.session_state.get(f"{name}|{place}|unit", AS_FILE_SAYS)
        if chosen != UNKNOWN:
            work.change(
                own.with_meaning(work.text, place, chosen, "" if unit in (None, AS_FILE_SAYS) else unit.strip())
            )


def _take_guesses(name: str) -> None:
    work = current()
    own = work.headers().get(name)
    guesses = own.guesses() if isinstance(own, Headers) else {}
    for place, column in guesses.items():
        own = work.headers().get(name)  # with what the one before it wrote
        if isinstance(own, Headers):
            work.change(own.with_meaning(work.text, place, column))


def _layout(work: Work, name: str) -> None:
    """What a log needs beside its headers."""
    first, second, third = st.columns(3)
    rows, missing = f"{name}|skip_rows", f"{name}|missing"
    said = value_at(work.text, ("tests", name, "skip_rows"))
    file = str(value_at(work.text, ("tests", name, "file"))).lower()
    with first:
        part = next((key for key, (endings, _) in PARTS.items() if file.endswith(endings)), None)
        if part is not None:
            bound_text(work, ("tests", name, part), f"{part.capitalize()} of the file, where it is not the first")
        if part in (None, "sheet"):
            st.session_state[rows] = said if isinstance(said, int) and 0 <= said <= MOST_ROWS else 0
            st.number_input("Lines above the headers", 0, step=1, key=rows, on_change=_skip, args=(name, rows))
    with second:
        bound_text(work, ("tests", name, "noise"), "Noise of a reading, where it is known", "0.01 l/min")
    with third:
        st.session_state[missing] = value_at(work.text, ("tests", name, "missing")) == "skip"
        st.checkbox("Leave out rows with a missing cell", key=missing, on_change=_miss, args=(name, missing))


def _skip(name: str, key: str) -> None:
    work = current()
    work.change(with_value(work.text, ("tests", name, "skip_rows"), int(st.session_state[key]) or None))


def _miss(name: str, key: str) -> None:
    work = current()
    work.change(with_value(work.text, ("tests", name, "missing"), "skip" if st.session_state[key] else None))
