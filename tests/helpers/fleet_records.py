"""A fleet of small records on disk, rows of a store, and jobs that do to their process what a bad record can."""

import os
import resource
import signal
import time
from datetime import datetime
from pathlib import Path
from typing import Any

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.fleet.rows import now

from .bench_folder import LEAKAGE, TOML, write_record


def write_fleet(folder: Path, count: int) -> Path:
    """Records r000, r001, ...: of five valves of two types, no two alike."""
    for i in range(count):
        valve = f'serial = "S{i % 5}"\ntype = "T{i % 2}"\noperating_hours = {100 * i}'
        toml = TOML.replace('name = "test valve"', valve) + f"\n[test]\ndate = {2020 + i % 3}-03-01\n"
        write_record(folder / f"r{i:03d}", toml, leakage=LEAKAGE.replace("0,up,-10,0.1", f"0,up,-10,0.1{i}"))
    return folder


def stored_row(number: int, **other: Any) -> dict[str, Any]:
    """A row as a fit writes it."""
    parameter = {
        "name": "clearance",
        "value": 2e-6 + 1e-8 * number,
        "std": 1e-8,
        "low": 1e-6,
        "high": 3e-6,
        "unit": "m",
    }
    row = {
        "identity": f"{number:032x}",
        "content": f"content {number}",
        "job": "fit",
        "settings": "{}",
        "version": "1",
        "path": f"/records/{number}",
        "type": "MOOG 76/1 = ä",
        "serial": f"S{number % 3}",
        "date": datetime(2020 + number % 2, 5, 1),
        "operating_hours": 100.0 * number,
        "verdict": "named",
        "parameters": [{**parameter, "at_bound": False, "fixed": False}],
        "effects": [{**parameter, "name": "oil_lag", "p_value": 0.01, "gap_closed": 0.5, "alternatives": ["other"]}],
        "written": now(),
    }
    return {**row, **other}


# Jobs, by `helpers.fleet_records:NAME`: host only.


def slowly(record: BenchRecord, seconds: float = 0.15) -> None:
    """Long enough to be killed."""
    time.sleep(seconds)


def dies(record: BenchRecord, serial: str) -> None:
    """The process of one valve's records is gone, as by a segmentation fault."""
    if record.service.serial == serial:
        os.kill(os.getpid(), signal.SIGSEGV)


def hangs(record: BenchRecord, serial: str) -> None:
    if record.service.serial == serial:
        time.sleep(600)


def grows(record: BenchRecord, serial: str, size: int) -> None:
    """Needs more memory than it may."""
    if record.service.serial == serial:
        held = bytearray(os.urandom(1 << 20)) * (size >> 20)
        time.sleep(600)
        del held


def raises(record: BenchRecord, serial: str) -> None:
    if record.service.serial == serial:
        raise ZeroDivisionError("no flow at all")


def no_room() -> None:
    """From here on the system refuses to write a file of results: called in a process that computes."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
