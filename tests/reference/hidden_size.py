"""How large is a hidden effect beside the noise, before and after the six parameters have taken their share of it?"""

from dataclasses import replace

import numpy as np

from reference.hidden_bench import Bench
from reference.valve import Effects


# A step of each identified parameter, for central differences [SI].
STEPS = {
    "edge_radius": 1e-8,
    "clearance": 1e-9,
    "underlap": 1e-8,
    "discharge_coefficient": 1e-4,
    "transition_number": 0.05,
    "null_bias": 1e-9,
}

Readings = dict[tuple[str, str], np.ndarray]


def whitened(bench: Bench, difference: Readings) -> np.ndarray:
    """A difference of noise-free readings in units of independent noise, all channels in one vector.

    AR(1) noise is undone run by run; a condition that is run twice counts twice.
    """
    found = []
    for (_, channel), value in difference.items():
        runs = value.reshape(len(bench.copies), -1) / bench.noise[channel]
        rest = (runs[:, 1:] - bench.phi * runs[:, :-1]) / np.sqrt(1.0 - bench.phi**2)
        found.append((np.concatenate([runs[:, :1], rest], axis=1) * np.sqrt(bench.copies)[:, None]).ravel())
    return np.concatenate(found)


def parameter_columns(bench: Bench) -> np.ndarray:
    """Whitened derivatives of all readings by the six parameters, at the true ones: (rows, 6)."""
    columns = []
    for name, step in STEPS.items():
        at = lambda sign, name=name, step=step: bench.ideal(
            replace(bench.valve, **{name: getattr(bench.valve, name) + sign * step}), Effects()
        )
        high, low = at(1.0), at(-1.0)
        columns.append(whitened(bench, {k: (high[k] - low[k]) / (2.0 * step) for k in high}))
    return np.stack(columns, axis=1)


def delta(signature: np.ndarray, columns: np.ndarray) -> float:
    """Length of what `columns` leave of a whitened signature: the effect's strength in noise units."""
    q, _ = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))
    left = signature - q @ (q.T @ signature)
    return float(np.linalg.norm(left - q @ (q.T @ left)))
