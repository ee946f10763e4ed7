"""A real position servo with a hanging load, logged in volts: half of its steps fitted, the other half predicted, and the jack's leak.

Reads ../shared/real/hanging_load from beside the checkout and stops where it is absent. Nobody knows this rig's valve, pressure,
areas, mass, oil or volts per millimetre: what stands in for them below scales the answers, which are therefore reported as
relative. The loop compares volts with volts, x_c = X_n 1.42 (reference - position)/10 V; the offset of its output is part of the
null bias. Known from its author: a small orifice joins the chambers.
A valve of a stated load for each of LOADS, the best one shown; in each fit all fourteen runs are integrated and seven count.
`python benchmarks/hanging_load.py FOLDER` prints all of it, the motor's curve too, and writes figures.json and a picture there.
`python benchmarks/hanging_load.py FOLDER terms` asks, with no leak in the library and the best load, where in the circuit something is
missing and with what (docs/diagnosis.md section 14.1), half of the steps held out.
`python benchmarks/hanging_load.py FOLDER diagnose [NAME ...]` prints a whole diagnosis of all steps, with these effects out of its library.
"""

import json
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import jax


jax.config.update("jax_enable_x64", True)

import numpy as np
from matplotlib.figure import Figure

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.test_record import TestRecord
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.fitting.library import Library
from thermohyd.identify.fitting.motion_readings import require_actuator
from thermohyd.identify.fitting.parameters import plan_motion
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit
from thermohyd.identify.fitting.problem_solution import solution_of
from thermohyd.identify.fitting.readings import white_noise
from thermohyd.identify.fitting.relative import with_relatives
from thermohyd.identify.fitting.sensed import sensor_plans
from thermohyd.identify.noise.level import initial_noises


REAL = Path(__file__).resolve().parents[2] / "shared" / "real" / "hanging_load"
STEP = 0.5  # V within 0.1 s: that of a setpoint
BEFORE, AFTER = 1.0, 19.0  # s about a step
DENSE, SPARSE, BUSY = 0.1, 1.0, 4.0  # s between rows, and until when after the step they lie dense
NOISE = 5e-3  # V
SUPPLY = 60e5  # Pa, stands in
LOADS = (0.0, -0.4, -0.8)  # of the supply pressure on 12 cm2; against +z
BEST_LOAD = -0.4
GAINS = (5e-3, 15e-3, 40e-3)  # m/V, where searches begin
STEPS = 40  # of a search, twice
LEAK = "jack_leakage"


def runs() -> list[dict[str, np.ndarray]]:
    """The fourteen steps: time from the step, reference and position in volts, a few rows each."""
    time, reference, position, _ = np.loadtxt(REAL / "HangingLoad.csv", delimiter=",").T
    ahead = np.interp(time + 0.1, time, reference) - reference
    places = np.flatnonzero(np.abs(ahead) > STEP)
    starts = [places[0], *(b for a, b in pairwise(places) if time[b] - time[a] > 5.0)]
    found = []
    for start in starts:
        origin = time[start]
        wanted = np.concatenate([
            np.arange(-BEFORE, -0.01, DENSE), np.arange(0.0, 0.2, 0.02), np.arange(0.2, BUSY, DENSE),
            np.arange(BUSY, AFTER, SPARSE),
        ])  # fmt: skip
        rows = np.unique(np.searchsorted(time, origin + wanted - 1e-6))
        rows = rows[rows < len(time)]
        found.append({"time": time[rows] - origin, "reference": reference[rows], "position": position[rows]})
    return found


def record_of(steps: list[dict[str, np.ndarray]], load: float) -> BenchRecord:
    """All steps as runs of one test. load: of the supply pressure."""
    column = lambda name: np.concatenate([step[name] for step in steps])
    names = np.concatenate([[f"{number:02d}"] * len(step["time"]) for number, step in enumerate(steps)])
    return BenchRecord.from_arrays(
        {
            "step": {
                "time": column("time"), "run": names, "command [V]": column("reference"),
                "piston_position [V]": column("position"),
            }
        },
        valve={
            "name": "hanging load", "rated_flow": "40 l/min", "rated_pressure_drop": "10 bar", "rated_current": "1 A"
        },
        oil="iso-vg-46",
        conditions={"supply_pressure": SUPPLY, "return_pressure": 0.0, "temperature": "40 degC"},
        actuator={
            "chamber_volume": "250 cm^3", "piston_stroke": "300 mm", "heat": "isothermal", "external_force": load * SUPPLY * 12e-4,
            "controller": {"amplifier_gain": "0.142 A/V"},
        },
        sensors={"piston_position": {"gain": "free", "zero": "5 V"}},
        noise={"step": {"piston_position": NOISE}},
        start={
            "null_bias": {"value": -0.02e-3, "fixed": False},
            "underlap": {"value": -0.02e-3, "fixed": False},
        },
    )  # fmt: skip


