"""Logs of MATLAB and LabVIEW: they read as the same rows of a CSV do, and what is wrong with them is said in one line."""
# ruff: noqa: E501 (the messages stand whole, as they are printed)

import sys
from typing import Any

import h5py
import numpy as np
import pytest
from helpers.bench_folder import TOML, write_record
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter
from scipy.io import savemat

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record


HEADERS = {"time": "t [s]", "run": "sweep", "spool_position": "xv [um]", "leakage_flow": "ql [l/min]"}
MAPPED = f"columns = {{ {', '.join(f'{name} = "{header}"' for name, header in HEADERS.items())} }}\n"
MAT = TOML.replace("leakage.csv", "leakage.mat") + MAPPED
TDMS = TOML.replace("leakage.csv", "leakage.tdms")
LOG = {
    "t": np.array([0.0, 1.0, 2.0, 0.0, 1.0]),
    "sweep": np.array(["up", "up", "up", "down", "down"], dtype=object),
    "xv": np.array([-10.0, 0.0, 10.0, 10.0, 0.0]),
    "ql": np.array([0.1, 0.3, 0.1, 0.1, 0.3]),
}
NUMBERS = {**LOG, "sweep": np.array([1, 1, 1, 2, 2])}


def same_rows(folder, runs=("up", "down")) -> None:
    test = read_record(folder).tests["leakage"]
    assert test.spool_position == pytest.approx(1e-6 * LOG["xv"])
    assert test.channels[0].value == pytest.approx(LOG["ql"] / 6e4)
    assert test.time == pytest.approx(LOG["t"])
    assert test.run_names == runs
    assert test.lines is not None
    assert test.lines.tolist() == [1, 2, 3, 4, 5]


def message(folder) -> str:
    with pytest.raises(BenchInputError) as caught:
        read_record(folder)
    return str(caught.value).removeprefix(f"{folder}/")


# ---- MATLAB


def write_mat(folder, content, toml=MAT, **options):
    savemat(write_record(folder, toml) / "leakage.mat", content, **options)
    return folder


@pytest.mark.parametrize("options", [{}, {"do_compression": True}, {"oned_as": "column"}, {"format": "4"}], ids=str)
def test_vectors_read_as_a_csv_does(tmp_path, options):
    version_4 = options.get("format") == "4"
    log = {**LOG, "sweep": np.array(["up", "up", "up", "down", "down"])} if version_4 else LOG
    same_rows(write_mat(tmp_path, {**log, "fs": 1000.0}, **options))


def test_a_struct_of_vectors(tmp_path):
    write_mat(tmp_path, {"log": LOG, "about": "bench 4"})
    same_rows(tmp_path)
    write_mat(tmp_path, {"log": LOG, "second": LOG, "spare": LOG["t"][:3]}, MAT + 'variable = "log"\n')
    same_rows(tmp_path)


def test_a_matrix_has_numbered_columns(tmp_path):
    toml = MAT
    for i, name in enumerate(("t [s]", "sweep", "xv [um]", "ql [l/min]"), start=1):
        unit = name.partition(" ")[2]
        toml = toml.replace(f'"{name}"', f'"column {i} {unit}"' if unit else f'"column {i}"')
    same_rows(write_mat(tmp_path, {"data": np.stack(list(NUMBERS.values()), axis=1)}, toml), ("1.0", "2.0"))


