"""One claim of the seed paper, in our words, beside what was computed."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np


Verdict = Literal["holds", "partly", "no"]
LITTLE = 0.05  # the paper's own "less than 5 %"


@dataclass(frozen=True)
class Claim:
    """where: figure or section of the paper. title and short: the claim and its figure in a few words, for a terminal.
    computed: a sentence with the figures; why: what explains a difference, or limits the claim; empty where there is
    nothing to say. values: the figures behind the sentence, by name with unit."""

    key: str
    where: str
    title: str
    claim: str
    holds: Verdict
    short: str
    computed: str
    why: str = ""
    values: dict[str, float] = field(default_factory=dict)


def verdict(holds: bool | np.bool_, partly: bool | np.bool_ = False) -> Verdict:
    """The word for a claim that holds, or holds in part."""
    return "holds" if holds else "partly" if partly else "no"


def percent(share: float, decimals: int = 1, sign: bool = False) -> str:
    """Such as "4.4 %" or, with its sign, "+4.4 %"."""
    return f"{100.0 * share:{'+' if sign else ''}.{decimals}f} %"


def thickest_within(viscosity: np.ndarray, gap: np.ndarray, limit: float = LITTLE) -> float:
    """Viscosity [m2/s] up to which |gap| (same shape) stays below the limit, interpolated in ln nu; the thickest where it
    always does, 0 where it never does."""
    order = np.argsort(viscosity)
    nu, size = viscosity[order], np.abs(gap[order])
    above = np.flatnonzero(size >= limit)
    if not len(above):
        return float(nu[-1])
    i = int(above[0])
    if i == 0:
        return 0.0
    share = (limit - size[i - 1]) / (size[i] - size[i - 1])
    return float(np.exp(np.log(nu[i - 1]) + share * np.log(nu[i] / nu[i - 1])))
