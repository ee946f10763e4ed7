"""The sample records of data/: labelled, made by the committed script, and true to what their README says."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from reference import make_samples, sample_raw_log, sample_seed_valve


DATA = Path(__file__).parents[1] / "data"


def text_of(path: Path) -> str:
    return (gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()).decode()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("samples")
    make_samples.make(folder)
    make_samples.make_whole(folder)
    return folder


def files() -> list[str]:
    return [f"{r}/{f.name}" for r in ("seed_valve", "raw_log", "whole_servo") for f in sorted((DATA / r).iterdir())]


@pytest.mark.parametrize("name", files())
def test_committed_files_are_those_of_the_script(made, name):
    committed, fresh = text_of(DATA / name).splitlines(), text_of(made / name).splitlines()
    assert len(committed) == len(fresh)
    # Another platform's rounding may turn a last digit over, here and there.
    assert np.mean([a == b for a, b in zip(committed, fresh, strict=True)]) > 0.99


@pytest.mark.parametrize("name", [f for f in files() if not f.endswith(".md")])
def test_every_file_says_that_it_is_synthetic(name):
    assert text_of(DATA / name).startswith("# synthetic: made by the reference simulator, not measured\n")


def test_same_bytes_every_time(made, tmp_path):
    """Of the static records: the runs of whole_servo take 40 s to integrate, and once is enough to compare them."""
    make_samples.make(tmp_path)
    for name in (name for name in files() if not name.startswith("whole_servo")):
        assert (made / name).read_bytes() == (tmp_path / name).read_bytes()


def test_sizes():
    assert (
        sum(
            (DATA / "raw_log" / f).stat().st_size
            for f in ("leakage.csv.gz", "pressure_gain.csv.gz", "flow_gain.csv.gz")
        )
        < 4e5
    )
    for sample, low, high in ((sample_seed_valve, 600, 900), (sample_raw_log, 8000, 12000)):
        for _, _, columns in sample.tests():
            assert {len(c) for c in columns.values()} <= set(range(low, high + 1))
