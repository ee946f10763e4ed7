"""With a dynamic effect taken out of the library: does the second tier point at its place, and at what it goes with?

    python benchmarks/leave_one_out_motion.py             the table of typed terms beside the plain model, every effect out
    python benchmarks/leave_one_out_motion.py --search    a whole diagnosis with the hidden effect alone out: minutes per record

Records of hidden_dynamic_table.py, each effect at the strength that shows well, white noise, and records with nothing wrong; from the
reference simulator, seeds of their own. Set 1 is for development, set 2 is looked at once. The right answers stand in `TRUTH`.
"""

import argparse
import sys
from pathlib import Path
from typing import Any


sys.path.insert(0, str(Path(__file__).parent))

from _hidden_run import all_answered, answer_within
from _told_terms import terms_beside, terms_of_a_diagnosis
from hidden_dynamic_table import ROOT, STRENGTHS, bench_of, dynamic_bench


CHAMBERS = ("flow_into_chamber_a", "flow_into_chamber_b", "flow_into_chambers")
SPOOL = ("force_on_spool", "position")
# {effect: (its places, its variables)}: written down before the first record was looked at.
TRUTH: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "coulomb_friction": (("force_on_piston",), ("direction",)),
    "stribeck_friction": (("force_on_piston",), ("direction", "velocity")),
    "backlash": (("force_on_spool",), ("direction", "rate")),
    "entrained_air": (CHAMBERS, ("pressure_rate",)),
    "jack_leakage": (("flow_from_a_to_b", *CHAMBERS), ("load", "pressure", "pressure_drop")),
    "flow_force": (("force_on_spool",), ("position", "velocity", "opening")),
    "spool_delay": (("force_on_spool",), ("rate",)),
    "wall_heat": (("heat_of_chamber",), ("temperature",)),
}
NOTHING_WRONG = 6
PATIENCE = 7200  # s, for one record, compiling included


def plan(number: int) -> dict[str, tuple[int, dict[str, float]]]:
    """{record: (seed, effects)}."""
    found = {name: (7000 * number + i, {name: own[1]}) for i, (name, own) in enumerate(STRENGTHS.items())}
    return found | {f"none_{i + 1}": (7000 * number + 100 + i, {}) for i in range(NOTHING_WRONG)}


def ask(job: tuple[Path, int, dict[str, float], bool]) -> dict[str, Any]:
    """What is told of one record, made for it; the last of the job: by a whole diagnosis."""
    folder, seed, effects, search = job

    def told(record: Path) -> dict[str, Any]:
        dynamic_bench.write(record, bench_of(seed, effects, 0.0))
        answer = terms_of_a_diagnosis(record, tuple(effects)) if search else terms_beside_the_plain_model(record)
        return {"effects": list(effects), **answer}

    return answer_within(PATIENCE, folder, told)


def terms_beside_the_plain_model(folder: Path) -> dict[str, Any]:
    """The terms that are told with an empty library."""
    from thermohyd.effects.library import whole_library
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.diagnosis.case import with_noise_around
    from thermohyd.identify.diagnosis.diagnose import open_motion

    case = open_motion(read_record(folder), without=tuple(whole_library()))
    return terms_beside(with_noise_around(case, case.base), folder)


def mark(effects: list[str], answer: dict[str, Any]) -> str:
    """How right the first term that holds is."""
    told = [t for t in answer["terms"] if t["holds"]]
    if not effects:
        return "false" if told else "right"
    if not told:
        return f"named {', '.join(answer['named'])}" if answer["named"] else "nothing"
    places, variables = TRUTH[effects[0]]
    first, pairs = told[0], [(told[0]["place"], told[0]["variable"]), *map(tuple, told[0]["alternatives"])]
    if first["place"] in places:
        return "both" if first["variable"] in variables else "place"
    return "rival" if any(p in places for p, _ in pairs) else "wrong"


def table(answers: dict[str, dict[str, Any]]) -> str:
    """The rates, then a line per record."""
    marks = {name: mark(a["effects"], a) for name, a in answers.items()}
    hidden = [m for name, m in marks.items() if answers[name]["effects"]]
    none = [m for name, m in marks.items() if not answers[name]["effects"]]
    of = lambda *kinds: f"{sum(m in kinds for m in hidden)} of {len(hidden)}"
    lines = [
        f"right place first: {of('both', 'place')}; place and variable: {of('both')}; right place first or allowed: "
        f"{of('both', 'place', 'rival')}",
        f"a false place where nothing is wrong: {none.count('false')} of {len(none)}",
    ]
    for name, answer in answers.items():
        terms = "; ".join(
            f"{t['place']} {t['variable']} {t['law']} closes {t['gap_closed']:.2f}{'' if t['holds'] else ' (not proven)'}"
            for t in answer["terms"]
        )
        lines.append(
            f"{name:<20}{marks[name]:<10}{answer['seconds']:5.0f} s  before {answer['before']:.2f}  {terms or 'no term'}"
            + (f"; allowed too: {answer['terms'][0]['alternatives']}" if answer["terms"] else "")
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", type=int, choices=(1, 2), default=1, help="1: development; 2: looked at once")
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
    text = table(all_answered(folder / f"{mode}.jsonl", jobs, ask, options.processes, any_version=options.any_version))
    (folder / f"{mode}.txt").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
