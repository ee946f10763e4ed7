"""Write the sample records of data/: `python -m reference.make_samples [FOLDER]` with tests/ on the path.

Fixed seeds: the same files come out every time. The records are synthetic and say so in their first line.
"""

import gzip
import io
import json
import sys
from pathlib import Path

import numpy as np

from reference import sample_actuator, sample_raw_log, sample_seed_valve, sample_whole_servo
from reference.sample_text import LABEL, csv_text


def write_text(path: Path, text: str) -> None:
    """Plain, or gzip where the name says so; without a date or a name inside, so that the bytes repeat."""
    data = text.encode()
    if path.suffix == ".gz":
        buffer = io.BytesIO()
        with gzip.GzipFile(filename="", mode="wb", fileobj=buffer, mtime=0) as stream:
            stream.write(data)
        data = buffer.getvalue()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def make(folder: Path) -> None:
    for name, sample in (("seed_valve", sample_seed_valve), ("raw_log", sample_raw_log)):
        write_text(folder / name / "bench.toml", LABEL + "\n" + sample.BENCH)
        write_text(folder / name / "README.md", sample.readme())
        for file, comments, columns in sample.tests():
            write_text(folder / name / file, csv_text(comments, columns))


def make_whole(folder: Path) -> None:
    """The record that has static and dynamic tests."""
    for file, text in sample_whole_servo.files().items():
        write_text(folder / "whole_servo" / file, text)


def make_dynamic(folder: Path) -> None:
    """The records of an actuator in motion, and the truth of the hidden ones."""
    sample = sample_actuator
    records = {"seed_actuator": sample.SEED} | {
        f"hidden_dynamic/{name}": bench for name, (bench, _) in sample.HIDDEN.items()
    }
    for name, bench in records.items():
        words = "An actuator on the seed valve in a closed position loop: steps of the setpoint."
        for file, text in sample.files_of(bench, words, name.split("/")[-1]).items():
            write_text(folder / name / file, text)
    write_text(folder / "seed_actuator" / "README.md", sample.README)
    write_text(folder / "hidden_dynamic" / "README.md", sample.HIDDEN_README)
    write_text(folder / "hidden_dynamic" / "truth.json", json.dumps(sample.truth(), indent=1) + "\n")


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[2] / "data"
    make(target)
    make_whole(target)
    make_dynamic(target)
