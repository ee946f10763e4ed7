"""One diagnosis, from an empty compilation cache, from a filled one, and beside others in one command.

A first process makes the programs that a record of its kind needs and keeps them, a second one finds them; both write their report. Then
the record in a process that has diagnosed others. No other program names an effect, so the peer is this program's own plain fit of the
same record, warm, in the same process.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path


HIDDEN = Path(__file__).parents[1] / "data" / "hidden"
DATA = HIDDEN.parent
# A table with nothing hidden and one with effects, a raw log, an actuator in motion: what each kind of record takes as a command.
COMMANDS = (HIDDEN / "bench_27", HIDDEN / "bench_26", DATA / "raw_log", DATA / "hidden_dynamic" / "servo_2")
FIRST, RECORDS = "bench_27", ("bench_26", "bench_38", "bench_69", "bench_76", "bench_23", "bench_65", "bench_48")


def main() -> None:
    with tempfile.TemporaryDirectory() as home:
        for folder in COMMANDS:
            first, second = (process_seconds(["diagnose", str(folder), "--out", f"{home}/out"], home) for _ in range(2))
            print(
                f"  as a command, with its report: {folder.name:8s}  first {first:6.1f} s, a second process {second:5.1f} s",
                flush=True,
            )
    warm()


def process_seconds(arguments: list[str], home: str) -> float:
    """Wall time of one `thermohyd` process whose caches live under `home`."""
    environment = os.environ | {"HOME": home, "XDG_CACHE_HOME": f"{home}/.cache"}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    script = "from thermohyd.identify.cli.commands import main; main()"
    began = time.perf_counter()
    subprocess.run([sys.executable, "-P", "-c", script, *arguments], check=True, capture_output=True, env=environment)
    return time.perf_counter() - began


def warm() -> None:
    """Records in one process: the first pays for what is compiled, the others for their own work."""
    from thermohyd.identify.cli.jax_setup import set_up_jax

    set_up_jax()
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.diagnosis.diagnose import diagnose
    from thermohyd.identify.fitting.fit import fit

    for name in (FIRST, *RECORDS):
        record = read_record(HIDDEN / name)
        result = diagnose(record)
        fit(record)
        began = time.perf_counter()
        fit(record)
        plain = time.perf_counter() - began
        again = diagnose(record).seconds
        print(
            f"  {name}, {result.before.points:,} readings, reduced chi-square {result.gap_before:6.2f}, {result.verdict:12s}"
            f" in the row {result.seconds:5.1f} s, once more {again:5.1f} s ({again / plain:4.0f} plain fits)",
            flush=True,
        )


if __name__ == "__main__":
    main()
