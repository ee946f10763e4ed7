"""The columns of a MATLAB .mat file: vectors, a struct of vectors or a matrix. Versions 4 to 7 by SciPy, 7.3 (HDF5) by h5py.

A MATLAB name holds no unit: `columns = { spool_position = "xv [um]" }` in bench.toml gives it. Text (a char matrix or a cell array
of texts) may be a column, such as the run.
"""

import struct
import warnings
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from thermohyd.identify.optional_parts import install

from .errors import BenchInputError, listed, one_line, quoted
from .sheets import LARGEST, MOST_CELLS, SheetRows


HDF5 = b"\x89HDF\r\n\x1a\n"
OTHER_WAY = 'or save it in MATLAB as vectors of numbers, with save(..., "-v7")'
FROM_TABLE = 's = table2struct(T, "ToScalar", true)'
SHOWN = 8  # names in a message


def read_mat(path: Path, variable: str | None) -> SheetRows:
    """The columns of a .mat file. variable: a struct or a matrix in it; None: its vectors, or its only struct or matrix.

    Rows count from 1, as MATLAB does. Raises BenchInputError.
    """
    try:
        with path.open("rb") as file:
            start = file.read(512 + len(HDF5))
        if path.stat().st_size > LARGEST:
            raise BenchInputError(f"is larger than {LARGEST:,} bytes; thin the log before fitting", file=path)
    except OSError as error:
        raise BenchInputError(f"cannot be read ({error.strerror or error})", file=path) from None
    hdf5 = start.startswith(HDF5) or start[512:] == HDF5
    found = _of_hdf5(path) if hdf5 else _of_scipy(path)
    return _rows(path, _chosen(path, found, variable))


def _of_scipy(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat, whosmat

    try:
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore"
            )  # about duplicate names and MATLAB's own objects, of which the reader speaks itself
            _refuse_claims(path)
            cells = sum(int(np.prod(shape, dtype=float)) for _, shape, _ in whosmat(str(path)))
            if cells > MOST_CELLS:
                raise BenchInputError(f"has more than {MOST_CELLS:,} cells; thin the log before fitting", file=path)
            found = loadmat(str(path), squeeze_me=False, struct_as_record=True, chars_as_strings=True)
    except BenchInputError:
        raise
    except MemoryError:
        raise BenchInputError(f"has more than {MOST_CELLS:,} cells; thin the log before fitting", file=path) from None
    except Exception:  # SciPy raises whatever it trips over in a damaged or hostile file
        raise BenchInputError(f"is no .mat file, or a damaged one; save it again, {OTHER_WAY}", file=path) from None
    return {name: _plain(value) for name, value in found.items() if not name.startswith("__")}


INT32, MATRIX, COMPRESSED = 5, 14, 15  # types of elements of a version 5 file
SPARSE = 5  # class of a matrix whose size says nothing of what it holds
DEEPEST = 8  # structs within structs


def _refuse_claims(path: Path) -> None:
    """Raise BenchInputError where an array at any depth claims more cells than are read: SciPy makes room for them first.

    By the file's own format (MATLAB, MAT-File Format, level 5): elements of a tag and its bytes, a matrix being elements itself, of
    which the second holds its sizes. ValueError or struct.error where that is not kept.
    """
    raw = path.read_bytes()
    if len(raw) < 128 or raw[126:128] not in (b"IM", b"MI"):
        return  # version 4: all its sizes have been seen
    order = "<" if raw[126:128] == b"IM" else ">"
    for kind, start, stop in _elements(raw, 128, len(raw), order):
        if kind == COMPRESSED:
            unpacked = zlib.decompressobj().decompress(raw[start:stop], LARGEST + 1)
            if len(unpacked) > LARGEST:
                raise BenchInputError(f"unpacks to more than {LARGEST:,} bytes; thin the log before fitting", file=path)
            _refuse_claim(path, unpacked, 0, len(unpacked), order, 0)
        elif kind == MATRIX:
            _refuse_claim(path, raw, start - 8, stop, order, 0)


def _refuse_claim(path: Path, raw: bytes, start: int, stop: int, order: str, depth: int) -> None:
    for kind, inner, end in _elements(raw, start, stop, order):
        if kind != MATRIX or end == inner:
            continue
        if depth > DEEPEST:
            raise ValueError("nested too deeply")
        parts = list(_elements(raw, inner, end, order))
        holds_sizes, a, b = parts[1]
        if holds_sizes != INT32 or raw[parts[0][1] if order == "<" else parts[0][1] + 3] == SPARSE:
            continue  # an object of MATLAB's own, or sparse
        cells = 1.0
        for size in struct.unpack_from(f"{order}{(b - a) // 4}i", raw, a):
            if size < 0:
                raise ValueError("a size below zero")
            cells *= size
        if cells > MOST_CELLS:
            raise BenchInputError(f"has more than {MOST_CELLS:,} cells; thin the log before fitting", file=path)
        if cells > end - inner:
            raise ValueError("more cells than bytes")
        for part, first, last in parts[2:]:
            if part == MATRIX:
                _refuse_claim(path, raw, first - 8, last, order, depth + 1)


