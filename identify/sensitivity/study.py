"""Compute the whole sensitivity study of a valve in one call."""

import time
from collections.abc import Callable

import numpy as np

from thermohyd.actuator import Actuator
from thermohyd.identify.fitting.parameters import OF_THE_EDGES, PARAMETERS
from thermohyd.identify.fitting.result import FitResult

from .curves import TESTS, CurveSlopes, columns_of, curve_slopes, slopes_at
from .drift import performance_drifts, temperature_drifts
from .factors import Factor
from .global_measures import base_of, derivative_measures, sobol_indices, sobol_samples, total_along, uniform_constant
from .next_test import (
    Measurements,
    Posterior,
    ReadingNoise,
    covariance_of,
    d_optimal_points,
    marginal_stds,
    next_tests,
    posterior_of,
    shares,
)
from .result import GlobalStudy, InformationStudy, PosteriorStudy, SensitivityResult
from .settings import Settings, factors_with
from .source import Subject
from .static_figures import OUTPUTS, SWEEP, StaticTests
from .varied import valve_of_model


EVALUATIONS = 65_536
DERIVATIVE_SAMPLES = 1024
POSTERIOR_EVALUATIONS = 8192
POSITIONS = 121  # of a curve, denser near null
PLAN = 12  # readings of the D-optimal plan
MOST_ROWS = 3000  # of a record's channel in the map of information: evenly thinned beyond

Say = Callable[[str], None]


def sensitivity(
    subject: Subject,
    settings: Settings | None = None,
    *,
    actuator: Actuator | None = None,
    evaluations: int = EVALUATIONS,
    seed: int = 0,
    progress: Say | None = None,
) -> SensitivityResult:
    """Which parameter matters: local and global sensitivities, temperature drift, information and the next test.

    actuator: whose performance is to be followed over the temperature; None: of the valve alone.
    evaluations: of the three static tests in the Sobol study, at most (a power of two times the factors + 2).
    Raises RuntimeError in single precision.

    >>> from thermohyd.identify.sensitivity.settings import Settings
    >>> from thermohyd.identify.sensitivity.source import seed_model, subject_of_model
    >>> found = sensitivity(subject_of_model(seed_model(), Settings()), evaluations=2048)
    >>> sorted(found.factors[i].name for i in found.ranking()[:4])
    ['clearance', 'discharge_coefficient', 'null_bias', 'underlap']
    """
    began = time.perf_counter()
    settings = settings or Settings()
    say = progress or (lambda _: None)
    at = (subject.temperature, subject.supply_pressure, subject.return_pressure)
    factors = factors_with(settings, subject.model, *at)
    valve = valve_of_model(subject.model)
    say("sensitivities of the curves")
    share = np.linspace(-1.0, 1.0, POSITIONS)
    curves = curve_slopes(
        valve,
        factors,
        subject.model.valve.stroke * share * np.abs(share),
        temperatures=subject.temperatures,
        supply_pressures=subject.supply_pressures,
        return_pressure=subject.return_pressure,
    )
    tests = StaticTests(valve, factors, *at)
    values, slopes = tests.slopes(np.array([[factor.value for factor in factors]]))
    say("temperature drifts")
    ends = min(subject.temperatures), max(subject.temperatures)
    kelvins = np.sort(np.unique(np.append(np.linspace(*ends, 12), subject.temperature)))
    drifts = temperature_drifts(valve, kelvins, *at[1:]) | performance_drifts(valve, actuator, kelvins, *at[1:])
    varied = global_study(tests, evaluations, seed, say)
    posterior = posterior_of(subject.model, factors)
    return SensitivityResult(
        subject,
        factors,
        OUTPUTS,
        values[0],
        slopes[0],
        curves,
        drifts,
        actuator,
        varied,
        None if posterior is None else posterior_study(tests, posterior, seed, say),
        information_study(subject, factors, curves, say),
        time.perf_counter() - began,
        (*subject.notes, *_remarks(varied)),
    )


def global_study(
    tests: StaticTests, evaluations: int = EVALUATIONS, seed: int = 0, say: Say = lambda _: None
) -> GlobalStudy:
    """Sobol indices and derivative-based measures of the tests' figures, every factor uniform over its tolerance."""
    low, high = (np.array([getattr(factor, end) for factor in tests.factors]) for end in ("low", "high"))
    count, names = len(tests.factors), tuple(output.name for output in OUTPUTS)
    base = base_of(evaluations, count)
    values, sweeps = tests.outputs(low + (high - low) * sobol_samples(count, base, seed), say)
    found = sobol_indices(values, tests.names, names, seed=seed, progress=say)
    say("derivatives over the tolerances")
    # The first points of each block are a Sobol sequence themselves.
    unit = sobol_samples(count, DERIVATIVE_SAMPLES, seed + 1)[:: count + 2]
    _, slopes = tests.slopes(low + (high - low) * unit)
    measures = derivative_measures(slopes, found.variance, uniform_constant(high - low), tests.names, names)
    along = {test: total_along(sweeps[:, i], count) for i, test in enumerate(TESTS)}
    return GlobalStudy(found, measures, np.array(SWEEP), along)


