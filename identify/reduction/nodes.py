"""Where within a bin of rows a curve is evaluated for its mean over them. NumPy only."""

import numpy as np

from thermohyd.identify.bench.test_record import Nodes


def nodes_of(
    axis: np.ndarray, time: np.ndarray | None, starts: np.ndarray, name: str, shaken: np.ndarray | float = 0.0
) -> Nodes:
    """Two nodes per bin whose weighted sum is the mean over its rows of any cubic along `axis` (rows,), in the order of time.

    Gauss's rule for the rows themselves as the measure: the roots of x^2 - (m3/m2) x - m2, of their central moments. shaken: variance
    (rows,) by which each row may have been aside, either way alike: where a curve has a corner its mean differs from the curve.
    """
    rows = np.diff(np.append(starts, len(axis)))
    mean = lambda values: np.add.reduceat(values, starts) / rows
    offset = axis - np.repeat(mean(axis), rows)
    aside = mean(np.broadcast_to(shaken, axis.shape))
    size = np.maximum(np.repeat(np.hypot(np.maximum.reduceat(np.abs(offset), starts), np.sqrt(aside)), rows), 1e-300)
    unit = offset / size  # of order one: moments of micrometres must not vanish in rounding
    second, third = mean(unit**2) + (np.sqrt(aside) / size[starts]) ** 2, mean(unit**3)
    flat = second <= 1e-20
    skew = np.where(flat, 0.0, third / np.where(flat, 1.0, second))
    root = np.sqrt(skew**2 + 4.0 * second)
    low, high = (skew - root) / 2.0, (skew + root) / 2.0
    width = np.where(flat, 1.0, high - low)
    weight = np.stack([np.where(flat, 0.5, high / width), np.where(flat, 0.5, -low / width)], axis=1)
    places = np.stack([low, high], axis=1)
    pace = np.zeros(len(starts))
    if time is not None:
        late = time - np.repeat(mean(time), rows)
        pace = np.where(flat, 0.0, mean(unit * late) / np.where(flat, 1.0, second))
        falling = pace < 0.0
        places[falling], weight[falling] = places[falling, ::-1], weight[falling, ::-1]
    return Nodes(places * size[starts][:, None], places * pace[:, None], weight, name)
