"""DiagnosisResults made by hand, for tests of what the user sees: plausible numbers, no diagnosis was run."""

from dataclasses import replace
from typing import Any

import numpy as np

from helpers.fake_fit import fake_channel, fake_fit
from thermohyd.effects.library import EFFECTS
from thermohyd.identify.bench.test_record import Fault
from thermohyd.identify.diagnosis.result import (
    Alternative,
    Candidate,
    ChannelDiscrepancy,
    ChannelNoiseFound,
    Credit,
    DiagnosisResult,
    Evidence,
    HeldOut,
    NamedEffect,
    NextTest,
    ParameterShift,
    Proposal,
    Region,
    Variation,
)
from thermohyd.identify.fitting.result import ChannelFit, FitResult


UM, LPM = 1e-6, 1.0 / 6e4
CELSIUS = 273.15
ABSORBED = ("flowmeter_scale", "position_scale")
NAN = float("nan")
KINDS = ("consistent", "named", "two", "ambiguous", "unexplained", "helped", "learned")


def _gap(fit: ChannelFit) -> np.ndarray:
    """What a first stage that takes its own flow adds to the leakage, and a little hysteresis to the flow."""
    if fit.channel == "leakage_flow":
        return 0.045 * LPM * np.sqrt(fit.supply_pressure / 1e5) * (1.0 - 0.4 * np.exp(-((fit.position / 40e-6) ** 2)))
    if fit.channel == "flow":
        return 4.0 * fit.noise * fit.direction * np.exp(-((fit.position / 120e-6) ** 2))
    return np.zeros(len(fit.position))


def _shifted(fit: ChannelFit, by: np.ndarray) -> ChannelFit:
    residual = fit.measured - (fit.predicted - by)
    return replace(
        fit,
        predicted=fit.predicted - by,
        residual_rms=float(np.sqrt(np.mean(residual**2))),
        reduced_chi2=float(np.mean((residual / fit.std) ** 2)),
    )


def _fits(points: int, gap: bool) -> tuple[FitResult, FitResult]:
    channels = (
        fake_channel("leakage", "leakage_flow", 0.01 * LPM, 1, points),
        fake_channel("pressure_gain", "load_pressure", 0.35e5, 2, points),
        fake_channel("flow_gain", "flow", 0.05 * LPM, 3, points),
    )
    after = fake_fit(channels=channels)
    if not gap:
        return after, after
    missed = tuple(_shifted(fit, _gap(fit)) for fit in channels)
    return fake_fit(channels=missed, reduced_chi2=12.4, chi2=11544.0), after


def fake_candidates(*named: str, seen: bool = True) -> tuple[Candidate, ...]:
    rng = np.random.default_rng(5)
    found = []
    for name, info in EFFECTS.items():
        z = float(rng.normal())
        least = info.typical[0]
        if name in ABSORBED:
            state, why, kept = "absorbed", "discharge_coefficient takes it up: 0.4 % of it is left", 0.004
            found.append(Candidate(name, info.unit, state, why, z, NAN, NAN, kept, NAN, NAN))
        elif name == "flowmeter_lag":
            found.append(
                Candidate(name, info.unit, "impossible", "needs the column time", NAN, NAN, NAN, 0.0, NAN, NAN)
            )
        else:
            z = 38.0 - 5.0 * named.index(name) if name in named else 6.0 * z if seen else z
            p = float(min(1.0, 23.0 * np.exp(-0.5 * z**2)))
            closed = 0.97 if name in named else 0.05 * abs(z) if abs(z) > 4.0 else NAN
            found.append(Candidate(name, info.unit, "testable", "", z, p, 3.0 * least * np.sign(z), 0.4, least, closed))
    return tuple(found)


def pilot(**changes: Any) -> NamedEffect:
    named = NamedEffect(
        "pilot_leakage",
        2.377e-9,
        "m3/s/sqrt(Pa)",
        3.2e-11,
        (2.314e-9, 2.440e-9),
        1e-12,
        38.0,
        0.97,
        "the first stage takes its own flow",
    )
    return replace(named, **changes)


