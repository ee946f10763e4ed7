"""Which numbers of the diagnosis decide anything? Each is halved and doubled, and a record of each kind is diagnosed again.

    search_constants.py [--set 1] [--per-kind 1] [--only NAME ...]

The records are those of `make hidden-bench` with the fewest rows, of each kind so many. What counts is the answer: verdict, effects and
faults that are named. A number near 1 is one more or less than nothing: there its distance to 1 is halved and doubled. Answers are
those without the other law of an edge, as in the tables of the hidden sets.
"""

import argparse
import ast
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any


sys.path.insert(0, str(Path(__file__).parent))

from _commit import commit
from _hidden_run import records_of_set
from hidden_bench_table import GENERATOR, shortest_first


PACKAGE = "thermohyd.identify.diagnosis"
# By module. Those that theory gives (levels, likelihood ratios) and those of computing alone (seeds, steps) are not asked.
ASKED: dict[str, tuple[str, ...]] = {
    "search": (
        "SINGLES", "PAIRS", "FAULTS", "FAR", "EXPLAINED", "MOST_HOPPING", "HOPPING_REACH", "GLANCE", "PAIR_PENALTY",
        "BEYOND_TYPICAL", "FAR_FROM_PRUNED",
    ),
    "case": ("STILL_THERE",),
    "final_model": (
        "OF_THE_GAP", "OF_WHAT_IS_LEFT", "OF_A_CHANNEL", "TOGETHER", "TOGETHER_IN_A_CHANNEL", "ON_HELD_OUT", "A_GAP", "MISFIT",
        "MISFIT_SCORE",
    ),
    "rivals": ("SAME_SHAPE", "MOST_REFITS", "MOST_SWAPS", "FAR_BEHIND"),
    "stored_oil": ("REACH", "RELATIVE_REACH"),
    "screening": ("LEAST_KEPT", "SAME_DIRECTION"),
    "screening_faults": ("SHARE",),
    "record_noise": ("MOST_TAKEN", "ENOUGH_REPEATS", "EXCESS"),
    "left_over": ("DEGREE",),
    "held_out": ("SHARE", "STRETCHES"),
    "confirmation": ("FEWEST", "MOST", "STRETCHES", "RIDGE"),
    "result": ("MOST_USUAL", "WEAK"),
}  # fmt: skip
ABOUT_ONE = frozenset({"EXPLAINED", "MISFIT", "EXCESS", "SAME_SHAPE", "SAME_DIRECTION"})


@dataclass(frozen=True)
class Constant:
    """A number of one module, and of those that import it."""

    module: str
    name: str
    value: float
    holders: tuple[ModuleType, ...]

    def times(self, factor: float) -> float:
        """The number, or what it is apart from 1, times `factor`; of a count a whole number, at least 1."""
        if self.name in ABOUT_ONE:
            return 1.0 + factor * (self.value - 1.0)
        return max(1, round(factor * self.value)) if isinstance(self.value, int) else factor * self.value

    def put(self, value: float) -> None:
        for holder in self.holders:
            setattr(holder, self.name, value)


def constants(only: list[str]) -> Iterator[Constant]:
    folder = Path(import_module(PACKAGE).__file__ or "").parent
    modules = {file.stem: import_module(f"{PACKAGE}.{file.stem}") for file in folder.glob("[a-z]*.py")}
    for module, names in ASKED.items():
        for name in names:
            if only and name not in only:
                continue
            holders = [m for stem, m in modules.items() if stem == module or _takes(m, module, name)]
            yield Constant(module, name, getattr(modules[module], name), tuple(holders))


def _takes(module: ModuleType, source: str, name: str) -> bool:
    """Whether a module imports the name from another of the package."""
    tree = ast.parse(Path(module.__file__ or "").read_text(encoding="utf-8"))
    found = (node for node in tree.body if isinstance(node, ast.ImportFrom) and node.module == source)
    return any(alias.name == name for node in found for alias in node.names)


def answer(record: Any) -> tuple[str, frozenset[str], frozenset[str]]:
    """Verdict, effects, faults."""
    from thermohyd.identify.diagnosis.diagnose import diagnose

    result = diagnose(record, model_form=False)
    faults = (f"{fault.name} of {fault.test} {fault.run}" for fault in result.after.faults)
    return result.verdict, frozenset(effect.name for effect in result.effects), frozenset(faults)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", type=int, choices=(1, 2), default=1, help="of the development sets")
    parser.add_argument("--per-kind", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[], metavar="NAME")
    options = parser.parse_args()
    from thermohyd.identify import read_record
    from thermohyd.identify.cli.jax_setup import keep_memory_flat, set_up_jax

    set_up_jax()
    folder = records_of_set(options.set, GENERATOR)
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    records = {name: read_record(folder / name) for name in shortest_first(truth, options.per_kind)}
    usual = {name: answer(record) for name, record in records.items()}
    print(
        f"# Numbers of the diagnosis, halved and doubled\n\nCommit {commit('--', 'thermohyd', 'identify')}; {len(records)} records:"
    )
    for name, (verdict, effects, faults) in usual.items():
        print(f"- {name} ({truth[name]['kind']}): {verdict}; {', '.join(sorted(effects | faults)) or 'nothing'}")
    print(
        "\n| number | is | halved | answers changed | doubled | answers changed |\n| --- | --- | --- | --- | --- | --- |"
    )
    began = time.monotonic()
    for number, constant in enumerate(constants(options.only), start=1):
        cells = [f"{constant.module}.{constant.name}", f"{constant.value:g}"]
        for factor in (0.5, 2.0):
            changed = []
            constant.put(constant.times(factor))
            try:
                for name, record in records.items():
                    now = answer(record)
                    if now != usual[name]:
                        changed.append(f"{name} {now[0]}: {', '.join(sorted(now[1] | now[2])) or 'nothing'}")
                    keep_memory_flat()
            finally:
                constant.put(constant.value)
            cells += [f"{constant.times(factor):g}", "; ".join(changed) or "none"]
        print(f"| {' | '.join(cells)} |", flush=True)
        print(f"{number}: {constant.name}, {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
