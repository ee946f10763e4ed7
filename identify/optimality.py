"""Whether the end of a solve is an optimum: judged on the host in double precision, whatever the solver says.

Bates and Watts, "A relative offset orthogonality convergence criterion for nonlinear least squares",
Technometrics 23, 1981.
"""

import numpy as np

from .orthogonal import gram_schmidt


# Their criterion, in units of the parameters' own standard errors: an optimum missed by a thousandth of one.
BELIEVE_BELOW = 1e-3
# A column that shrank by this much between its largest and its last value: the search left the region where it acts.
VANISHED = 1e-7


def relative_offset(columns: np.ndarray, residual: np.ndarray, free: np.ndarray) -> tuple[float, np.ndarray]:
    """Bates and Watts' relative offset over the `free` rows of `columns` (n, m), and the Gauss-Newton step (n,).

    QR of [J r] once more, in NumPy: an independent look at what the compiled solver reports.
    """
    n, m = columns.shape
    if not (np.all(np.isfinite(columns)) and np.all(np.isfinite(residual))):
        return np.inf, np.zeros(n)
    lengths = np.sqrt(np.sum(columns**2, axis=1))
    chosen = np.flatnonzero(free & (lengths > 0.0))
    count = len(chosen)
    _, triangle = gram_schmidt(np.vstack([columns[chosen] / lengths[chosen, None], residual[None, :]]).T)
    step = np.zeros(n)
    if not count:
        return 0.0, step
    left, values, right = np.linalg.svd(triangle[:count, :count])
    alive = values > count * np.finfo(float).eps * values[0]
    loads = left.T[alive] @ triangle[:count, count]
    step[chosen] = -(right[alive].T @ (loads / values[alive])) / lengths[chosen]
    spread = triangle[count, count] ** 2 / max(m - count, 1)
    return float(np.sqrt(np.sum(loads**2) / max(int(alive.sum()), 1) / max(spread, 1e-300))), step


def why_not_optimal(
    names: list[str],
    z: np.ndarray,
    residual: np.ndarray,
    columns: np.ndarray,
    size: np.ndarray,
    offset: float,
    step: np.ndarray,
    done: bool,
    steps: int,
    believe: float = BELIEVE_BELOW,
) -> str:
    """Why this end is no optimum, in words; empty where it is one: within `believe` standard errors."""
    if not np.all(np.isfinite(residual)):
        bad = int(np.sum(~np.isfinite(residual)))
        return f"the model gives no finite value at the start for {bad} of {len(residual)} readings"
    rough = [name for name, column in zip(names, columns, strict=True) if not np.all(np.isfinite(column))]
    if rough:
        return f"the model has no finite derivative at the start for {', '.join(rough)}"
    lengths = np.sqrt(np.sum(columns**2, axis=1))
    lost = [name for name, now, most in zip(names, lengths, size, strict=True) if most > 0 and now < VANISHED * most]
    if lost:
        return f"the search ended where the readings no longer depend on {', '.join(lost)}"
    # Where the model meets the data exactly, only rounding is left to be orthogonal: the step then decides.
    if offset <= believe or np.all(np.abs(step) <= 1e-8 * (1.0 + np.abs(z))):
        return ""
    ending = "it cannot get any lower" if done else f"the limit of {steps} steps was reached"
    return f"{ending}, yet the slope is not zero (still {offset:.2g} standard errors from an optimum)"