def problem_of(record: BenchRecord) -> Problem:
    tests: dict[str, TestRecord] = {**record.dynamic_tests}
    plans = plan_motion(record.valve, require_actuator(record), record.start) | sensor_plans(tests, record)
    noise = initial_noises(tests.values())
    plans = with_relatives(plans, tests, record)
    return Problem(record, tests, plans, Library((LEAK,), {}), white_noise(noise))


def fitted(problem: Problem, trained: np.ndarray, effects: tuple[str, ...], start: dict[str, float]) -> Fit:
    """Fitted to the runs that count, from `start` or from the best of GAINS."""
    part = problem.with_rows(trained)
    if not start:
        tried = [{"piston_position_gain": gain} for gain in GAINS]
        start = min(tried, key=lambda values: part.evaluate(values).chi2)
    found = part.fit(effects, start, most_steps=STEPS)
    return part.fit(effects, found.values, most_steps=STEPS)


def misfit(problem: Problem, fit: Fit) -> np.ndarray:
    """Model - reading of every row [mV], those that the fit did not see, too."""
    (test,) = problem.tests.values()
    return 1e3 * NOISE * problem.evaluate(fit.values, fit.effects).residual[: test.rows]


def main() -> None:
    if not REAL.exists():
        print("the record is not beside this checkout: nothing done", file=sys.stderr)
        return
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/hanging_load")
    folder.mkdir(parents=True, exist_ok=True)
    if "terms" in sys.argv[2:]:
        terms(folder)
        return
    if "diagnose" in sys.argv[2:]:
        diagnosed(sys.argv[sys.argv.index("diagnose") + 1 :])
        return
    steps = runs()
    up = np.concatenate([np.full(len(s["time"]), s["reference"][-1] > s["reference"][0]) for s in steps])
    number = np.concatenate([np.full(len(s["time"]), i) for i, s in enumerate(steps)])
    trained = number % 2 == 0
    print(f"{len(steps)} steps, {len(up)} rows")
    results, best = {}, {}
    for load in LOADS:
        problem = problem_of(record_of(steps, load))
        start: dict[str, float] = {}
        for effects in ((), (LEAK,)):
            found = fitted(problem, trained, effects, start)
            start = found.values
            what = LEAK if effects else "no leak"
            off = misfit(problem, found)
            figures = {
                f"{side} {which}": float(np.sqrt(np.nanmean(off[mask & part] ** 2)))
                for side, mask in (("up", up), ("down", ~up))
                for which, part in (("fitted", trained), ("predicted", ~trained))
            }
            print(f"load {load:+.1f}, {what}: chi2 {found.chi2:.0f}, {found.message}; "
                  + ", ".join(f"{k} {v:.1f} mV" for k, v in figures.items()), flush=True)  # fmt: skip
            results[f"load {load:+.1f}, {what}"] = {
                "rms_mV": figures, "chi2": found.chi2, "converged": found.converged,
                "runs_that_failed": len(np.unique(number[np.isnan(off)])), "parameters": parameters(problem, found),
            }  # fmt: skip
            if what not in best or found.chi2 < best[what][1].chi2:
                best[what] = off, found, load
    for what, (_, _, load) in best.items():
        print(f"{what}, load {load:+.1f}, the best one:")
        for name, p in results[f"load {load:+.1f}, {what}"]["parameters"].items():
            kind = "relative" if p["relative"] else "absolute"
            print(f"  {name:22s} {p['value']:12.4g} +- {p['std']:8.2g} {p['unit']:26s} {kind}")
    results["motor rotation"] = rotation_figures()
    (folder / "figures.json").write_text(json.dumps(results, indent=2) + "\n")
    picture(steps, number, best, folder / "hanging_load.png")


def terms(folder: Path) -> None:
    """Typed terms beside the machine without a leak, the steps that do not count held out."""
    from thermohyd.identify.diagnosis.held_out import Split
    from thermohyd.identify.diagnosis.learned import as_term
    from thermohyd.identify.diagnosis.typed_terms import terms_of
    from thermohyd.identify.fitting.library import NOTHING
    from thermohyd.identify.report.term_words import term_lines

    steps = runs()
    number = np.concatenate([np.full(len(s["time"]), i) for i, s in enumerate(steps)])
    trained = number % 2 == 0
    problem = replace(problem_of(record_of(steps, BEST_LOAD)), library=NOTHING)
    begun = fitted(problem, trained, (), {})
    fit = problem.fit((), begun.values, most_steps=STEPS)
    print(f"load {BEST_LOAD:+.1f}, no leak, all steps: chi2 {fit.chi2:.0f}, {fit.message}", flush=True)
    say = lambda words: print(words, file=sys.stderr, flush=True)
    found = tuple(as_term(one) for one in terms_of(problem, fit, Split(~trained, "every second step"), say))
    for one in found:
        print(f"{one.place} with {one.variable} ({one.law}): closes {one.gap_closed:.2f} of the steps held out, 2 ln E {one.proof:.1f}, "
              f"holds {one.holds}; {one.value:.3g} +- {one.std:.2g} {one.unit}; allowed too: {list(one.alternatives)}")  # fmt: skip
    lines = term_lines(found)
    print("\n".join(lines or ["no term beyond chance"]))
    kept = [{"place": o.place, "variable": o.variable, "law": o.law, "gap_closed": o.gap_closed, "holds": o.holds,
             "alternatives": [list(a) for a in o.alternatives]} for o in found]  # fmt: skip
    (folder / "terms.json").write_text(json.dumps(kept, indent=2) + "\n")


