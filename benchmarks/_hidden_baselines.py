"""What simpler rules would have named, on the same record, noise model and library of effects.

All but the last follow one greedy path: to the effects that are in, add the one whose refit lowers chi-square most.
They differ in when they stop. Per effect added, with n readings: AIC stops below 2, BIC below ln n, the likelihood-ratio
test below 3.84 (5 % each time, as is usual), and the same test at 5 % over the whole library (Bonferroni).
Correlation names the effect whose signature correlates best with the ideal valve's residuals, where a t-test at 5 %
over the library finds it (no projection on what the parameters could do, no refit).
"""

from typing import Any, Protocol

import numpy as np
from scipy import stats


MOST_EFFECTS = 4  # of a greedy path
REFITTED = 6  # candidates of each step: those with the best scores, and the even ones, whose score says nothing
METHODS = ("AIC forward", "BIC forward", "likelihood ratio 5 %", "likelihood ratio, Bonferroni", "correlation")


class Fit(Protocol):
    """See thermohyd.identify.diagnosis.library_fit.LibraryFit."""

    chi2: float
    residual: np.ndarray
    values: dict[str, float]

    @property
    def nuisance(self) -> np.ndarray: ...

    def column(self, name: str) -> np.ndarray: ...


class Problem(Protocol):
    """See thermohyd.identify.diagnosis.library_fit.LibraryProblem."""

    @property
    def library(self) -> Any: ...

    def fit(self, effects: tuple[str, ...] = (), start: dict[str, float] | None = None) -> Fit: ...


def baselines(problem: Problem, signatures: dict[str, np.ndarray], even: frozenset[str]) -> dict[str, list[str]]:
    """{method: names in the order in which they came in}.

    signatures: {effect: whitened change of the readings by a step of usual size from the ideal fit}.
    """
    base = problem.fit(())
    path, gains = greedy_path(problem, base, signatures, even)
    rows, size = len(base.residual), len(signatures)
    thresholds = {
        "AIC forward": 2.0,
        "BIC forward": float(np.log(rows)),
        "likelihood ratio 5 %": float(stats.chi2.isf(0.05, 1)),
        "likelihood ratio, Bonferroni": float(stats.chi2.isf(0.05 / size, 1)),
    }
    found = {}
    for method, threshold in thresholds.items():
        short = next((i for i, gain in enumerate(gains) if gain < threshold), len(gains))
        found[method] = path[:short]
    found["correlation"] = correlated(base.residual, signatures)
    return found


def greedy_path(
    problem: Problem, base: Fit, signatures: dict[str, np.ndarray], even: frozenset[str]
) -> tuple[list[str], list[float]]:
    """Effects in the order of forward selection, and what each took off chi-square when it came in."""
    path: list[str] = []
    gains: list[float] = []
    fit = base
    for _ in range(MOST_EFFECTS):
        left = [name for name in signatures if name not in path]
        # A column at neutral is the signature of this moment; an even effect has none and keeps its finite step.
        z = {name: score(fit, signatures[name] if name in even else fit.column(name)) for name in left}
        tried = sorted(left, key=lambda name: -abs(z[name]))[:REFITTED]
        tried += [name for name in left if name in even and name not in tried]
        start = dict(fit.values)
        fits = {name: problem.fit((*path, name), start) for name in tried}
        best = min(fits, key=lambda name: fits[name].chi2)
        gain = fit.chi2 - fits[best].chi2
        path.append(best)
        gains.append(float(gain))
        fit = fits[best]
        if gain < 2.0:
            break
    return path, gains


def score(fit: Fit, signature: np.ndarray) -> float:
    """Score statistic of an absent effect beside what is fitted."""
    nuisance = fit.nuisance
    q, _ = np.linalg.qr(nuisance / np.maximum(np.linalg.norm(nuisance, axis=0), 1e-300))
    left = signature - q @ (q.T @ signature)
    size = float(np.linalg.norm(left))
    return 0.0 if size <= 1e-9 * float(np.linalg.norm(signature)) else float(left @ fit.residual) / size


def correlated(residual: np.ndarray, signatures: dict[str, np.ndarray]) -> list[str]:
    """The effect with the largest correlation, where it is significant over the library."""
    z = residual - residual.mean()

    def correlation(g: np.ndarray) -> float:
        g = g - g.mean()
        size = float(np.linalg.norm(g) * np.linalg.norm(z))
        return float(g @ z) / size if size > 0.0 else 0.0

    found = {name: abs(correlation(signature)) for name, signature in signatures.items()}
    best = max(found, key=lambda name: found[name])
    limit = float(stats.t.isf(0.025 / len(found), len(residual) - 2)) / np.sqrt(len(residual))
    return [best] if found[best] > limit else []
