"""How the noise of neighbouring readings hangs together, from residuals along the sweeps, and what that does to error bars."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter


MOST_MEMORY = 0.995  # phi: noise that remembers longer is drift, which a sweep cannot tell from the curve
LAGS = 12
SIGNIFICANT = 2.0  # lag-1 correlation in units of its standard error 1/sqrt(n), below which noise counts as white


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
    if lags < 1 or power <= 0.0 or n < 20:
        return NoiseCorrelation()
    rho = np.empty(lags)
    for lag in range(1, lags + 1):
        pairs = sum(max(len(p) - lag, 0) for p in pieces)
        product = sum(float(p[lag:] @ p[:-lag]) for p in pieces if len(p) > lag)
        rho[lag - 1] = product / power * n / max(pairs, 1)
    if rho[0] < SIGNIFICANT / np.sqrt(n):
        return NoiseCorrelation()
    found = _fitted(rho)
    biased = rho + found.inflation * parameters / n * (1.0 - rho)
    return _fitted(np.clip(biased, -1.0, 1.0))


def _fitted(rho: np.ndarray) -> NoiseCorrelation:
    """Least squares of share phi^l over a grid of phi; the share is linear. Later lags count less, as they say less."""
    lag = np.arange(1, len(rho) + 1)
    weight = 1.0 / lag
    best, found = np.inf, NoiseCorrelation()
    for phi in np.concatenate([np.linspace(0.05, 0.95, 91), np.linspace(0.955, MOST_MEMORY, 9)]):
        shape = phi**lag
        share = float(np.clip(np.sum(weight * shape * rho) / np.sum(weight * shape**2), 0.0, 1.0))
        error = float(np.sum(weight * (rho - share * shape) ** 2))
        if error < best:
            best, found = error, NoiseCorrelation(share, float(phi))
    return found


def correlated_sum(columns: np.ndarray, sweeps: np.ndarray, noise: NoiseCorrelation) -> np.ndarray:
    """J' R J (p, p) for columns J (n, p): R has ones on the diagonal and share phi^|i-j| within a sweep.

    By one recursion along each sweep, O(n): sum_{i>j} phi^(i-j) J_j is a first-order filter of the columns.
    """
    total = columns.T @ columns
    if noise.share == 0.0 or noise.phi == 0.0:
        return total
    cross = np.zeros_like(total)
    for s in np.unique(sweeps):
        part = columns[sweeps == s]
        if len(part) < 2:
            continue
        past = lfilter([0.0, noise.phi], [1.0, -noise.phi], part, axis=0)
        cross += part.T @ past
    return total + noise.share * (cross + cross.T)
