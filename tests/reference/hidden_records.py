"""Bench records in which an effect is hidden: `python -m reference.hidden_records FOLDER [--set 1|2|3|kept]`, tests/ on the path.

FOLDER/<record>/ gets bench.toml and one CSV per test; what is hidden goes to FOLDER/truth.json, outside every record.
Fixed seeds: the same files come out every time.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from reference import hidden_outside
from reference.hidden_bench import CHANNELS, OILS, noise_of
from reference.hidden_plan import SEEDS, Hidden, deltas, plan
from reference.hidden_size import delta, parameter_columns, whitened
from reference.make_samples import write_text
from reference.sample_text import LABEL, csv_text
from reference.valve import Effects


# The unit of each reading in the files, its size in SI, and how it is written.
READINGS = {
    "leakage_flow": ("l/min", 1e-3 / 60.0, ".5f"),
    "load_pressure": ("bar", 1e5, ".3f"),
    "pressure_a": ("bar", 1e5, ".3f"),
    "pressure_b": ("bar", 1e5, ".3f"),
    "flow": ("l/min", 1e-3 / 60.0, ".4f"),
}

# Records of set 1 that are kept in data/hidden: singles, none, a pair, outside; white and correlated noise.
KEPT = ("bench_23", "bench_26", "bench_27", "bench_38", "bench_48", "bench_65", "bench_69", "bench_76")


@dataclass(frozen=True)
class HiddenRecord:
    """One record as text, and its truth, which belongs outside the record's folder."""

    name: str
    truth: dict[str, Any]
    bench_toml: str
    csv: dict[str, str]  # by file name


def records(seed_set: int, only: tuple[str, ...] = ()) -> Iterator[HiddenRecord]:
    """The records of set 1 (development), 2 or 3 (looked at once, at the end); `only` those names, or all."""
    for number, hidden in enumerate(plan(seed_set), start=1):
        name = f"bench_{number:02d}"
        if not only or name in only:
            yield record_of(name, hidden)


def record_of(name: str, hidden: Hidden) -> HiddenRecord:
    exact = _exact(hidden)
    csv = {f"{test}.csv.gz": _csv(hidden, test, exact) for test in CHANNELS}
    return HiddenRecord(name, _truth(hidden, exact), _bench_toml(name, hidden), csv)


def _exact(hidden: Hidden) -> hidden_outside.Readings:
    if hidden.outside:
        return hidden_outside.readings(hidden.bench, *hidden.outside)
    return hidden.bench.ideal(hidden.bench.valve, Effects(**hidden.effects))


def _csv(hidden: Hidden, test: str, exact: hidden_outside.Readings) -> str:
    """All runs of a test: every condition once, then the second runs of those that have one."""
    bench, rows = hidden.bench, hidden.bench.rows(test)
    random = np.random.default_rng([*hidden.seed, list(CHANNELS).index(test)])
    count = 2 * bench.points
    assert rows.time is not None
    runs = [k for copy in (1, 2) for k in range(len(bench.copies)) if bench.copies[k] >= copy]
    index = np.concatenate([np.arange(k * count, (k + 1) * count) for k in runs])
    column = lambda values, size, fmt: [format(v / size, fmt) for v in values[index]]
    table = {
        "time [s]": column(rows.time, 1.0, ".2f"),
        "run": [str(number) for number in range(1, len(runs) + 1) for _ in range(count)],
        "spool_position [um]": column(rows.spool_position, 1e-6, ".2f"),
        "supply_pressure [bar]": column(rows.supply_pressure, 1e5, ".1f"),
        "temperature [degC]": column(rows.temperature - 273.15, 1.0, ".1f"),
    }
    for channel in CHANNELS[test]:
        if channel not in bench.noise:
            continue
        unit, size, fmt = READINGS[channel]
        noise = np.concatenate([noise_of(random, bench.noise[channel], bench.phi, count) for _ in runs])
        table[f"{channel} [{unit}]"] = [format(v / size, fmt) for v in exact[test, channel][index] + noise]
    return csv_text([], table)


def _bench_toml(name: str, hidden: Hidden) -> str:
    bench = hidden.bench
    lines = [
        LABEL,
        "",
        "[valve]",
        f'name = "{name}"',
        'stroke = "213 um"',
        f'slot_width = "{bench.valve.slot_width * 1e3:g} mm"',
        'land_diameter = "6.9 mm"',
        'rated_flow = "9.8 l/min"',
        'rated_pressure_drop = "70 bar"',
        "",
        "[oil]",
        OILS[bench.oil_name][0],
        "",
        "[conditions]",
        'return_pressure = "0 bar"',
    ]
    for test, channels in CHANNELS.items():
        lines += ["", f"[tests.{test}]", f'file = "{test}.csv.gz"']
        channel = next(c for c in channels if c in bench.noise)
        if hidden.declared:
            unit, size, _ = READINGS[channel]
            lines.append(f'noise = "{bench.noise[channel] / size:.4g} {unit}"')
    return "\n".join(lines) + "\n"


def _truth(hidden: Hidden, exact: hidden_outside.Readings) -> dict[str, Any]:
    """All SI. delta: noise units left beside the six parameters; delta_of: of each effect beside the others too."""
    bench = hidden.bench
    ideal = bench.ideal(bench.valve, Effects())
    signature = whitened(bench, {k: exact[k] - ideal[k] for k in exact})
    kind, amount = hidden.outside or ("", 0.0)
    outside = {"name": kind, "amount": amount, "sentence": hidden_outside.SENTENCES[kind]} if kind else None
    rows = int(sum(bench.copies)) * 2 * bench.points
    return {
        "kind": hidden.kind,
        "effects": hidden.effects,
        "outside": outside,
        "strength": hidden.strength,
        "parameters": {
            k: float(v) for k, v in asdict(bench.valve).items() if k not in ("slot_width", "null_pressure", "edge_law")
        },
        "noise": "AR(1)" if bench.phi else "white",
        "phi": bench.phi,
        "noise_std": bench.noise,
        "noise_declared": hidden.declared,
        "ports_measured": "pressure_a" in bench.noise,
        "oil": bench.oil_name,
        "rows": rows * len(CHANNELS),
        "readings": rows * len(exact),
        "raw_delta": float(np.linalg.norm(signature)),
        "delta": delta(signature, parameter_columns(bench)) if signature.any() else 0.0,
        "delta_of": deltas(bench, hidden.effects),
    }


def write(folder: Path, made: Iterator[HiddenRecord]) -> list[str]:
    """Write records and their truth; returns the records' names."""
    truth = {}
    for record in made:
        write_text(folder / record.name / "bench.toml", record.bench_toml)
        for file, text in record.csv.items():
            write_text(folder / record.name / file, text)
        truth[record.name] = record.truth
    write_text(folder / "truth.json", json.dumps(truth, indent=1) + "\n")
    return list(truth)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--set",
        choices=(*map(str, SEEDS), "kept"),
        default="1",
        help="1: development; kept: data/hidden; the others: looked at once",
    )
    arguments = parser.parse_args()
    np.seterr(all="raise", under="ignore")
    made = records(1, KEPT) if arguments.set == "kept" else records(int(arguments.set))
    print(len(write(arguments.folder, made)), "records in", arguments.folder)


if __name__ == "__main__":
    main()