def hysteresis() -> NamedEffect:
    return NamedEffect(
        "hysteresis", 1.4e-6, "m", 0.05e-6, (1.3e-6, 1.5e-6), 2e-5, 9.1, 0.12, EFFECTS["hysteresis"].sentence
    )


def _evidence(effect: str, after: FitResult, test: str) -> Evidence:
    (fit,) = [fit for fit in after.channels if fit.test == test]
    weight = np.abs(_gap(fit)) / fit.noise
    weight = 36.0 * weight / weight.sum() * np.random.default_rng(8).normal(1.0, 0.5, weight.size)
    return Evidence(effect, test, fit.channel, fit.position, fit.direction, fit.temperature, weight)


def variation(learned: bool = False) -> Variation:
    temperature = np.linspace(20.0, 70.0, 40) + CELSIUS
    scaled = np.linspace(-1.0, 1.0, 40)
    curve = 0.08 * scaled + 0.03 * (1.5 * scaled**2 - 0.5)
    return Variation(
        "clearance",
        "temperature",
        "1",
        temperature,
        curve,
        0.01 + 0.005 * scaled**2,
        210.0,
        3e-9,
        0.55,
        (0.0, 0.08, 0.03),
        318.15,
        25.0,
        learned,
    )


def underlap_with_pressure() -> Variation:
    first = variation()
    return replace(
        first,
        quantity="underlap",
        unit="m",
        curve=first.curve * UM,
        band=first.band * UM,
        variable="supply_pressure",
        variable_values=np.linspace(70e5, 140e5, 40),
        gap_closed=0.21,
    )


def regions() -> tuple[Region, ...]:
    return (
        Region("leakage", "leakage_flow", {"spool_position": (-203 * UM, 203 * UM)}, 9200.0, 0.71, 480, 0.64 * LPM),
        Region(
            "flow_gain",
            "flow",
            {"spool_position": (-90 * UM, 85 * UM), "temperature": (333.15, 344.15), "direction": (-1.0, -1.0)},
            2100.0,
            0.17,
            130,
            -0.19 * LPM,
        ),
        Region("flow_gain", "flow", {"supply_pressure": (138e5, 142e5)}, 640.0, 0.05, 66, 0.11 * LPM),
    )


HEADLINES = {
    "consistent": "The ideal valve explains the record within its noise: reduced chi-square 1.02 on 1440 readings.",
    "named": (
        "Leakage is 0.64 l/min too high everywhere: pilot_leakage, 0.0451 +/- 0.0006 l/min/sqrt(bar), closes 97 % of the "
        "gap on held-out sweeps; ignoring it would have inflated clearance by 0.6 um."
    ),
    "two": "pilot_leakage and hysteresis are missing from the ideal valve: together they close 98 % of the gap.",
    "ambiguous": "One of pilot_leakage, bushing_leakage or flowmeter_offset is missing; this record cannot tell which.",
    "unexplained": "Leakage disagrees by 0.64 l/min and no effect of the library explains it.",
    "helped": "pilot_leakage closes 61 % of the gap, the rest is unexplained: it varies with the temperature.",
    "learned": "No effect explains the gap; a clearance that varies with temperature was learned and closes 55 % of it.",
}


