"""What does each nuisance of a log do to the tests that a diagnosis rests on? The true effects are given, nothing is left to find.

    nuisances.py [--records 20] [--first 1] [--off conditions position ...] [--stated] [--brief] [--diagnose]

A line a record: p of the lack-of-fit test and the least of each of its families, the reduced chi-square, mean square of the whitened
residuals by sixths of |reading| and of |position|, and how residuals of gauges of one row go together. Then how the p-values are
spread. The logs are the reference simulator's (tests/reference/nuisance_logs.py), the same random numbers with `--off` as without.
--diagnose: whole diagnoses that know nothing instead: verdict, names, and whether the intervals of the parameters hold the truth.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.stats import binomtest, kstest


ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from reference.nuisance_logs import NUISANCES, Log, draw, write

from thermohyd.identify.cli.jax_setup import keep_memory_flat, set_up_jax


set_up_jax()

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.diagnosis.case import open_case, with_noise_around
from thermohyd.identify.diagnosis.diagnose import diagnose
from thermohyd.identify.diagnosis.left_over import families_left, misfit_left, smooth_block


SIXTHS = 6
PARAMETERS = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
TRUSTED = ("named", "ambiguous")


def judged(folder: Path, log: Log) -> dict:
    """What is left beside the true effects, of a fit that begins at the true valve: which valley a search finds is not asked here."""
    case, effects = open_case(read_record(folder)), tuple(log.effects)
    fit = case.problem.fit(effects, {n: float(getattr(log.valve, n)) for n in PARAMETERS}, hop_basins=True)
    if effects:
        case = with_noise_around(case, fit)
        fit = case.problem.fit(effects, fit.values, hop_basins=True)
    problem = case.problem
    block = smooth_block(problem, len(fit.residual))
    left, families = misfit_left(problem, fit, block), families_left(problem, fit, block)
    squares, apart = {}, {}
    leverage = 1.0 - np.sum(np.linalg.qr(fit.nuisance)[0] ** 2, axis=1)
    for (name, channel), rows in problem.rows().items():
        test, used = problem.tests[name], fit.used[rows]
        square = fit.residual[rows] ** 2 / np.maximum(leverage[rows], 0.1)
        for what, along in (
            ("reading", np.abs(test.channel(channel).value)),
            ("position", np.abs(test.spool_position)),
        ):
            order = np.argsort(along[used], kind="stable")
            squares[name, channel, what] = [float(np.mean(p)) for p in np.array_split(square[used][order], SIXTHS)]
        for other, own in problem.rows().items():
            if other[0] == name and other[1] > channel:
                apart[name, channel, other[1]] = float(np.corrcoef(fit.residual[rows], fit.residual[own])[0, 1])
    return {
        "p": left.p_value,
        "families": {name: [float(one.p_value) for one in tests] for name, tests in families.items()},
        "chi2": fit.chi2 / max(int(fit.used.sum()) - len(fit.free), 1),
        "squares": squares,
        "gauges": apart,
        "points": int(fit.used.sum()),
    }


def diagnosed(folder: Path, log: Log) -> dict:
    """What a whole diagnosis says of a log. first: the first name is right, or an alternative of it; false: names that are neither."""
    result = diagnose(read_record(folder))
    of = lambda effect: {effect.name, *(other.name for other in effect.alternatives)}
    right = [bool(of(effect) & set(log.effects)) for effect in result.effects]
    intervals = {n: result.parameters[n].ci95 for n in PARAMETERS if n in result.parameters}
    return {
        "verdict": result.verdict,
        "names": [effect.name for effect in result.effects],
        "first": bool(right) and right[0],
        "false": sum(not one for one in right),
        "inside": [ends[0] <= getattr(log.valve, n) <= ends[1] for n, ends in intervals.items() if ends is not None],
        "chi2": result.gap_after,
        "p": result.left_over_p,
    }


def shown(hits: list[bool]) -> str:
    """A rate with its exact 95 % interval (Clopper and Pearson)."""
    interval = binomtest(sum(hits), len(hits)).proportion_ci() if hits else (0.0, 1.0)
    return f"{sum(hits)} of {len(hits)} ({100 * interval[0]:.0f} to {100 * interval[1]:.0f} %)"


def all_diagnosed(seeds: range, most_rows: int) -> None:
    """Whole diagnoses, a line each, and their rates."""
    found: list[tuple[Log, dict]] = []
    for seed in seeds:
        log, began = draw(seed, most_rows=most_rows), time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            write(Path(folder) / f"log_{seed}", log)
            said = diagnosed(Path(folder) / f"log_{seed}", log)
        keep_memory_flat()
        found.append((log, said))
        kind = f"{'stated' if log.stated else 'not stated'}, {log.rows} rows, phi {log.phi:.2f}"
        print(
            f"{seed}: {', '.join(log.effects) or 'nothing'}, {kind}: "
            f"{said['verdict']} {', '.join(said['names']) or '-'}, chi-square {said['chi2']:.2f}, p {said['p']:.2g}, intervals "
            f"{sum(said['inside'])} of {len(said['inside'])}, {time.process_time() - began:.0f} s",
            flush=True,
        )
    single, empty = ([said for log, said in found if bool(log.effects) is one] for one in (True, False))
    print(
        f"right first name: {shown([s['first'] for s in single])}, named or ambiguous with it "
        f"{shown([s['first'] and s['verdict'] in TRUSTED for s in single])}; consistent where nothing is missing: "
        f"{shown([s['verdict'] == 'consistent' for s in empty])}; records with a false name that is trusted: "
        f"{shown([s['false'] > 0 and s['verdict'] in TRUSTED for _, s in found])}; 95 % intervals that hold the truth, "
        f"where the verdict is trusted: "
        f"{shown([i for _, s in found if s['verdict'] in (*TRUSTED, 'consistent') for i in s['inside']])}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--first", type=int, default=1, help="first seed; others, another set")
    parser.add_argument("--off", nargs="*", default=[], choices=NUISANCES, help="nuisances that the logs have not")
    parser.add_argument("--stated", action="store_true", help="every row's noise stands beside it, in all records")
    parser.add_argument("--brief", action="store_true", help="a line a record, without sixths and gauges")
    parser.add_argument("--most-rows", type=int, default=30_000)
    parser.add_argument("--diagnose", action="store_true", help="whole diagnoses, which are told nothing")
    given = parser.parse_args()
    if given.diagnose:
        return all_diagnosed(range(given.first, given.first + given.records), given.most_rows)
    p, curves, sixths = [], [], []
    for seed in range(given.first, given.first + given.records):
        log = draw(seed, off=given.off, stated=True if given.stated else None, most_rows=given.most_rows)
        began = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            write(Path(folder) / f"log_{seed}", log)
            found = judged(Path(folder) / f"log_{seed}", log)
        keep_memory_flat()
        p.append(found["p"])
        curves += [value for name, values in found["families"].items() for value in values if name == "curves"]
        sixths += [value for values in found["squares"].values() for value in values]
        kind = f"{'two gauges' if 'pressure_a' in log.noise else 'load pressure'}, {'current' if log.current else 'position'}"
        print(
            f"{seed}: {log.rows} rows a test, {found['points']} points, {kind}, {'stated' if log.stated else 'not stated'}, "
            f"phi {log.phi:.2f}, {', '.join(log.effects) or 'nothing'}: p {found['p']:.2g}, chi-square {found['chi2']:.2f}, "
            f"{time.process_time() - began:.0f} s"
        )
        if not given.brief:
            print("    " + ", ".join(f"{n} {min(v):.2g} of {len(v)}" for n, v in found["families"].items() if v))
            for key, values in found["squares"].items():
                print(f"    {' '.join(key)}: {' '.join(f'{v:.2f}' for v in values)}")
            for key, value in found["gauges"].items():
                print(f"    {' '.join(key)} correlate by {value:+.2f}", flush=True)
    p, sixths = np.array(p), np.array(sixths)
    inside = np.mean((sixths > 0.85) & (sixths < 1.15))
    # The least of several tests, times their number, is uniform only where it is small; the test over all curves is one test.
    print(
        f"p of all curves uniform: Kolmogorov-Smirnov {kstest(curves, 'uniform').pvalue:.2g}; "
        f"p of what is left below 0.001 in {np.mean(p < 1e-3):.1%}, below 0.05 in "
        f"{np.mean(p < 0.05):.0%} of {len(p)}; mean square by sixths inside 0.85 to 1.15: {inside:.0%}"
    )


if __name__ == "__main__":
    main()
