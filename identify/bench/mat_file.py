"""The columns of a MATLAB .mat file: vectors, a struct of vectors or a matrix. Version 7.3 (HDF5) by h5py.

A MATLAB name holds no unit: `columns = { spool_position = "xv [um]" }` in bench.toml gives it. Text (a char matrix or a cell array
of texts) may be a column, such as the run.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from thermohyd.identify.optional_parts import install

from .errors import BenchInputError, listed, one_line, quoted
from .input_file import Allowance, open_input
from .mat_elements import BYTES, OF_AN_ARRAY, texts_of, variables
from .sheets import SheetRows


HDF5 = b"\x89HDF\r\n\x1a\n"
OTHER_WAY = 'or save it in MATLAB as vectors of numbers, with save(..., "-v7")'
FROM_TABLE = 's = table2struct(T, "ToScalar", true)'
OTHER_KINDS = {"": "an object", "struct": "an array of structs"} | dict.fromkeys(
    ("table", "object"), "a MATLAB table or another object"
)
SHOWN = 8  # names in a message
LONGEST_CLASS = 64  # bytes of MATLAB's word for what a variable is
OF_A_TEXT = 1000  # of a cell array, in HDF5: each is looked up by itself


def read_mat(path: Path, variable: str | None) -> SheetRows:
    """The columns of a .mat file. variable: a struct or a matrix in it; None: its vectors, or its only struct or matrix.

    Rows count from 1, as MATLAB does. Raises BenchInputError.
    """
    with open_input(path) as file:
        start = file.read(512 + len(HDF5))
    hdf5 = start.startswith(HDF5) or start[512:] == HDF5
    found = _of_hdf5(path) if hdf5 else _of_elements(path)
    return _rows(path, _chosen(path, found, variable))


def _of_elements(path: Path) -> dict[str, Any]:
    try:
        return variables(path)
    except BenchInputError:
        raise
    except Exception:  # of every part that is not where it should be
        raise BenchInputError(f"is no .mat file, or a damaged one; save it again, {OTHER_WAY}", file=path) from None


def _of_hdf5(path: Path) -> dict[str, Any]:
    try:
        import h5py
    except ImportError:
        raise BenchInputError(
            f"is of MATLAB version 7.3 and needs the package h5py: {install('matlab')}; or save it in MATLAB with "
            'save(..., "-v7")',
            file=path,
        ) from None
    try:
        with h5py.File(path, "r") as file:
            return _Hdf5(path, file).variables()
    except BenchInputError:
        raise
    except Exception:  # h5py raises whatever it trips over
        raise BenchInputError(f"is no .mat file, or a damaged one; save it again, {OTHER_WAY}", file=path) from None


class _Hdf5:
    """The variables of a file of version 7.3. HDF5 can lead to any other file of the machine, by links, by data kept outside and by
    virtual data sets: MATLAB writes none of them, and none is followed. Sizes are looked at before anything is read.
    """

    def __init__(self, path: Path, file: Any) -> None:
        self.path, self.file = path, file
        self.allowance = Allowance(path)

    def variables(self) -> dict[str, Any]:
        return {name: self._node(node) for name, node in self._children(self.file)}

    def _children(self, group: Any) -> Iterator[tuple[str, Any]]:
        import h5py

        for name in group:
            self.allowance.take(OF_AN_ARRAY)
            if name.startswith("#"):
                continue
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise self._leads_elsewhere(name, "is a link to another place or file")
            yield name, group[name]

    def _leads_elsewhere(self, name: str, what: str) -> BenchInputError:
        return BenchInputError(
            f"variable {quoted(name)} {what}, which is not followed; save it again, {OTHER_WAY}", file=self.path
        )

    def _node(self, node: Any, deep: bool = True) -> Any:
        """A data set or a group as `variables` gives it; MATLAB stores matrices transposed there."""
        kind = self._attribute(node, "MATLAB_class")
        kind = kind.decode(errors="replace") if isinstance(kind, bytes) else str(kind or "")
        if hasattr(node, "keys"):
            fields = {name: self._node(child, False) for name, child in self._children(node)} if deep else {}
            return fields if deep and kind in ("struct", "") else kind or "struct"
        if not hasattr(node, "shape"):
            return kind or "object"
        if self._attribute(node, "MATLAB_empty"):
            return np.zeros(0)
        if kind == "cell":
            return self._cell(node)
        if not self._numbers(node):
            return kind or "object"
        value = np.asarray(node[()])
        if kind == "char":
            return texts_of("".join(map(chr, value.reshape(-1))), list(value.T.shape))
        return value.T

    def _attribute(self, node: Any, name: str) -> Any:
        """A small one; None where there is none."""
        if name not in node.attrs:
            return None
        about = node.attrs.get_id(name)
        return node.attrs[name] if about.shape == () and about.dtype.itemsize <= LONGEST_CLASS else None

    def _numbers(self, node: Any, kinds: str = "biuf") -> bool:
        """Whether a data set holds numbers (or what else `kinds` says). Raises BenchInputError where they are too many or elsewhere."""
        import h5py

        made = node.id.get_create_plist()
        if made.get_layout() == h5py.h5d.VIRTUAL or made.get_external_count():
            raise self._leads_elsewhere(node.name, "keeps its data in another file")
        filters = {made.get_filter(i)[0] for i in range(made.get_nfilters())}
        if not filters <= {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}:
            raise self._leads_elsewhere(node.name, "is packed in a way that MATLAB does not use")
        chunk = made.get_chunk() if made.get_layout() == h5py.h5d.CHUNKED else ()
        size = max(np.prod(node.shape, dtype=float), np.prod(chunk, dtype=float))
        self.allowance.take(float(size) * max(BYTES, node.dtype.itemsize))
        return node.dtype.kind in kinds

    def _cell(self, node: Any) -> Any:
        """The texts of a cell array; "cell" where it holds anything else."""
        import h5py

        if not self._numbers(node, "O") or h5py.check_ref_dtype(node.dtype) is not h5py.Reference:
            return "cell"
        texts = []
        for reference in node[()].reshape(-1):
            self.allowance.take(OF_A_TEXT)
            cell = self.file[reference]
            if self._attribute(cell, "MATLAB_class") != b"char":
                return "cell"
            empty = self._attribute(cell, "MATLAB_empty") or not self._numbers(cell)
            texts.append("" if empty else "".join(map(chr, cell[()].reshape(-1))))
        return np.array(texts, dtype=object)


def _chosen(path: Path, found: Mapping[str, Any], variable: str | None) -> dict[str, np.ndarray]:
    """{name: column} of what bench.toml names, or of what there is."""
    if not found:
        raise BenchInputError("is empty; expected vectors, a struct of vectors or a matrix", file=path)
    if variable is not None:
        if variable not in found:
            names = listed([quoted(name) for name in found], SHOWN)
            raise BenchInputError(f"has no variable {quoted(variable)}; it has {names}", file=path)
        return _columns(path, variable, found[variable])
    vectors = {name: value for name, value in found.items() if _is_vector(value)}
    if vectors:
        return {name: _flat(value) for name, value in vectors.items()}
    tables = {name: value for name, value in found.items() if isinstance(value, dict) or _is_matrix(value)}
    if len(tables) == 1:
        ((name, value),) = tables.items()
        return _columns(path, name, value)
    if not tables:
        name, value = next(iter(found.items()))
        return _columns(path, name, value)  # which says what is wrong with it
    names = listed([quoted(name) for name in tables], SHOWN)
    raise BenchInputError(
        f'holds {names}; write variable = "{one_line(next(iter(tables)))}" beside its file in bench.toml', file=path
    )


def _columns(path: Path, name: str, value: Any) -> dict[str, np.ndarray]:
    where = f"variable {quoted(name)}"
    if isinstance(value, dict):
        columns = {field: _flat(column) for field, column in value.items() if _is_vector(column)}
        if columns:
            return columns
        raise BenchInputError(f"{where} is a struct without a vector of numbers among its fields", file=path)
    if _is_vector(value):
        return {name: _flat(value)}
    if _is_matrix(value):
        return {f"column {i + 1}": value[:, i] for i in range(value.shape[1])}
    what = OTHER_KINDS.get(value, "") if isinstance(value, str) else ""
    if isinstance(value, str) and not what:
        what = f"of MATLAB's class {one_line(value)}"
    raise BenchInputError(
        f"{where} is {what or 'no vector and no matrix'}, of which only MATLAB can read the columns; save a struct of vectors: "
        f"of a table T, {FROM_TABLE}",
        file=path,
    )


def _is_vector(value: Any) -> bool:
    """A column of numbers or texts: more than one value, along one direction."""
    return (
        isinstance(value, np.ndarray)
        and value.dtype.kind in "biufUO"
        and value.size > 1
        and value.size == max(value.shape)
    )


def _is_matrix(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "biuf" and min(value.shape) > 1


def _flat(value: np.ndarray) -> np.ndarray:
    flat = value.reshape(-1)
    return np.array([str(text).strip() for text in flat], dtype=object) if flat.dtype.kind == "U" else flat


def _rows(path: Path, columns: Mapping[str, np.ndarray]) -> SheetRows:
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        few = listed([f"{quoted(name)} {count:,}" for name, count in lengths.items()], SHOWN)
        raise BenchInputError(
            f'its vectors differ in length: {few}; name the struct or matrix that is the log, variable = "..." in bench.toml, or '
            "save one log per file",
            file=path,
        )
    frame = pd.DataFrame({i: column for i, column in enumerate(columns.values())})
    return SheetRows(path, [one_line(name) for name in columns], 0, np.arange(1, len(frame) + 1), frame)
