"""The row of one parameter: what its error bar, its profile and its posterior say together, in a word, and why."""

import numpy as np

from thermohyd.identify.fitting.outcome import Fitted
from thermohyd.identify.fitting.result import FitResult, ParameterEstimate

from .profiles import SEES_NOTHING
from .result import KnownParameter, ProfileOf, Verdict


WORTH_NAMING = 0.3  # correlation from which on two parameters trade off
DECIDED_BY_PRIOR = 0.5  # share of the information


def known_parameter(result: FitResult, fitted: Fitted, name: str, profile: ProfileOf | None = None) -> KnownParameter:
    """The row of a free parameter."""
    estimate = result.parameters[name]
    share = prior_share(fitted, name)
    verdict, why = judged(estimate, profile, share)
    bound = ""
    if estimate.at_bound:
        bound = "lower" if abs(estimate.value - estimate.lower) <= abs(estimate.upper - estimate.value) else "upper"
    return KnownParameter(
        name, estimate.value, estimate.unit, estimate.std, estimate.ci95, verdict, why, share, bound,
        trades_with(result, name), profile, averaged=estimate.averaged_over,
    )  # fmt: skip


def judged(estimate: ParameterEstimate, profile: ProfileOf | None, share: float | None) -> tuple[Verdict, str]:
    """Whether the data say what a parameter is, and why not. With a profile by its shape, else by the error bar."""
    if profile is not None:
        if profile.seen < SEES_NOTHING:
            return "structurally not", "chi-square is the same whatever its value"
        if profile.shape == "flat":
            return "practically not", "the data allow every value within its limits"
        if profile.shape == "one-sided":
            side = "an upper" if profile.at(0.95).open_low else "a lower"
            return "practically not", f"the data give {side} limit only"
    elif estimate.std is None or estimate.ci95 is None:
        why = estimate.why_no_error_bar
        blind = why.startswith(("no reading depends", "flat direction"))
        return ("structurally not" if blind else "practically not"), why or "it has no error bar"
    elif estimate.ci95[0] <= estimate.lower or estimate.ci95[1] >= estimate.upper:
        return "practically not", "its interval ends at a limit of the parameter's"
    if share is not None and share > DECIDED_BY_PRIOR:
        return "practically not", f"{100.0 * share:.0f} % of what is known of it is its prior"
    return "identified", ""


def prior_share(fitted: Fitted, name: str) -> float | None:
    """1 - (information of the readings)/(of readings and priors), of one parameter beside all others; None where nothing is known.

    Its information is what of its column the others' columns cannot take its place for (the inverse of its variance).
    """
    solution, free = fitted.solution, fitted.free
    if all(plan.prior is None for plan in (fitted.plans[n] for n in free)):
        return 0.0
    scale = np.array([fitted.plans[n].info.scale for n in free])
    i = free.index(name)
    others = [j for j in range(len(free)) if j != i and not solution.active[j]]
    columns = solution.jacobian * scale
    whole, readings = (_left_of(part[:, i], part[:, others]) for part in (columns, columns[: -len(free)]))
    return None if not whole > 0.0 else float(np.clip(1.0 - readings / whole, 0.0, 1.0))


def _left_of(column: np.ndarray, others: np.ndarray) -> float:
    """Squared length of what remains of a column beside others."""
    if others.shape[1]:
        lengths = np.sqrt(np.sum(others**2, axis=0))
        others = others / np.where(lengths > 0.0, lengths, 1.0)
        column = column - others @ np.linalg.lstsq(others, column, rcond=1e-9)[0]
    return float(column @ column)


def trades_with(result: FitResult, name: str) -> tuple[str, float] | None:
    """The parameter that it is most correlated with, and the correlation; None below `WORTH_NAMING`."""
    i = result.free.index(name)
    others = {other: float(result.correlation[i, j]) for j, other in enumerate(result.free) if j != i}
    others = {other: value for other, value in others.items() if np.isfinite(value) and abs(value) >= WORTH_NAMING}
    if not others:
        return None
    strongest = max(others, key=lambda other: abs(others[other]))
    return strongest, others[strongest]
