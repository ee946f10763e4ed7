"""With a dynamic effect taken out of the library: does the second tier point at its place, and at what it goes with?

    python benchmarks/leave_one_out_motion.py             the table of typed terms beside the plain model, every effect out
    python benchmarks/leave_one_out_motion.py --search    a whole diagnosis with the hidden effect alone out: minutes per record

Records of hidden_dynamic_table.py, each effect at three strengths, white and correlated noise by turns, and records with nothing wrong;
from the reference simulator, seeds of their own. Set 1 is for development (2 and 3 were looked at, too), sets 4 and 5 are looked at
once. The right answers stand in `TRUTH`.
"""

import argparse
import sys
from pathlib import Path
from typing import Any


sys.path.insert(0, str(Path(__file__).parent))

from _hidden_run import all_answered, answer_within
from _place_scores import Hidden, table
from _told_terms import terms_beside, terms_of_a_diagnosis
from hidden_dynamic_table import MEMORY, ROOT, STRENGTHS, bench_of, dynamic_bench


CHAMBERS = ("flow_into_chamber_a", "flow_into_chamber_b", "flow_into_chambers")
SPOOL = ("force_on_spool", "position")
# {effect: (its places, its variables)}: written down before the first record was looked at, but for the lag of the command, a place that
# came after set 4.
TRUTH: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "coulomb_friction": (("force_on_piston",), ("direction",)),
    "stribeck_friction": (("force_on_piston",), ("direction", "velocity")),
    "backlash": (("force_on_spool",), ("direction", "rate")),
    "entrained_air": (CHAMBERS, ("pressure_rate",)),
    "jack_leakage": (("flow_from_a_to_b", *CHAMBERS), ("load", "pressure", "pressure_drop")),
    "flow_force": (("force_on_spool",), ("position", "velocity", "opening")),
    "spool_delay": (("force_on_spool", "command_lag"), ("rate", "command_rate")),
    "wall_heat": (("heat_of_chamber",), ("temperature",)),
}
NOTHING_WRONG = 6
PATIENCE = 7200  # s, for one record, compiling included


WORDS = ("faint", "middle", "strong")


def plan(number: int) -> dict[str, tuple[int, dict[str, float], float]]:
    """{record: (seed, effects, memory of the noise)}."""
    found: dict[str, tuple[int, dict[str, float], float]] = {}
    for i, (name, (faint, strong)) in enumerate(STRENGTHS.items()):
        for k, amount in enumerate((strong, (faint * strong) ** 0.5, faint)):
            found[f"{name}_{WORDS[2 - k]}"] = 7000 * number + i + 10 * k, {name: amount}, MEMORY * ((i + k) % 2)
    for i in range(NOTHING_WRONG):
        found[f"none_{i + 1}"] = 7000 * number + 100 + i, {}, MEMORY * (i % 2)
    return found


def ask(job: tuple[Path, int, dict[str, float], float, bool]) -> dict[str, Any]:
    """What is told of one record, made for it; the last of the job: by a whole diagnosis."""
    folder, seed, effects, memory, search = job

    def told(record: Path) -> dict[str, Any]:
        dynamic_bench.write(record, bench_of(seed, effects, memory))
        return (terms_of_a_diagnosis if search else terms_beside_the_plain_model)(record, tuple(effects))

    return answer_within(PATIENCE, folder, told)


def terms_beside_the_plain_model(folder: Path, effects: tuple[str, ...]) -> dict[str, Any]:
    """The terms that are told with an empty library."""
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.diagnosis.case import with_noise_around
    from thermohyd.identify.diagnosis.diagnose import open_motion

    def opened(without: tuple[str, ...]) -> Any:
        case = open_motion(read_record(folder), without=without)
        return with_noise_around(case, case.base)

    return terms_beside(opened, folder, effects)


def hidden_in(name: str, effects: dict[str, float], memory: float) -> Hidden:
    """What is hidden in a record, and with which others it is counted."""
    if not effects:
        return Hidden("", (), "")
    strength = name.rsplit("_", 1)[1]
    (effect,) = effects
    return Hidden(effect, (f"{'correlated' if memory else 'white'} noise", strength), strength)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--set", type=int, choices=(1, 2, 3, 4, 5), default=1, help="1: development; 4, 5: looked at once"
    )
    parser.add_argument("--search", action="store_true", help="a whole diagnosis of each record")
    parser.add_argument("--only", nargs="*", default=[], metavar="RECORD")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "leave_one_out_motion")
    parser.add_argument("--processes", type=int, default=1, help="records asked at a time")
    parser.add_argument("--any-version", action="store_true", help="keep answers of an earlier state of the program")
    options = parser.parse_args()
    mode = "search" if options.search else "alone"
    folder = options.out / f"set{options.set}"
    jobs = {
        name: (folder / name, *hidden, options.search)
        for name, hidden in plan(options.set).items()
        if not options.only or name in options.only
    }
    answers = all_answered(folder / f"{mode}.jsonl", jobs, ask, options.processes, any_version=options.any_version)
    hidden = {name: hidden_in(name, *about[1:]) for name, about in plan(options.set).items()}
    text = f"# Leave-one-out in motion, set {options.set}, {mode}\n\n" + table(hidden, answers, TRUTH)
    (folder / f"{mode}.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
