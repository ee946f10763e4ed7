"""The notebooks of the site, run as the plain scripts that they are."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest


ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.py"))
SAID = {
    "fit_and_sensitivities": ("clearance", "% at null, known to"),
    "a_hidden_effect": ("hysteresis: 1.00", "with the effect: rms"),
}


@pytest.mark.nightly
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_as_a_script(notebook, tmp_path):
    kept = {"JAX_COMPILATION_CACHE_DIR": str(ROOT / "build" / "compiled-for-tests"), "MPLBACKEND": "Agg"}
    kept |= {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2"}  # as in conftest.py
    ran = subprocess.run(
        [sys.executable, "-P", str(notebook)], cwd=tmp_path, env=os.environ | kept, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr
    assert all(words in ran.stdout for words in SAID[notebook.stem]), ran.stdout


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_marimo_reads_it_and_no_name_is_given_twice(notebook):
    """marimo refuses a notebook in which two cells give the same name, and a cell that asks for a name that none gives."""
    given: list[str] = []
    asked: set[str] = set()
    for cell in ast.parse(notebook.read_text(encoding="utf-8")).body:
        if isinstance(cell, ast.FunctionDef):
            asked |= {argument.arg for argument in cell.args.args}
            last = cell.body[-1]
            assert isinstance(last, ast.Return)
            given += [name.id for name in ast.walk(last) if isinstance(name, ast.Name)]
    assert len(given) == len(set(given))
    assert asked <= set(given)
