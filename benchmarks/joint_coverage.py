"""Do the 95 % intervals of a valve and its jack hold the truth, where one record has static and dynamic tests?

    joint_coverage.py [--records 50] [--first 0] [--processes 1]    what `fit` gives
    joint_coverage.py --plug-in ...                                 motion with the static fit's values held as if exact

Random valves and jacks by the reference simulator: three static tests of 40 rows, whose noise leaves the valve known to some
per cent, two step tests and a frequency response. Answers are appended to build/joint_coverage/*.jsonl; an interrupted run
goes on where it stopped, as long as the program is the same.
"""

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from _hidden_run import source_hash, stored
from _processes import answers_of
from scipy.stats import binomtest


ROOT = Path(__file__).parents[1]
WORK = ROOT / "build" / "joint_coverage"
STATIC = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
MOTION = ("spool_frequency", "spool_damping", "bulk_modulus_factor", "viscous_friction")


def whole_of(number: int) -> Any:
    """The truth and the test programme of record `number`: everything from its own seed."""
    sys.path.insert(0, str(ROOT / "tests"))
    from reference.actuator import Jack
    from reference.valve import Valve
    from reference.whole_record import StepPlan, Whole

    random = np.random.default_rng([77, number])
    valve = Valve(
        edge_radius=random.uniform(4e-6, 20e-6),
        clearance=random.uniform(1.5e-6, 4e-6),
        underlap=random.uniform(1e-6, 15e-6),
        discharge_coefficient=random.uniform(0.6, 0.78),
        transition_number=random.uniform(60.0, 150.0),
        null_bias=random.uniform(-3e-6, 3e-6),
    )
    jack = Jack(
        amplifier_gain=0.03,
        spool_frequency=random.uniform(60.0, 140.0),
        spool_damping=random.uniform(0.5, 1.1),
        bulk_modulus_factor=random.uniform(0.6, 1.0),
        viscous_friction=random.uniform(1500.0, 4000.0),
    )
    steps = {
        "step_fast": StepPlan((3.0,), 0.12, 1e-3),
        "step_slow": StepPlan((-4.0,), 0.6, 6e-3, ("pressure_a", "pressure_b", "piston_position")),
    }
    # A workshop's meters, coarser than the samples': else the valve is known so well that holding it does no harm.
    noise = {"leakage": 0.01, "pressure_gain": 1.0, "flow_gain": 0.1}
    return Whole(valve, jack, 10_000 + number, ((20.0, 210.0), (50.0, 210.0)), 10, steps, noise=noise)


def folder_of(number: int, whole: Any) -> Path:
    """The record's folder, made once: simulating it takes longer than its fit."""
    from reference.whole_record import write

    folder = WORK / "records" / str(number)
    made, mark = folder / "generator", source_hash(ROOT / "tests" / "reference") + source_hash(ROOT / "benchmarks")
    if not made.is_file() or made.read_text(encoding="utf-8") != mark:
        write(folder, whole)
        made.write_text(mark, encoding="utf-8")
    return folder


def plug_in(record: Any, fit: Any) -> dict[str, Any]:
    """{parameter: estimate} of the static tests alone, then of the dynamic ones with these values held."""
    from thermohyd.identify.bench.record import StartValue

    valve = fit(replace(record, dynamic=None)).parameters
    held = {name: StartValue(valve[name].value, fixed=True) for name in STATIC}
    motion = fit(replace(record, tests={}, start=held)).parameters
    return {name: valve[name] for name in STATIC} | {name: motion[name] for name in MOTION}


def ask(job: tuple[int, bool]) -> dict[str, Any]:
    """One record's answer; a failure is an answer too."""
    number, held = job
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.cli.jax_setup import set_up_jax
    from thermohyd.identify.fitting.fit import fit

    set_up_jax()
    whole = whole_of(number)
    try:
        record = read_record(folder_of(number, whole))
        began = time.perf_counter()
        found = plug_in(record, fit) if held else fit(record).parameters
    except Exception as error:
        return {"record": number, "error": f"{type(error).__name__}: {error}"}
    parameters = {
        name: {
            "truth": float(getattr(whole.valve if name in STATIC else whole.jack, name)),
            "value": float(found[name].value),
            "std": found[name].std,
            "ci95": found[name].ci95,
        }
        for name in (*STATIC, *MOTION)
    }
    return {"record": number, "parameters": parameters, "seconds": time.perf_counter() - began}


def answers(numbers: range, held: bool, processes: int) -> list[dict[str, Any]]:
    """Those of the records; only what this version of the program has not answered yet is asked."""
    store = WORK / ("plug_in.jsonl" if held else "fit.jsonl")
    store.parent.mkdir(parents=True, exist_ok=True)
    version = source_hash(ROOT / "thermohyd", ROOT / "identify", ROOT / "tests" / "reference")
    known = {a["record"]: a for a in stored(store) if a["version"] == version}
    left = [(number, held) for number in numbers if number not in known]
    began = time.monotonic()
    with store.open("a", encoding="utf-8") as out:
        for done, answer in enumerate(answers_of(ask, left, processes), start=1):
            out.write(json.dumps({**answer, "version": version}) + "\n")
            out.flush()
            known[answer["record"]] = answer
            words = answer.get("error") or f"{answer['seconds']:.0f} s"
            took = time.monotonic() - began
            print(f"{done}/{len(left)} {took:.0f} s  record {answer['record']}: {words}", file=sys.stderr, flush=True)
    return [known[number] for number in numbers]


def line(name: str, entries: list[dict[str, Any]]) -> str:
    """Coverage with its own 95 % interval (Wilson), rms of (value - truth)/std, and how many had no error bar."""
    inside = [e["ci95"][0] <= e["truth"] <= e["ci95"][1] for e in entries if e["ci95"]]
    z = [(e["value"] - e["truth"]) / e["std"] for e in entries if e["std"]]
    if not inside:
        return f"{name:22s} no intervals"
    band = binomtest(sum(inside), len(inside)).proportion_ci(method="wilson")
    rms = f"{np.sqrt(np.mean(np.square(z))):6.2f}" if z else "     -"
    share = np.median([e["std"] / abs(e["truth"]) for e in entries if e["std"]] or [np.nan])
    return (
        f"{name:22s} {sum(inside):4d} of {len(inside):4d}  {np.mean(inside):5.0%}  ({band.low:4.0%} to {band.high:4.0%})  "
        f"{rms}  {100.0 * share:8.2g} %  {len(entries) - len(inside):4d}"
    )


def table(found: list[dict[str, Any]]) -> str:
    whole = [answer["parameters"] for answer in found if "error" not in answer]
    head = f"{'parameter':22s} {'held the truth':>12s}  share  (95 % interval)  rms z  std, median  without"
    lines = [head, *(line(name, [p[name] for p in whole]) for name in (*STATIC, *MOTION))]
    for words, names in (("all of the valve", STATIC), ("all of motion", MOTION)):
        lines.append(line(words, [p[name] for p in whole for name in names]))
    for answer in found:
        if "error" in answer:
            lines.append(f"record {answer['record']} failed: {answer['error']}")
    seconds = [answer["seconds"] for answer in found if "error" not in answer]
    return "\n".join([*lines, f"{len(whole)} records, median {np.median(seconds or [np.nan]):.0f} s each"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=50)
    parser.add_argument("--first", type=int, default=0, help="number of the first record; other numbers, other valves")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--plug-in", action="store_true", help="hold the static fit's values in the fit of motion")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.records)
    print(table(answers(numbers, options.plug_in, options.processes)))


if __name__ == "__main__":
    main()
