"""FMUs unpacked and run by the small host in C (`fmu_host.c`)."""

import subprocess
import zipfile
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from thermohyd.identify.export.fmu import make_fmu
from thermohyd.identify.model.model import Model


def unpacked(given: Model, folder: Path, **options: Any) -> Path:
    made = make_fmu(given, **options)
    folder.mkdir(exist_ok=True)
    (folder / "model.fmu").write_bytes(made.content)
    with zipfile.ZipFile(folder / "model.fmu") as archive:
        archive.extractall(folder / "inside")
    return folder / "inside"


def run_in(host: Path, fmu: Path, guid: str, lines: str, inputs: int, outputs: int, *more: Any) -> Any:
    """The host's completed process."""
    (binary,) = (path for path in (fmu / "binaries").rglob("*") if path.is_file())
    call = [str(host), str(binary), guid, str(inputs), str(outputs), *map(str, more)]
    return subprocess.run(call, input=lines, capture_output=True, text=True)


def table_of(host: Path, fmu: Path, rows: np.ndarray, *more: Any) -> dict[str, np.ndarray]:
    """{output: what a C program reads of it}; rows: lines of the host's input."""
    about: Any = fmpy.read_model_description(str(fmu))
    names = [v.name for v in about.modelVariables if v.causality == "output"]
    inputs = sum(v.causality == "input" for v in about.modelVariables)
    lines = "\n".join(" ".join(map(repr, map(float, row))) for row in rows)
    ran = run_in(host, fmu, str(about.guid), lines, inputs, len(names), *more)
    assert (ran.returncode, ran.stderr) == (0, "")
    table = np.array([[float(cell) for cell in line.split()] for line in ran.stdout.splitlines()])
    return dict(zip(names, table.T, strict=True))
