"""Records as a real bench makes them: `python -m reference.real_bench_records FOLDER --set N`, tests/ on the path.

FOLDER/<record>/ gets bench.toml and one CSV per test: noisy or rounded positions, rounded readings, correlated noise that is mostly
not stated, several rates, now and then a missing test. What is hidden there goes to FOLDER/truth.json. Fixed seeds.
"""

import argparse
import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from reference import hidden_outside
from reference.hidden_bench import CHANNELS, OILS, noise_of
from reference.hidden_records import HiddenRecord
from reference.hidden_size import delta
from reference.make_samples import write_text
from reference.real_bench import UNITS, Bench, Readings
from reference.real_bench_faults import as_truth, shown, written_rows
from reference.real_bench_plan import SEEDS, Hidden, beside_ideal, exact, plan
from reference.sample_text import LABEL, csv_text


ABOVE = 2  # lines of a file above its first row: the label and the header
LARGE = 600  # rows from which a file is written as gzip


def record_of(name: str, hidden: Hidden) -> HiddenRecord:
    felt = exact(hidden)
    csv = {_file(hidden.bench, test): _csv(hidden, test, felt) for test in hidden.bench.tests}
    return HiddenRecord(name, _truth(hidden), _bench_toml(name, hidden), csv)


def _file(bench: Bench, test: str) -> str:
    return f"{test}.csv.gz" if len(bench.runs_of(test)) * bench.points > LARGE else f"{test}.csv"


def _rounded(values: np.ndarray, step: float) -> list[str]:
    """As a logger writes them: whole steps, with the digits that the step has."""
    digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return [format(value, f".{digits}f") for value in np.round(values / step) * step + 0.0]


def _csv(hidden: Hidden, test: str, felt: Readings) -> str:
    bench, rows = hidden.bench, written_rows(hidden.bench, hidden.faults)[test]
    random = np.random.default_rng([*bench.seed, 1, list(CHANNELS).index(test)])
    position = rows.spool_position + bench.position_noise * random.standard_normal(len(rows.spool_position))
    names = [run.name for run in bench.runs_of(test)]
    table = {
        "time [s]": [format(t, ".3f") for t in bench.clock(test)],
        "run": [name for name in names for _ in range(bench.points)],
        "spool_position [um]": _rounded(position * 1e6, bench.position_step * 1e6),
        "supply_pressure [bar]": [format(p / 1e5, ".1f") for p in rows.supply_pressure],
        "temperature [degC]": [format(t - 273.15, ".1f") for t in rows.temperature],
    }
    for channel in CHANNELS[test]:
        if channel in bench.noise:
            unit, size = UNITS[channel]
            noise = np.concatenate([noise_of(random, bench.noise[channel], bench.phi, bench.points) for _ in names])
            value = shown(bench, test, channel, felt[test, channel] + noise, hidden.faults)
            table[f"{channel} [{unit}]"] = _rounded(value / size, bench.step[channel] / size)
    return csv_text([], table)


def _bench_toml(name: str, hidden: Hidden) -> str:
    bench = hidden.bench
    lines = [LABEL, "", "[valve]", f'name = "{name}"', 'stroke = "213 um"']
    lines += [f'slot_width = "{bench.valve.slot_width * 1e3:g} mm"', 'rated_flow = "9.8 l/min"']
    lines += ['rated_pressure_drop = "70 bar"', "", "[oil]", OILS[bench.oil_name][0], ""]
    lines += ["[conditions]", 'return_pressure = "0 bar"']
    for test in bench.tests:
        lines += ["", f"[tests.{test}]", f'file = "{_file(bench, test)}"']
        if hidden.declared:
            stated = {
                c: f"{bench.noise[c] / UNITS[c][1]:.3g} {UNITS[c][0]}" for c in CHANNELS[test] if c in bench.noise
            }
            if not bench.raw:
                stated["spool_position"] = (
                    f"{np.hypot(bench.position_noise, bench.position_step * 12**-0.5) * 1e6:.3g} um"
                )
            lines.append("noise = { " + ", ".join(f'{c} = "{size}"' for c, size in stated.items()) + " }")
    return "\n".join(lines) + "\n"


def _truth(hidden: Hidden) -> dict[str, Any]:
    """All SI. delta: noise units that all that is hidden leaves beside the six parameters; delta_of: of each, beside the others."""
    bench, scale = hidden.bench, hidden.scale
    kind, amount = hidden.outside or ("", 0.0)
    hiding = bool(hidden.effects or hidden.faults or hidden.outside)
    return {
        "kind": hidden.kind,
        "effects": hidden.effects,
        "faults": [as_truth(bench, fault, ABOVE) for fault in hidden.faults],
        "outside": {"name": kind, "amount": amount, "sentence": hidden_outside.SENTENCES[kind]} if kind else None,
        "delta": delta(scale.whitened(beside_ideal(scale, hidden)), scale.columns) if hiding else 0.0,
        "delta_of": hidden.sizes,
        "parameters": {
            k: float(v) for k, v in asdict(bench.valve).items() if k not in ("slot_width", "null_pressure", "edge_law")
        },
        "noise": "AR(1)" if bench.phi else "white",
        "phi": bench.phi,
        "noise_std": {c: bench.noise[c] for _, c in bench.channels},
        "noise_declared": hidden.declared,
        "position_noise": bench.position_noise,
        "position_step": bench.position_step,
        "dither": bench.dither,
        "ports_measured": "pressure_a" in bench.noise,
        "oil": bench.oil_name,
        "raw_log": bench.raw,
        "tests": list(bench.tests),
        "rows": len(bench.runs) * bench.points,
    }


def write(folder: Path, hidden: Iterable[tuple[str, Hidden]]) -> list[str]:
    """Write records and their truth; returns the records' names."""
    truth = {}
    for record in (record_of(name, one) for name, one in hidden):
        for file, text in {"bench.toml": record.bench_toml, **record.csv}.items():
            write_text(folder / record.name / file, text)
        truth[record.name] = record.truth
    write_text(folder / "truth.json", json.dumps(truth, indent=1) + "\n")
    return list(truth)


def main(arguments: Iterable[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--set", type=int, choices=tuple(SEEDS), default=1, help="the last one is looked at once")
    parser.add_argument("--only", nargs="*", metavar="RECORD", help="these records, such as bench_07")
    given = parser.parse_args(None if arguments is None else list(arguments))
    np.seterr(all="raise", under="ignore")
    made = write(given.folder, plan(given.set, set(given.only) if given.only else None))
    print(len(made), "records in", given.folder)


if __name__ == "__main__":
    main()
