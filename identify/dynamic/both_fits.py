"""One result of a record with static and dynamic tests: the static fit first, then motion with what it gave held."""

from dataclasses import replace

import numpy as np

from ..fit_result import FitResult, Identifiability
from ..parameters import IN_MOTION


HELD = (
    "The static tests were fitted first; the dynamic fit holds the valve's parameters that they gave, so the error bars of "
    "the parameters of motion do not include theirs."
)


def joined(static: FitResult, motion: FitResult) -> FitResult:
    """Parameters, channels and words of both; the two covariances stand beside each other."""
    free = (*static.free, *motion.free)
    chi2, freedom = static.chi2 + motion.chi2, static.degrees_of_freedom + motion.degrees_of_freedom
    words = Identifiability(
        max(static.identifiability.condition_number, motion.identifiability.condition_number),
        (*static.identifiability.singular_values, *motion.identifiability.singular_values),
        (*static.identifiability.weak_directions, *motion.identifiability.weak_directions),
        (*static.identifiability.sentences, *motion.identifiability.sentences),
    )
    unconverged = next((part for part in (static, motion) if not part.converged), None)
    return replace(
        static,
        parameters={**static.parameters, **{n: motion.parameters[n] for n in IN_MOTION}},
        free=free,
        covariance=_beside(static.covariance, motion.covariance),
        correlation=_beside(static.correlation, motion.correlation),
        reduced_chi2=chi2 / freedom,
        chi2=chi2,
        degrees_of_freedom=freedom,
        noise_freedom=_together(static, motion),
        channels=(*static.channels, *motion.channels),
        identifiability=words,
        rows=static.rows + motion.rows,
        points=static.points + motion.points,
        converged=unconverged is None,
        message=static.message if unconverged is None else unconverged.message,
        notes=(*static.notes, *motion.notes, HELD),
        warnings=tuple(dict.fromkeys((*static.warnings, *motion.warnings))),
        verdict=(*static.verdict, *motion.verdict),
    )


def _together(static: FitResult, motion: FitResult) -> float:
    """Degrees of freedom behind the noise of both, each weighing with its readings."""
    points = static.points + motion.points
    spread = sum((part.points / points) ** 2 / part.noise_freedom for part in (static, motion))
    return 1.0 / spread if spread > 0.0 else float("inf")


def _beside(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    found = np.zeros((len(a) + len(b),) * 2)
    found[: len(a), : len(a)] = a
    found[len(a) :, len(a) :] = b
    return found
