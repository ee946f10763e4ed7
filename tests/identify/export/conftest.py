"""The host of FMUs in C, compiled once."""

import shutil
import subprocess
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def host(tmp_path_factory) -> Path:
    """Compiled once: a C program that runs an FMU."""
    folder = tmp_path_factory.mktemp("host")
    source = shutil.copy(f"{__file__.rsplit('/identify/', 1)[0]}/helpers/fmu_host.c", folder)
    subprocess.run(
        ["cc", "-std=c99", "-D_GNU_SOURCE", "-Wall", "-Wextra", "-Wno-pedantic", source, "-o", folder / "host", "-ldl"],
        check=True,
    )
    return folder / "host"
