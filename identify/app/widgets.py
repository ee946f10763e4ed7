"""What all parts of the page share: the record of the session, a user's text that Markdown leaves alone, fields bound to bench.toml."""

import re

import streamlit as st

from .draft import Place, value_at, with_value
from .work import Work


WORK = "work"  # its key in the session


def plain(text: str) -> str:
    """A user's text such that Markdown shows it as it is: a header must not load a picture from somewhere."""
    return re.sub(r"([!-/:-@\[-`{-~])", r"\\\1", text)


def spoken(text: str) -> str:
    """A user's text without signs, for labels that are read aloud as they are written and not shown."""
    return re.sub(r"[\W_]+", " ", text).strip()


def shown(work: Work, message: str) -> str:
    """A message of the program, with files named as the user knows them."""
    return plain(work.home.words(message))


def current() -> Work:
    """The record of this session."""
    return st.session_state[WORK]


def bound_text(work: Work, place: Place, label: str, example: str = "") -> None:
    """A field that shows what bench.toml says at a place, and writes it there; of a whole table it only shows it."""
    key = ".".join(map(str, place))
    said = value_at(work.text, place)
    st.session_state[key] = "" if said is None else str(said)
    st.text_input(
        label,
        key=key,
        placeholder=f"such as {example}" if example else "",
        on_change=_write,
        args=(place, key),
        disabled=isinstance(said, dict | list),
    )


def _write(place: Place, key: str) -> None:
    work = current()
    work.change(with_value(work.text, place, st.session_state[key].strip()))
