"""A FitResult made by hand, for tests of what the user sees: the numbers are plausible, no fit was run."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from thermohyd.identify.bench.record import BenchRecord, Provenance, RecordFile, ValveData
from thermohyd.identify.fitting.result import ChannelFit, FitResult, Identifiability, ParameterEstimate, StartOutcome
from thermohyd.oil_definition import OilDefinition


STROKE = 213e-6


def _reading(test: str, x: np.ndarray, supply: float, celsius: float) -> np.ndarray:
    """A rough valve: sharp edges, mean opening, viscosity only as a factor."""
    opens = np.hypot(np.maximum(15e-6 + x, 0.0), 4e-6)
    closes = np.hypot(np.maximum(15e-6 - x, 0.0), 4e-6)
    jet = 0.7 * 12e-3 * np.sqrt(supply / 870.0) * (1.0 + 0.003 * (celsius - 40.0))
    if test == "leakage":
        return 2.0 * jet * opens * closes / np.hypot(opens, closes)
    if test == "flow_gain":
        return jet * (opens - closes)
    return supply * (opens**2 - closes**2) / (opens**2 + closes**2)


def fake_channel(test: str, channel: str, noise: float, seed: int, points: int = 60) -> ChannelFit:
    rng = np.random.default_rng(seed)
    sweep = np.linspace(-0.95 * STROKE, 0.95 * STROKE, points)
    parts = []
    for run, (celsius, bar) in enumerate([(20.0, 70.0), (40.0, 70.0), (70.0, 70.0), (40.0, 140.0)]):
        for direction in (1, -1):
            model = _reading(test, sweep * direction, bar * 1e5, celsius)
            parts.append((sweep * direction, model, direction, run, bar * 1e5, celsius + 273.15))
    x, predicted = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    direction, run, supply, temperature = (np.repeat([float(part[i]) for part in parts], points) for i in (2, 3, 4, 5))
    measured = predicted + rng.normal(0.0, noise, x.size) + 0.6 * noise * np.sin(x / 30e-6)
    return ChannelFit(
        test=test,
        channel=channel,
        position=x,
        measured=measured,
        predicted=predicted,
        std=np.full(x.size, noise),
        predicted_std=np.full(x.size, 0.3 * noise),
        direction=direction.astype(int),
        run=run.astype(int),
        supply_pressure=supply,
        temperature=temperature,
        residual_rms=float(np.sqrt(np.mean((measured - predicted) ** 2))),
        noise=noise,
        noise_source="scatter of the rows within each bin of the sweep",
        reduced_chi2=float(np.mean(((measured - predicted) / noise) ** 2)),
        autocorrelation=0.21,
        effective_size=0.65 * x.size,
    )


def fake_parameters() -> dict[str, ParameterEstimate]:
    def estimate(name, value, unit, std, start, lower, upper, **more):
        ci = None if std is None else (value - 1.96 * std, value + 1.96 * std)
        return ParameterEstimate(name, value, unit, std, ci, start, lower, upper, **more)

    um = 1e-6
    parameters = (
        estimate("edge_radius", 14.93 * um, "m", 0.118 * um, 10 * um, 0.0, 200 * um),
        estimate("clearance", 2.031 * um, "m", 0.042 * um, 3 * um, 0.05 * um, 50 * um, prior_std=0.5 * um),
        estimate("underlap", 15.12 * um, "m", 0.33 * um, 5 * um, -106 * um, 106 * um),
        estimate("discharge_coefficient", 0.7012, "dimensionless", 0.0021, 0.7, 0.05, 2.0),
        estimate(
            "transition_number",
            1.0,
            "dimensionless",
            None,
            100.0,
            1.0,
            10000.0,
            at_bound=True,
            why_no_error_bar="it ended at its lower bound: the data want a sharper edge than the law has",
        ),
        estimate("null_bias", -1.27 * um, "m", 0.011 * um, 0.0, -106 * um, 106 * um),
        estimate(
            "heat_retention", 0.0, "dimensionless", None, 0.0, 0.0, 1.0, fixed=True, why_no_error_bar="held fixed"
        ),
    )
    return {parameter.name: parameter for parameter in parameters}


def fake_fit(name: str = "seed valve, made by hand", folder: Path = Path("seed_valve"), **changes) -> FitResult:
    """A converged fit of three tests with one parameter at its bound; `changes` replace fields of the FitResult."""
    valve = ValveData(name, STROKE, 12e-3, 6.9e-3, 9.8 / 6e4, 70e5)
    record = BenchRecord(folder, name, valve, OilDefinition(8.8, 3.45, name="seed oil"), {})
    free = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "null_bias")
    parameters = fake_parameters()
    correlation = np.eye(5)
    for i, j, r in ((0, 2, 0.93), (0, 1, -0.71), (1, 2, -0.55), (2, 3, 0.32), (3, 4, 0.02)):
        correlation[i, j] = correlation[j, i] = r
    std = np.array([parameters[n].std for n in free])
    channels = (
        fake_channel("leakage", "leakage_flow", 0.004 / 6e4, 1),
        fake_channel("pressure_gain", "load_pressure", 0.35e5, 2),
        fake_channel("flow_gain", "flow", 0.05 / 6e4, 3),
    )
    starts = [
        StartOutcome({n: parameters[n].start for n in free}, cost, converged, message, steps)
        for cost, converged, message, steps in (
            (1391.2, True, "converged", 9),
            (1391.2, True, "converged", 12),
            (1391.21, True, "converged", 15),
            (4402.7, True, "converged", 22),
            (9120.0, False, "the largest number of steps was reached", 100),
        )
    ]
    result = FitResult(
        record=record,
        parameters=parameters,
        free=free,
        covariance=correlation * std[:, None] * std,
        correlation=correlation,
        reduced_chi2=1.17,
        chi2=1391.2,
        degrees_of_freedom=931.0,
        channels=channels,
        identifiability=Identifiability(
            48.3,
            (41.0, 12.0, 5.0, 2.1, 0.85),
            ("edge_radius and underlap trade off: +0.71 -0.70",),
            ("discharge_coefficient and slot_width only ever appear as a product.",),
        ),
        rows=146_220,
        points=1440,
        seconds=1.83,
        converged=True,
        message="converged",
        starts=tuple(starts),
        notes=("leakage: 50,000 rows became 480 points in bins along each sweep.",),
        warnings=("flow_gain: readings above 4 l/min are rounded to 0.4 l/min; they are believed to that step only.",),
        verdict=(
            "The ideal valve describes this record to within 1.2 times its noise.",
            "The largest misfit is in leakage between +20 and +60 um.",
        ),
    )
    return replace(result, **changes)


def with_files(record: BenchRecord) -> BenchRecord:
    """The record as if it had been read from two files."""
    files = (RecordFile("bench.toml", "ab" * 32, None, None), RecordFile("leakage.csv", "cd" * 32, 800, 790))
    return replace(record, provenance=Provenance("/bench/mine", files, "2026-03-04T05:06:07+01:00", "0.1.0"))
