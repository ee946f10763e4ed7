"""petab_select asks for models, somebody else fits them: its interface for models that are not SBML.

PEtab wants a model, conditions and observables on disk; petab_select reads none of them. It reads which parameters are estimated and
which have priors, and counts the measurements: these are honest, the rest are dummies, as in its own example `other_model_types`.
"""

import importlib
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from unittest.mock import patch

from thermohyd.identify.export.model_space import EITHER, SpaceParameter, space_files


METHODS = ("forward", "famos")
CRITERIA = ("AICc", "BIC")
# FAMoS swaps effects within sets that the user must give: here any effect may stand for any other. With its default, one swap at a
# time, petab_select 0.4.0 takes a swap that found nothing better for a success and never ends.
ARGUMENTS: dict[str, Callable[[Sequence[str]], dict[str, object]]] = {
    "forward": lambda effects: {},
    "famos": lambda effects: {"swap_parameter_sets": [list(effects)], "consecutive_laterals": True},
}


@dataclass(frozen=True)
class Space:
    """A model space on disk: the effects that its models differ in, and the data behind every criterion."""

    folder: Path
    effects: tuple[str, ...]
    data: dict[str, int]


@dataclass(frozen=True)
class Choice:
    """The effects of the best model of a search. models: asked for; complete: False where the next round was beyond the budget."""

    effects: tuple[str, ...]
    criterion: float
    models: int
    complete: bool


def tool() -> ModuleType:
    """petab_select; imported by its name, because it is no dependency of the package."""
    try:
        return importlib.import_module("petab_select")
    except ModuleNotFoundError as missing:
        raise SystemExit(f"{missing.name} is not installed: pip install '.[dev]' installs petab_select.") from None


def write_space(
    folder: Path,
    always: Iterable[str],
    priors: Mapping[str, tuple[float, float]],
    effects: Sequence[str],
    readings: int,
) -> Space:
    """Model space and PEtab problem: parameters that every model estimates, effects that are 0 or estimated, and the readings.

    priors: {parameter: (mean, standard deviation)}, counted as data like the readings.
    """
    parameters = [SpaceParameter(name, prior=priors.get(name)) for name in (*always, *effects)]
    files = space_files(parameters, {"M": dict.fromkeys(effects, EITHER)}, readings)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return Space(folder, tuple(effects), {"n_measurements": readings, "n_priors": len(priors)})


def chosen(space: Space, method: str, criterion: str, nllh: Callable[[frozenset[str]], float], budget: int) -> Choice:
    """Search a model space that `write_space` has written; a round of models that the budget does not cover is not begun.

    nllh: of the model with these effects its negative log-likelihood, up to a constant of the record.
    """
    select = tool()
    problem = select.Problem.model_validate(
        {
            "criterion": criterion,
            "method": method,
            "model_space_files": ["model_space.tsv"],
            "candidate_space_arguments": ARGUMENTS[method](space.effects),
            "root_path": space.folder,
        }
    )
    value = getattr(select.criteria, f"calculate_{criterion.lower()}")
    candidates, asked, complete = None, 0, True
    with one_parameter_a_step(), warnings.catch_warnings():
        # It says of every model that it was excluded before, as its own rounds ask for.
        warnings.simplefilter("ignore", RuntimeWarning)
        while True:
            begun = select.ui.start_iteration(problem=problem, candidate_space=candidates)
            models = begun["uncalibrated_models"]
            if asked + len(models) > budget:
                complete = False
                break
            # Sets give them in another order in every process, and a fit starts from what was fitted before.
            for model in sorted(models, key=lambda model: sorted(estimated(model.parameters))):
                misfit = nllh(estimated(model.parameters))
                model.set_criterion(select.Criterion.NLLH, misfit)
                # `model.compute_criterion` counts the same, and reads all of the problem's files again for every model.
                counts = {"n_estimated": len(model.get_estimated_parameter_ids()), **space.data}
                model.set_criterion(problem.criterion, value(nllh=misfit, **counts))
            asked += len(models)
            ended = select.ui.end_iteration(
                problem=problem, candidate_space=begun["candidate_space"], calibrated_models=models
            )
            if ended["terminate"]:
                break
            candidates = ended["candidate_space"]
    best = select.ui.get_best(problem=problem, models=problem.state.models)
    named = estimated(best.parameters)
    return Choice(
        tuple(name for name in space.effects if name in named),
        float(best.get_criterion(problem.criterion)),
        asked,
        complete,
    )


def one_parameter_a_step() -> AbstractContextManager[object]:
    """petab_select without moves of several parameters at once.

    Where no single parameter helps, its forward method would go on with pairs and triples, and for a swap it lists every subset of the
    library before the first: 2^27 of them. FAMoS itself takes one parameter a step, and so does stepwise selection.
    """
    module = importlib.import_module("petab_select.model_subspace")
    return patch.object(module, "powerset", lambda names: [(), *((name,) for name in sorted(names))])


def estimated(parameters: Mapping[str, object]) -> frozenset[str]:
    """The effects that a model estimates."""
    return frozenset(name for name, value in parameters.items() if value == "estimate")
