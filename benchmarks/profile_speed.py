"""Likelihood profiles of the six parameters of a valve, beside pyPESTO's on the same problem.

    profile_speed.py            (pip install pypesto beside the development packages; without it, the program's own figures alone)

One record of leakage, pressure gain and flow gain; both profile from the same optimum to a rise of chi-square of 3.84, 95 % with
one degree of freedom. pyPESTO gets the program's own compiled residuals and derivatives, so that the model costs both the same,
parameters in their standard errors, steps of half of one instead of its own fiftieth, and SciPy's trust region for least squares as
its optimiser. Noise is white and known, so that both mean the same interval. Times are medians of three runs of each in turn;
compiling is in none of them.
"""

import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from _peers import machine


ROOT = Path(__file__).parents[1]
RISE = 3.84
RUNS = 3


def problem() -> Any:
    sys.path.insert(0, str(ROOT / "tests"))
    import jax

    jax.config.update("jax_enable_x64", True)
    from helpers.records import synthetic_record
    from reference.valve import Valve

    from thermohyd.identify.fitting.fit import fit_and_fitted

    valve = Valve(12e-3, 8e-6, 2.5e-6, 6e-6, 0.68, 90.0, 1.2e-6)
    return fit_and_fitted(synthetic_record(valve, np.random.default_rng(4), points=31))[1]


def own(fitted: Any, std: np.ndarray) -> tuple[dict[str, tuple[float, float]], int]:
    from thermohyd.identify.fitting.fit import StaticSearch
    from thermohyd.identify.fitting.profile_intervals import ProfileCurve, profile_curve

    search = StaticSearch(fitted.record, fitted.tests, fitted.plans, fitted.free)
    args, count = search.args(fitted.noise), [0]

    def hold(start: np.ndarray, held: Any) -> Any:
        found = search.solve(args, start, held)
        count[0] += found.steps + 1
        return found

    ends = {}
    for i, name in enumerate(fitted.free):
        curve = profile_curve(fitted.solution, search.boxes, i, float(std[i]) * RISE**0.5, [RISE], hold)
        assert isinstance(curve, ProfileCurve)
        ends[name] = (curve.intervals[0].low, curve.intervals[0].high)
    return ends, count[0]


def peer(fitted: Any, std: np.ndarray) -> tuple[dict[str, tuple[float, float]], int]:
    import jax
    import pypesto  # pyright: ignore[reportMissingImports]  # of this benchmark alone
    import pypesto.optimize  # pyright: ignore[reportMissingImports]
    import pypesto.profile  # pyright: ignore[reportMissingImports]
    from pypesto.result import OptimizerResult  # pyright: ignore[reportMissingImports]

    from thermohyd.identify.fitting.fit import StaticSearch
    from thermohyd.identify.fitting.static_residuals import residual_and_columns

    search = StaticSearch(fitted.record, fitted.tests, fitted.plans, fitted.free)
    args, count, centre = search.args(fitted.noise), [0], fitted.solution.p
    if not hasattr(peer, "both"):
        peer.both = jax.jit(lambda p, args: residual_and_columns(fitted.free, p, args))  # pyright: ignore
    kept: dict[str, Any] = {}

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and derivatives, asked for apart and computed once."""
        key = np.asarray(x, dtype=float).tobytes()
        if kept.get("key") != key:
            count[0] += 1
            residual, columns = peer.both(centre + std * np.asarray(x), args)  # pyright: ignore
            kept.update(key=key, found=(np.asarray(residual), np.asarray(columns).T * std))
        return kept["found"]

    objective = pypesto.Objective(
        fun=lambda x: 0.5 * float(np.sum(at(x)[0] ** 2)), grad=lambda x: at(x)[1].T @ at(x)[0],
        res=lambda x: at(x)[0], sres=lambda x: at(x)[1],
    )  # fmt: skip
    size = len(fitted.free)
    asked = pypesto.Problem(objective, lb=-20.0 * np.ones(size), ub=20.0 * np.ones(size), x_names=list(fitted.free))
    result = pypesto.Result(asked)
    result.optimize_result.append(OptimizerResult(id="0", x=np.zeros(size), fval=0.5 * fitted.solution.cost))
    options = pypesto.profile.ProfileOptions(
        default_step_size_absolute=0.5, min_step_size_absolute=0.05, max_step_size_absolute=1.0, ratio_min=float(np.exp(-0.5 * RISE)),
    )  # fmt: skip
    optimizer = pypesto.optimize.ScipyOptimizer(method="ls_trf")
    result = pypesto.profile.parameter_profile(
        asked, result, optimizer, engine=pypesto.engine.SingleCoreEngine(), profile_options=options, progress_bar=False
    )  # fmt: skip
    ends = {}
    for i, name in enumerate(fitted.free):
        found = result.profile_result.list[0][i]
        low, high = pypesto.profile.calculate_approximate_ci(
            found["x_path"][i], found["ratio_path"], float(np.exp(-0.5 * RISE))
        )
        ends[name] = (centre[i] + std[i] * low, centre[i] + std[i] * high)
    return ends, count[0]


def main() -> None:
    fitted = problem()
    std = np.sqrt(np.diag(np.linalg.inv(fitted.solution.jacobian.T @ fitted.solution.jacobian)))
    contenders = {"thermohyd": own}
    try:
        import pypesto  # pyright: ignore[reportMissingImports]

        contenders[f"pyPESTO {pypesto.__version__}"] = peer
    except ImportError:
        print("pyPESTO is not installed: the program's own figures alone")
    times: dict[str, list[float]] = {name: [] for name in contenders}
    found: dict[str, Any] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for run in range(RUNS + 1):
            for name, profile in contenders.items():
                began = time.perf_counter()
                found[name] = profile(fitted, std)
                if run:
                    times[name].append(time.perf_counter() - began)
    print(f"{sum(test.rows for test in fitted.tests.values())} readings, six parameters; {machine()}\n")
    print(
        "| | time [s] | evaluations with derivatives | half width / standard error 1.96 | largest difference of an end |"
    )
    print("|---|---|---|---|---|")
    truth = found["thermohyd"][0]
    for name, (ends, count) in found.items():
        widths = [(ends[n][1] - ends[n][0]) / 2 / (RISE**0.5 * std[i]) for i, n in enumerate(fitted.free)]
        apart = max(abs(ends[n][k] - truth[n][k]) / std[i] for i, n in enumerate(fitted.free) for k in (0, 1))
        print(
            f"| {name} | {np.median(times[name]):.3g} | {count} | {min(widths):.3f} to {max(widths):.3f} | {apart:.3f} std |"
        )
    if len(contenders) > 1:
        first, second = (float(np.median(t)) for t in times.values())
        print(f"\nRatio of times: {second / first:.1f}")


if __name__ == "__main__":
    main()
