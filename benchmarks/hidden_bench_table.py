"""Records as a real bench makes them: does the diagnosis name the effect, or the fault of the bench? `make hidden-bench`.

The records come from the reference simulator (tests/reference/real_bench_records.py, fixed seeds); their truth lies in a file outside
every record. Set 1 is for development. Each further set was looked at once, when nothing changed any more, and is for development since
(2 to 9, from 2026-11-23 to 26): who wants another adds a seed to tests/reference/real_bench_plan.py.
"""

import argparse
import json
import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any


sys.path.insert(0, str(Path(__file__).parent))

from _commit import commit
from _hidden_bench_scores import BenchCase
from _hidden_bench_tables import table
from _hidden_run import answers, folder_of_set, records_of_set, sets_of


GENERATOR = "real_bench_records"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--set", type=int, choices=sets_of(GENERATOR), default=1, help="1: development; the others: looked at once"
    )
    parser.add_argument("--processes", type=int, default=1, help="records diagnosed at a time")
    parser.add_argument("--only", nargs="*", default=[], metavar="RECORD", help="these records, such as bench_07")
    parser.add_argument("--per-kind", type=int, metavar="N", help="of each kind the N records with the fewest rows")
    parser.add_argument("--any-version", action="store_true", help="keep answers of an earlier state of the program")
    parser.add_argument("--show", action="store_true", help="only the table of the answers so far, of any version")
    arguments = parser.parse_args()
    truth = json.loads((records_of_set(arguments.set, GENERATOR) / "truth.json").read_text(encoding="utf-8"))
    found = answers(
        arguments.set,
        arguments.only or shortest_first(truth, arguments.per_kind),
        arguments.processes,
        any_version=arguments.any_version or arguments.show,
        with_baselines=False,
        ask_more=not arguments.show,
        generator=GENERATOR,
    )
    failed = {name: answer["error"] for name, answer in found.items() if "error" in answer}
    cases = [BenchCase(truth[name], answer) for name, answer in found.items() if name not in failed]
    text = f"# Real-bench records, set {arguments.set}\n\n{state(found.values())}\n\n" + table(cases, failed)
    (folder_of_set(arguments.set, GENERATOR) / "table.md").write_text(text, encoding="utf-8")
    print(text)


def shortest_first(truth: dict[str, Any], per_kind: int | None) -> list[str]:
    """One record of each kind, then another one, those with few rows first: an hour, or so many `per_kind`, says something of all."""
    turns: dict[str, int] = {}
    order = []
    for name in sorted(truth, key=lambda name: (truth[name]["rows"], name)):
        turn = turns[truth[name]["kind"]] = turns.get(truth[name]["kind"], 0) + 1
        if per_kind is None or turn <= per_kind:
            order.append((turn, len(order), name))
    return [name for _, _, name in sorted(order)]


def state(found: Iterable[dict[str, Any]]) -> str:
    """The program's state: commit, what is not committed, date, and how many versions the answers are of."""
    versions = sorted({answer["version"] for answer in found})
    return (
        f"Commit {commit('--', 'thermohyd', 'identify')}, {datetime.now(UTC):%Y-%m-%d}; "
        f"answers of {len(versions)} version{'s' if len(versions) != 1 else ''} of the program ({', '.join(versions)})."
    )


if __name__ == "__main__":
    main()
