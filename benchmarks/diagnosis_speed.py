"""One diagnosis, from an empty compilation cache, from a filled one, and beside others in one command.

Claimed: 3000 readings at most 60 s cold and 15 s warm on 2 cores; records in one command share what is compiled. Cold:
a first-ever process. Warm: the record in a process that has diagnosed another one. No other program names an effect, so
the peer is this program's own plain fit of the same record, warm, in the same process.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path


HIDDEN = Path(__file__).parents[1] / "data" / "hidden"
FIRST, RECORDS = "bench_27", ("bench_26", "bench_38", "bench_69", "bench_76", "bench_23", "bench_65", "bench_48")


def main() -> None:
    with tempfile.TemporaryDirectory() as home:
        for words in ("empty cache", "filled cache"):
            took = process_seconds(["diagnose", str(HIDDEN / RECORDS[0]), "--out", f"{home}/out"], home)
            print(f"  one process, {words:13s} with its report    {took:6.1f} s", flush=True)
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
