"""Does an answer hang on the rounding of the machine? Records diagnosed twice, the second time with readings changed by parts in 10^8.

Every test's readings are multiplied by one number each, 1 + 1e-8 z with z standard normal, which keeps the steps of a rounded log as they
are. A search that chooses between valleys of nearly the same depth can end in another one after that. The records are real-bench ones of
tests/reference, of a set that was looked at.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from _hidden_run import PATIENCE, all_answered, answer_of, answer_within, folder_of_set, records_of_set
from hidden_bench_table import GENERATOR


SIZE = 1e-8


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", type=int, default=9)
    parser.add_argument("--every", type=int, default=2, help="of the set's records, in the order of their names")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--any-version", action="store_true", help="keep answers of an earlier state of the program")
    options = parser.parse_args()
    folder = records_of_set(options.set, GENERATOR)
    chosen = sorted(json.loads((folder / "truth.json").read_text(encoding="utf-8")))[:: options.every]
    found = all_answered(
        folder_of_set(options.set, GENERATOR) / "same_answer.jsonl",
        {name: folder / name for name in chosen},
        ask,
        options.processes,
        any_version=options.any_version,
    )
    print(table(found))


def ask(folder: Path) -> dict[str, Any]:
    """Both answers of one record."""
    return answer_within(2 * PATIENCE, folder, asked_twice)


def asked_twice(folder: Path) -> dict[str, Any]:
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.diagnosis.diagnose import diagnose

    record, rng = read_record(folder), np.random.default_rng(sum(folder.name.encode()))
    tests = {}
    for name, test in record.tests.items():
        factor = 1.0 + SIZE * rng.standard_normal()
        tests[name] = replace(test, channels=tuple(replace(c, value=c.value * factor) for c in test.channels))
    both = (record, replace(record, tests=tests))
    answers = [answer_of(folder.name, diagnose(r)) for r in both]
    return {"record": folder.name, "headline": " | ".join(a["verdict"] for a in answers), "answers": answers}


def names(answer: dict[str, Any]) -> set[str]:
    """Effects, and faults of the bench with their places, that an answer names."""
    return {e["name"] for e in answer["effects"]} | {fault_name(f) for f in answer["faults"]}


def fault_name(fault: dict[str, Any]) -> str:
    return " ".join(str(fault[key]) for key in ("name", "test", "run", "channel") if fault.get(key))


def change(one: dict[str, Any], other: dict[str, Any]) -> float:
    """The largest change of a value of the final model, parameter or amount, in its error bars; NaN where none is known."""
    pairs = [(own, other["parameters"][n]) for n, own in one["parameters"].items() if n in other["parameters"]]
    moved = [abs(now["value"] - own["value"]) / own["std"] for own, now in pairs if own["std"]]
    return max(moved, default=float("nan"))


def alike(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether each effect of one answer is one of the other, or a rival of one."""
    listed = lambda a: {e["name"] for e in a["effects"]} | {r["name"] for e in a["effects"] for r in e["alternatives"]}
    own = lambda a: {e["name"] for e in a["effects"]}
    return len(own(one)) == len(own(other)) and own(one) <= listed(other) and own(other) <= listed(one)


def table(found: dict[str, dict[str, Any]]) -> str:
    pairs = {name: answer["answers"] for name, answer in found.items()}
    count = lambda good: f"{sum(good)}/{len(pairs)}"
    changed = {name: (a, b) for name, (a, b) in pairs.items() if names(a) != names(b) or a["verdict"] != b["verdict"]}
    moved = np.array([change(a, b) for a, b in pairs.values() if names(a) == names(b)])
    typical, most = np.nanmedian(moved), np.nanmax(moved)
    words = lambda a: f"{' + '.join(sorted(names(a))) or 'nothing'} ({a['verdict']})"
    lines = [
        "| | records |",
        "|---|---|",
        f"| the same verdict | {count(a['verdict'] == b['verdict'] for a, b in pairs.values())} |",
        f"| the same names | {count(names(a) == names(b) for a, b in pairs.values())} |",
        f"| or effects that both answers list as rivals | {count(alike(a, b) for a, b in pairs.values())} |",
        "",
        f"- values where the names are the same: changed by {typical:.1e} of their error bars (median), {most:.1e} at most",
        *(f"- {name}: {words(a)}, then {words(b)}" for name, (a, b) in changed.items()),
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
