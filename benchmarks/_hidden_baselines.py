"""What simpler rules would have named, on the same record, noise model and library of effects.

All but the last follow one greedy path: to the effects that are in, add the one whose refit lowers chi-square most.
They differ in when they stop. Per effect added, with n readings: AIC stops below 2, BIC below ln n, the likelihood-ratio
test below 3.84 (5 % each time, as is usual), and the same test at 5 % over the whole library (Bonferroni).
Correlation names the effect whose signature correlates best with the ideal valve's residuals, where a t-test at 5 %
over the library finds it (no projection on what the parameters could do, no refit).
"""

import numpy as np
from scipy import stats

from thermohyd.effects.library import EFFECTS
from thermohyd.identify.fitting.problem import Problem
from thermohyd.identify.fitting.problem_fit import Fit


MOST_EFFECTS = 4  # of a greedy path
REFITTED = 5  # candidates of each step: those with the best scores
STEPS = 15  # of each refit, as in the diagnosis's own search
METHODS = ("AIC forward", "BIC forward", "likelihood ratio 5 %", "likelihood ratio, Bonferroni", "correlation")


def baselines(problem: Problem, base: Fit) -> dict[str, list[str]]:
    """{method: names in the order in which they came in}; `base`: the ideal valve, fitted."""
    path, gains = greedy_path(problem, base)
    thresholds = {
        "AIC forward": 2.0,
        "BIC forward": float(np.log(len(base.residual))),
        "likelihood ratio 5 %": float(stats.chi2.isf(0.05, 1)),
        "likelihood ratio, Bonferroni": float(stats.chi2.isf(0.05 / len(problem.library.names), 1)),
    }
    found = {}
    for method, threshold in thresholds.items():
        short = next((i for i, gain in enumerate(gains) if gain < threshold), len(gains))
        found[method] = path[:short]
    found["correlation"] = correlated(base.residual, {n: signature(problem, base, n) for n in problem.library.names})
    return found


def greedy_path(problem: Problem, base: Fit) -> tuple[list[str], list[float]]:
    """Effects in the order of forward selection, and what each took off chi-square when it came in."""
    path: list[str] = []
    gains: list[float] = []
    fit = base
    for _ in range(MOST_EFFECTS):
        left = [name for name in problem.library.names if name not in path]
        z = {name: score(fit, signature(problem, fit, name)) for name in left}
        tried = sorted(left, key=lambda name: -abs(z[name]))[:REFITTED]
        fits = {name: problem.fit((*path, name), dict(fit.values), most_steps=STEPS) for name in tried}
        best = min(fits, key=lambda name: fits[name].chi2)
        gain = fit.chi2 - fits[best].chi2
        path.append(best)
        gains.append(float(gain))
        fit = fits[best]
        if gain < 2.0:
            break
    return path, gains


def signature(problem: Problem, fit: Fit, name: str) -> np.ndarray:
    """What a step of usual size of an absent effect does to the residuals of a fit."""
    return problem.evaluate({**fit.values, name: EFFECTS[name].scale}, (name,)).residual - fit.residual


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

    found = {name: abs(correlation(g)) for name, g in signatures.items()}
    best = max(found, key=lambda name: found[name])
    limit = float(stats.t.isf(0.025 / len(found), len(residual) - 2)) / np.sqrt(len(residual))
    return [best] if found[best] > limit else []
