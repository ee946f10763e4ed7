"""Intervals from the profile of chi-square, where the covariance at the optimum does not hold, and the whole profile where it is asked.

A parameter is moved and held, the others adapt: the interval ends where chi-square has risen as far as the covariance would
have it rise at its ends. It may be lopsided, it ends at a limit, and it sees what a slope at one point cannot: limits that
others press against, kinks where an edge closes, other valleys nearby.
Venzon and Moolgavkar, "A method for computing profile-likelihood-based confidence intervals", Applied Statistics 37, 1988.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from thermohyd.identify.uncertainty.result import ProfilePoint

from .boxes import Box
from .least_squares import LeastSquaresResult


# Chi-square at the ends of the covariance's interval, against what it promises: beyond this share the profile is asked.
HOLDS = 0.25
MOST_STEPS, GROWTH = 14, 1.7
REFINEMENTS, CLOSE = 5, 0.03  # of the bracket that holds an end; of the rise asked for
MOVES = (1.0e-6, 4.0e-6)  # m of underlap, over the kinks that hold a search back
LOWER = 1e-3  # fall of chi-square that makes another optimum

# solve(start, {index: value}) -> the fit with these parameters held there.
SolveHeld = Callable[[np.ndarray, dict[int, float]], LeastSquaresResult]


@dataclass(frozen=True)
class Interval:
    """A profile's ends (SI); `open_low`, `open_high`: the box ended before chi-square had risen enough."""

    low: float
    high: float
    open_low: bool = False
    open_high: bool = False


@dataclass(frozen=True)
class ProfileCurve:
    """Points by rising value, the optimum among them; one interval for each rise asked, in the order asked."""

    points: tuple[ProfilePoint, ...]
    intervals: tuple[Interval, ...]


@dataclass(frozen=True)
class Profiles:
    """intervals by index of the parameter. better: a deeper optimum that a profile ran into; then everything is to be redone."""

    intervals: dict[int, Interval]
    better: LeastSquaresResult | None = None


def covariance_holds(
    best: LeastSquaresResult, boxes: Sequence[Box], covariance: np.ndarray, reach: float, solve: SolveHeld
) -> bool:
    """Whether chi-square rises as the covariance (p, p) says, out to `reach` standard errors of every parameter either way.

    False where a parameter sits at its limit, or where the way out of one leads out of the box.
    """
    if np.any(best.active != 0):
        return False
    every = range(len(boxes))
    for i in every:
        std = float(np.sqrt(covariance[i, i]))
        if not std > 0.0:
            return False
        way = covariance[:, i] / std
        promised = float(np.sum((best.jacobian @ way) ** 2)) * reach**2
        for side in (-reach, reach):
            p = best.p + side * way
            if any(not box.lower <= value <= box.upper for box, value in zip(boxes, p, strict=True)):
                return False
            rise = solve(p, {j: float(p[j]) for j in every}).cost - best.cost
            if not abs(rise - promised) <= HOLDS * promised:
                return False
    return True


def profile_intervals(
    best: LeastSquaresResult,
    boxes: Sequence[Box],
    std: np.ndarray,
    rise: np.ndarray,
    solve: SolveHeld,
    say: Callable[[str], None] = lambda _: None,
) -> Profiles:
    """Interval of every parameter: where its profile of chi-square lies `rise` (p,) above `best`.

    std (p,): a first idea of the distance, NaN where there is none.
    """
    intervals: dict[int, Interval] = {}
    for i, box in enumerate(boxes):
        say(f"profile of {box.name}")
        ends: list[tuple[float, bool]] = []
        for side in (-1.0, 1.0):
            walk = _Walk(best, boxes, i, float(rise[i]), solve)
            first = float(std[i]) * float(np.sqrt(rise[i])) if np.isfinite(std[i]) and std[i] > 0.0 else box.scale
            end = walk.out(side, first)
            if end is None:
                return Profiles({}, walk.better)
            ends.append(end)
        (low, open_low), (high, open_high) = ends
        intervals[i] = Interval(low, high, open_low, open_high)
    return Profiles(intervals)


def profile_curve(
    best: LeastSquaresResult, boxes: Sequence[Box], i: int, first: float, rises: Sequence[float], solve: SolveHeld
) -> ProfileCurve | LeastSquaresResult:
    """The profile of parameter `i` out to the largest of `rises`, which ascend, with an interval for each of them.

    first: distance at which chi-square is thought to have risen by the first of them. Each search starts from its neighbour's end.
    Instead of a curve a deeper optimum, where the profile ran into one.
    """
    trail: list[Visited] = []
    intervals: dict[int, dict[float, tuple[float, bool]]] = {k: {} for k in range(len(rises))}
    for side in (-1.0, 1.0):
        step, before = first, rises[0]
        for k, rise in enumerate(rises):
            walk = _Walk(best, boxes, i, float(rise), solve, trail)
            end = walk.out(side, step * float(np.sqrt(rise / before)))
            if end is None:
                assert walk.better is not None
                return walk.better
            intervals[k][side] = end
            away = abs(end[0] - float(best.p[i]))
            step, before = (away, rise) if away > 0.0 and not end[1] else (step, before)
    names = [box.name for box in boxes]
    pressed = lambda active: tuple(
        n for j, n in enumerate(names) if active[j] and j != i and boxes[j].lower < boxes[j].upper
    )
    points = [ProfilePoint(float(best.p[i]), 0.0, pressed(best.active))]
    points += [ProfilePoint(v.value, max(v.rise, 0.0), pressed(v.active)) for v in trail]
    found = []
    for ends in intervals.values():
        (low, open_low), (high, open_high) = ends[-1.0], ends[1.0]
        found.append(Interval(low, high, open_low, open_high))
    return ProfileCurve(tuple(sorted(points, key=lambda point: point.value)), tuple(found))


