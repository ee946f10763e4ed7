"""Two records of one valve with a known difference: is it named, is nothing else, and do the intervals of differences hold the truth?

    compare_pairs.py [--pairs 40] [--seed 1] [--processes 1]    seed 1: development; 2: looked at once
    compare_pairs.py --show ...                                 only the table of the answers so far

Pairs by the reference simulator: random valves, three static tests of 256 rows at three temperatures and two supplies, a
workshop's noise (white or AR(1), stated or not), instruments with gains to 1 % and zeros to 0.5 % of the largest reading, off by the
same amounts in both records. In turn: nothing differs; the clearance does; the edges are worn; an effect is in one record only, or in
both in different amounts; the clearance differs and an effect is in one. Every fourth pair has the same oil off its data sheet in both.
Answers are appended to build/compare_pairs/*.jsonl; an interrupted run goes on where it stopped.
"""

import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest


sys.path.insert(0, str(Path(__file__).parent))

from _hidden_run import ROOT, answers_of_seeds, plain


WORK = ROOT / "build" / "compare_pairs"
KINDS = ("nothing", "clearance", "wear", "effect", "both")
GAIN, ZERO = 0.01, 0.005
NOISE = 2.5  # times that of the small bench: 0.01 l/min, 1 bar, 0.08 l/min
# Effects of one record and their amounts [SI], log-uniform; those that a data sheet allows either sign have it.
AMOUNTS = {
    "pilot_leakage": (2e-10, 3e-9),
    "bushing_leakage": (4e-14, 5e-13),
    "hysteresis": (0.3e-6, 3e-6),
    "unequal_underlap": (2e-6, 8e-6),
    "supply_edge_wear": (4e-6, 15e-6),
    "cross_port_leakage": (4e-14, 5e-13),
    "null_shift_temperature": (8e-9, 50e-9),
    "flow_saturation": (3e13, 2e14),
}
EITHER_SIGN = ("unequal_underlap", "null_shift_temperature")


@dataclass(frozen=True)
class Truth:
    """Both records of a pair: parameters and effects of each, what the instruments are off by, and the noise."""

    kind: str
    valves: tuple[dict[str, float], dict[str, float]]
    effects: tuple[dict[str, float], dict[str, float]]
    gains: dict[str, float]
    zeros: dict[str, float]  # shares of the largest reading
    phi: float
    declared: bool

    def difference(self, name: str) -> float:
        """Second minus first; an effect that neither has: 0."""
        own = [{**self.effects[i], **self.valves[i]}.get(name, 0.0) for i in (0, 1)]
        return own[1] - own[0]

    @property
    def differing(self) -> tuple[str, ...]:
        names = {**self.valves[0], **self.effects[0], **self.effects[1]}
        return tuple(name for name in names if self.difference(name) != 0.0)


def truth_of(seed: int, number: int) -> Truth:
    """Everything of pair `number` from its own seed."""
    random = np.random.default_rng([14, seed, number])
    kind = KINDS[number % len(KINDS)]
    valve = {
        "edge_radius": random.uniform(4e-6, 18e-6),
        "clearance": random.uniform(1.5e-6, 4e-6),
        "underlap": random.uniform(1e-6, 15e-6),
        "discharge_coefficient": random.uniform(0.62, 0.76),
        "transition_number": random.uniform(70.0, 140.0),
        "null_bias": random.uniform(-3e-6, 3e-6),
    }
    other, effects = dict(valve), ({}, {})
    sign = lambda: float(random.choice([-1.0, 1.0]))
    drawn = lambda low, high: float(np.exp(random.uniform(np.log(low), np.log(high))))
    if kind in ("clearance", "both"):
        other["clearance"] = max(valve["clearance"] + sign() * drawn(0.1e-6, 0.8e-6), 0.7e-6)
    if kind == "wear":
        other["edge_radius"] = valve["edge_radius"] + drawn(1.5e-6, 10e-6)
    if kind in ("effect", "both"):
        name = str(random.choice(list(AMOUNTS)))
        amount = drawn(*AMOUNTS[name]) * (sign() if name in EITHER_SIGN else 1.0)
        which = int(random.integers(2))
        effects[which][name] = amount
        if kind == "effect" and random.random() < 0.4:
            effects[1 - which][name] = amount * random.uniform(0.2, 0.6)
    if number % 4 == 3:
        shift = sign() * random.uniform(0.06, 0.2)
        effects[0]["viscosity_shift"] = effects[1]["viscosity_shift"] = shift
    channels = ("leakage_flow", "load_pressure", "flow")
    return Truth(
        kind,
        (valve, other),
        effects,
        {channel: 1.0 + GAIN * random.standard_normal() for channel in channels},
        {channel: ZERO * random.standard_normal() for channel in channels},
        0.5 if number % 3 == 2 else 0.0,
        number % 2 == 0,
    )


