"""Simulation-based calibration: is the posterior that --posterior draws the posterior?

    calibration.py [--records 1000] [--minutes 10] [--together 25] [--draw]

Parameters are drawn from the priors of `[start]`, a record is made of them by the reference simulator in tests/, and the posterior is
drawn as the program draws it. Among the draws of an exact posterior the true value has any rank with the same probability (Talts et
al., "Validating Bayesian inference algorithms with simulation-based calibration", arXiv 1804.06788, 2018). The edge radius lies so near
its limit 0 that the limit cuts the prior and most of the posteriors. Ranks are appended to build/calibration/ranks.jsonl, and an
interrupted run goes on where it stopped. It ends after so many minutes of processor time. --draw: the figure alone, of the ranks that
are there, into docs/figures/calibration.png, with the share of draws beneath the truth against the uniform one and the band that holds
all of 95 % of exact samplers' curves (Säilynoja, Bürkner and Vehtari, Statistics and Computing 32, 2022; here by simulation).
"""

import argparse
import json
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from _commit import commit


ROOT = Path(__file__).parents[1]
STORE = ROOT / "build" / "calibration" / "ranks.jsonl"
FIGURE = ROOT / "docs" / "figures" / "calibration.png"
PRIORS = {  # centre, standard deviation, lower limit: SI
    "edge_radius": (4e-6, 4e-6, 0.0),
    "clearance": (3e-6, 0.7e-6, 0.05e-6),
    "underlap": (6e-6, 3e-6, -np.inf),
    "discharge_coefficient": (0.7, 0.04, 0.05),
    "transition_number": (100.0, 20.0, 1.0),
    "null_bias": (0.0, 2e-6, -np.inf),
}
WARMUP, DRAWS, THIN = 100, 100, 2
ROWS: dict[str, Any] = {"points": 11, "temperatures": (293.15, 333.15), "supplies": (210e5,), "noise": 40.0}


def drawn_from_priors(rng: np.random.Generator) -> dict[str, float]:
    truth = {}
    for name, (centre, std, lower) in PRIORS.items():
        value = -np.inf
        while value <= lower:
            value = float(centre + std * rng.standard_normal())
        truth[name] = value
    return truth


def record_of(truth: dict[str, float], rng: np.random.Generator) -> Any:
    from helpers.records import synthetic_record
    from reference.valve import Valve

    from thermohyd.identify.bench.record import StartValue

    start: dict[str, Any] = {name: StartValue(centre, prior_std=std) for name, (centre, std, _) in PRIORS.items()}
    made: dict[str, Any] = {**truth}
    return synthetic_record(Valve(slot_width=12e-3, **made), rng, **ROWS, **start)


def ranks_of(numbers: list[int], at: str) -> list[dict[str, Any]]:
    """Of each record the ranks of the truth among its thinned draws, and how many of its trajectories diverged."""
    from thermohyd.identify.fitting.fit import StaticSearch
    from thermohyd.identify.fitting.outcome import Fitted, uncertainty_of
    from thermohyd.identify.fitting.parameters import plan_parameters
    from thermohyd.identify.noise.level import initial_noises
    from thermohyd.identify.uncertainty.log_posterior import log_posterior
    from thermohyd.identify.uncertainty.sampler import draw_each

    targets, truths = [], []
    for number in numbers:
        rng = np.random.default_rng([57, number])
        truth = drawn_from_priors(rng)
        record = record_of(truth, rng)
        plans = plan_parameters(record.valve, record.start)
        free = tuple(name for name in plans if not plans[name].fixed)
        search = StaticSearch(record, record.tests, plans, free)
        noise = initial_noises(record.tests.values())
        start = np.array([truth[name] for name in free])
        solution = search.basin_hopping(search.solve(search.args(noise), start), noise)
        fitted = Fitted(record, record.tests, plans, free, noise, solution, (), ())
        # The noise is known to be white and of its stated size: what the residuals make of it is left out.
        targets.append(log_posterior(fitted, as_stated(uncertainty_of(fitted))))
        truths.append(start)
    first = targets[0]
    found = draw_each(
        first.density, [t.data for t in targets], np.stack([t.start for t in targets]),
        np.stack([t.covariance for t in targets]), warmup=WARMUP, draws=DRAWS, target=0.9, seed=numbers[0],
    )  # fmt: skip
    rows = []
    for k, (number, target, truth) in enumerate(zip(numbers, targets, truths, strict=True)):
        own = np.array([np.asarray(target.clamp.physical(u)) for u in found.draws[k, ::THIN]])
        ranks = {name: int(np.sum(own[:, i] < truth[i])) for i, name in enumerate(target.names)}
        rows.append(
            {
                "record": number,
                "of": len(own),
                "ranks": ranks,
                "divergent": int(found.divergent[k].sum()),
                "commit": at,
            }
        )
    return rows


def as_stated(known: Any) -> Any:
    from dataclasses import replace

    from thermohyd.identify.noise.correlation import NoiseCorrelation

    blocks = {key: replace(b, correlation=NoiseCorrelation(), variance=1.0) for key, b in known.blocks.items()}
    return replace(known, blocks=blocks)


