"""The channels of a LabVIEW .tdms file as columns. A channel's property unit_string gives its unit where its name has none.

A waveform has no column of times: its increment (wf_increment) makes one.
"""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from thermohyd.identify.optional_parts import install

from .errors import BenchInputError, listed, one_line, quoted
from .headers import plain_name, split_header
from .sheets import LARGEST, MOST_CELLS, SheetRows


SHOWN = 8  # names in a message


def read_tdms(path: Path, group: str | None) -> SheetRows:
    """The channels of a group (None: its only one with channels). Rows count from 1. Raises BenchInputError."""
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise BenchInputError(
            f"needs the package npTDMS: {install('tdms')}; or save the log as CSV", file=path
        ) from None
    try:
        if path.stat().st_size > LARGEST:
            raise BenchInputError(f"is larger than {LARGEST:,} bytes; thin the log before fitting", file=path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            about = TdmsFile.read_metadata(path)
            cells = sum(len(channel) for each in about.groups() for channel in each.channels())
            if cells > MOST_CELLS:
                raise BenchInputError(f"has more than {MOST_CELLS:,} cells; thin the log before fitting", file=path)
            found = {each.name: list(each.channels()) for each in TdmsFile.read(path).groups()}
            channels = _chosen(path, found, group)
            columns = {_header(channel): np.asarray(channel[:]) for channel in channels}
            pace = {float(channel.properties.get("wf_increment", 0.0)) for channel in channels}
            first = {float(channel.properties.get("wf_start_offset", 0.0)) for channel in channels}
    except BenchInputError:
        raise
    except OSError as error:
        raise BenchInputError(f"cannot be read ({error.strerror or error})", file=path) from None
    except Exception:  # npTDMS raises whatever it trips over in a damaged or hostile file
        raise BenchInputError("is no .tdms file, or a damaged one; write it again, or as CSV", file=path) from None
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        few = listed([f"{quoted(name)} {count:,}" for name, count in lengths.items()], SHOWN)
        raise BenchInputError(
            f"its channels differ in length: {few}; save those of the log in a group of their own", file=path
        )
    rows = next(iter(lengths.values()))
    if not rows:
        raise BenchInputError("is empty; expected channels with at least one row", file=path)
    if len(pace) == len(first) == 1 and next(iter(pace)) > 0.0 and not any(_is_time(name) for name in columns):
        columns = {"time [s]": first.pop() + pace.pop() * np.arange(rows), **columns}
    frame = pd.DataFrame({i: column for i, column in enumerate(columns.values())})
    return SheetRows(path, list(columns), 0, list(range(1, rows + 1)), frame)


def _chosen(path: Path, found: dict[str, list[Any]], group: str | None) -> list[Any]:
    full = {name: channels for name, channels in found.items() if channels}
    if not full:
        raise BenchInputError("is empty; expected a group with channels", file=path)
    names = listed([quoted(name) for name in full], SHOWN)
    if group is not None:
        if group not in full:
            raise BenchInputError(f"has no group {quoted(group)} with channels; it has {names}", file=path)
        return full[group]
    if len(full) > 1:
        raise BenchInputError(
            f'holds the groups {names}; write group = "{one_line(next(iter(full)))}" beside its file in bench.toml',
            file=path,
        )
    return next(iter(full.values()))


def _header(channel: Any) -> str:
    name = one_line(str(channel.name)).strip()
    unit = str(channel.properties.get("unit_string", "")).strip()
    return f"{name} [{one_line(unit)}]" if unit and split_header(name)[1] is None else name


def _is_time(header: str) -> bool:
    return plain_name(split_header(header)[0]) == "time"
