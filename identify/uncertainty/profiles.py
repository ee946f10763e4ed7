"""The likelihood profile of every free parameter, with nested intervals and what the shape of the profile says.

Raue et al., "Structural and practical identifiability analysis of partially observed dynamical models by exploiting the profile
likelihood", Bioinformatics 25, 2009.
"""

from collections.abc import Callable

import numpy as np

from thermohyd.identify.fitting.least_squares import LeastSquaresResult
from thermohyd.identify.fitting.profile_intervals import ProfileCurve, profile_curve

from .finished_fit import FinishedFit
from .result import LEVELS, Nested, ProfileOf, Shape


SEES_NOTHING = 0.01  # rise of chi-square over the whole box, below which the data do not see a parameter


def profile_of(around: FinishedFit, name: str, levels: tuple[float, ...] = LEVELS) -> ProfileOf | LeastSquaresResult:
    """The profile of one free parameter, or a deeper optimum that it ran into."""
    i, rises = around.place(name), around.rises(name, levels)
    own = around.fitted.free.index(name)
    std = float(np.sqrt(around.known.covariance.matrix[own, own] / around.known.inflation[own]))
    first = std * float(np.sqrt(rises[0])) if std > 0.0 else around.boxes[i].scale
    found = profile_curve(around.best, around.boxes, i, first, rises, around.hold)
    return found if isinstance(found, LeastSquaresResult) else as_profile(name, found, levels, tuple(rises))


def as_profile(name: str, curve: ProfileCurve, levels: tuple[float, ...], rises: tuple[float, ...]) -> ProfileOf:
    """The curve with its shape; intervals are nested even where two searches ended a hair apart."""
    intervals: list[Nested] = []
    for level, interval in zip(levels, curve.intervals, strict=True):
        low, high = interval.low, interval.high
        if intervals:
            low, high = min(low, intervals[-1].low), max(high, intervals[-1].high)
        intervals.append(Nested(level, low, high, interval.open_low, interval.open_high))
    judged = next((n for n in intervals if n.level == 0.95), intervals[-1])
    ends = judged.open_low + judged.open_high
    shape: Shape = "bounded" if not ends else "one-sided" if ends == 1 else "flat"
    return ProfileOf(name, curve.points, tuple(intervals), rises, shape, max(p.rise for p in curve.points))


def profiles_of(around: FinishedFit, say: Callable[[str], None]) -> tuple[dict[str, ProfileOf], tuple[str, ...]]:
    """{free parameter: profile}, and what is to be said of those that could not be made."""
    found: dict[str, ProfileOf] = {}
    notes = []
    for k, name in enumerate(around.fitted.free, start=1):
        say(f"profile of {name} ({k} of {len(around.fitted.free)})")
        profile = profile_of(around, name)
        if isinstance(profile, LeastSquaresResult):
            lower = around.best.cost - profile.cost
            notes.append(
                f"the profile of {name} ran into an optimum whose chi-square is {lower:.3g} lower: it is left out; values of your own "
                "in [start] near that optimum would lead the fit there"
            )
            continue
        found[name] = profile
    return found, tuple(notes)
