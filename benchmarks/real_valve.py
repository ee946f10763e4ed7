"""A real servovalve (../shared/real, not part of the project): does a sweep rate that the fit never saw come out right?

    real_valve.py [--out FOLDER | --diagnose]

Leakage sweeps of 50 and 200 s and the pressure gain, weighed with 0.02 l/min and 8 bar, are fitted without one leakage sweep, which is then
predicted: with either law of the edge, with and without oil stored at the ports. Ends at once where the record is absent. --out: a picture.
--diagnose: instead what a diagnosis says of the record as it is, and what it takes; --without NAME,NAME: with these out of its library.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from recovery import state


RECORD = Path(__file__).parents[2] / "shared" / "real" / "servovalve_5329"
NOISE = {"leakage": 0.02 / 6e4, "pressure_gain": 8e5}  # SI: what a model of this kind can be asked for, not the meters'
OTHERS = ("hysteresis", "flowmeter_lag", "pilot_leakage")
STORAGE = ("port_compliance_a", "port_compliance_b")
TO_UNIT = 6e4  # m3/s to l/min


def weighed(record: Any, law: str) -> Any:
    """The tests that are fitted, at these weights."""
    tests = {}
    for name, size in NOISE.items():
        test = record.tests[name]
        (channel,) = test.channels
        std = np.full(test.rows, size)
        tests[name] = replace(test, channels=(replace(channel, std=std, std_source="declared in bench.toml"),))
    return replace(record, tests=tests, valve=replace(record.valve, edge_law=law))


def left_out(record: Any, law: str) -> list[dict[str, Any]]:
    """The answers of one law: each sweep left out in turn, without and with storage."""
    from thermohyd.identify.fitting.fit import run_fit
    from thermohyd.identify.fitting.library import library_for
    from thermohyd.identify.fitting.problem import Problem
    from thermohyd.identify.fitting.readings import white_noise

    plain = run_fit(weighed(record, law))
    library = library_for(plain.tests.values())
    problem = Problem(plain.record, plain.tests, plain.plans, library, white_noise(plain.noise))
    leakage = plain.tests["leakage"]
    rows = problem.rows()["leakage", "leakage_flow"]
    size = plain.noise["leakage", "leakage_flow"].used * TO_UNIT
    count = sum(test.rows for test in plain.tests.values())
    found = []
    for number, run in enumerate(leakage.run_names):
        held = leakage.run == number
        used = np.ones(count, dtype=bool)
        used[rows] = ~held
        for stored in ((), STORAGE):
            began = time.perf_counter()
            fit = problem.with_rows(used).fit((*OTHERS, *stored), plain.values, hop_basins=True)
            residual = (problem.evaluate(fit.values, fit.effects).residual[rows] * size)[held]
            shown = leakage.place[held], leakage.channels[0].value[held] * TO_UNIT, residual
            own = float(np.sqrt(np.mean((fit.residual[rows][~held] * np.broadcast_to(size, held.shape)[~held]) ** 2)))
            found.append({
                "law": law, "left_out": run, "storage": bool(stored), "rms": float(np.sqrt(np.mean(residual**2))),
                "rms_fitted": own, "converged": fit.converged, "seconds": time.perf_counter() - began,
                "values": {name: fit.values[name] for name in fit.free}, "shown": shown,
            })  # fmt: skip
            print(line(found[-1]), flush=True)
    return found


def line(answer: dict[str, Any]) -> str:
    with_or_without = "with storage" if answer["storage"] else "without"
    amounts = "".join(
        f"  {name[-1].upper()} {answer['values'][name]:.2e}" for name in STORAGE if name in answer["values"]
    )
    return (
        f"{answer['law']:12s} {answer['left_out']:12s} {with_or_without:13s} {answer['rms']:.4f} l/min on it, "
        f"{answer['rms_fitted']:.4f} on the other one{amounts}{'' if answer['converged'] else '  (did not converge)'}"
    )


def picture(found: list[dict[str, Any]], folder: Path) -> Path:
    """Readings and predictions of the sweeps left out, and what is left, the cases side by side."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    cases = list(dict.fromkeys((a["law"], a["left_out"]) for a in found))
    figure, axes = pyplot.subplots(2, len(cases), figsize=(5.0 * len(cases), 7.0), sharex="col", squeeze=False)
    for i, (law, run) in enumerate(cases):
        above, below = axes[:, i]
        above.set_title(f"{run} left out, {law} law", fontsize=10)
        for answer in (a for a in found if (a["law"], a["left_out"]) == (law, run)):
            place, measured, residual = answer["shown"]
            label = f"{'with' if answer['storage'] else 'without'} storage, RMS {answer['rms']:.3f}"
            colour = "tab:blue" if answer["storage"] else "tab:orange"
            if not answer["storage"]:
                above.plot(place * 1e6, measured, ".", color="0.6", markersize=3, label="measured")
            above.plot(place * 1e6, measured + residual, "-", color=colour, linewidth=1.0, label=label)
            below.plot(place * 1e6, residual, ".-", color=colour, markersize=2, linewidth=0.5)
        above.legend(fontsize=8, loc="upper right")
        below.axhline(0.0, color="0.5", linewidth=0.5)
        below.set_xlabel("spool position (nominal) [um]")
    axes[0, 0].set_ylabel("leakage [l/min]")
    axes[1, 0].set_ylabel("model - reading [l/min]")
    figure.tight_layout()
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "real_valve.png"
    figure.savefig(file, dpi=110)
    return file


def diagnosed(record: Any, without: list[str]) -> None:
    """Print what a diagnosis says and takes, and what the command in a second process takes."""
    from thermohyd.identify import diagnose

    result = diagnose(record, without=without)
    said = result.summary().replace(str(RECORD), RECORD.name)  # a page names no folder of one machine
    command = [Path(sys.executable).with_name("thermohyd"), "diagnose", RECORD]
    command += ["--without", ",".join(without)] if without else []
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        subprocess.run([*command, "--out", f"{folder}/out"], check=True, capture_output=True)
        again = time.perf_counter() - began
    print(f"{result.seconds:.0f} s; then as a command in a second process, its report written, {again:.0f} s\n{said}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder for the picture")
    parser.add_argument("--laws", nargs="+", default=["orifice", "lubrication"])
    parser.add_argument(
        "--diagnose", action="store_true", help="instead: what a diagnosis says of the record, in words"
    )
    parser.add_argument(
        "--without", default="", metavar="NAME,NAME", help="effects taken out of that diagnosis' library"
    )
    options = parser.parse_args()
    if not (RECORD / "bench.toml").is_file():
        print(f"no record in {RECORD.parent.name}/{RECORD.name}: nothing done", file=sys.stderr)
        return
    from thermohyd.identify import read_record
    from thermohyd.identify.cli.jax_setup import set_up_jax

    set_up_jax()
    print(state())
    record = read_record(RECORD)
    if options.diagnose:
        diagnosed(record, [name for name in options.without.split(",") if name])
        return
    found = [answer for law in options.laws for answer in left_out(record, law)]
    if options.out is not None:
        print(picture(found, options.out))


if __name__ == "__main__":
    main()
