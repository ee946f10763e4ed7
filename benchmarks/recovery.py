"""Does `fit` with one effect freed by name find it in noisy records, and do its 95 % intervals hold the truth?

    recovery.py [--effects NAME ...] [--records 50] [--phi 0.0] [--processes 1]

For each effect random valves by the reference simulator, each with a random amount of it: leakage, pressure gain (both ports) and flow gain
at three temperatures and two supplies, 41 rows a sweep of 12 or 60 s. phi: of AR(1) noise along a sweep, 0 white. Answers are appended
to build/recovery/*.jsonl; an interrupted run goes on where it stopped, as long as the program is the same.
"""

import argparse
import json
import sys
import time
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from _commit import commit
from _hidden_run import source_hash, stored
from _processes import answers_of
from joint_coverage import STATIC, line


ROOT = Path(__file__).parents[1]
WORK = ROOT / "build" / "recovery"

WEAR = (2e-6, 15e-6)
# Limits of the amount [SI], which the record shows: log-uniform where it is one-sided, else uniform with either sign.
AMOUNTS = {
    "edge_wear_pa": WEAR,
    "edge_wear_pb": WEAR,
    "edge_wear_at": WEAR,
    "edge_wear_bt": WEAR,
    "load_pressure_scale": (0.002, 0.03),
    "null_shift_temperature": (2e-9, 40e-9),
    "null_shift_pressure": (1e-14, 2e-13),
    "port_compliance_a": (1e-13, 2e-12),
    "port_compliance_b": (1e-13, 2e-12),
}
EITHER_SIGN = ("load_pressure_scale", "null_shift_temperature", "null_shift_pressure")

STROKE, SLOT_WIDTH = 213e-6, 12e-3  # m
POINTS = [[-40.0, 368.28], [100.0, 5.2244]]  # degC, cSt
CONDITIONS = tuple((t, p) for t in (0.0, 30.0, 60.0) for p in (70e5, 210e5))  # degC, Pa
SECONDS = (12.0, 60.0, 60.0, 12.0, 12.0, 60.0)  # of each condition's sweep, up and down
UP = 21
REACH = {"leakage": 1.0, "pressure_gain": 0.3, "flow_gain": 1.0}  # of the stroke
NOISE = {"leakage_flow": 0.004 / 6e4, "pressure_a": 0.4e5, "pressure_b": 0.4e5, "flow": 0.03 / 6e4}  # SI
CHANNELS = {"leakage": ("leakage_flow",), "pressure_gain": ("pressure_a", "pressure_b"), "flow_gain": ("flow",)}


def rows_of(test: str) -> Any:
    """A sweep up and down at every condition, denser near null; the points of the way down lie between those of the way up."""
    from reference.valve import Rows

    up = np.linspace(-1.0, 1.0, UP)
    s = np.concatenate([up, (0.5 * (up[:-1] + up[1:]))[::-1]])
    x = REACH[test] * STROKE * np.sinh(3.5 * s) / np.sinh(3.5)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))])
    count = len(CONDITIONS)
    spread = lambda values: np.repeat(np.asarray(values, dtype=float), len(x))
    return Rows(
        np.tile(x, count),
        spread([p for _, p in CONDITIONS]),
        np.zeros(len(x) * count),
        spread([t + 273.15 for t, _ in CONDITIONS]),
        time=np.concatenate([way / way[-1] * seconds for seconds in SECONDS]),
        run=np.repeat(np.arange(count), len(x)),
    )


def truth_of(effect: str, number: int) -> tuple[Any, float]:
    """(valve, amount) of record `number` of an effect: everything from its own seed."""
    from helpers.records import random_valve

    random = np.random.default_rng([2026, list(AMOUNTS).index(effect), number])
    valve = random_valve(random)  # of SLOT_WIDTH
    low, high = AMOUNTS[effect]
    amount = float(np.exp(random.uniform(np.log(low), np.log(high))))
    return valve, amount * (random.choice([-1.0, 1.0]) if effect in EITHER_SIGN else 1.0)


def exact_readings(valve: Any, effect: str, amount: float) -> dict[str, dict[str, np.ndarray]]:
    """{test: {channel: reading}} without noise, SI."""
    from reference import port_storage, static_tests
    from reference.oil import Oil, walther
    from reference.valve import Effects

    oil = Oil(*walther(POINTS))
    if not effect.startswith("port_compliance"):
        own = Effects(**{effect: amount})
        return {test: static_tests.TESTS[test](valve, oil, rows_of(test), own) for test in CHANNELS}
    compliance = (amount, 0.0) if effect.endswith("_a") else (0.0, amount)
    found = {
        test: port_storage.swept_together(valve, oil, rows_of(test), Effects(), compliance)
        for test in ("leakage", "pressure_gain")
    }
    return {**found, "flow_gain": static_tests.flow_gain(valve, oil, rows_of("flow_gain"))}


