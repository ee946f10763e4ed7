"""What a sensitivity study returns: plain numbers, ready for the terminal, JSON and plots."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from thermohyd.actuator import Actuator
from thermohyd.identify.result import Result

from .curves import CurveSlopes
from .drift import Drift
from .global_measures import DerivativeMeasures, SobolIndices
from .next_test import Measurements, Posterior, TestChoice
from .source import Subject
from .static_figures import Output


if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from rich.console import Console


@dataclass(frozen=True)
class GlobalStudy:
    """Sobol indices and derivative measures of the static tests' figures over the tolerances.

    along: {test: (factors, positions)} total indices of the readings at `shares` of the stroke.
    """

    sobol: SobolIndices
    derivative: DerivativeMeasures
    shares: np.ndarray
    along: dict[str, np.ndarray]


@dataclass(frozen=True)
class PosteriorStudy:
    """How uncertain a fit leaves the figures, and which direction of its parameters is to blame.

    std: (outputs,) by sampling; linear_std: (outputs,) from slopes and covariance alone.
    """

    posterior: Posterior
    sobol: SobolIndices
    std: np.ndarray
    linear_std: np.ndarray


@dataclass(frozen=True)
class InformationStudy:
    """Which measurement tells which parameter, and what to measure next.

    measurements, share: the points of the map and their shares (points, parameters), see `information.shares`; `of` says
    what they are. known: {parameter: standard deviation before any new test}, from `source`. tests: every possible next
    sweep, the best first. points: single readings of a D-optimal plan over all of them, with how often each is taken.
    """

    measurements: Measurements
    share: np.ndarray
    of: str
    known: dict[str, float]
    source: str
    tests: tuple[TestChoice, ...]
    points: Measurements
    repeats: np.ndarray


@dataclass(frozen=True)
class SensitivityResult(Result):
    """Everything that `sensitivity` found (SI). nominal: (outputs,); slope: (factors, outputs) there."""

    _command: ClassVar[str] = "sensitivity"

    subject: Subject
    factors: tuple
    outputs: tuple[Output, ...]
    nominal: np.ndarray
    slope: np.ndarray
    curves: CurveSlopes
    drifts: dict[str, Drift]
    actuator: Actuator | None
    tolerances: GlobalStudy
    posterior: PosteriorStudy | None
    information: InformationStudy
    seconds: float
    notes: tuple[str, ...] = ()

    def ranking(self) -> list[int]:
        """Indices of the factors, the one that brings most of the outputs' variance first."""
        return sorted(range(len(self.factors)), key=lambda i: -self.weight(i))

    def weight(self, factor: int) -> float:
        """Mean total index of a factor over the outputs; the peak leakage, nearly always that at null, does not count twice."""
        rows = [i for i, output in enumerate(self.outputs) if output.name != "peak_leakage"]
        return float(np.mean(self.tolerances.sobol.total[rows, factor]))

    def elasticity(self) -> np.ndarray:
        """(factors, outputs): d ln y/d ln theta of the figures; per tolerance where a factor may be zero; NaN where y is 0."""
        steps = np.array([factor.step for factor in self.factors])
        scale = np.where(np.abs(self.nominal) > 1e-9 * np.sqrt(self.tolerances.sobol.variance), self.nominal, np.nan)
        return steps[:, None] * self.slope / scale

    def to_dict(self) -> dict[str, Any]:
        """The content of `sensitivity.json`."""
        from .report import sensitivity_json

        return sensitivity_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """One row per factor and output, by name, the most important factor first: slope (SI units of output per factor),
        elasticity (see `elasticity`), total and first-order Sobol index over the tolerances."""
        import pandas as pd

        sobol, elasticity = self.tolerances.sobol, self.elasticity()
        rows = {
            (self.factors[i].name, output.name): (
                self.slope[i, o], elasticity[i, o], sobol.total[o, i], sobol.first[o, i]
            )
            for i in self.ranking() for o, output in enumerate(self.outputs)
        }  # fmt: skip
        columns = ["slope", "elasticity", "total_index", "first_order_index"]
        index = pd.MultiIndex.from_tuples(rows, names=["factor", "output"])
        return pd.DataFrame(list(rows.values()), index=index, columns=columns)

    def print_on(self, console: "Console") -> None:
        from .report import print_sensitivity

        print_sensitivity(self, console)

    def figures(self) -> "dict[str, Figure]":
        from .report import sensitivity_figures

        return sensitivity_figures(self)

    def _files(self) -> dict[str, bytes | str]:
        from .report import sensitivity_files

        return sensitivity_files(self)
