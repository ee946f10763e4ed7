"""Do the intervals that know both laws of an edge hold the truth, whichever law made the record and whichever it is fitted with?

    law_coverage.py [--valves 24] [--first 0] [--processes 1]

Random valves by the reference simulator, each with an edge of either law, each record fitted with either. Four of eight
valves have leakage, pressure gain and flow gain at three temperatures and two supply pressures, four only leakage and pressure gain
at one of each, as many benches run them. The noise is 1 to 10 times that of a good bench, so that some records tell the laws
apart and others cannot; it is stated in one half of the records and found from residuals in the other, white in one half and
correlated in the other. Answers are appended to
build/law_coverage/answers.jsonl; an interrupted run goes on where it stopped, as long as the program is the same.
"""

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from _hidden_run import source_hash, stored
from _processes import answers_of
from scipy.stats import binomtest


ROOT = Path(__file__).parents[1]
STORE = ROOT / "build" / "law_coverage" / "answers.jsonl"
LAWS = ("orifice", "lubrication")
PARAMETERS = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "null_bias")  # that both laws have
POINTS = 21  # per sweep; two sweeps a condition
SHORT = {"tests": ("leakage", "pressure_gain"), "temperatures": (313.15,), "supplies": (210e5,), "points": 41}


def record_of(number: int, truth: str) -> tuple[Any, Any]:
    """The valve and the record of one truth: everything from the valve's own seed, the noise too."""
    sys.path.insert(0, str(ROOT / "tests"))
    from helpers.records import random_valve, synthetic_record

    random = np.random.default_rng([31, number])
    valve = replace(random_valve(random), edge_law=truth)
    noise, declared, phi = 10.0 ** random.uniform(0.0, 1.0), bool(number % 2), 0.6 * (number // 2 % 2)
    programme: dict[str, Any] = SHORT if number // 4 % 2 else {"points": POINTS}
    return valve, synthetic_record(valve, random, phi=phi, noise=noise, declared=declared, **programme)


def ask(job: tuple[int, str, str]) -> dict[str, Any]:
    """What a fit with one law says of a record that one law made."""
    import jax

    jax.config.update("jax_enable_x64", True)
    from thermohyd.identify import fit

    number, truth, law = job
    valve, record = record_of(number, truth)
    began = time.perf_counter()
    found = fit(replace(record, valve=replace(record.valve, edge_law=law)), model_form=True)
    asked = found.other_law
    parameters = {}
    for name in PARAMETERS:
        estimate = found.parameters[name]
        form = estimate.model_form
        parameters[name] = {
            "truth": float(getattr(valve, name)),
            "value": estimate.value,
            "std": estimate.std,
            "ci95": estimate.ci95,
            "both": None if form is None else form.ci95,
            "std_of_both": None if form is None else form.std,
            "undetermined": form is not None and form.undetermined,
        }
    return {
        "valve": number,
        "truth": truth,
        "law": law,
        "parameters": parameters,
        "converged": found.converged and asked is not None and asked.converged,
        "preferred": None if asked is None else asked.preferred,
        "evidence": None if asked is None else asked.evidence,
        "seconds": time.perf_counter() - began,
    }


def answers(numbers: range, processes: int) -> list[dict[str, Any]]:
    """Those of all records; only what this version of the program has not answered yet is asked."""
    STORE.parent.mkdir(parents=True, exist_ok=True)
    version = source_hash(ROOT / "thermohyd", ROOT / "identify", ROOT / "tests" / "reference")
    jobs = [(number, truth, law) for number in numbers for truth in LAWS for law in LAWS]
    known = {(a["valve"], a["truth"], a["law"]): a for a in stored(STORE) if a["version"] == version}
    left = [job for job in jobs if job not in known]
    with STORE.open("a", encoding="utf-8") as out:
        for done, answer in enumerate(answers_of(ask, left, processes), start=1):
            job = (answer["valve"], answer["truth"], answer["law"])
            out.write(json.dumps({**answer, "version": version}) + "\n")
            out.flush()
            known[job] = answer
            print(f"{done}/{len(left)} {job}: {answer['seconds']:.0f} s", file=sys.stderr, flush=True)
    return [known[job] for job in jobs]


def share(entries: list[dict[str, Any]], key: str) -> str:
    """How many intervals hold the truth, with the share's own 95 % interval (Wilson)."""
    inside = [e[key][0] <= e["truth"] <= e[key][1] for e in entries if e[key]]
    if not inside:
        return f"{'no intervals':>32s}"
    band = binomtest(sum(inside), len(inside)).proportion_ci(method="wilson")
    return f"{sum(inside):4d} of {len(inside):4d} {np.mean(inside):5.0%} ({band.low:4.0%} to {band.high:4.0%})"


def line(words: str, entries: list[dict[str, Any]]) -> str:
    z = [(e["value"] - e["truth"]) / e["std_of_both"] for e in entries if e["std_of_both"]]
    rms = f"{np.sqrt(np.mean(np.square(z))):6.2f}" if z else "     -"
    without = sum(e["both"] is None for e in entries)
    return f"{words:34s} {share(entries, 'ci95')}   {share(entries, 'both')} {rms} {without:5d}"


def table(found: list[dict[str, Any]]) -> str:
    of = lambda chosen: [e for a in chosen for e in a["parameters"].values()]
    head = f"{'made by / fitted with':34s} {'this law alone held the truth':>32s}   {'both laws held it':>32s}  rms z  none"
    lines = [head]
    groups: list[tuple[str, Callable[[dict[str, Any]], bool]]] = [
        (f"{truth} / {law}", lambda a, t=truth, w=law: (a["truth"], a["law"]) == (t, w))
        for truth in LAWS
        for law in LAWS
    ]
    groups.append(("all", lambda a: True))
    groups.append(("all in which no law is preferred", lambda a: a["preferred"] is None))
    for words, chosen in groups:
        lines.append(line(words, of([a for a in found if chosen(a)])))
    for name in PARAMETERS:
        lines.append(line(f"all, {name}", [a["parameters"][name] for a in found]))
    right = sum(a["preferred"] == a["truth"] for a in found)
    wrong = sum(a["preferred"] not in (None, a["truth"]) for a in found)
    lines.append(
        f"the data preferred the law that made them in {right} of {len(found)} fits, the other in {wrong}, none in "
        f"{len(found) - right - wrong}; {sum(not a['converged'] for a in found)} not converged; said not to be determined: "
        f"{sum(e['undetermined'] for e in of(found))} parameters; median {np.median([a['seconds'] for a in found]):.1f} s a fit"
    )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--valves", type=int, default=24)
    parser.add_argument("--first", type=int, default=0, help="number of the first valve")
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    print(table(answers(range(options.first, options.first + options.valves), options.processes)))


if __name__ == "__main__":
    main()
