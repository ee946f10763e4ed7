"""`thermohyd` as a process: --help, a first-ever fit of the sample record with an empty cache, and the second one.

Claimed: --help under 0.5 s; the first-ever fit with its report under 20 s, the second under 6 s (compilation cache).
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path


RECORD = Path(__file__).parents[1] / "data" / "seed_valve"
SCRIPT = "from thermohyd.identify.cli.commands import main; main()"


def seconds(arguments: list[str], home: str) -> float:
    """Wall time of one `thermohyd` process whose caches live under `home`."""
    environment = os.environ | {"HOME": home, "XDG_CACHE_HOME": f"{home}/.cache"}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    began = time.perf_counter()
    subprocess.run([sys.executable, "-P", "-c", SCRIPT, *arguments], check=True, capture_output=True, env=environment)
    return time.perf_counter() - began


def main() -> None:
    with tempfile.TemporaryDirectory() as home:
        seconds(["--help"], home)
        print(f"  --help                             {min(seconds(['--help'], home) for _ in range(5)):5.2f} s")
        fit = ["fit", str(RECORD), "--out", f"{home}/report"]
        print(f"  first-ever fit of the sample       {seconds(fit, home):5.1f} s")
        later = sorted(seconds(fit, home) for _ in range(3))
        print(f"  the same in a second process       {later[1]:5.1f} s (median of 3)")


if __name__ == "__main__":
    main()
