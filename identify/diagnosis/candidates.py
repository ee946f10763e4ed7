"""The library beside the ideal valve: what this record could show, what it shows, and what the parameters swallow."""

from collections.abc import Mapping

import numpy as np

from thermohyd.effects.registry import DYNAMIC_EFFECTS, EFFECTS, effect_info

from .library import Library
from .library_fit import LibraryFit
from .result import Candidate
from .screening import Screen, Signature, least_visible


# An effect that would have to exceed its usual largest amount this many times before the record showed it is absorbed.
VISIBLE_WITHIN = 1.0


def candidates(
    library: Library, screen: Screen, base: LibraryFit, singles: Mapping[str, LibraryFit], excess: float
) -> tuple[Candidate, ...]:
    """One line per effect of the whole library, in its order. excess: chi-square of `base` beyond noise."""
    found = []
    for name, info in {**EFFECTS, **DYNAMIC_EFFECTS}.items():
        if name not in library.names and name not in library.impossible:
            continue
        if name in library.impossible:
            found.append(_without_figures(name, "impossible", library.impossible[name]))
            continue
        best = screen.best(name)
        if best is None:
            found.append(_without_figures(name, "absorbed", "the free parameters do exactly the same"))
            continue
        least = least_visible(best, screen.critical)
        hidden = least > VISIBLE_WITHIN * info.typical[1] and best.strength < screen.critical
        why = f"would show only from {least / info.typical[1]:.1f} times its usual largest amount" if hidden else ""
        gap, amount = _refit(name, base, singles, best, excess)
        found.append(
            Candidate(
                name, info.unit, "absorbed" if hidden else "testable", why, best.score, screen.p_value(best), amount,
                best.kept, least, gap,
            )
        )  # fmt: skip
    return tuple(found)


def _refit(
    name: str, base: LibraryFit, singles: Mapping[str, LibraryFit], best: Signature, excess: float
) -> tuple[float, float]:
    """(gap closed by this effect alone, its amount): of a refit, or linear where the search made none."""
    if name in singles:
        fit = singles[name]
        return _share(base.chi2 - fit.chi2, excess), fit.values[name]
    return _share(best.strength**2 if best.strength > 0.0 else 0.0, excess), best.estimate


def _share(gain: float, excess: float) -> float:
    """Of the excess; where there is none to speak of, nothing can be closed."""
    return float(np.clip(gain / excess, 0.0, 1.0)) if excess > 0.0 else 0.0


def _without_figures(name: str, state: str, why: str) -> Candidate:
    nan = float("nan")
    return Candidate(name, effect_info(name).unit, state, why, nan, nan, nan, 0.0, nan, nan)
