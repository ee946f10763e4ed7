"""Raw logs in which nothing is missing: do intervals hold the truth, and does a diagnosis find nothing? `make hidden-logs`.

    hidden_raw_logs.py fit [--seeds 20]          coverage, rms z, reduced chi-square inside its own band
    hidden_raw_logs.py diagnose [--records 60]   verdict of each record
    hidden_raw_logs.py leakage [--seeds 20]      leakage alone, 20,000 rows, noise not stated, of any valve, oil and bench; with
                                                 --coefficient 0.78 of valves outside of what a fit holds near

The logs come from the reference simulator (tests/reference/raw_log_records.py).
"""

import argparse
import contextlib
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np


jax.config.update("jax_enable_x64", True)
ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from reference.raw_log_records import VALVE, Log, any_setting, plan, write

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.diagnosis.diagnose import diagnose
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.report.fit_report import chi2_band


NAMES = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
ALL = ("leakage", "flow_gain", "pressure_gain")
# rows of a test, tests, runs of each, every k-th row
FITS = ((2_000, ("leakage",), 1, 1), (20_000, ("leakage",), 1, 1), (6_000, ALL, 1, 1), (6_000, ALL, 1, 30),
        (20_000, ALL, 1, 1), (8_000, ALL, 2, 1))  # fmt: skip


def coverage(seeds: int, first: int) -> None:
    """One line per kind of log, and one per parameter."""
    for rows, tests, repeats, every in FITS:
        z: dict[str, list[float]] = {name: [] for name in NAMES}
        inside: dict[str, list[bool]] = {name: [] for name in NAMES}
        chi2, banded = [], []
        for seed in range(first, first + seeds):
            with tempfile.TemporaryDirectory() as folder:
                log = Log(rows, tests, seed, sine=bool(seed % 2), stated=bool(seed // 2 % 2), repeats=repeats)
                write(Path(folder), log, every)
                result = fit(read_record(folder))
            low, high = chi2_band(result.degrees_of_freedom, result.noise_freedom)
            chi2.append(result.reduced_chi2)
            banded.append(low <= result.reduced_chi2 <= high)
            for name in NAMES:
                found, true = result.parameters[name], float(np.asarray(getattr(VALVE, name)))
                if found.std:
                    z[name].append((found.value - true) / found.std)
                if found.ci95:
                    inside[name].append(found.ci95[0] <= true <= found.ci95[1])
        kind = f"{rows} rows, {'+'.join(tests)}, {repeats} run(s), every {every}"
        print(f"{kind}: reduced chi-square {min(chi2):.2f} to {max(chi2):.2f}, in its band in {np.mean(banded):.0%}")
        for name in NAMES:
            rms = np.sqrt(np.mean(np.square(z[name]))) if z[name] else np.nan
            print(f"   {name:22s} coverage {np.mean(inside[name]):.2f}  rms z {rms:.2f}", flush=True)


def leakage_alone(seeds: int, first: int, rows: int = 20_000, coefficient: float | None = None) -> list[str]:
    """The commonest record there is: each seed whose fit did not converge or whose intervals do not all hold the truth; then of each
    parameter how many intervals were given and held the truth, and how far off the farthest value was."""
    lines, converged, held = [], 0, 0
    off: dict[str, list[float]] = {name: [] for name in NAMES}
    inside: dict[str, list[bool]] = {name: [] for name in NAMES}
    for seed in range(first, first + seeds):
        setting = any_setting(seed, coefficient)
        with tempfile.TemporaryDirectory() as folder:
            write(Path(folder), Log(rows, ("leakage",), seed, sine=bool(seed % 2)), setting=setting)
            result = fit(read_record(folder))
        converged += result.converged
        missed = []
        for name in NAMES:
            found, true = result.parameters[name], float(np.asarray(getattr(setting.valve, name)))
            if found.ci95 is None:
                continue
            inside[name].append(found.ci95[0] <= true <= found.ci95[1])
            off[name] += [abs(found.value - true) / found.std] if found.std else []
            missed += [] if inside[name][-1] else [name]
        held += bool(result.parameters["discharge_coefficient"].prior_because)
        line = (
            f"{seed}: {setting.grade} cSt, {setting.supply * 1e-5:.0f} bar, {setting.temperature - 273.15:.0f} degC: {result.message}, "
            f"reduced chi-square {result.reduced_chi2:.2f}{'; interval without the truth: ' if missed else ''}{', '.join(missed)}"
        )
        print(line, file=sys.stderr, flush=True)
        lines += [line] if missed or not result.converged else []
    lines.append(f"converged: {converged} of {seeds}; flow coefficients held near the usual in {held}")
    for name in NAMES:
        farthest = f"{max(off[name]):.1f}" if off[name] else "-"
        lines.append(
            f"   {name:22s} interval given {len(inside[name])}, holds the truth {sum(inside[name])}; farthest {farthest} standard errors"
        )
    every = [held for name in NAMES for held in inside[name]]
    lines.append(f"intervals that hold the truth: {sum(every)} of {len(every)} ({np.mean(every):.0%})")
    return lines


def verdicts(records: int, first: int) -> None:
    """One line per record, then the count."""
    consistent = 0
    for log in plan(records, first):
        began = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            write(Path(folder), log)
            with contextlib.redirect_stdout(sys.stderr):
                result = diagnose(read_record(folder))
        consistent += result.verdict == "consistent"
        effects = ", ".join(f"{e.name} p {e.p_value:.1g} closed {e.gap_closed:.0%}" for e in result.effects)
        shape, known = "sine" if log.sine else "triangle", "stated" if log.stated else "not stated"
        print(
            f"{log.seed}: {log.rows} rows, {'+'.join(log.tests)}, {shape}, noise {known}: {result.verdict}"
            f"{f' ({effects})' if effects else ''}, reduced chi-square {result.gap_before:.2f}, left over p "
            f"{result.left_over_p:.2g}, {time.perf_counter() - began:.0f} s",
            flush=True,
        )
    print(f"consistent: {consistent} of {records}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("fit", "diagnose", "leakage"))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--records", type=int, default=60)
    parser.add_argument("--first", type=int, default=1000, help="first seed; other seeds, another set")
    parser.add_argument("--coefficient", type=float, help="discharge coefficient of all valves of `leakage`")
    arguments = parser.parse_args()
    if arguments.what == "leakage":
        print("\n".join(leakage_alone(arguments.seeds, arguments.first, coefficient=arguments.coefficient)))
    elif arguments.what == "fit":
        coverage(arguments.seeds, arguments.first)
    else:
        verdicts(arguments.records, arguments.first)


if __name__ == "__main__":
    main()
