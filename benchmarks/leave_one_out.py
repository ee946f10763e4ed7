"""With an effect taken out of the library: does the second tier point at its place, and at what it goes with?

    python benchmarks/leave_one_out.py --set 1             the table of typed terms beside the ideal valve, every effect out
    python benchmarks/leave_one_out.py --set 1 --search    a whole diagnosis with the hidden effect alone out: minutes per record

The records are those of hidden_table.py: each of 23 effects weak and strong, white and correlated noise, from the reference simulator.
Set 1 is for development; set 2 is looked at once, when nothing changes any more. What counts as the right answer stands in `TRUTH`.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np


sys.path.insert(0, str(Path(__file__).parent))

from _hidden_bench_tables import rate
from _hidden_run import ROOT, answer_within, folder_of_set, kept, records_of_set, source_hash
from _told_terms import terms_beside, terms_of_a_diagnosis


PATIENCE = 1800  # s
FLOWS = ("reading:flows", "reading:flow", "reading:leakage_flow")
GAUGES = ("reading:load_pressure", "reading:pressures", "reading:pressure_a", "reading:pressure_b")
# {effect: (its places, its variables)}: written down before the first record was looked at. An effect of several edges, or of a flow
# that no single place has, counts where its nearest place is first.
TRUTH: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "supply_edge_wear": (("edge_radius:supply",), ("constant",)),
    "return_edge_wear": (("edge_radius:return",), ("constant",)),
    "unequal_underlap": (("underlap:return", "underlap:supply"), ("constant",)),
    "eccentricity": (("clearance", "edge_flow"), ("opening", "position")),
    "land_leakage": (("clearance", "edge_flow", "flow_into_return"), ("opening", "position", "pressure_drop")),
    "thermal_clearance": (("clearance",), ("temperature",)),
    "pressure_clearance": (("clearance",), ("pressure", "pressure_drop")),
    "flow_saturation": (("pressure_in_passages", "supply_pressure", "return_pressure"), ("flow",)),
    "supply_droop": (("supply_pressure",), ("flow",)),
    "return_back_pressure": (("return_pressure",), ("flow",)),
    "throttle_heating": (("viscosity",), ("pressure", "pressure_drop", "flow", "temperature")),
    "pressure_viscosity": (("viscosity",), ("pressure", "pressure_drop")),
    "viscosity_shift": (("viscosity",), ("constant",)),
    "temperature_offset": (("viscosity",), ("temperature",)),
    "pilot_leakage": (("flow_into_return",), ("pressure_drop",)),
    "bushing_leakage": (("flow_into_return",), ("pressure_drop",)),
    "cross_port_leakage": (("flow_from_a_to_b",), ("pressure", "pressure_drop", "load")),
    "flowmeter_offset": (FLOWS, ("constant",)),
    "flowmeter_scale": (FLOWS, ("flow",)),
    "flowmeter_lag": (FLOWS, ("reading_rate",)),
    "position_scale": (("position",), ("position",)),
    "hysteresis": (("position",), ("direction",)),
    "pressure_offset": (GAUGES, ("constant",)),
}


def beside_the_ideal_valve(folder: Path) -> dict[str, Any]:
    """The terms that are told with an empty library."""
    from thermohyd.effects.library import whole_library
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.diagnosis.case import open_case

    return terms_beside(open_case(read_record(folder), without=tuple(whole_library())), folder)


def ask(job: tuple[Path, tuple[str, ...], bool]) -> dict[str, Any]:
    folder, effects, search = job
    return answer_within(
        PATIENCE, folder, lambda f: terms_of_a_diagnosis(f, effects) if search else beside_the_ideal_valve(f)
    )


RATES = ("place", "quantity", "allowed", "both", "both_allowed")


def table(truth: dict[str, Any], answers: dict[str, dict[str, Any]]) -> str:
    """The rates, then a line per record."""
    from thermohyd.identify.diagnosis.term_table import family

    lines, rows = [], []
    scores: dict[str, list[bool]] = {key: [] for key in ("false", "standin", *RATES, *(f"{one} told" for one in RATES))}
    left: list[float] = []
    for name, answer in answers.items():
        about = truth[name]
        if "error" in answer:
            rows.append(f"| {name} | {about['kind']} | failed: {answer['error'][:80]} | | |")
            continue
        told = [t for t in answer["terms"] if t["holds"]]
        first = told[0] if told else None
        words = "nothing" if first is None else f"{first['place']} {first['variable']} {first['law']}"
        closes = "" if first is None else f"{first['gap_closed']:.2f}"
        what = ", ".join(f"{n} {about['strength']}" for n in about["effects"]) or (about["outside"] or {}).get(
            "name", "none"
        )
        mark = ""
        if about["kind"] == "none":
            scores["false"].append(first is not None)
            mark = "false" if first is not None else "right"
        elif about["kind"] == "single":
            (effect,) = about["effects"]
            places, variables = TRUTH[effect]
            scores["standin"].append(first is None and bool(answer["named"]))
            if answer["named"] and first is None:
                mark, words = "stand-in", " + ".join(answer["named"])
            else:
                pairs = (
                    [] if first is None else [(first["place"], first["variable"]), *map(tuple, first["alternatives"])]
                )
                scores["place"].append(bool(pairs) and pairs[0][0] in places)
                scores["quantity"].append(bool(pairs) and family(pairs[0][0]) in {family(p) for p in places})
                scores["both"].append(bool(pairs) and pairs[0][0] in places and pairs[0][1] in variables)
                scores["allowed"].append(any(p in places for p, _ in pairs))
                scores["both_allowed"].append(any(p in places and v in variables for p, v in pairs))
                if pairs:
                    for key in RATES:
                        scores[f"{key} told"].append(scores[key][-1])
                mark = (
                    "both"
                    if scores["both"][-1]
                    else "place"
                    if scores["place"][-1]
                    else "rival"
                    if scores["allowed"][-1]
                    else ""
                )
                if first is not None:
                    left.append(1.0 - first["gap_closed"])
        rows.append(f"| {name} | {what} | {words} | {closes} | {mark} |")
    count = lambda key: rate(scores[key])
    lines += [
        f"- right place first: {count('place')}; right but for which edges: {count('quantity')}",
        f"- right place first or among what the readings allow as well: {count('allowed')}",
        f"- right place and variable first: {count('both')}; first or allowed: {count('both_allowed')}",
        f"- of the records in which a term is told: place {count('place told')}, but for the edges {count('quantity told')}",
        f"- of these, first or allowed: place {count('allowed told')}, place and variable {count('both_allowed told')}",
        f"- a false place in records with nothing wrong: {count('false')}",
        f"- another effect stands in and leaves nothing to place: {count('standin')}",
        f"- excess on held-out rows, after/before: median {np.median(left):.3f}, upper quartile {np.quantile(left, 0.75):.3f}"
        if left
        else "- no term held",
    ]
    seconds = [a["seconds"] for a in answers.values() if "seconds" in a and a["verdict"] == ""]
    if seconds:
        cpu = [a["cpu"] for a in answers.values() if a.get("cpu") is not None]
        lines.append(f"- the second tier took {np.median(seconds):.1f} s (median), {np.median(cpu):.1f} s of processor")
    return "\n".join([*lines, "", "| record | hidden | first term | closes | |", "|---|---|---|---|---|", *rows]) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", type=int, choices=(1, 2, 3), default=1, help="1: development; 2, 3: looked at once")
    parser.add_argument("--search", action="store_true", help="a whole diagnosis of each record")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[], metavar="RECORD")
    parser.add_argument("--kinds", nargs="*", default=["single", "none"], help="of single, none, outside")
    parser.add_argument("--most", type=int, default=1000, help="records at most, in the set's own (shuffled) order")
    parser.add_argument("--any-version", action="store_true", help="keep answers of an earlier state of the program")
    parser.add_argument("--show", action="store_true", help="only the table of the answers so far, of any version")
    arguments = parser.parse_args()
    folder = records_of_set(arguments.set)
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    names = [n for n in arguments.only or truth if truth[n]["kind"] in arguments.kinds][: arguments.most]
    jobs = {n: (folder / n, tuple(truth[n]["effects"]), arguments.search) for n in names}
    mode = "search" if arguments.search else "alone"
    found = kept(
        folder_of_set(arguments.set) / f"leave_one_out_{mode}.jsonl",
        source_hash(ROOT / "thermohyd", ROOT / "identify"),
        jobs,
        ask,
        arguments.processes,
        any_version=arguments.any_version or arguments.show,
        ask_more=not arguments.show,
    )
    text = f"# Leave-one-out, set {arguments.set}, {mode}\n\n" + table(truth, found)
    (folder_of_set(arguments.set) / f"leave_one_out_{mode}.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
