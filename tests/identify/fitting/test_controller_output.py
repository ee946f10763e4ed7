"""A measured controller output of unknown gain that drives the valve, fitted end to end: as good as if the loop were known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from reference.actuator import Run
from reference.dynamic_bench import COLUMNS, noise, plain, toml
from reference.sample_text import csv_text
from reference.step_test import READINGS, readings

from thermohyd.identify.bench.read import read_record
from thermohyd.identify.fitting.fit import fit
from thermohyd.identify.fitting.parameters import IN_MOTION
from thermohyd.identify.fitting.result import FitResult
from thermohyd.identify.model.predict import simulate_record


# 1 ms: rows of 4 ms, fewer than two in a swing of piston and oil, leave two optima of the bulk modulus as good as each other.
MEASURED = ("spool_position", "pressure_a", "piston_position")
BENCH = plain(32, steps=(2.0, -1.5), seconds=0.1, spacing=1e-3, adiabatic=False, measured=MEASURED)
STROKE = 213e-6
GAIN = STROKE / 10.0  # m/V: 10 V open the valve fully


def output_of(run: Run) -> Run:
    """What the controller of a closed loop puts out, sampled and rounded as a log has it, as the command of an open one."""
    jack = BENCH.jack
    position = readings(BENCH.machine(run), rtol=1e-7)[:, READINGS.index("piston_position")]
    current = jack.amplifier_gain * jack.sensor_gain * (run.command - position)
    return replace(run, kind="spool_position", command=GAIN * np.round(STROKE * current / jack.rated_current / GAIN, 5))


def record_in(folder: Path) -> Path:
    """Two runs of a closed loop; the log has the controller's output in volts, and nobody says what a volt is."""
    random = np.random.default_rng(BENCH.seed)
    table: dict[str, list[str]] = {"time [s]": [], "run": [], "command [V]": []}
    for number, step in enumerate(BENCH.steps, 1):
        run = output_of(BENCH.run(step))
        found: dict[str, np.ndarray] = dict(zip(READINGS, readings(BENCH.machine(run)).T, strict=True))
        table["time [s]"] += [f"{t:.4f}" for t in run.time]
        table["run"] += [str(number)] * len(run.time)
        table["command [V]"] += [f"{c / GAIN:.5f}" for c in run.command]
        for name in BENCH.measured:
            unit, size, fmt = COLUMNS[name]
            read = found[name] / size + noise(random, len(run.time), BENCH.noise[name], 0.0)
            table.setdefault(f"{name} [{unit}]", []).extend(format(v, fmt) for v in read)
    said = '[sensors]\ncommand = { gain = "free" }\n\n[tests.step]\ncommand = "controller_output"\n'
    (folder / "bench.toml").write_text(toml(BENCH).replace("[tests.step]\n", said), encoding="utf-8")
    (folder / "step.csv").write_text(csv_text([], table), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> FitResult:
    return fit(read_record(record_in(tmp_path_factory.mktemp("output"))))


@pytest.mark.nightly  # a recovery
def test_the_truth_lies_inside_honest_intervals(found):
    assert found.converged, found.message
    assert found.free == (*IN_MOTION, "command_gain")
    truth = {name: getattr(BENCH.jack, name) for name in IN_MOTION} | {"command_gain": GAIN}
    for name, value in truth.items():
        estimate = found.parameters[name]
        assert estimate.std is not None, name
        print(f"{name}: {estimate.value:.5g} +- {estimate.std:.2g}, truth {value:.5g}")
        assert abs(estimate.value - value) < 3.5 * estimate.std, name
    assert found.parameters["command_gain"].std < 0.01 * GAIN
    assert 0.75 < found.reduced_chi2 < 1.25


def test_the_model_predicts_what_the_fit_drew(found):
    assert found.record is not None
    table = simulate_record(found.record, found.model)["step"]
    drawn = next(c for c in found.channels if c.channel == "piston_position")
    np.testing.assert_allclose(table["piston_position_predicted [mm]"], 1e3 * drawn.predicted, atol=1e-6)