def posterior_study(
    tests: StaticTests, posterior: Posterior, seed: int = 0, say: Say = lambda _: None
) -> PosteriorStudy:
    """The same figures over what a fit left uncertain; inputs are the posterior's independent directions."""
    own = StaticTests(tests.valve, posterior.factors, tests.temperature, tests.supply_pressure, tests.return_pressure)
    count = len(posterior.spread)
    unit = sobol_samples(count, base_of(POSTERIOR_EVALUATIONS, count), seed)
    values, _ = own.outputs(posterior.samples(unit), say)
    found = sobol_indices(values, posterior.names, tuple(output.name for output in OUTPUTS), seed=seed, progress=say)
    _, slopes = own.slopes(posterior.mean[None])
    linear = np.sqrt(np.sum(posterior.slopes(slopes[0]) ** 2, axis=0))
    return PosteriorStudy(posterior, found, np.sqrt(found.variance), linear)


def information_study(
    subject: Subject, factors: tuple[Factor, ...], curves: CurveSlopes, say: Say = lambda _: None
) -> InformationStudy:
    """Which measurement tells which identified parameter, and the D-optimal next test, given what is known."""
    say("information of every measurement")
    free = tuple(name for name in _free(subject) if any(factor.name == name for factor in factors))
    candidates = _candidates(curves, free, subject.noise)
    known, source = _known(subject, factors, free)
    measured = candidates if subject.fit is None else _measured(subject, subject.fit, factors, free)
    of = "every curve of the study, each measured once" if subject.fit is None else "the record's own readings"
    picked = d_optimal_points(candidates.columns, PLAN, known)
    rows, repeats = np.unique(picked, return_counts=True)
    return InformationStudy(
        measured,
        shares(measured.columns),
        of,
        dict(zip(free, marginal_stds(known).tolist(), strict=True)),
        source,
        tuple(next_tests(candidates, known)),
        candidates.at(rows),
        repeats,
    )


def _free(subject: Subject) -> tuple[str, ...]:
    if subject.model.covariance is None:
        return OF_THE_EDGES
    return tuple(name for name in subject.model.free if name in PARAMETERS)


def _candidates(curves: CurveSlopes, free: tuple[str, ...], noise: ReadingNoise) -> Measurements:
    """Every reading of every curve as a measurement that could be made."""
    order = {factor.name: i for i, factor in enumerate(curves.factors)}
    rows = [order[name] for name in free]
    parts = []
    for test in TESTS:
        # A null bias shifts the curve: it is the position's own slope, turned round.
        per_stroke = curves.factors[order["stroke"]].value * curves.slope[test][order["null_bias"]]
        std = noise.std(test, curves.value[test], curves.supply_pressure, per_stroke)
        parts.append(curves.slope[test][rows].T / std[:, None])
    each = len(curves.position)
    spread = lambda column: np.tile(column, len(TESTS))
    return Measurements(
        free,
        np.repeat(np.array(TESTS), each),
        spread(curves.temperature),
        spread(curves.supply_pressure),
        spread(curves.position),
        np.concatenate(parts),
    )


def _measured(subject: Subject, fit: FitResult, factors: tuple[Factor, ...], free: tuple[str, ...]) -> Measurements:
    """The readings of a fitted record, with the noise that the fit found; load flow and second port gauges left out."""
    valve = valve_of_model(subject.model)
    own = tuple(factor for factor in factors if factor.name in free)
    order = [[factor.name for factor in own].index(name) for name in free]
    found = []
    for channel in fit.channels:
        if channel.test not in TESTS or channel.channel == "pressure_b":
            continue
        keep = np.arange(0, len(channel.measured), -(-len(channel.measured) // MOST_ROWS))
        x, ps, t = (getattr(channel, name)[keep] for name in ("position", "supply_pressure", "temperature"))
        _, slopes = slopes_at(valve, x, ps, np.full(len(x), subject.return_pressure), t)
        std = channel.std[keep] * (np.sqrt(2.0) if channel.channel == "pressure_a" else 1.0)
        columns = columns_of(slopes[TESTS.index(channel.test)], own)[order].T / std[:, None]
        found.append((np.full(len(x), channel.test), t, ps, x, columns))
    return Measurements(free, *(np.concatenate(part) for part in zip(*found, strict=True)))


def _known(subject: Subject, factors: tuple[Factor, ...], free: tuple[str, ...]) -> tuple[np.ndarray, str]:
    """Information on the free parameters before the next test, and where it comes from."""
    by_name = {factor.name: factor for factor in factors}
    tolerance = np.array([by_name[name].tolerance for name in free])
    weak = np.diag(3.0 / tolerance**2)  # a uniform interval has the variance tolerance^2/3
    covariance = subject.model.covariance
    if covariance is None:
        return weak, "the tolerances"
    rows = [subject.model.free.index(name) for name in free]
    own = covariance[np.ix_(rows, rows)]
    certain = np.flatnonzero(np.diag(own) > 0.0)  # a parameter without an error bar is known by its tolerance only
    information = weak.copy()
    information[certain[:, None], certain] = covariance_of(own[certain[:, None], certain])
    return information, "the fit" if len(certain) == len(own) else "the fit, and tolerances where it gave no error"


def _remarks(varied: GlobalStudy) -> tuple[str, ...]:
    wide = varied.sobol.total_ci.max()
    return (f"Sobol intervals are up to +/- {wide:.2f} wide: ask for more samples",) if wide > 0.1 else ()
