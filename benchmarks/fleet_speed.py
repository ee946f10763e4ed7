"""How fast is a fleet: two workers beside one process in a loop, memory of a worker, the scheduler's own time, what a store takes.

    fleet_speed.py [--records 36] [--job fit] [--parts loop,fleet,scheduler,store]

Records by the reference simulator, three tests of 256 rows each. Each part in a process of its own, programs compiled before (a first
record is not counted). The scheduler's part deals out 10,000 records that a worker answers at once.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path


sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from _peers import machine


LOOP = """
import sys, time
from pathlib import Path
from thermohyd.identify.cli.jax_setup import keep_memory_flat, set_up_jax
set_up_jax()
from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fleet.jobs import job_of
job = job_of(sys.argv[2])
folders = sorted(Path(sys.argv[1]).iterdir())
job(read_record(folders[0]))
began = time.perf_counter()
for folder in folders[1:]:
    job(read_record(folder)).to_dict()
    keep_memory_flat()
print(time.perf_counter() - began)
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=36)
    parser.add_argument("--job", default="fit")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--parts", default="loop,fleet,scheduler,store")
    asked = parser.parse_args()
    parts = asked.parts.split(",")
    print(f"{machine()}; load of the machine before: {os.getloadavg()[0]:.1f}\n", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        if {"loop", "fleet"} & set(parts):
            from _fleet_records import write_fleet

            write_fleet(work / "records", asked.records, max(1, asked.records // 6))
        if "loop" in parts:
            in_a_loop(work, asked.job, asked.records)
        if "fleet" in parts:
            as_a_fleet(work, asked.job, asked.records, asked.workers)
        if "scheduler" in parts:
            scheduler(10_000)
        if "store" in parts:
            store(work, 2_000)


def in_a_loop(work: Path, job: str, count: int) -> None:
    ran = subprocess.run(
        [sys.executable, "-P", "-c", LOOP, str(work / "records"), job], capture_output=True, text=True, check=True
    )
    seconds = float(ran.stdout)
    print(
        f"one process in a loop: {seconds / (count - 1):.2f} s a record, {3600 * (count - 1) / seconds:,.0f} an hour",
        flush=True,
    )


def as_a_fleet(work: Path, job: str, count: int, workers: int) -> None:
    """The rate between the moment at which each worker has done a record and the end."""
    from thermohyd.identify.cli.jax_setup import keep_memory_flat, set_up_jax
    from thermohyd.identify.fleet.computer import Care
    from thermohyd.identify.fleet.identity import Settings
    from thermohyd.identify.fleet.run import run_fleet
    from thermohyd.identify.fleet.store import Store

    began = time.perf_counter()
    kept = Store(work / "fleet")
    summary = run_fleet(
        kept, work / "records", Settings(job), workers=workers, care=Care(prepare=set_up_jax), between=keep_memory_flat
    )
    whole = time.perf_counter() - began
    written = sorted(row["written"] for row in kept.results(["written"]).to_pylist())
    after = (written[-1] - written[workers - 1]).total_seconds()
    rate = 3600 * (count - workers) / max(after, 1e-9)
    print(
        f"{workers} workers: {rate:,.0f} an hour once each has done one; all {count} took {whole:.0f} s",
        flush=True,
    )
    for process, memory in summary.memory.items():
        print(
            f"   process {process}: {len(memory)} records, {memory[0] / 1e9:.2f} GB after its first, {max(memory) / 1e9:.2f} at most"
        )


def scheduler(count: int) -> None:
    import threading

    from thermohyd.identify.fleet import run
    from thermohyd.identify.fleet.clusters import client_of
    from thermohyd.identify.fleet.computer import Care
    from thermohyd.identify.fleet.identity import Found, Settings
    from thermohyd.identify.fleet.store import Store
    from thermohyd.identify.fleet.work import Outcome

    def at_once(tasks, care, flag):
        return [Outcome(task.found.content, "done", folder=task.found.folder) for task in tasks]

    run.compute_chunk = at_once
    with tempfile.TemporaryDirectory() as folder, client_of("local", 2) as client:
        found = [Found(f"/records/{i}", str(i), (("leakage", 64),)) for i in range(count)]
        one = run._Run(
            Store(folder), Settings("read"), Care(), False, None, lambda words: None, threading.Event(), run.Summary()
        )
        began = time.perf_counter()
        one._round(found, client, 2)
        seconds = time.perf_counter() - began
    print(
        f"scheduler: {count:,} empty records in {seconds:.1f} s, {1e3 * seconds / count:.2f} ms each",
        flush=True,
    )


def store(work: Path, count: int) -> None:
    from helpers.fleet_records import stored_row

    from thermohyd.identify.fleet.query import query
    from thermohyd.identify.fleet.store import Store

    kept = Store(work / "store")
    began = time.perf_counter()
    for number in range(count):
        kept.write_result(stored_row(number))
    seconds = time.perf_counter() - began
    size = sum(path.stat().st_size for path in kept.files())
    print(
        f"store: {count / seconds:,.0f} results written a second by one process, {size / count / 1e3:.1f} kB each",
        flush=True,
    )
    for when in ("one file each", "put together"):
        began = time.perf_counter()
        query(kept, "SELECT type, avg(value) FROM parameters GROUP BY type")
        print(f"   a question over {count:,} results, {when}: {time.perf_counter() - began:.2f} s", flush=True)
        kept.tidy(all_of_them=True)
    size = sum(path.stat().st_size for path in kept.files())
    print(f"   put together: {size / count / 1e3:.2f} kB each", flush=True)


if __name__ == "__main__":
    main()
