"""What a record tells less of than books do is held near what books say: the flow coefficients of sharp edges.

Where edges are laminar or overlapped a leakage curve shows C_qmax/lambda_c and not the two apart, and a fit may put either anywhere,
beside whatever edges go with that. Both priors are asked for only where the readings alone leave the discharge coefficient wider
than its prior would, or put it where no sharp edge is known to be; and they stay only where the readings do not contradict them.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from .outcome import Fitted, uncertainty_of
from .parameters import ParameterPlan, Prior


COEFFICIENT = "discharge_coefficient"
# {parameter: (mean, standard deviation)}. Of sharp metering edges C_qmax is 0.60 to 0.65 (Merritt, Hydraulic Control Systems, 1967,
# section 3-4), with edges as they are made up to 0.75; lambda_c is 57 of a classical slit and may be a few hundred: twice the standard
# deviation either way.
USUAL = {COEFFICIENT: (0.675, 0.0375), "transition_number": (100.0, 100.0)}
UNUSUAL = 3.0  # standard deviations of the prior from which on a value of the coefficient is looked at twice, however sharp it is
# Rise of chi-square, both priors counted in, from which on the readings know better: chance makes it in one record of a thousand.
CONTRADICTED = 13.8
HOPELESS = 300.0  # the same of a search that has not been over the kinks yet


def usual_is_asked(fitted: Fitted) -> bool:
    """Whether a fit of static tests leaves the coefficient wider than books do, at a limit, or where it is not known of any edge."""
    if COEFFICIENT not in fitted.free or not _is_open(fitted.plans[COEFFICIENT]):
        return False
    i, (mean, std) = fitted.free.index(COEFFICIENT), USUAL[COEFFICIENT]
    if fitted.solution.active[i] or abs(float(fitted.solution.p[i]) - mean) > UNUSUAL * std:
        return True
    known = uncertainty_of(fitted)
    # By the noise believed alone: what a misfit adds to an error bar says nothing about how much the readings tell.
    return i in known.covariance.why or bool(known.covariance.matrix[i, i] > std**2 * known.inflation[i])


def with_usual(plans: Mapping[str, ParameterPlan]) -> dict[str, ParameterPlan]:
    """The plans, with priors on the coefficients that `[start]` says nothing of, and the search beginning there."""
    held = {name: usual for name, usual in USUAL.items() if name in plans and _is_open(plans[name])}
    near = " and ".join(f"{at - 2.0 * std:.2f} to {at + 2.0 * std:.2f}" if at < 1.0 else f"up to {at + 2.0 * std:.0f}"
                        for at, std in held.values())  # fmt: skip
    why = (
        f"this record does not tell, so held near what is usual, {near}; "
        f'"{COEFFICIENT} = {{ value = 0.7, std = 0.2 }}" in [start] of bench.toml changes that'
    )
    return {**plans, **{n: replace(plans[n], start=at, prior=Prior(at, std, why)) for n, (at, std) in held.items()}}


def starts_beside(alone: np.ndarray, free: tuple[str, ...], plans: Mapping[str, ParameterPlan]) -> list[np.ndarray]:
    """Where searches with the priors begin: at the fit without them, its coefficients moved; and so with the lap turned round, as an
    open laminar gap and an overlapped land look alike."""
    moved = np.array([plans[name].start if name in USUAL else value for name, value in zip(free, alone, strict=True)])
    if "underlap" not in free:
        return [moved]
    turned = moved.copy()
    turned[free.index("underlap")] *= -1.0
    return [moved, turned]


def contradicted(alone: Fitted, rise: float, most: float = CONTRADICTED) -> bool:
    """Whether the readings know better than books. rise: chi-square with the priors, their own share counted in, over that without."""
    inflation = float(uncertainty_of(alone).inflation[alone.free.index(COEFFICIENT)])
    return not rise <= most * max(inflation, 1.0)


def _is_open(plan: ParameterPlan) -> bool:
    return not (plan.fixed or plan.given or plan.absent or plan.prior is not None)