def write_mat73(folder, content, toml=MAT):
    """A file as MATLAB writes it: 512 bytes before the HDF5, matrices transposed, texts as numbers."""
    with h5py.File(write_record(folder, toml) / "leakage.mat", "w", userblock_size=512) as file:
        _write(file, file, content)
    with (folder / "leakage.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return folder


def _write(file, into, content):
    for name, value in content.items():
        if isinstance(value, dict):
            group = into.create_group(name)
            group.attrs["MATLAB_class"] = np.bytes_("struct")
            _write(file, group, value)
        elif value.dtype == object:
            cells = file.require_group("#refs#")
            references = []
            for i, text in enumerate(value):
                cell = cells.create_dataset(f"{name}{i}", data=np.array([[ord(c)] for c in text], dtype=np.uint16))
                cell.attrs["MATLAB_class"] = np.bytes_("char")
                references.append(cell.ref)
            made = into.create_dataset(name, data=np.array([references], dtype=h5py.ref_dtype))
            made.attrs["MATLAB_class"] = np.bytes_("cell")
        else:
            into.create_dataset(name, data=np.atleast_2d(value.astype(float))).attrs["MATLAB_class"] = np.bytes_(
                "double"
            )


def test_version_7_3(tmp_path, monkeypatch):
    same_rows(write_mat73(tmp_path, LOG))
    same_rows(write_mat73(tmp_path, {"log": LOG}))
    monkeypatch.setitem(sys.modules, "h5py", None)
    assert message(tmp_path) == (
        "leakage.mat: is of MATLAB version 7.3 and needs the package h5py: pip install -c constraints.txt '.[matlab]' in the source "
        "folder of thermohyd; or save it in MATLAB "
        'with save(..., "-v7")'
    )


def test_mat_files_that_are_refused(tmp_path):
    damaged = 'leakage.mat: is no .mat file, or a damaged one; save it again, or save it in MATLAB as vectors of numbers, with save(..., "-v7")'
    assert message(write_mat(tmp_path, {**LOG, "xv": LOG["xv"][:3]})).startswith(
        'leakage.mat: its vectors differ in length: "t" 5, "sweep" 5, "xv" 3, "ql" 5; name the struct or matrix'
    )
    bad = {**LOG, "ql": np.array([0.1, np.nan, 0.1, 0.1, 0.3])}
    assert message(write_mat(tmp_path, bad)) == (
        'leakage.mat, row 2, column "ql": the cell is empty; leave the row out, or write missing = "skip" in [tests.leakage]'
    )
    assert message(write_mat(tmp_path, {"a": LOG, "b": LOG})) == (
        'leakage.mat: holds "a", "b"; write variable = "a" beside its file in bench.toml'
    )
    assert (
        message(write_mat(tmp_path, {"a": LOG}, MAT + 'variable = "c"\n'))
        == 'leakage.mat: has no variable "c"; it has "a"'
    )
    structs = np.array([(1.0, 2.0), (3.0, 4.0)], dtype=[("xv", float), ("ql", float)])
    assert message(write_mat(tmp_path, {"log": structs})) == (
        'leakage.mat: variable "log" is an array of structs, of which only MATLAB can read the columns; save a struct of vectors: '
        'of a table T, s = table2struct(T, "ToScalar", true)'
    )
    assert "no vector" in message(write_mat(tmp_path, {"fs": 3.0}))
    whole = (write_mat(tmp_path, LOG) / "leakage.mat").read_bytes()
    for content in (b"", b"\x89HDF\r\n\x1a\nxyz", whole[:200]):
        (tmp_path / "leakage.mat").write_bytes(content)
        assert message(tmp_path) == damaged
    assert "only a .mat file has variables" in message(write_record(tmp_path, TOML + 'variable = "a"\n'))
    write_record(tmp_path, MAT + "skip_rows = 2\n")
    assert message(tmp_path) == "leakage.mat: a .mat file has no lines above its headers; remove skip_rows"


def test_a_column_without_a_unit_says_where_it_goes(tmp_path):
    assert "xv" in message(write_mat(tmp_path, LOG, MAT.replace("xv [um]", "xv")))
    assert "the unit is missing" in message(tmp_path)


# ---- LabVIEW


def write_tdms(folder, groups, toml=TDMS):
    with TdmsWriter(str(write_record(folder, toml) / "leakage.tdms")) as file:
        parts: list[Any] = [RootObject({})]
        for name, channels in groups.items():
            parts.append(GroupObject(name))
            parts += [ChannelObject(name, *channel) for channel in channels]
        file.write_segment(parts)
    return folder


CHANNELS = [
    ("time", LOG["t"], {"unit_string": "s"}),
    ("run", list(LOG["sweep"]), {}),
    ("spool_position", LOG["xv"], {"unit_string": "um"}),
    ("leakage_flow [l/min]", LOG["ql"], {"unit_string": "gal/min"}),  # its own name says more than the property
]


def test_channels_read_as_a_csv_does(tmp_path):
    same_rows(write_tdms(tmp_path, {"log": CHANNELS}))
    same_rows(write_tdms(tmp_path, {"log": CHANNELS, "about": []}))
    same_rows(write_tdms(tmp_path, {"a": CHANNELS[1:], "log": CHANNELS}, TDMS + 'group = "log"\n'))


def test_a_waveform_brings_its_times(tmp_path):
    paced = [(name, data, {**about, "wf_increment": 0.5, "wf_start_offset": 1.0}) for name, data, about in CHANNELS[2:]]
    test = read_record(write_tdms(tmp_path, {"log": paced})).tests["leakage"]
    assert test.time == pytest.approx([1.0, 1.5, 2.0, 2.5, 3.0])


def test_tdms_files_that_are_refused(tmp_path, monkeypatch):
    assert message(write_tdms(tmp_path, {"a": CHANNELS, "b": CHANNELS})) == (
        'leakage.tdms: holds the groups "a", "b"; write group = "a" beside its file in bench.toml'
    )
    assert message(write_tdms(tmp_path, {"a": CHANNELS}, TDMS + 'group = "b"\n')) == (
        'leakage.tdms: has no group "b" with channels; it has "a"'
    )
    uneven = [(name, data[:3] if name == "time" else data, about) for name, data, about in CHANNELS]
    assert message(write_tdms(tmp_path, {"a": uneven})).startswith(
        'leakage.tdms: its channels differ in length: "time [s]" 3'
    )
    for content in (b"", b"TDSm" + bytes(20), b"no"):
        (tmp_path / "leakage.tdms").write_bytes(content)
        assert message(tmp_path).startswith("leakage.tdms: is ")
    assert "only a .tdms file has groups" in message(write_record(tmp_path, TOML + 'group = "a"\n'))
    write_tdms(tmp_path, {"a": CHANNELS})
    monkeypatch.setitem(sys.modules, "nptdms", None)
    assert message(tmp_path) == (
        "leakage.tdms: needs the package npTDMS: pip install -c constraints.txt '.[tdms]' in the source folder of thermohyd; or save "
        "the log as CSV"
    )


def test_without_jax(tmp_path):
    import subprocess

    write_mat(tmp_path / "mat", LOG)
    write_tdms(tmp_path / "tdms", {"log": CHANNELS})
    code = (
        "import sys\nfrom thermohyd.identify import read_record\n"
        "for folder in sys.argv[1:]:\n    read_record(folder)\n"
        "assert not {'jax', 'equinox'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-P", "-c", code, tmp_path / "mat", tmp_path / "tdms"], check=True)