def records_of(seed: int, number: int, truth: Truth) -> list[Any]:
    """Both records, as a reader returns them."""
    sys.path.insert(0, str(ROOT / "tests"))
    from helpers.small_bench import small_record

    from thermohyd.identify.bench.sensors import Sensor

    records = []
    for which in (0, 1):
        record = small_record(
            truth.effects[which],
            seed=10_000 * seed + 2 * number + which,
            phi=truth.phi,
            noise=NOISE,
            declared=truth.declared,
            valve=truth.valves[which],
        )
        tests = {}
        for name, test in record.tests.items():
            (channel,) = test.channels
            largest = float(np.max(np.abs(channel.value)))
            # The same zero in both records, of the first one's largest reading.
            size = largest if not records else float(np.max(np.abs(records[0].tests[name].channels[0].value)))
            value = channel.value * truth.gains[channel.name] + truth.zeros[channel.name] * size
            sensor = Sensor(channel.name, tolerance=GAIN, zero_tolerance=ZERO * largest)
            tests[name] = replace(test, channels=(replace(channel, value=value, sensor=sensor),))
        records.append(replace(record, tests=tests, folder=Path(("before", "after")[which])))
    return records


def ask(job: tuple[int, int]) -> dict[str, Any]:
    """One pair's answer; a failure is an answer too."""
    seed, number = job
    from thermohyd.identify.cli.jax_setup import keep_memory_flat, set_up_jax

    set_up_jax()
    from thermohyd.identify.comparison.study import compare

    truth = truth_of(seed, number)
    name = f"pair_{number:02d}"
    try:
        result = compare(*records_of(seed, number, truth))
    except Exception as error:
        return {"record": name, "error": f"{type(error).__name__}: {error}"}
    finally:
        keep_memory_flat()
    rows = {
        row.name: {
            "state": row.state,
            "difference": row.difference,
            "std": row.std,
            "std_apart": row.std_apart,
            "ci95": row.ci95,
            "p_value": row.p_value,
            "alternatives": row.alternatives,
            "truth": truth.difference(row.name),
        }
        for row in result.rows
    }
    return plain(
        {
            "record": name,
            "headline": result.headline,
            "truth": asdict(truth),
            "differing": truth.differing,
            "rows": rows,
            "shared": [entry.name for entry in result.shared],
            "verdicts": [d.verdict for d in result.diagnoses],
            "named": [[e.name for e in d.effects] for d in result.diagnoses],
            "effects": result.effects,
            "same_p": result.same_p,
            "one_of": [e.names for e in result.one_of],
            "converged": result.converged,
            "seconds": result.seconds,
        }
    )


def share(hits: int, of: int) -> str:
    """A rate with its 95 % interval (Wilson)."""
    if not of:
        return "none"
    band = binomtest(hits, of).proportion_ci(method="wilson")
    return f"{hits} of {of}, {hits / of:.1%} ({band.low:.1%} to {band.high:.1%})"


def _of_effects(good: list[dict[str, Any]], effects: set[str], *, rivals: bool) -> list[dict[str, Any]]:
    rows = [row for a in good for name, row in a["rows"].items() if row["ci95"] and name in effects]
    return [row for row in rows if bool(row["alternatives"]) == rivals]


