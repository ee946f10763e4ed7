"""Damaged logs of MATLAB and LabVIEW: each is read, or refused in one sentence of the reader's own; nothing else is ever raised."""

import io

import numpy as np
import pytest
from helpers.bench_folder import TOML, write_record
from nptdms import ChannelObject, RootObject, TdmsWriter
from scipy.io import savemat

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record


COLUMNS = 'columns = { spool_position = "xv [um]", leakage_flow = "ql [l/min]" }\n'
LOG = {"xv": np.linspace(-50.0, 50.0, 40), "ql": np.linspace(0.1, 0.3, 40)}


def mat() -> bytes:
    packed = io.BytesIO()
    savemat(packed, {"log": LOG})
    return packed.getvalue()


def tdms() -> bytes:
    packed = io.BytesIO()
    with TdmsWriter(packed) as file:
        file.write_segment([RootObject({}), *(ChannelObject("log", name, data) for name, data in LOG.items())])
    return packed.getvalue()


@pytest.mark.parametrize(("ending", "whole"), [("mat", mat()), ("tdms", tdms())], ids=["mat", "tdms"])
def test_whatever_is_damaged_is_read_or_refused(ending, whole, tmp_path):
    folder = write_record(tmp_path, TOML.replace("leakage.csv", f"leakage.{ending}") + COLUMNS)
    rng, read, said = np.random.default_rng(0), 0, []
    for _ in range(60):
        damaged = bytearray(whole)
        for place in rng.integers(0, len(whole), rng.integers(1, 6)):
            damaged[place] = rng.integers(0, 256)
        cut = int(rng.integers(1, len(whole))) if rng.random() < 0.3 else len(whole)
        (folder / f"leakage.{ending}").write_bytes(bytes(damaged[:cut]))
        try:
            read += len(read_record(folder).tests)
        except BenchInputError as error:
            said.append(str(error))
    (folder / f"leakage.{ending}").write_bytes(whole)
    assert read_record(folder).tests["leakage"].rows == 40
    assert read > 0
    assert said
    assert not any("\n" in words for words in said)
