"""Records diagnosed one after another in one process: time of a further record, and whether memory stays flat.

What a command with many records, or a worker of a fleet, does all night. The records are real-bench ones of tests/reference (set 9, then
set 8; 600 to 12,000 rows), in the order of their names; the first ones pay for what is not compiled yet. Between records memory is given
back as the command does; what is held then is printed, and the process's peak.
"""

import argparse
import json
import resource
import statistics

from _hidden_run import records_of_set
from hidden_bench_table import GENERATOR


SETS = (9, 8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=100, help="how many")
    count = parser.parse_args().records
    folders = []
    for number in SETS:
        made = records_of_set(number, GENERATOR)
        folders += [made / name for name in sorted(json.loads((made / "truth.json").read_text(encoding="utf-8")))]
    from thermohyd.identify.cli.jax_setup import keep_memory_flat, resident_memory, set_up_jax

    set_up_jax()
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.diagnosis.diagnose import diagnose

    took = []
    for folder in folders[:count]:
        record = read_record(folder)
        took.append(diagnose(record).seconds)
        keep_memory_flat()
        if len(took) % 10 == 0:
            last = took[-10:]
            print(
                f"  records {len(took) - 9:3d} to {len(took):3d}   median {statistics.median(last):5.1f} s, largest {max(last):5.1f} s,"
                f"   memory held {resident_memory() / 1e9:.2f} GB",
                flush=True,
            )
    later = took[len(took) // 2 :]
    print(
        f"  all {len(took)}: median {statistics.median(took):.1f} s, {sum(t <= 20.0 for t in took)} within 20 s, largest {max(took):.1f} s;"
        f" the second half: median {statistics.median(later):.1f} s, largest {max(later):.1f} s"
    )
    print(f"  peak memory of the process {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9:.2f} GB")


if __name__ == "__main__":
    main()