@dataclass(frozen=True)
class Visited:
    """Where a walk has been: the parameter's value, the rise of chi-square, the others and which of them press."""

    value: float
    rise: float
    p: np.ndarray
    active: np.ndarray


@dataclass
class _Walk:
    """One parameter's way out from the optimum. trail: where earlier walks have been, and this one too; it goes on from there."""

    best: LeastSquaresResult
    boxes: Sequence[Box]
    i: int
    rise: float
    solve: SolveHeld
    trail: list[Visited] = field(default_factory=list)
    better: LeastSquaresResult | None = None

    def out(self, side: float, first: float) -> tuple[float, bool] | None:
        """(value, whether the box ended first) of the end on one side; None where a deeper optimum was met: `better`.

        first: distance of the first step from the optimum.
        """
        box, start = self.boxes[self.i], self.best.p
        limit = box.lower if side < 0.0 else box.upper
        inner, inner_rise, inner_p = float(start[self.i]), 0.0, start
        beyond = sorted((v for v in self.trail if (v.value - inner) * side > 0.0), key=lambda v: v.value * side)
        for visited in beyond:
            if visited.rise >= self.rise:
                return self.between(inner, inner_rise, inner_p, visited.value, visited.rise), False
            inner, inner_rise, inner_p = visited.value, max(visited.rise, 0.0), visited.p
        if beyond and (inner - limit) * side >= 0.0:
            return inner, True
        step = max(first - abs(inner - float(start[self.i])), 0.1 * first)
        for _ in range(MOST_STEPS):
            value = inner + side * step
            at_limit = (value - limit) * side >= 0.0
            value = float(limit if at_limit else value)
            if value == inner:
                return value, True
            end = self.best_beside(value, inner_p)
            risen = end.cost - self.best.cost
            if risen < -LOWER * max(1.0, 1e-3 * self.best.cost):
                self.better = end
                return None
            if risen >= self.rise:
                return self.between(inner, inner_rise, inner_p, value, risen), False
            inner, inner_rise, inner_p = value, max(risen, 0.0), end.p
            if at_limit:
                return value, True
            step *= GROWTH
        return inner, True

    def best_beside(self, value: float, start: np.ndarray) -> LeastSquaresResult:
        """The other parameters' best beside this value: from the neighbouring one's, and from across the kinks."""
        best = self.solve(self.ahead(value, start), {self.i: value})
        names = [box.name for box in self.boxes]
        if best.cost - self.best.cost < self.rise or "underlap" not in names or names[self.i] == "underlap":
            return self.seen(value, best)
        u = names.index("underlap")
        for move in MOVES:
            for way in (move, -move):
                other = best.p.copy()
                other[u] = np.clip(other[u] + way, self.boxes[u].lower, self.boxes[u].upper)
                tried = self.solve(other, {self.i: value})
                if tried.cost < best.cost:
                    best = tried
        return self.seen(value, best)

    def ahead(self, value: float, start: np.ndarray) -> np.ndarray:
        """Where the others will be beside this value: on along the line from the optimum, at first along its own slope."""
        i, away = self.i, start - self.best.p
        if away[i] == 0.0:
            others = [j for j, box in enumerate(self.boxes) if j != i and not box.held and not self.best.active[j]]
            columns = self.best.jacobian[:, others]
            lengths = np.sqrt(np.sum(columns**2, axis=0))
            lengths[lengths == 0.0] = 1.0
            away = np.zeros(len(start))
            away[i] = 1.0
            away[others] = -np.linalg.lstsq(columns / lengths, self.best.jacobian[:, i], rcond=1e-6)[0] / lengths
        moved = start + (value - start[i]) / away[i] * away
        moved = np.clip(moved, [box.lower for box in self.boxes], [box.upper for box in self.boxes])
        moved[i] = value
        return moved

    def seen(self, value: float, end: LeastSquaresResult) -> LeastSquaresResult:
        self.trail.append(Visited(value, end.cost - self.best.cost, end.p, end.active))
        return end

    def between(self, inner: float, inner_rise: float, inner_p: np.ndarray, outer: float, outer_rise: float) -> float:
        """The value between two at which chi-square has risen enough: secants of its root, which is nearly straight."""
        for _ in range(REFINEMENTS):
            low, high, aim = np.sqrt(inner_rise), np.sqrt(outer_rise), np.sqrt(self.rise)
            share = (aim - low) / (high - low) if high > low else 0.5
            value = inner + float(np.clip(share, 0.1, 0.9)) * (outer - inner)
            end = self.best_beside(value, inner_p)
            risen = max(end.cost - self.best.cost, 0.0)
            if abs(risen - self.rise) <= CLOSE * self.rise:
                return value
            if risen < self.rise:
                inner, inner_rise, inner_p = value, risen, end.p
            else:
                outer, outer_rise = value, risen
        low, high, aim = np.sqrt(inner_rise), np.sqrt(outer_rise), np.sqrt(self.rise)
        return inner + (aim - low) / (high - low) * (outer - inner) if high > low else outer
