"""How the noise of neighbouring readings hangs together, from residuals along the sweeps, and what that does to error bars."""

from dataclasses import dataclass

import numpy as np


MOST_MEMORY = 0.995  # phi: noise that remembers longer is drift, which a sweep cannot tell from the curve
LAGS = 12
# Residuals, alone and per parameter, below which nothing is said: what a fit takes out of few of them looks like memory.
FEWEST, PER_PARAMETER = 20, 15
SIGNIFICANT = 2.5  # fitted share in units of its standard error under white noise, below which noise counts as white


@dataclass(frozen=True)
class NoiseCorrelation:
    """Stationary noise: rho_0 = 1, rho_l = share phi^l. share 0 is white; 1 is AR(1); between them AR(1) plus white."""

    share: float = 0.0
    phi: float = 0.0

    @property
    def inflation(self) -> float:
        """1 + 2 sum rho: how many correlated readings are worth one independent reading."""
        return 1.0 + 2.0 * self.share * self.phi / (1.0 - self.phi)


def noise_correlation(residual: np.ndarray, sweeps: np.ndarray, parameters: float) -> NoiseCorrelation:
    """Fit (share, phi) to the autocorrelation of residuals (n,) pooled over the sweeps (n,), an id per row in sweep order.

    Fitting p parameters takes (1 + 2 sum rho) p/n off every correlation; that bias is added back once (Kendall, 1954,
    for a fitted mean; here spread over the sweeps' rows), so that short sweeps do not look whiter than they are.
    """
    pieces = [residual[sweeps == s] for s in np.unique(sweeps)]
    n = len(residual)
    lags = min(LAGS, max((len(p) for p in pieces), default=1) - 2)
    power = float(np.sum(residual**2))
    if lags < 1 or power <= 0.0 or n < max(FEWEST, PER_PARAMETER * parameters):
        return NoiseCorrelation()
    rho = np.empty(lags)
    for lag in range(1, lags + 1):
        pairs = sum(max(len(p) - lag, 0) for p in pieces)
        product = sum(float(p[lag:] @ p[:-lag]) for p in pieces if len(p) > lag)
        rho[lag - 1] = product / power * n / max(pairs, 1)
    # Over all lags together, not lag 1 alone: weak noise with a long memory costs most and shows least at any one lag.
    found, significance = _fitted(rho + parameters / n, n)
    if significance < SIGNIFICANT:
        return NoiseCorrelation()
    unbiased = rho + found.inflation * parameters / n * (1.0 - rho)
    return _fitted(np.clip(unbiased, -1.0, 1.0), n)[0]


def _fitted(rho: np.ndarray, n: int) -> tuple[NoiseCorrelation, float]:
    """Least squares of share phi^l over a grid of phi, for which the share is linear; and share/(its standard error).

    Later lags count less, as they say less. The standard error is that of n white readings: 1/sqrt(n) for every rho_l.
    """
    lag = np.arange(1, len(rho) + 1)
    weight = 1.0 / lag
    phi = np.concatenate([np.linspace(0.05, 0.95, 91), np.linspace(0.955, MOST_MEMORY, 9)])
    shape = phi[:, None] ** lag
    norm = np.sum(weight * shape**2, axis=1)
    raw = np.sum(weight * shape * rho, axis=1) / norm
    share = np.clip(raw, 0.0, 1.0)
    best = int(np.argmin(np.sum(weight * (rho - share[:, None] * shape) ** 2, axis=1)))
    error = np.sqrt(np.sum((weight * shape[best]) ** 2) / n) / norm[best]
    return NoiseCorrelation(float(share[best]), float(phi[best])), float(raw[best] / error)


def correlated_sum(columns: np.ndarray, sweeps: np.ndarray, noise: NoiseCorrelation) -> np.ndarray:
    """J' R J (p, p) for columns J (n, p): R has ones on the diagonal and share phi^|i-j| within a sweep.

    O(n log n): the memory m_i = J_i + phi m_(i-1) of a sweep doubles its reach with every pass.
    """
    total = columns.T @ columns
    if noise.share == 0.0 or noise.phi == 0.0:
        return total
    order = np.argsort(sweeps, kind="stable")
    columns, sweeps = columns[order], sweeps[order]
    memory = columns.copy()
    reach, fade = 1, noise.phi
    while reach < len(columns) and fade > 1e-17:
        inside = (sweeps[reach:] == sweeps[:-reach])[:, None]
        memory[reach:] += fade * np.where(inside, memory[:-reach], 0.0)
        reach, fade = 2 * reach, fade**2
    cross = columns.T @ (memory - columns)
    return total + noise.share * (cross + cross.T)