def _elements(raw: bytes, start: int, stop: int, order: str) -> Iterator[tuple[int, int, int]]:
    """(type, first byte, end) of each element between two places."""
    while start + 8 <= stop:
        kind, size = struct.unpack_from(f"{order}II", raw, start)
        if kind >> 16:  # a small one: type and size in four bytes, its own in the next four
            yield kind & 0xFFFF, start + 4, start + 4 + min(kind >> 16, 4)
            start += 8
            continue
        if start + 8 + size > stop:
            raise ValueError("an element beyond its end")
        yield kind, start + 8, start + 8 + size
        start += 8 + size + (-size % 8 if kind != COMPRESSED else 0)


def _plain(value: Any) -> Any:
    """A struct as a dict, a cell array of texts as texts; anything else as SciPy gives it."""
    if isinstance(value, np.ndarray) and value.dtype.names is not None and type(value).__name__ == "ndarray":
        if value.size == 1:
            only = value.reshape(-1)[0]
            return {name: _plain(only[name]) for name in value.dtype.names}
        return value
    if isinstance(value, np.ndarray) and value.dtype == object and value.size:
        texts = [np.asarray(cell).reshape(-1) for cell in value.reshape(-1)]
        if all(len(cell) <= 1 and cell.dtype.kind in "US" for cell in texts):
            return np.array([str(cell[0]) if len(cell) else "" for cell in texts], dtype=object)
    return value


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
            return {name: _of_node(file, node, path) for name, node in file.items() if not name.startswith("#")}
    except BenchInputError:
        raise
    except Exception:  # h5py raises whatever it trips over
        raise BenchInputError(f"is no .mat file, or a damaged one; save it again, {OTHER_WAY}", file=path) from None


def _of_node(file: Any, node: Any, path: Path, deep: bool = True) -> Any:
    """A data set or a group of an HDF5 file as `_plain` gives it; MATLAB stores matrices transposed there."""
    kind = node.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if hasattr(node, "keys"):
        fields = {name: _of_node(file, child, path, False) for name, child in node.items()} if deep else {}
        return fields if deep and kind in ("struct", "") else kind or "struct"
    if node.size > MOST_CELLS:
        raise BenchInputError(f"has more than {MOST_CELLS:,} cells; thin the log before fitting", file=path)
    if node.attrs.get("MATLAB_empty", 0):
        return np.zeros(0)
    value = np.asarray(node[()])
    if kind == "char":
        return np.array(["".join(map(chr, row)) for row in value.T.reshape(value.shape[-1], -1)])
    if kind == "cell":
        cells = [file[reference] for reference in value.reshape(-1)]
        if all(cell.attrs.get("MATLAB_class", b"") == b"char" for cell in cells):
            texts = [
                "" if cell.attrs.get("MATLAB_empty", 0) else "".join(map(chr, cell[()].reshape(-1))) for cell in cells
            ]
            return np.array(texts, dtype=object)
        return "cell"
    return value.T if value.dtype.kind in "biuf" else kind or "object"


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
    what = {"MatlabOpaque": "a MATLAB table or another object", "MatlabFunction": "a function"}.get(
        type(value).__name__
    )
    if isinstance(value, str):
        what = {"table": "a MATLAB table or another object", "": "an object"}.get(
            value, f"of MATLAB's class {one_line(value)}"
        )
    elif isinstance(value, np.ndarray) and value.dtype.names is not None:
        what = "an array of structs"
    raise BenchInputError(
        f"{where} is {what or 'no vector and no matrix'}, of which only MATLAB can read the columns; save a struct of vectors: "
        f"of a table T, {FROM_TABLE}",
        file=path,
    )


def _is_vector(value: Any) -> bool:
    """A column of numbers or texts: more than one value, along one direction."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biufUSO" or value.dtype.names is not None:
        return False
    if type(value).__name__ != "ndarray" or (
        value.dtype == object and not all(isinstance(v, str) for v in value.reshape(-1))
    ):
        return False
    return value.size > 1 and value.size == max(value.shape)


def _is_matrix(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "biuf" and min(value.shape) > 1


def _flat(value: np.ndarray) -> np.ndarray:
    flat = value.reshape(-1)
    return np.array([str(text).strip() for text in flat], dtype=object) if flat.dtype.kind in "US" else flat


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
    return SheetRows(path, [one_line(name) for name in columns], 0, list(range(1, len(frame) + 1)), frame)