def table(answers: dict[str, dict[str, Any]]) -> str:
    good = [a for a in answers.values() if "error" not in a]
    pairs = [(a, name) for a in good for name in a["differing"]]
    named = [(a, name) for a, name in pairs if a["rows"].get(name, {}).get("state") == "differs"]
    of_rivals = [
        (a, name)
        for a, name in pairs
        if (a, name) not in named
        and any(row["state"] == "differs" and name in row["alternatives"] for row in a["rows"].values())
    ]
    one_of = [
        (a, n)
        for a, n in pairs
        if (a, n) not in [*named, *of_rivals] and any(n in names for names in a.get("one_of", []))
    ]
    wrong = [
        (a, n) for a in good for n, row in a["rows"].items() if row["state"] == "differs" and n not in a["differing"]
    ]
    false = [(a, n) for a, n in wrong if not {*a["rows"][n]["alternatives"]} & {*a["differing"]}]
    effects = {name for a in good for name in (*a["effects"], *AMOUNTS)}
    entries = {
        "parameters and instruments": [r for a in good for n, r in a["rows"].items() if r["ci95"] and n not in effects],
        "effects without a rival": _of_effects(good, effects, rivals=False),
        "effects with a rival": _of_effects(good, effects, rivals=True),
    }
    equal = [row for a in good for n, row in a["rows"].items() if row["ci95"] and n not in a["differing"]]
    lines = [
        f"{len(good)} pairs; differences named: {share(len(named), len(pairs))}",
        f"  as a rival of what is named: {len(of_rivals)}; as one of what may differ: {len(one_of)}",
        f"pairs with a false difference: {share(len({a['record'] for a, _ in false}), len(good))}",
        f"false differences of entries that are equal: {share(len(false), len(equal))}",
        "intervals of differences that hold the truth:",
    ]
    for words, own in {**entries, "all": [row for rows in entries.values() for row in rows]}.items():
        inside = sum(row["ci95"][0] <= row["truth"] <= row["ci95"][1] for row in own)
        z = [(row["difference"] - row["truth"]) / row["std"] for row in own]
        lines.append(f"  {words}: {share(inside, len(own))}; rms z {np.sqrt(np.mean(np.square(z or [np.nan]))):.2f}")
    for name in dict.fromkeys(n for a in good for n in a["rows"]):
        own = [a["rows"][name] for a in good if name in a["rows"]]
        ratio = [row["std"] / row["std_apart"] for row in own if row["std_apart"]]
        held = [row["ci95"][0] <= row["truth"] <= row["ci95"][1] for row in own if row["ci95"]]
        tight = f"{np.median(ratio):.2f} (median)" if ratio else "-"
        lines.append(f"  {name:24s} error over that of two fits {tight:15s} interval holds {sum(held)} of {len(held)}")
    for kind in KINDS:
        own = [a for a in good if a["truth"]["kind"] == kind]
        hits = sum(a["rows"].get(n, {}).get("state") == "differs" for a in own for n in a["differing"])
        lines.append(f"{kind:10s} {len(own)} pairs, named {hits} of {sum(len(a['differing']) for a in own)}")
    for a, name in pairs:
        if (a, name) not in named:
            row = a["rows"].get(name, {})
            lines.append(
                f"missed: {a['record']} {name} {row.get('truth')} {row.get('state', 'not in the model')}: {a['headline']}"
            )
    lines += [f"false: {a['record']} {name} p {a['rows'][name]['p_value']:.1g}: {a['headline']}" for a, name in false]
    lines += [f"failed: {a['record']}: {a['error']}" for a in answers.values() if "error" in a]
    lines.append(f"median {np.median([a['seconds'] for a in good] or [np.nan]):.0f} s a pair")
    return "\n".join(lines)


def main() -> None:
    print(table(answers_of_seeds(__doc__ or "", "pair", 40, WORK, 2, ask)[1]))


if __name__ == "__main__":
    main()