def fake_diagnosis(kind: str = "named", points: int = 60, **changes: Any) -> DiagnosisResult:
    """One of KINDS; `changes` replace fields."""
    before, after = _fits(points, gap=kind != "consistent")
    effects: tuple[NamedEffect, ...] = {
        "named": (pilot(),),
        "two": (pilot(gap_closed=0.86), hysteresis()),
        "ambiguous": (
            pilot(
                alternatives=(
                    Alternative("bushing_leakage", 3.1e-13, "m3/(s Pa)", 1.7),
                    Alternative("flowmeter_offset", 6.2e-6, "m3/s", 4.9),
                )
            ),
        ),
        "helped": (pilot(gap_closed=0.61),),
    }.get(kind, ())
    unclear = kind in ("unexplained", "helped", "learned")
    where = () if kind == "consistent" else regions()
    if kind == "unexplained":
        after = before
    result = DiagnosisResult(
        record=before.record,
        verdict=kind if kind in ("consistent", "named", "ambiguous") else "unexplained" if unclear else "named",  # pyright: ignore[reportArgumentType]
        headline=HEADLINES[kind],
        sentences=("The leakage of the ideal valve is too low at every position and in both directions.",),
        where=where,
        where_after=where[1:] if unclear else (),
        effects=effects,
        candidates=fake_candidates(*(effect.name for effect in effects), seen=kind != "consistent"),
        absorbed=ABSORBED,
        gap_before=before.reduced_chi2,
        gap_after=4.1 if kind in ("helped", "learned") else after.reduced_chi2,
        held_out=HeldOut(
            rows=480,
            what="run 3 of every test (70 degC)",
            before=11.2,
            after=11.2 if kind == "unexplained" else 0.31,
            reduced_chi2_before=12.2,
            reduced_chi2_after=12.2 if kind == "unexplained" else 1.31,
            gap_closed=0.0 if kind == "unexplained" else 0.972,
            exchange={"bushing_leakage": 0.61, "hysteresis": -0.02} if effects else {},
        ),
        next_test=NextTest(
            "Repeat the leakage test at 210 bar: chi-square then differs by 64 between pilot_leakage and its nearest rival.",
            64.0,
            (
                Proposal("leakage at 210 bar", 64.0, 96, 240.0),
                Proposal("leakage at 70 degC", 21.0, 96, 240.0),
                Proposal("leakage, ports connected", 2.1, 96),
            ),
        )
        if kind == "ambiguous"
        else None,
        before=before,
        after=after,
        shifts=(
            ParameterShift("edge_radius", "m", 15.2 * UM, 14.93 * UM, 0.118 * UM),
            ParameterShift("clearance", "m", 2.63 * UM, 2.031 * UM, 0.042 * UM),
            ParameterShift("discharge_coefficient", "dimensionless", 0.69, 0.7012, 0.0021),
            ParameterShift("transition_number", "dimensionless", 1.0, 1.0, None),
        )
        if effects
        else (),
        variations=(variation(kind == "learned"), underlap_with_pressure()) if unclear else (),
        evidence=tuple(
            _evidence(effect.name, after, test)
            for effect in effects
            for test in (("leakage", "flow_gain") if effect.name == "hysteresis" else ("leakage",))
        ),
        noise=tuple(
            ChannelNoiseFound(f.test, f.channel, f.noise, "differences of repeated sweeps", 0.31, "repeats", 250.0, 480)
            for f in before.channels
        ),
        left_over_p=1e-9 if unclear else 0.43,
        seconds=9.4,
        evaluations=1091,
        notes=("The last sweep at 70 degC was held out.",),
        critical_level=3.1,
    )
    return replace(result, **changes)


SUPPLY = Fault(
    "wrong_supply", "", "", 3.2e5, "Pa", (), "all tests at 158 bar: the supply gauge, or its label, reads 3.20 +- 0.11 bar too high",
    False, "158 bar", 1.1e4, 1e-30, (), 0.93,
)  # fmt: skip
ZERO = Fault(
    "position_zero", "leakage", "", 1e-6, "m", (), "leakage: positions read 1.00 +- 0.02 um too high beside the other tests and runs",
    False, "", 2e-8, 0.0004, (), 0.05,
)  # fmt: skip
CREDIT = (Credit("names", 0.04, 0.0, 0.02), Credit("faults", 0.95, 0.91, 0.93), Credit("weights", 0.03, 0.01, 0.022))


def shared_diagnosis(kind: str = "helped", **changes: Any) -> DiagnosisResult:
    """One whose gap faults of the bench and widened noise close with its names, which is not what is handed over."""
    result = fake_diagnosis(kind, **changes)
    assert result.held_out is not None
    return replace(
        result,
        after=replace(result.after, faults=(SUPPLY, ZERO)),
        held_out=replace(result.held_out, credit=CREDIT, valves=(5.2, 5.6, 480)),
        discrepancy=(ChannelDiscrepancy("leakage", "leakage_flow", 0.05 * LPM, 0.2, 0.15),),
        instead=result.before,
    )
