"""Which effects petab_select would choose for one record: its four searches over fits of our own engine.

Every fit stands on the noise that the diagnosis measures first, beside the ideal valve, and on all rows. That noise is the same for
every model, so that chi-square, priors included, is -2 log-likelihood up to a constant.
"""

import tempfile
import time
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from _hidden_run import answer_within
from _petab_select import CRITERIA, METHODS, chosen, write_space


PATIENCE = 3600  # s, for the four searches of one record
SEARCHES = tuple(f"{method} {criterion}" for method in METHODS for criterion in CRITERIA)


class Fits:
    """The fits of a record's models, each made once for all searches."""

    def __init__(self, case: Any):
        self.problem = case.problem
        self.readings = len(case.base.residual) - len(case.problem.parameters)
        self.made: dict[frozenset[str], tuple[float, dict[str, float]]] = {
            frozenset(): (case.base.chi2, dict(case.base.values))
        }

    def nllh(self, effects: frozenset[str]) -> float:
        """Half of a model's chi-square."""
        if effects not in self.made:
            self.made[effects] = self._fitted(effects)
        return 0.5 * self.made[effects][0]

    def _fitted(self, effects: frozenset[str]) -> tuple[float, dict[str, float]]:
        """From the model that differs least, of several the best one; what still misses by far from the nominal valve too.

        Never worse than a smaller model, which it holds with amounts of 0: a search may end a little above it.
        """
        from thermohyd.effects.library import EFFECTS
        from thermohyd.identify.diagnosis.search import FAR

        nearest = min(self.made, key=lambda other: (len(other ^ effects), self.made[other][0]))
        values = self.made[nearest][1]
        fits = [self.problem.fit(effects, values)]
        if not fits[0].chi2 <= FAR * self.readings:
            usual = {name: EFFECTS[name].scale for name in effects - nearest}
            own = {name: values[name] for name in (*(effects & nearest), "null_bias") if name in values}
            fits.append(self.problem.fit(effects, usual | own))
        found = [(float(fit.chi2), dict(fit.values)) for fit in fits if np.isfinite(fit.chi2)]
        found += [fit for smaller, fit in self.made.items() if smaller < effects]
        return min(found, key=lambda fit: fit[0])


def ask_petab_select(job: tuple[Path, int, bool]) -> dict[str, Any]:
    """One record's four searches, of at most so many models each, with or without the effects that store oil."""
    folder, budget, storage = job
    return answer_within(PATIENCE, folder, lambda record: searched(record, budget, storage))


def searched(record: Path, budget: int, storage: bool) -> dict[str, Any]:
    from thermohyd.identify.bench.read import read_record
    from thermohyd.identify.diagnosis.case import open_case

    began = time.perf_counter()
    case = open_case(read_record(record))
    fits, plans = Fits(case), case.problem.plans
    effects = case.problem.library.names if storage else case.problem.library.steady
    always = case.problem.free_parameters
    priors = {n: (prior.value, prior.std) for n in always if (prior := plans[n].prior)}
    with tempfile.TemporaryDirectory() as folder:
        space = write_space(Path(folder), always, priors, effects, fits.readings)
        found = {
            f"{method} {criterion}": asdict(chosen(space, method, criterion, fits.nllh, budget))
            for method in METHODS
            for criterion in CRITERIA
        }
    return {
        "record": record.name,
        "headline": "; ".join(f"{search}: {_words(choice['effects'])}" for search, choice in found.items()),
        "searches": found,
        "fits": len(fits.made) - 1,
        "candidates": list(effects),
        "readings": fits.readings,
        "parameters": len(always),
        "seconds": time.perf_counter() - began,
    }


def _words(effects: Iterable[str]) -> str:
    return " + ".join(effects) or "nothing"
