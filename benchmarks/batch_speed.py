"""Plain fits one by one beside the same in batches, in one process: records per second, processor time, and whether they agree.

    batch_speed.py [--records 32] [--together 8,16]

Records by the reference simulator, three tests of 256 rows, one in twenty with a moved zero. On whatever device JAX finds. Each way is
run once and compiles, from an empty cache; then all are run in turn, three times, and the medians are printed.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np


sys.path.insert(0, str(Path(__file__).parent))

from thermohyd.identify.cli.jax_setup import set_up_jax


empty = tempfile.TemporaryDirectory()
os.environ["JAX_COMPILATION_CACHE_DIR"] = empty.name
set_up_jax()

import jax
from _fleet_records import write_fleet

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting.batch import fit_many
from thermohyd.identify.fitting.fit import fit


TIMES = 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=32)
    parser.add_argument("--together", default="8,16")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        write_fleet(Path(folder), given.records, max(given.records // 4, 1), faulty=0.05)
        records = [read_record(path) for path in sorted(Path(folder).iterdir())]
    print(f"On {jax.devices()[0].device_kind}; load of the machine before: {os.getloadavg()[0]:.1f}.\n")
    ways: dict[str, Callable[[], Any]] = {"one by one": lambda: [fit(record) for record in records]}
    for count in map(int, given.together.split(",")):
        ways[f"{count} together"] = lambda count=count: fit_many(records, together=count)
    results, seconds = {}, {name: [] for name in ways}
    compiled = {}
    for name, way in ways.items():
        began = time.perf_counter()
        results[name] = way()
        compiled[name] = time.perf_counter() - began
    for _ in range(TIMES):
        for name, way in ways.items():
            began, used = time.perf_counter(), time.process_time()
            way()
            seconds[name].append((time.perf_counter() - began, time.process_time() - used))
    alone = results["one by one"]
    print(
        f"| {given.records} records | records a second | processor time of a record | first time, compiling | furthest apart |"
    )
    print("|---|---|---|---|---|")
    for name, times in seconds.items():
        wall, used = (median(column) for column in zip(*times, strict=True))
        far = max(apart(a, b) for a, b in zip(alone, results[name], strict=True))
        print(
            f"| {name} | {len(records) / wall:.2f} | {used / len(records):.2f} s | {compiled[name]:.0f} s | {far:.1e} standard errors |"
        )
    print("\nVerdicts, and what converged, are the same in all.")


def apart(a, b) -> float:
    """The largest difference of a value or an error bar, in standard errors. Raises AssertionError where a verdict differs."""
    assert (a.verdict, a.converged) == (b.verdict, b.converged), a.record.name
    pairs = [(a.parameters[name], b.parameters[name]) for name in a.free]
    return max((float(np.hypot(p.value - q.value, p.std - q.std) / p.std) for p, q in pairs if p.std), default=0.0)


if __name__ == "__main__":
    main()