def diagnosed(without: list[str]) -> None:
    """What a diagnosis says of all steps; which of them it holds out is its own choice."""
    from thermohyd.identify.diagnosis.diagnose import diagnose

    say = lambda words: print(words, file=sys.stderr, flush=True)
    result = diagnose(record_of(runs(), BEST_LOAD), without=without, progress=say)
    print(
        f"load {BEST_LOAD:+.1f}; out of the library: {', '.join(without) or 'nothing'}; {result.seconds:.0f} s\n{result.summary()}"
    )


def rotation() -> BenchRecord:
    """MotorRotation.csv as a flow gain: a motor's speed in volts against the command in volts, ten of which are the stroke."""
    time, command, speed = np.loadtxt(REAL / "MotorRotation.csv", delimiter=",").T
    return BenchRecord.from_arrays(
        {"flow_gain": {"time": time, "spool_position [V]": command, "flow [V]": speed}},
        valve={"name": "motor rotation", "rated_flow": "40 l/min", "rated_pressure_drop": "10 bar"},
        oil="iso-vg-46",
        conditions={"supply_pressure": SUPPLY, "return_pressure": 0.0, "temperature": "40 degC"},
        sensors={"flow": {"gain": "free"}, "spool_position": {"gain": "10 %/V"}},
        start={"underlap": "-0.05 mm"},
    )


def rotation_figures() -> dict[str, dict]:
    """The static curve without and with hysteresis, and with the saturation that passages make."""
    record, found = rotation(), {}
    for effects in ((), ("hysteresis",), ("hysteresis", "flow_saturation")):
        result = fit(record, effects=effects)
        (channel,) = result.channels
        found[" and ".join(effects) or "ideal valve"] = {
            "rms_mV": 1e3 * channel.residual_rms,
            "converged": result.converged,
            "parameters": result.to_dict()["parameters"],
        }
        print(
            f"motor rotation, {effects}: {1e3 * channel.residual_rms:.1f} mV over {len(channel.measured)} points, {result.message}"
        )
    return found


def parameters(problem: Problem, fit: Fit) -> dict[str, dict]:
    """Values in the units that they are relative to, with the standard error of white noise of the residuals' size."""
    solution = solution_of(problem, fit)
    jacobian = solution.jacobian
    scale = np.sqrt(np.sum(jacobian**2, axis=0))
    spread = np.sqrt(np.diag(np.linalg.pinv((jacobian / scale).T @ (jacobian / scale)))) / scale
    spread *= np.sqrt(fit.chi2 / max(int(np.sum(fit.used)) - len(fit.free), 1))
    found = {}
    for name, std in zip(fit.free, spread, strict=True):
        relative = problem.plans[name].relative if name in problem.plans else None
        # An effect's amount is in SI with the area and the pressure that stand in.
        stands_in = name not in problem.plans
        size, unit = (1.0, "SI") if relative is None else (relative.size, relative.unit)
        found[name] = {
            "value": fit.values[name] / size,
            "std": std / size,
            "unit": f"{unit} of what stands in" if stands_in else unit,
            "relative": relative is not None or stands_in,
        }
    return found


def picture(steps: list[dict], number: np.ndarray, best: dict, path: Path) -> None:
    figure = Figure(figsize=(16.0, 9.0), layout="constrained")
    grid = figure.subplots(2, 7, sharex=True)
    for i, (step, axes) in enumerate(zip(steps, grid.ravel(), strict=False)):
        axes.plot(step["time"], step["reference"], color="0.8", label="reference")
        axes.plot(step["time"], step["position"], "k.", markersize=3, label="measured")
        for what, (off, _, load) in best.items():
            axes.plot(
                step["time"],
                step["position"] + 1e-3 * off[number == i],
                label=f"{what}, load {load:+.1f}",
                linewidth=1.0,
            )
        axes.set_title(f"step {i}, {'fitted' if i % 2 == 0 else 'predicted'}", fontsize=9)
    grid[0, 0].legend(fontsize=7)
    grid[1, 0].set_xlabel("time [s]")
    grid[0, 0].set_ylabel("position [V]")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
