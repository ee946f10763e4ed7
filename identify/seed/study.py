"""Reproduce the seed paper in one call: curves, Eq. 6 macro-models and claims."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from thermohyd import seed_paper as paper
from thermohyd.actuator import seed_actuator
from thermohyd.edge import EdgeLaw
from thermohyd.identify.flow_curve_fit import FlowCurveFit, TwoTermFit, fit_eq6, fit_two_terms
from thermohyd.identify.result import Result

from .actuator_claims import actuator_claims, performance_of
from .blocked_port_claims import leakage_claims, pressure_claims
from .curves import MODELS, Claim, SeedCurves, seed_curves
from .flow_claims import flow_claims


if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from rich.console import Console


TEMPERATURE_STEP = 5.0  # K, between the temperatures of the curves against temperature


@dataclass(frozen=True)
class SeedStudy(Result):
    """macro: {"HM", "THM": Eq. 6 at the first supply pressure}; two_terms: the variant for HM, a fit per temperature.
    performance: {figure of `thermohyd.Performance`: (model, supply, temperature)} of the example jack at null."""

    _command: ClassVar[str] = "seed"

    curves: SeedCurves
    macro: dict[str, FlowCurveFit]
    two_terms: tuple[TwoTermFit, ...]
    performance: dict[str, np.ndarray]
    claims: tuple[Claim, ...]
    seconds: float
    # Of another edge law than the paper's: the same claims with its own, the orifice's, in the same order.
    of_the_paper: tuple[Claim, ...] | None = None

    @property
    def drawn(self) -> list[int]:
        """Indices of the temperatures at which curves against the opening are drawn, cold to hot."""
        return [self.curves.at_viscosity(viscosity) for viscosity in paper.VISCOSITIES[::-1]]

    @property
    def edge_law(self) -> EdgeLaw:
        return self.curves.edge_law

    def count(self, holds: str) -> int:
        """How many claims hold, hold "partly", or do not ("no")."""
        return sum(claim.holds == holds for claim in self.claims)

    def to_dict(self) -> dict[str, Any]:
        """The content of `seed.json`."""
        from .report import seed_json

        return seed_json(self)

    def to_dataframe(self) -> "pd.DataFrame":
        """One row per claim of the paper, by its key: where, title, claim, holds, short, computed, why."""
        import pandas as pd

        columns = ["where", "title", "claim", "holds", "short", "computed", "why"]
        rows = {claim.key: [getattr(claim, name) for name in columns] for claim in self.claims}
        if self.of_the_paper is not None:
            columns += ["holds, orifice law", "short, orifice law"]
            for claim in self.of_the_paper:
                rows[claim.key] += [claim.holds, claim.short]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("key")

    def print_on(self, console: "Console") -> None:
        from .report import print_seed

        print_seed(self, console)

    def figures(self) -> "dict[str, Figure]":
        from .report import seed_figures

        return seed_figures(self)

    def _files(self) -> dict[str, bytes | str]:
        from .report import seed_files

        return seed_files(self)


def temperatures() -> np.ndarray:
    """-40 to 70 degC in steps of 5 K, and those at which the oil has 100, 300 and 1000 cSt [K]."""
    even = np.arange(paper.COLDEST, paper.HOTTEST + 0.5 * TEMPERATURE_STEP, TEMPERATURE_STEP)
    return np.sort(np.concatenate([even, [paper.temperature_at(nu) for nu in paper.VISCOSITIES[1:-1]]]))


def seed_study(progress: Callable[[str], None] | None = None, *, edge_law: EdgeLaw = "orifice") -> SeedStudy:
    """Figures 3 to 8, Eq. 6 and every claim of the seed paper for its valve and oil. Raises RuntimeError in single precision.

    edge_law: "orifice" is the paper's; with "lubrication" the claims of both laws stand side by side.
    """
    began = time.perf_counter()
    say = progress or (lambda _: None)
    say("simulating the valve of the paper")
    valve = paper.seed_valve(edge_law)
    curves = seed_curves(valve, temperatures(), paper.SUPPLY_PRESSURES)
    say("fitting Eq. 6")
    even = curves.equidistant
    position = curves.opening[even] * curves.stroke
    macro = {
        name: fit_eq6(
            position, curves.flow[i, 0][:, even], curves.temperature, curves.viscosity, drop=float(curves.supply[0])
        )
        for i, name in enumerate(MODELS)
    }
    two_terms = [fit_two_terms(position, flow[even]) for flow in curves.flow[0, 0]]
    say("the actuator")
    at_null = performance_of(curves, valve, seed_actuator())
    claims = [
        *leakage_claims(curves),
        *pressure_claims(curves, paper.NOMINAL_PRESSURE),
        *flow_claims(curves, macro["HM"], two_terms, paper.NOMINAL_FLOW),
        *actuator_claims(curves, at_null, valve, seed_actuator(), paper.NOMINAL_FLOW),
    ]
    beside = None if edge_law == "orifice" else seed_study(progress).claims
    seconds = time.perf_counter() - began
    return SeedStudy(curves, macro, tuple(two_terms), at_null, tuple(claims), seconds, beside)
