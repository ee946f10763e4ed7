"""`thermohyd` run within a test, and in a process of its own without double precision."""

import subprocess
import sys
from collections.abc import Callable

import pytest
from typer.testing import CliRunner

from thermohyd.identify.cli import jax_setup
from thermohyd.identify.cli.commands import app


def command(monkeypatch: pytest.MonkeyPatch, name: str, columns: int) -> Callable:
    """A function that runs a command with arguments in a terminal of so many columns; JAX stays as the tests set it."""
    monkeypatch.setattr(jax_setup, "set_up_jax", lambda: None)
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.delenv("THERMOHYD_DEBUG", raising=False)
    return lambda *arguments: CliRunner().invoke(app, [name, *map(str, arguments)])


def refusal_in_single_precision(call: str) -> str:
    """What RuntimeError says where `thermohyd.<call>` runs without double precision."""
    code = f"import thermohyd\ntry:\n    thermohyd.{call}\nexcept RuntimeError as error:\n    print(error)\n"
    return subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True).stdout
