"""Records that went wrong in every way, through the reader: does it always answer, in time, in memory, and write nothing?

    mangled_records.py [--records 100000] [--seconds 1200] [--seed 1]

Edits of sound records (pieces cut, repeated, overwritten, inserted; bytes changed; ends cut off) with the pieces of
tests/identify/bench/test_mangled_records.py, and by hand: gzip bombs, huge headers, devices, pipes, links in a circle, paths that lead
outside. A run ends after so many records, or when its time is over, and says how many it was.
"""

import argparse
import gzip
import importlib.util
import os
import random
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path


ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from helpers.bench_folder import LEAKAGE, TOML, write_record

from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fleet.identity import look_at


def pieces() -> tuple[str, ...]:
    """What the tests insert."""
    path = ROOT / "tests" / "identify" / "bench" / "test_mangled_records.py"
    spec = importlib.util.spec_from_file_location("mangled", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.PIECES


def mangled(chance: random.Random, text: bytes, inserted: tuple[str, ...]) -> bytes:
    data = text
    for _ in range(chance.randint(1, 5)):
        at = chance.randint(0, len(data))
        end = min(len(data), at + chance.randint(0, 30))
        piece = chance.choice(inserted).encode()
        edits = (
            data[:at] + data[end:], data[:end] + data[at:], data[:at] + piece + data[at:], data[:at] + piece + data[end:],
            data[:at] + chance.randbytes(4) + data[end:], data[:at],
        )  # fmt: skip
        data = chance.choice(edits)
    return data


def by_hand(folder: Path) -> dict[str, Callable[[], object]]:
    """{what: a record with it}"""
    named = lambda name: TOML.replace('"leakage.csv"', f'"{name}"')

    def bomb() -> None:
        with gzip.open(folder / "leakage.csv.gz", "wb", 6) as file:
            for _ in range(64):
                file.write(b"0" * (8 << 20))
        (folder / "bench.toml").write_text(named("leakage.csv.gz"))

    def circle() -> None:
        (folder / "leakage.csv").unlink()
        (folder / "leakage.csv").symlink_to("leakage.csv")

    def pipe() -> None:
        (folder / "leakage.csv").unlink()
        os.mkfifo(folder / "leakage.csv")

    text = lambda name: lambda: (folder / "bench.toml").write_text(named(name))
    return {
        "a gzip bomb of 512 MB": bomb,
        "a header of 10 million characters": lambda: (folder / "leakage.csv").write_text("x," * 5_000_000 + "\n1\n"),
        "100,000 tables": lambda: (folder / "bench.toml").write_text("".join(f"[t{i}]\n" for i in range(100_000))),
        "a device that never ends": text("/dev/zero"),
        "a random device": text("/dev/urandom"),
        "a pipe that nobody writes": pipe,
        "a link to itself": circle,
        "a file outside, ../../../../etc/passwd": text("../../../../../../../../etc/passwd"),
        "a folder in the place of a file": text("."),
        "a name with a zero in it": text("a\\u0000b.csv"),
    }


def asked(folder: Path) -> str:
    """read, refused, or what must not be."""
    try:
        look_at(folder)
        read_record(folder)
    except BenchInputError as error:
        return "refused" if str(error).isprintable() else "A MESSAGE OF SEVERAL LINES"
    except BaseException as error:
        return f"TRACEBACK: {type(error).__name__}"
    return "read"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=100_000)
    parser.add_argument("--seconds", type=float, default=1200.0)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    chance, inserted = random.Random(given.seed), pieces()
    print("| what | answer | seconds |\n|---|---|---|")
    for what in by_hand(Path()):
        with tempfile.TemporaryDirectory() as top:
            folder = write_record(Path(top) / "record")
            by_hand(folder)[what]()
            began = time.perf_counter()
            print(f"| {what} | {asked(folder)} | {time.perf_counter() - began:.2f} |", flush=True)
    answers: dict[str, Counter[str]] = {"bench.toml": Counter(), "CSV": Counter()}
    slowest, began_all = 0.0, time.perf_counter()
    count, others = 0, set()
    with tempfile.TemporaryDirectory() as top:
        folder = write_record(Path(top) / "record")
        usual = {path.relative_to(top) for path in Path(top).rglob("*")}
        while count < given.records and time.perf_counter() < began_all + given.seconds:
            toml = chance.random() < 0.5
            (folder / "bench.toml").write_bytes(mangled(chance, TOML.encode(), inserted) if toml else TOML.encode())
            (folder / "leakage.csv").write_bytes(
                LEAKAGE.encode() if toml else mangled(chance, LEAKAGE.encode(), inserted)
            )
            began = time.perf_counter()
            answers["bench.toml" if toml else "CSV"][asked(folder)] += 1
            slowest = max(slowest, time.perf_counter() - began)
            count += 1
        others = {path.relative_to(top) for path in Path(top).rglob("*")} - usual
    seconds = time.perf_counter() - began_all
    for what, own in answers.items():
        said = ", ".join(f"{number:,} {word}" for word, number in sorted(own.items()))
        print(f"| {own.total():,} with one to five random edits of their {what} | {said} | |")
    print(f"| all {count:,} of these, seed {given.seed} | slowest {slowest:.2f} s | {seconds:.0f} |")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"| most memory of the process | {memory:.2f} GB | |")
    print(f"| files that were not there before | {len(others)} | |")


if __name__ == "__main__":
    main()
