"""A whole fleet through the commands as a user types them: run, query, life, report; as far as a time limit lets it.

    fleet_whole.py [--records 1500] [--valves 200] [--minutes 20] [--workers 2] [--job fit]

The reference simulator writes 1,500 records of 200 valves over six years: wear, overhauls, 5 % with a moved zero, 2 % that cannot be
read. After so many minutes the run is interrupted as by Ctrl-C; rates are those between the first result of each worker and the end,
and what was not run is said to be extrapolated. Memory and processor time of the processes that compute are looked at once a second.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import psutil


sys.path.insert(0, str(Path(__file__).parent))
from _fleet_records import Truth, write_fleet

from thermohyd.identify.fleet.life import fleet_life
from thermohyd.identify.fleet.store import Store


PROGRAM = str(Path(sys.executable).parent / "thermohyd")
LEAST = 0.1e9  # bytes: dask's own processes and those that only start up hold less than one that computes
SETTLED = 100  # records of the whole fleet after which a process's memory is called its first


@dataclass
class Seen:
    """Of every process beneath the command: (time, bytes) as it went, and processor time [s] of all of them together."""

    memory: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    processor: dict[int, float] = field(default_factory=dict)

    def look(self, top: psutil.Process) -> None:
        now = time.time()
        for process in [top, *top.children(recursive=True)]:
            try:
                size, used = process.memory_info().rss, process.cpu_times()
            except psutil.Error:
                continue
            self.memory.setdefault(process.pid, []).append((now, float(size)))
            self.processor[process.pid] = used.user + used.system


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=1500)
    parser.add_argument("--valves", type=int, default=200)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--job", default="fit")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        began = time.perf_counter()
        truth = write_fleet(work / "records", given.records, given.valves, broken=0.02, faulty=0.05)
        rows = [
            ("records written by the reference simulator", f"{given.records:,} in {time.perf_counter() - began:.0f} s")
        ]
        rows += run(work, given)
        rows += asked(work)
        rows += judged(work, truth)
    print("| what | figure |\n|---|---|")
    for what, figure in rows:
        print(f"| {what} | {figure} |")


def run(work: Path, given: argparse.Namespace) -> list[tuple[str, str]]:
    """The command, interrupted when its time is over."""
    command = [PROGRAM, "fleet", "run", str(work / "store"), "--records", str(work / "records"), "--job", given.job]
    command += ["--workers", str(given.workers)]
    load = os.getloadavg()[0]
    began, ends = time.time(), time.time() + 60.0 * given.minutes
    seen, asked_to_end = Seen(), False
    with (work / "said").open("wb") as said:
        process = subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT, start_new_session=True)
        top = psutil.Process(process.pid)
        while process.poll() is None:
            seen.look(top)
            if time.time() > ends and not asked_to_end:
                process.send_signal(signal.SIGINT)
                asked_to_end = True
            time.sleep(1.0)
    seconds = time.time() - began
    store = Store(work / "store", make=False)
    results = store.results(["written", "converged", "verdict"]).to_pylist()
    failed = len(store.failures())
    written = np.sort([row["written"].timestamp() for row in results])
    # naive UTC read as local time: only differences count
    first, count = min(given.workers, len(written) - 1), len(written)
    each = float(written[-1] - written[first]) / (count - 1 - first)
    computing = {
        pid: sizes for pid, sizes in seen.memory.items() if max(s for _, s in sizes) > LEAST and pid != process.pid
    }
    used = sum(seen.processor.values())
    verdicts = {word: sum(row["verdict"] == word for row in results) for word in ("fitted", "misfit")}
    left = given.records - count - failed
    beside = f", then interrupted with exit status {process.returncode}" if asked_to_end and left else ""
    rows = [
        (f"{given.job}, {given.workers} workers",
         f"{count:,} results and {failed} failures listed in {seconds / 60:.1f} min{beside}; load of the machine before {load:.1f}"),
        ("a further record, once each worker had done one", f"{each:.2f} s: {3600 / each:,.0f} an hour"),
        ("processor time of all processes", f"{used:,.0f} s, {used / (count + failed):.2f} s a record"),
        ("verdicts of the fits", f"{verdicts['fitted']:,} fitted, {verdicts['misfit']:,} misfit"),
    ]  # fmt: skip
    if left:
        rows.append((f"extrapolated, not run: the other {left:,}", f"{left * each / 60:.0f} min more at that rate"))
    for number, sizes in enumerate(computing.values(), 1):
        values = np.array([size for _, size in sizes]) / 1e9
        cut = max(len(values) // 4, 1)
        rows.append(
            (f"memory of process {number}, seen {len(values)} times",
             f"{values[:cut].max():.2f} GB at most in its first quarter, {values[-cut:].max():.2f} in its last, {values.max():.2f} ever")
        )  # fmt: skip
    return rows


def asked(work: Path) -> list[tuple[str, str]]:
    """The other commands, each in a process of its own."""
    store = str(work / "store")
    (work / "limits.toml").write_text('["*"]\nclearance = { max = "4 um" }\n')
    sql = "SELECT type, name, count(*), avg(value) FROM parameters WHERE NOT fixed GROUP BY ALL ORDER BY ALL"
    limits = ["--limits", str(work / "limits.toml")]
    rows = []
    commands = (
        ["query", store, sql, "--csv"],
        ["life", store, *limits, "--json"],
        ["report", store, "--out", str(work / "pages"), *limits],
    )
    for words in commands:
        began = time.perf_counter()
        ran = subprocess.run([PROGRAM, "fleet", *words], capture_output=True, text=True, check=False)
        what = f"{time.perf_counter() - began:.1f} s, exit status {ran.returncode}"
        rows.append((f"`fleet {words[0]}`, the whole command", what))
    size = sum(path.stat().st_size for path in (work / "pages").rglob("*") if path.is_file())
    kept = sum(path.stat().st_size for path in (work / "store").rglob("*") if path.is_file())
    return [*rows, ("the pages; the store", f"{size / 1e6:.1f} MB; {kept / 1e6:.1f} MB")]


def judged(work: Path, truth: Truth) -> list[tuple[str, str]]:
    """What the life of the valves says, beside what was made."""
    life = fleet_life(Store(work / "store", make=False))
    inside = told = found = false = overhauled = 0
    for valve in life.valves:
        i = int(valve.serial[1:])
        trend: Any = next((t for t in valve.trends if t.quantity == "clearance"), None)
        if valve.records >= 4 and trend is not None:
            told += 1
            inside += abs(trend.rate - truth.rate[i]) <= 1.96 * trend.rate_std
        if valve.records >= 4:
            overhauled += bool(truth.overhauled[i])
            found += bool(truth.overhauled[i]) and bool(valve.overhauls)
            false += not truth.overhauled[i] and bool(valve.overhauls)
    long = sum(valve.records >= 4 for valve in life.valves)
    return [
        ("valves with four records or more", f"{long:,} of {len(life.valves):,}"),
        ("... wear rate of the clearance inside its 95 % interval", f"{inside} of {told}"),
        ("... overhauled ones said to be so", f"{found} of {overhauled}"),
        ("... others said to be so", f"{false} of {long - overhauled}"),
        ("records that cannot be read; with a moved zero", f"{len(truth.broken)}; {len(truth.faulty)}"),
    ]


if __name__ == "__main__":
    main()
