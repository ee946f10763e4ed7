"""How well the data tell the parameters apart, in figures and in words."""

import numpy as np

from .fit_result import Identifiability
from .orthogonal import gram_schmidt


# Collinearity above which a combination is called weak: Brun et al. (Water Resources Research 37, 2001) found 10 to 15.
WEAK = 10.0
STRONGLY_CORRELATED = 0.9
WORTH_NAMING = 0.3  # share of a parameter in a unit direction


def identifiability(
    jacobian: np.ndarray, scales: np.ndarray, names: tuple[str, ...], correlation: np.ndarray, why: dict[int, str]
) -> Identifiability:
    """Condition number and weak directions of the Jacobian (n, p) of whitened residuals, columns of unit length.

    The condition number is that of unit columns, so that it speaks of trade-offs and not of units. A direction is given
    in the parameters' natural steps `scales` (p,), normalised: "edge_radius and underlap trade off: +0.71 -0.70".
    """
    lengths = np.sqrt(np.sum(jacobian**2, axis=0))
    seen = np.flatnonzero((lengths > 0.0) & np.isfinite(lengths))
    sentences = [f"{names[i]} has no error bar: {reason}" for i, reason in sorted(why.items())]
    if len(seen) == 0:
        return Identifiability(float("inf"), (), (), tuple(sentences))
    _, triangle = gram_schmidt(jacobian[:, seen] / lengths[seen])
    _, values, right = np.linalg.svd(triangle)
    condition = float(values[0] / values[-1]) if values[-1] > 0.0 else float("inf")
    weak = []
    for k in reversed(range(len(values))):
        collinearity = 1.0 / values[k] if values[k] > 0.0 else np.inf
        if collinearity < WEAK:
            continue
        direction = right[k] / lengths[seen] / scales[seen]
        direction = direction / np.sqrt(np.sum(direction**2))
        weak.append(_trade_off([names[i] for i in seen], direction, collinearity))
    for i in range(len(names)):
        for j in range(i):
            if abs(correlation[i, j]) > STRONGLY_CORRELATED:
                way = "rise together" if correlation[i, j] > 0.0 else "trade off"
                sentences.append(f"{names[j]} and {names[i]} {way} (correlation {correlation[i, j]:+.2f})")
    return Identifiability(condition, tuple(float(v) for v in values), tuple(weak), tuple(sentences))


def _trade_off(names: list[str], direction: np.ndarray, collinearity: float) -> str:
    """One sentence on a combination of parameters that moves the readings little."""
    order = [i for i in np.argsort(-np.abs(direction)) if abs(direction[i]) >= WORTH_NAMING]
    if direction[order[0]] < 0.0:
        direction = -direction
    shares = " ".join(f"{direction[i]:+.2f}" for i in order)
    if len(order) == 1:
        return f"{names[order[0]]} is weakly determined: {shares} (collinearity {collinearity:.0f})"
    listed = ", ".join(names[i] for i in order[:-1]) + f" and {names[order[-1]]}"
    return f"{listed} trade off: {shares} (collinearity {collinearity:.0f})"