def stored() -> list[dict[str, Any]]:
    return [json.loads(line) for line in STORE.read_text().splitlines()] if STORE.exists() else []


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=1000)
    parser.add_argument("--minutes", type=float, default=10.0, help="of processor time")
    parser.add_argument("--together", type=int, default=25)
    parser.add_argument("--draw", action="store_true")
    asked = parser.parse_args()
    if not asked.draw:
        sys.path.insert(0, str(ROOT / "tests"))
        import jax

        jax.config.update("jax_enable_x64", True)
        STORE.parent.mkdir(parents=True, exist_ok=True)
        done = {row["record"] for row in stored()}
        open_ = [number for number in range(asked.records) if number not in done]
        at = commit()  # of the code that this process has read
        while open_ and time.process_time() < 60.0 * asked.minutes:
            now, open_ = open_[: asked.together], open_[asked.together :]
            if len(now) < asked.together:  # another shape would be compiled for the rest
                break
            rows = ranks_of(now, at)
            with STORE.open("a") as file:
                file.writelines(json.dumps(row) + "\n" for row in rows)
            print(f"{now[-1] + 1} records, {time.process_time():.0f} s of processor time", file=sys.stderr, flush=True)
    rows = stored()
    print(table(rows))
    draw(rows)


def shares(rows: list[dict[str, Any]], name: str, rng: np.random.Generator) -> np.ndarray:
    """Of every record the place of the truth among its draws, 0 to 1, ties and steps broken by lot; sorted."""
    place = np.array([(row["ranks"][name] + rng.random()) / (row["of"] + 1) for row in rows])
    return np.sort(place)


def band(records: int, grid: np.ndarray, rng: np.random.Generator) -> float:
    """Half width, in standard deviations of the count, of the band that holds all of 95 % of uniform samples' curves."""
    sd = np.sqrt(grid * (1.0 - grid) / records)
    worst = [
        np.max(np.abs(np.searchsorted(np.sort(rng.random(records)), grid, side="right") / records - grid) / sd)
        for _ in range(4000)
    ]
    return float(np.quantile(worst, 0.95))


def excess(rows: list[dict[str, Any]], name: str, grid: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.searchsorted(shares(rows, name, rng), grid, side="right") / len(rows) - grid


GRID = np.linspace(0.02, 0.98, 97)


def table(rows: list[dict[str, Any]]) -> str:
    from scipy.stats import chi2

    rng = np.random.default_rng(1)
    width = band(len(rows), GRID, rng)
    sd = np.sqrt(GRID * (1.0 - GRID) / len(rows))
    lines = [
        f"{len(rows)} records, {sum(row['divergent'] > 0 for row in rows)} of them with divergent trajectories.",
        "",
        "| parameter | in the 50 % interval | in the 95 % interval | p of chi-square over 10 bins | largest excess / band |",
        "|---|---|---|---|---|",
    ]
    for name in PRIORS:
        place = shares(rows, name, rng)
        inside = lambda level, place=place: np.mean(np.abs(place - 0.5) < 0.5 * level)
        count = np.histogram(place, bins=10, range=(0.0, 1.0))[0]
        p = chi2.sf(np.sum((count - len(rows) / 10) ** 2) / (len(rows) / 10), 9)
        ratio = np.max(np.abs(excess(rows, name, GRID, rng)) / sd) / width
        lines.append(f"| {name} | {100 * inside(0.5):.1f} % | {100 * inside(0.95):.1f} % | {p:.2f} | {ratio:.2f} |")
    return "\n".join(lines)


def draw(rows: list[dict[str, Any]]) -> None:
    from matplotlib.figure import Figure

    rng = np.random.default_rng(1)
    half = band(len(rows), GRID, rng) * np.sqrt(GRID * (1.0 - GRID) / len(rows))
    figure = Figure(figsize=(9.0, 5.2))
    axes = figure.subplots(2, 3, sharex=True, sharey=True)
    for ax, name in zip(axes.ravel(), PRIORS, strict=True):
        ax.fill_between(GRID, -half, half, color="#dbe6f2", linewidth=0.0)
        ax.axhline(0.0, color="#8a8a8a", linewidth=0.7)
        ax.plot(GRID, excess(rows, name, GRID, rng), color="#1f5fa8")
        ax.set_title(name.replace("_", " "), fontsize=10, loc="left")
    for ax in axes[-1]:
        ax.set_xlabel("share of draws beneath the truth")
    figure.supylabel("records beneath, less that share", fontsize=10, x=0.01)
    made = ", ".join(dict.fromkeys(str(row["commit"]) for row in rows))
    day = datetime.now(UTC).date().isoformat()
    figure.suptitle(
        f"{len(rows)} records drawn from the priors; commit {made}, {day}; band: 95 % of exact samplers", fontsize=9
    )
    figure.subplots_adjust(left=0.1, right=0.985, bottom=0.1, top=0.88, hspace=0.2, wspace=0.08)
    FIGURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(FIGURE, dpi=110)


if __name__ == "__main__":
    main()
