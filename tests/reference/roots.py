"""Vectorised root solvers: a bracketed Newton for one unknown per row, a damped Newton for a few coupled ones."""

from collections.abc import Callable

import numpy as np


Residual = Callable[[np.ndarray], np.ndarray]


def bracketed_newton(
    f: Residual, lower: np.ndarray, upper: np.ndarray, start: np.ndarray, *, rtol: float = 1e-15, max_steps: int = 200
) -> np.ndarray:
    """Root of an f that falls with x, elementwise; f(lower) >= 0 >= f(upper).

    Newton with a central difference for slope; the bracket shrinks at every step, and where Newton leaves it or is slow
    the bracket is halved. Stops when every step is within rounding of x. Raises ArithmeticError where it does not.
    """
    low, high, x = (np.array(v, dtype=float) for v in np.broadcast_arrays(lower, upper, start))
    scale = np.abs(high - low)
    previous = scale.copy()
    for _ in range(max_steps):
        value = f(x)
        low = np.where(value >= 0.0, x, low)
        high = np.where(value <= 0.0, x, high)
        h = 1e-6 * np.maximum(np.abs(x), 1e-2 * scale)
        slope = (f(x + h) - f(x - h)) / (2.0 * h)
        with np.errstate(divide="ignore", invalid="ignore"):
            new = x - value / slope
        # A Newton step shorter than the last one by less than half is no better than halving, but only while far away.
        bad = ~np.isfinite(new) | (new < low) | (new > high)
        slow = (np.abs(new - x) > 0.5 * previous) & (np.abs(new - x) > 1e-9 * scale)
        new = np.where(bad | slow, 0.5 * (low + high), new)
        previous = np.abs(new - x)
        x = new
        if np.all((previous <= 4.0 * rtol * np.maximum(np.abs(x), 1e-2 * scale)) | (value == 0.0)):
            return x
        # Rounding makes f noisy at the root: the bracket may then be a few spacings wide and Newton hop inside it.
        if np.all((high - low <= 8.0 * rtol * np.maximum(np.abs(x), 1e-2 * scale)) | (value == 0.0)):
            return x
    if np.all(previous <= 1e-12 * np.maximum(np.abs(x), 1e-2 * scale)):
        return x
    raise ArithmeticError("a balance did not converge")


def damped_newton(
    f: Residual, start: np.ndarray, admissible: Callable[[np.ndarray], np.ndarray], *, max_steps: int = 80
) -> np.ndarray:
    """Root of k coupled equations per row; z, f(z) of shape (k, rows), scaled so that 1 is a large value of each.

    Newton with a central-difference Jacobian; a step is halved where it leaves `admissible(z)` or raises the residual.
    Rows stop by themselves; raises ArithmeticError where one keeps a residual above 1e-10.
    """
    z = start.copy()
    k = z.shape[0]
    value = f(z)
    for _ in range(max_steps):
        jacobian = np.empty((z.shape[1], k, k))
        for j in range(k):
            h = np.zeros_like(z)
            h[j] = 1e-6 * np.maximum(1.0, np.abs(z[j]))
            jacobian[:, :, j] = ((f(z + h) - f(z - h)) / (2.0 * h[j])).T
        step = -(np.linalg.pinv(jacobian) @ value.T[:, :, None])[:, :, 0].T
        step *= np.minimum(1.0, 3.0 / np.maximum(np.abs(step).max(axis=0), 1e-300))
        best = np.abs(value).max(axis=0)
        factor = np.ones(z.shape[1])
        ok, safe, new = np.zeros(z.shape[1], dtype=bool), z, value
        for _ in range(30):
            trial = z + factor * step
            ok = admissible(trial)
            safe = np.where(ok, trial, z)
            new = f(safe)
            ok &= (np.abs(new).max(axis=0) < best) | (best < 1e-12)
            if np.all(ok):
                break
            factor = np.where(ok, factor, 0.5 * factor)
        # Rows whose residual no step reduces are at rounding level, or stuck, which the check below finds.
        z, value = np.where(ok, safe, z), np.where(ok, new, value)
        if np.all((np.abs(factor * step).max(axis=0) < 1e-13) | ~ok):
            break
    if np.any(np.abs(value) > 1e-10):
        raise ArithmeticError(
            f"{np.count_nonzero(np.any(np.abs(value) > 1e-10, axis=0))} coupled balances did not converge"
        )
    return z
