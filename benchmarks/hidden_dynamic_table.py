"""Dynamic records with hidden physics, diagnosed and scored: who is named, and how honest the intervals are.

Every effect of the dynamic library at two strengths, ten records with nothing hidden, and pairs; noise white and AR(1) of
memory 0.6. Set 1 is for development; set 2, other seeds, is looked at once, when nothing changes any more. Records are made
by the reference simulator (SciPy) from fixed seeds with hidden values of the four identified parameters.
Answers stay in build/hidden_dynamic/set1; an interrupted run goes on where it stopped, as long as the program is the same.
`make hidden-dynamic`.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np


ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(Path(__file__).parent), str(ROOT / "tests")]

from _hidden_run import all_answered, answer_within
from reference import dynamic_bench
from reference.actuator import Dynamic


# Effect: a strength that shows faintly and one that shows well, on this jack with this noise.
STRENGTHS = {
    "coulomb_friction": (60.0, 200.0),
    "stribeck_friction": (100.0, 300.0),
    "backlash": (4e-6, 10e-6),
    "entrained_air": (0.01, 0.04),
    "jack_leakage": (1e-12, 6e-12),
    "flow_force": (1e-7, 4e-7),
    "spool_delay": (0.4e-3, 1.5e-3),
    "wall_heat": (10.0, 60.0),
}
PAIRS = (
    ("coulomb_friction", "spool_delay"),
    ("entrained_air", "flow_force"),
    ("backlash", "spool_delay"),
    ("coulomb_friction", "entrained_air"),
)
# Air makes oil soft at low pressure: at one pressure it is the bulk modulus by another name, so its records hold runs at two.
TWO_PRESSURES = (210.0, 70.0, 210.0)
MEMORY = 0.6
PATIENCE = 3600  # s, for one record, compiling included
NAMES = ("spool_frequency", "spool_damping", "bulk_modulus_factor", "viscous_friction")


def plan() -> dict[str, tuple[dict[str, float], float]]:
    """{record: (effects, memory of the noise)}; white and correlated noise take turns."""
    found: dict[str, tuple[dict[str, float], float]] = {}
    for i, (name, strengths) in enumerate(STRENGTHS.items()):
        for k, amount in enumerate(strengths):
            found[f"{name}_{k + 1}"] = {name: amount}, MEMORY * ((i + k) % 2)
    for i in range(10):
        found[f"none_{i + 1}"] = {}, MEMORY * (i % 2)
    for i, (a, b) in enumerate(PAIRS):
        found[f"pair_{i + 1}"] = {a: STRENGTHS[a][1], b: STRENGTHS[b][1]}, MEMORY * (i % 2)
    return found


def bench_of(seed: int, effects: dict[str, float], memory: float) -> dynamic_bench.Bench:
    random = np.random.default_rng(seed)
    factors = random.uniform(0.8, 1.2, 4)
    jack = dynamic_bench.plain().jack
    hidden = replace(
        jack,
        spool_frequency=100.0 * factors[0],
        spool_damping=0.7 * factors[1],
        bulk_modulus_factor=0.85 * factors[2],
        viscous_friction=2000.0 * factors[3],
    )
    return dynamic_bench.Bench(
        jack=hidden, dynamic=Dynamic(**effects), memory=memory, seed=seed, steps=(3.0, -6.0, 1.5), seconds=0.3,
        supplies=TWO_PRESSURES if "entrained_air" in effects else (),
    )  # fmt: skip


def ask(job: tuple[Path, int, dict[str, float], float]) -> dict[str, Any]:
    """The answer of one record, made for it."""
    folder, seed, effects, memory = job
    return answer_within(PATIENCE, folder, lambda record: answer(record, seed, effects, memory))


def answer(folder: Path, seed: int, effects: dict[str, float], memory: float) -> dict[str, Any]:
    """Make and diagnose a record."""
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.diagnosis.diagnose import diagnose

    bench = bench_of(seed, effects, memory)
    dynamic_bench.write(folder, bench)
    began = time.perf_counter()
    result = diagnose(read_record(folder))
    truth = {name: getattr(bench.jack, name) for name in NAMES} | effects
    inside = {
        name: bool(found.ci95[0] <= truth[name] <= found.ci95[1])
        for name, found in result.after.parameters.items()
        if found.ci95 is not None and name in truth
    }
    return {
        "record": folder.name,
        "headline": result.headline,
        "truth": effects,
        "memory": memory,
        "verdict": result.verdict,
        "named": [effect.name for effect in result.effects],
        "alternatives": {effect.name: [a.name for a in effect.alternatives] for effect in result.effects},
        "inside": inside,
        "least": {c.name: c.least for c in result.candidates if c.name in effects},
        "gap": [result.gap_before, result.gap_after],
        "seconds": time.perf_counter() - began,
    }


def table(answers: dict[str, dict]) -> str:
    """Every record, then the rates."""
    lines = [f"{'record':<22}{'noise':<7}{'verdict':<13}{'gap':<14}named (alternatives)"]
    for name, found in answers.items():
        told = ", ".join(n + (f" ({', '.join(a)})" if (a := found["alternatives"][n]) else "") for n in found["named"])
        gap = f"{found['gap'][0]:.2f} {found['gap'][1]:.2f}"
        lines.append(
            f"{name:<22}{'AR(1)' if found['memory'] else 'white':<7}{found['verdict']:<13}{gap:<14}{told or '-'}"
        )
    with_one = [f for f in answers.values() if len(f["truth"]) == 1]
    pairs = [f for f in answers.values() if len(f["truth"]) == 2]
    none = [f for f in answers.values() if not f["truth"]]
    told = lambda f: set(f["named"]) | {a for names in f["alternatives"].values() for a in names}
    first = sum(f["named"][:1] == list(f["truth"]) for f in with_one)
    among = sum(set(f["truth"]) <= told(f) for f in with_one)
    silent = sum(not f["named"] for f in with_one)
    # What the record cannot show at the program's own power of 80 % is not counted as missed.
    shown = [f for f in with_one if all((f["least"].get(n) or 0.0) <= a for n, a in f["truth"].items())]
    # Where an effect stays unnamed, parameters that swallowed it mean something else.
    right = [f for f in answers.values() if set(f["truth"]) == set(f["named"])]
    inside = [v for f in right for v in f["inside"].values()]
    seconds = [f["seconds"] for f in answers.values()]
    lines += [
        "",
        f"nothing hidden, something named:   {sum(bool(f['named']) for f in none)} of {len(none)}",
        f"one effect, named first:           {first} of {len(with_one)}; of those that can be seen: "
        f"{sum(f['named'][:1] == list(f['truth']) for f in shown)} of {len(shown)}",
        f"one effect, in name+alternatives:  {among} of {len(with_one)}   (nothing named: {silent})",
        f"pairs, both in name+alternatives:  {sum(set(f['truth']) <= told(f) for f in pairs)} of {len(pairs)}",
        f"nothing hidden, unexplained:       {sum(f['verdict'] == 'unexplained' for f in none)} of {len(none)}",
        f"truth inside its 95 % interval:    {sum(inside)} of {len(inside)} (records whose effects were all named)",
        f"seconds per record:                median {np.median(seconds):.0f}, most {max(seconds):.0f}",
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "hidden_dynamic")
    parser.add_argument("--set", type=int, choices=(1, 2), default=1, help="which seeds")
    parser.add_argument("--only", default="", help="records whose name holds this text")
    parser.add_argument("--processes", type=int, default=1, help="records diagnosed at a time")
    parser.add_argument("--any-version", action="store_true", help="keep answers of an earlier state of the program")
    options = parser.parse_args()
    out = options.out / f"set{options.set}"
    jobs = {
        name: (out / "records" / name, seed, *hidden)
        for seed, (name, hidden) in enumerate(plan().items(), 100 * options.set)
        if options.only in name
    }
    print(table(all_answered(out / "answers.jsonl", jobs, ask, options.processes, any_version=options.any_version)))


if __name__ == "__main__":
    main()