def record_of(effect: str, number: int, phi: float) -> Any:
    """Record `number`, its noise stated."""
    from reference.hidden_bench import noise_of

    from thermohyd.identify import BenchRecord

    valve, amount = truth_of(effect, number)
    exact = exact_readings(valve, effect, amount)
    random = np.random.default_rng([2027, list(AMOUNTS).index(effect), number])
    tests, noise = {}, {}
    for test, channels in CHANNELS.items():
        rows = rows_of(test)
        each = len(rows.run) // len(CONDITIONS)
        columns = {name: getattr(rows, name) for name in ("spool_position", "supply_pressure", "return_pressure",
                                                          "temperature", "time", "run")}  # fmt: skip
        for channel in channels:
            parts = [noise_of(random, NOISE[channel], phi, each) for _ in CONDITIONS]
            columns[channel] = exact[test][channel] + np.concatenate(parts)
        tests[test] = columns
        noise[test] = {channel: NOISE[channel] for channel in channels}
    body = {"name": f"{effect} {number}", "stroke": STROKE, "slot_width": SLOT_WIDTH}
    oil = {"viscosity": [[f"{t} degC", f"{v} cSt"] for t, v in POINTS]}
    return BenchRecord.from_arrays(tests, valve=body, oil=oil, noise=noise)


def ask(job: tuple[str, int, float]) -> dict[str, Any]:
    """One record's answer; a failure is an answer too."""
    effect, number, phi = job
    sys.path.insert(0, str(ROOT / "tests"))
    from thermohyd.identify import fit
    from thermohyd.identify.cli.jax_setup import set_up_jax

    set_up_jax()
    valve, amount = truth_of(effect, number)
    own = {"record": number, "effect": effect, "phi": phi}
    try:
        record = record_of(effect, number, phi)
        began = time.perf_counter()
        found = fit(record, effects=(effect,))
    except Exception as error:
        return {**own, "error": f"{type(error).__name__}: {error}"}
    truth = {**{name: float(getattr(valve, name)) for name in STATIC}, effect: amount}
    parameters = {
        name: {"truth": true, "value": float(p.value), "std": p.std, "ci95": p.ci95, "at_bound": p.at_bound}
        for name, true in truth.items()
        for p in [found.parameters[name]]
    }
    seconds = time.perf_counter() - began
    return {**own, "parameters": parameters, "reduced_chi2": found.reduced_chi2, "converged": found.converged,
            "seconds": seconds}  # fmt: skip


def answers(jobs: list[tuple[str, int, float]], processes: int) -> list[dict[str, Any]]:
    """Those of the records; only what this version of the program has not answered yet is asked."""
    store = WORK / "fit.jsonl"
    store.parent.mkdir(parents=True, exist_ok=True)
    version = source_hash(ROOT / "thermohyd", ROOT / "identify", ROOT / "tests" / "reference")
    key = lambda a: (a["effect"], a["record"], a["phi"])
    known = {key(a): a for a in stored(store) if a["version"] == version}
    left = [job for job in jobs if job not in known]
    began = time.monotonic()
    with store.open("a", encoding="utf-8") as out:
        for done, answer in enumerate(answers_of(ask, left, processes), start=1):
            out.write(json.dumps({**answer, "version": version}) + "\n")
            out.flush()
            known[key(answer)] = answer
            words = answer.get("error") or f"{answer['seconds']:.1f} s"
            took = f"{done}/{len(left)} {time.monotonic() - began:.0f} s"
            print(f"{took}  {answer['effect']} {answer['record']}: {words}", file=sys.stderr, flush=True)
    return [known[job] for job in jobs]


def table(found: list[dict[str, Any]]) -> str:
    """For each effect the coverage of its amount and of all six parameters beside it."""
    lines = [f"{'':22s} {'held the truth':>12s}  share  (95 % interval)  rms z  std, median  without"]
    good = [answer for answer in found if "error" not in answer]
    for effect in dict.fromkeys(answer["effect"] for answer in good):
        own = [answer["parameters"] for answer in good if answer["effect"] == effect]
        lines += [
            line(effect, [p[effect] for p in own]),
            line("  the six beside it", [p[n] for p in own for n in STATIC]),
        ]
    lines.append(line("all amounts", [a["parameters"][a["effect"]] for a in good]))
    lines.append(line("all parameters", [a["parameters"][name] for a in good for name in STATIC]))
    lines += [f"{a['effect']} {a['record']} failed: {a['error']}" for a in found if "error" in a]
    lines += [f"{a['effect']} {a['record']} did not converge" for a in good if not a["converged"]]
    return "\n".join(
        [*lines, f"{len(good)} records, median {np.median([a['seconds'] for a in good] or [np.nan]):.1f} s each"]
    )


def state() -> str:
    """Date and commit of the figures."""
    return f"{date.today().isoformat()}, commit {commit('--untracked-files=no', '--', 'thermohyd', 'identify', 'benchmarks')}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--effects", nargs="+", choices=list(AMOUNTS), default=list(AMOUNTS), metavar="NAME")
    parser.add_argument("--records", type=int, default=50, help="of each effect")
    parser.add_argument("--phi", type=float, default=0.0, help="of AR(1) noise along a sweep; 0: white")
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    jobs = [(effect, number, options.phi) for effect in options.effects for number in range(options.records)]
    noise = f"AR(1) noise, phi = {options.phi:g}" if options.phi else "white noise"
    text = f"{state()}; {noise}\n{table(answers(jobs, options.processes))}\n"
    (WORK / f"table_phi_{options.phi:g}.txt").write_text(text, encoding="utf-8")
    print(text, end="")


if __name__ == "__main__":
    main()
