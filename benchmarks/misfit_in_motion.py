"""How far from the truth do parameters of a model of motion lie that misses an effect, in standard errors?

Records of hidden-dynamic-1 (benchmarks/hidden_dynamic_table.py) with the effect taken out of the model: the plain model, its error bars by
the noise alone (scaled by the reduced chi-square), by what remains (docs/diagnosis.md section 14.3), and the values that are given.
`python benchmarks/misfit_in_motion.py [RECORD...]`; records are made where build/hidden_dynamic/set1 has none.
"""

import subprocess
import sys
from datetime import UTC, datetime

import jax


jax.config.update("jax_enable_x64", True)

import numpy as np
from hidden_dynamic_table import NAMES, ROOT, bench_of, dynamic_bench, plan

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.diagnosis.diagnose import open_motion
from thermohyd.identify.diagnosis.remaining_misfit import remaining_misfit
from thermohyd.identify.fitting.problem_solution import gls_covariance, misfit_scale


RECORDS = ("coulomb_friction_2", "stribeck_friction_2", "backlash_2", "jack_leakage_2", "flow_force_2", "spool_delay_2")


def lines_of(name: str, seed: int, effects: dict[str, float], memory: float) -> list[str]:
    """One line for each parameter of motion of a record."""
    bench = bench_of(seed, effects, memory)
    folder = ROOT / "build" / "hidden_dynamic" / "set1" / "records" / name
    if not (folder / "bench.toml").exists():
        dynamic_bench.write(folder, bench)
    case = open_motion(read_record(folder), without=tuple(effects))
    problem, plain = case.problem, case.base
    found, priors = remaining_misfit(problem, plain), len(problem.parameters)
    by_noise = gls_covariance(plain, misfit_scale(problem, plain), priors).matrix
    held = found.by_noise(problem, plain).covariance(plain, priors).matrix
    given = found.covariance(found.fit, priors).matrix
    lines = []
    for parameter in NAMES:
        i, truth = plain.free.index(parameter), getattr(bench.jack, parameter)
        away = lambda fit, matrix, i=i, truth=truth, parameter=parameter: (
            f"{(fit.values[parameter] - truth) / np.sqrt(matrix[i, i]):8.1f}" if matrix[i, i] > 0.0 else f"{'limit':>8}"
        )
        share = lambda fit, truth=truth, parameter=parameter: f"{100.0 * (fit.values[parameter] / truth - 1.0):7.0f} %"
        lines.append(
            f"{name:<21}{parameter:<21}{away(plain, by_noise)}{away(plain, held)}{away(found.fit, given)}"
            f"{share(plain)}{share(found.fit)}"
        )
    return lines


def main(names: list[str]) -> None:
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True).stdout
    print(f"{datetime.now(UTC):%Y-%m-%d}, commit {commit.strip()}; standard errors from the truth, then shares of it")
    print(f"{'':<42}{'noise':>8}{'remains':>8}{'given':>8}{'plain':>9}{'given':>9}")
    for seed, (name, (effects, memory)) in enumerate(plan().items(), 100):
        if name in names:
            print("\n".join(lines_of(name, seed, effects, memory)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or list(RECORDS))
