"""With an effect taken out of the library: does the second tier point at its place, and at what it goes with?

    python benchmarks/leave_one_out.py --set 1             the table of typed terms beside the ideal valve, every effect out
    python benchmarks/leave_one_out.py --set 1 --search    a whole diagnosis with the hidden effect alone out: minutes per record
    python benchmarks/leave_one_out.py --set 9 --real      the records of hidden_bench_table.py, logged as real benches log

The records are those of hidden_table.py: each of 23 effects weak and strong, white and correlated noise, and ten things that no library
holds, from the reference simulator. What is the same by another name goes out with an effect (`THE_SAME`). Set 1 is for
development; others are looked at once, when nothing changes any more. What counts
as the right answer stands in `TRUTH`.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any


sys.path.insert(0, str(Path(__file__).parent))

from _hidden_run import ROOT, answer_within, folder_of_set, kept, records_of_set, source_hash
from _place_scores import Hidden, table
from _told_terms import terms_beside, terms_of_a_diagnosis


PATIENCE = 1800  # s
# Effects that are the hidden one by another name, or both halves of it; two of the outsiders have become effects since.
THE_SAME = {
    "supply_edge_wear": ("edge_wear_pa", "edge_wear_pb"),
    "return_edge_wear": ("edge_wear_at", "edge_wear_bt"),
    "one_damaged_edge": ("edge_wear_pa",),
    "null_bias_with_temperature": ("null_shift_temperature",),
}
FLOWS = ("reading:flows", "reading:flow", "reading:leakage_flow")
GAUGES = ("reading:load_pressure", "reading:pressures", "reading:pressure_a", "reading:pressure_b")
# {effect: (its places, its variables)}: written down before the first record was looked at. An effect of several edges, or of a flow
# that no single place has, counts where its nearest place is first. (The oil's temperature became a place on 2026-11-28.)
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
    "throttle_heating": (
        ("viscosity", "oil_temperature", "oil_temperature:return"),
        ("pressure", "pressure_drop", "flow", "temperature"),
    ),
    "pressure_viscosity": (("viscosity",), ("pressure", "pressure_drop")),
    "viscosity_shift": (("viscosity",), ("constant",)),
    "temperature_offset": (("viscosity", "oil_temperature"), ("temperature", "constant")),
    "pilot_leakage": (("flow_into_return",), ("pressure_drop",)),
    "bushing_leakage": (("flow_into_return",), ("pressure_drop",)),
    "cross_port_leakage": (("flow_from_a_to_b",), ("pressure", "pressure_drop", "load")),
    "flowmeter_offset": (FLOWS, ("constant",)),
    "flowmeter_scale": (FLOWS, ("flow",)),
    "flowmeter_lag": (FLOWS, ("reading_rate",)),
    "position_scale": (("position",), ("position",)),
    "hysteresis": (("position",), ("direction",)),
    "pressure_offset": (GAUGES, ("constant",)),
    # Younger than the sets of ideal logs.
    **{f"edge_wear_{edge}": ((f"edge_radius:{edge}",), ("constant",)) for edge in ("pa", "pb", "at", "bt")},
    "null_shift_temperature": (("position",), ("temperature",)),
    "null_shift_pressure": (("position",), ("pressure", "pressure_drop")),
    "load_pressure_scale": (GAUGES, ("pressure", "load")),
    "position_lag": (("position",), ("rate",)),
    # Never in the library, or only lately.
    "discharge_with_opening": (("edge_flow",), ("opening", "position", "flow")),
    "discharge_with_flow_number": (("edge_flow",), ("flow", "opening", "pressure_drop", "temperature")),
    "one_damaged_edge": (("edge_radius:pa",), ("constant",)),
    "flowmeter_saturates": (FLOWS, ("flow",)),
    "position_waves": (("position",), ("position",)),
    "null_bias_with_temperature": (("position",), ("temperature",)),
    "silting": (("clearance",), ("time",)),
    "gauge_curvature": (GAUGES, ("pressure", "load")),
    "slot_narrows": (("edge_flow",), ("opening", "position")),
    "supply_gauge_gain": (("supply_pressure",), ("pressure", "pressure_drop")),
}


def beside_the_ideal_valve(folder: Path, effects: tuple[str, ...]) -> dict[str, Any]:
    """The terms that are told with an empty library."""
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.diagnosis.case import open_case

    return terms_beside(lambda without: open_case(read_record(folder), without=without), folder, effects)


def ask(job: tuple[Path, tuple[str, ...], bool]) -> dict[str, Any]:
    folder, effects, search = job
    return answer_within(
        PATIENCE, folder, lambda f: (terms_of_a_diagnosis if search else beside_the_ideal_valve)(f, effects)
    )


def out_with(about: dict[str, Any]) -> tuple[str, ...]:
    """What is taken out of the library for a record of this truth."""
    hidden = (*about["effects"], *([about["outside"]["name"]] if about["outside"] else []))
    return (*about["effects"], *(name for own in hidden for name in THE_SAME.get(own, ())))


MIDDLE = (10.0, 25.0)  # noise units that something of middle size leaves beside the parameters


def hidden_in(about: dict[str, Any]) -> Hidden:
    """What is hidden in a record of this truth, and with which others it is counted: by kind, noise and size."""
    outside, (small, large), delta = about["outside"], MIDDLE, about["delta"]
    names = [*about["effects"], *([outside["name"]] if outside else [])]
    if not names:
        return Hidden("", (), "")
    size = f"below {small:g}" if delta < small else f"above {large:g}" if delta > large else f"{small:g} to {large:g}"
    noise = "white" if about["phi"] == 0.0 else "correlated"
    groups = ("outsiders" if outside else "effects", f"{noise} noise", f"{size} noise units")
    return Hidden(names[0], groups, f"{delta:.1f} noise units")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", type=int, default=1, help="1: development; others are looked at once")
    parser.add_argument("--real", action="store_true", help="records as real benches log them")
    parser.add_argument("--search", action="store_true", help="a whole diagnosis of each record")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[], metavar="RECORD")
    parser.add_argument("--kinds", nargs="*", default=["single", "none", "outside"], help="of these")
    parser.add_argument("--most", type=int, default=1000, help="records at most, in the set's own (shuffled) order")
    parser.add_argument("--any-version", action="store_true", help="keep answers of an earlier state of the program")
    parser.add_argument("--show", action="store_true", help="only the table of the answers so far, of any version")
    arguments = parser.parse_args()
    generator = "real_bench_records" if arguments.real else "hidden_records"
    folder = records_of_set(arguments.set, generator)
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    names = [n for n in arguments.only or truth if truth[n]["kind"] in arguments.kinds][: arguments.most]
    out = out_with if arguments.search else lambda about: tuple(about["effects"])
    jobs = {n: (folder / n, out(truth[n]), arguments.search) for n in names}
    mode = "search" if arguments.search else "alone"
    work = folder_of_set(arguments.set, generator)
    found = kept(
        work / f"leave_one_out_{mode}.jsonl",
        source_hash(ROOT / "thermohyd", ROOT / "identify"),
        jobs,
        ask,
        arguments.processes,
        any_version=arguments.any_version or arguments.show,
        ask_more=not arguments.show,
    )
    what = "real benches" if arguments.real else "ideal logs"
    text = f"# Leave-one-out, {what}, set {arguments.set}, {mode}\n\n" + table(
        {n: hidden_in(truth[n]) for n in found}, found, TRUTH
    )
    (work / f"leave_one_out_{mode}.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
