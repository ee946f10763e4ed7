"""Parameters and effects of a diagnosis as a model space of PEtab Select: which effects a model has, beside parameters that all have.

    petab_select_problem.yaml   the criterion, the method, and model_space.tsv
    model_space.tsv             a row per set of models: each effect is 0, or estimated
    petab.yaml, parameters.tsv  limits, start values and priors of all of them, SI
    measurements.tsv, ...       as many readings as there are, without values: PEtab Select only counts them

The valve is no SBML model: whoever fits its models does so with `identify.fit(record, effects=...)`, and hands their likelihoods back.
No JAX, no PEtab.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from thermohyd.effects.library import find_effect
from thermohyd.identify.bench.errors import BenchInputError, quoted


CRITERIA = ("AIC", "AICc", "BIC")
METHODS = ("forward", "backward", "brute_force", "famos")
MOST_SUBSPACES = 200
FREE, HELD, EITHER = "estimate", "0", "0;estimate"
DUMMIES = {
    "model.xml": '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<sbml xmlns="http://www.sbml.org/sbml/level3/version2/core" level="3" version="2">\n<model/>\n</sbml>\n',
    "conditions.tsv": "conditionId\nbench\n",
    "observables.tsv": "observableId\tobservableFormula\tnoiseFormula\nreading\t0\t1\n",
}
PROBLEM = """format_version: 1
parameter_file: parameters.tsv
problems:
- condition_files: [conditions.tsv]
  measurement_files: [measurements.tsv]
  observable_files: [observables.tsv]
  sbml_files: [model.xml]
"""


@dataclass(frozen=True)
class SpaceParameter:
    """A row of PEtab's parameter table, SI. prior: (mean, standard deviation) of a Gaussian."""

    name: str
    lower: float = -math.inf
    upper: float = math.inf
    nominal: float | None = None
    estimated: bool = True
    prior: tuple[float, float] | None = None


def space_files(
    parameters: Iterable[SpaceParameter], subspaces: Mapping[str, Mapping[str, str]], readings: int
) -> dict[str, str]:
    """{file: text} of a model space without its problem.

    parameters: of all models, effects included. subspaces: {name: {effect: "0", "estimate" or "0;estimate"}}, the same effects in each.
    """
    rows = [
        "parameterId\tparameterScale\tlowerBound\tupperBound\tnominalValue\testimate\tobjectivePriorType\tobjectivePriorParameters"
    ]
    for p in parameters:
        prior = "normal\t{};{}".format(*p.prior) if p.prior else "\t"
        nominal = "" if p.nominal is None else repr(p.nominal)
        rows.append(f"{p.name}\tlin\t{p.lower}\t{p.upper}\t{nominal}\t{int(p.estimated)}\t{prior}")
    effects = list(next(iter(subspaces.values())))
    space = ["\t".join(["model_subspace_id", "model_subspace_petab_yaml", *effects])]
    space += ["\t".join([name, "petab.yaml", *(of[effect] for effect in effects)]) for name, of in subspaces.items()]
    measured = ["observableId\tsimulationConditionId\ttime\tmeasurement", *["reading\tbench\t0\t0"] * readings]
    tables = {"parameters.tsv": rows, "measurements.tsv": measured, "model_space.tsv": space}
    return {**DUMMIES, "petab.yaml": PROBLEM, **{name: "\n".join(lines) + "\n" for name, lines in tables.items()}}


@dataclass(frozen=True)
class ModelSpace:
    """effects: that models differ in; rivals: sets of which no model has two, as the data cannot tell them apart; files: {name: text}."""

    effects: tuple[str, ...]
    rivals: tuple[tuple[str, ...], ...]
    subspaces: int
    files: dict[str, str]


def model_space(content: Mapping[str, Any], *, criterion: str = "AICc", method: str = "forward") -> ModelSpace:
    """The space of a diagnosis.json: parameters as it estimated or held them, every effect that its record can show.

    Raises BenchInputError for another result, an unknown criterion or method, and more rivals than a space holds.
    """
    for option, given, known in (("--criterion", criterion, CRITERIA), ("--method", method, METHODS)):
        if given not in known:
            raise BenchInputError(f"{option}: unknown {quoted(given)}; known: {', '.join(known)}")
    if not isinstance(content.get("candidates"), list) or not isinstance(content.get("fit"), Mapping):
        raise BenchInputError("a model space needs the effects that were tried; give the diagnosis.json of a diagnosis")
    named = {effect["name"]: effect for effect in content.get("effects", [])}
    rivals = tuple((name, *effect["alternatives"]) for name, effect in named.items() if effect.get("alternatives"))
    tried = [c["name"] for c in content["candidates"] if c["state"] == "testable"]
    effects = tuple(dict.fromkeys([*(name for group in rivals for name in group), *named, *tried]))
    unknown = [name for name in effects if find_effect(name) is None]
    if unknown:
        raise BenchInputError(
            f"the effect {unknown[0]} is not known here; load the folder that it is in with --effects"
        )
    if not effects:
        raise BenchInputError("no effect of the library shows in this record, so that there is nothing to choose from")
    subspaces = _subspaces(effects, rivals)
    parameters = [
        _parameter(name, about) for name, about in content["fit"]["parameters"].items() if name not in effects
    ]
    parameters += [_effect(name, named.get(name)) for name in effects]
    readings = sum(about["points"] for test in content["fit"]["channels"].values() for about in test.values())
    files = {
        "petab_select_problem.yaml": f"format_version: 1\ncriterion: {criterion}\nmethod: {method}\n"
        "model_space_files:\n- model_space.tsv\n",
        **space_files(parameters, subspaces, readings),
    }
    return ModelSpace(effects, rivals, len(subspaces), files)


def _subspaces(effects: Sequence[str], rivals: Sequence[Sequence[str]]) -> dict[str, dict[str, str]]:
    """One where of each set of rivals the first may act, and one for every other that takes its place: no model twice."""
    if math.prod(len(group) for group in rivals) > MOST_SUBSPACES:
        raise BenchInputError(f"the rivals of the named effects make more than {MOST_SUBSPACES} sets of models")
    found = {}
    for chosen in product(*rivals):
        kinds = dict.fromkeys(effects, EITHER)
        for group, acting in zip(rivals, chosen, strict=True):
            kinds |= {name: HELD for name in group}
            kinds[acting] = EITHER if acting == group[0] else FREE
        found["_".join(["M", *chosen])] = kinds
    return found


def _parameter(name: str, about: Mapping[str, Any]) -> SpaceParameter:
    low, high = about.get("bounds") or (None, None)
    std, start = about.get("prior_std"), about.get("start")
    return SpaceParameter(
        name,
        -math.inf if low is None else low,
        math.inf if high is None else high,
        about.get("value"),
        not about.get("fixed", False),
        None if std is None or start is None else (start, std),
    )


def _effect(name: str, named: Mapping[str, Any] | None) -> SpaceParameter:
    info = find_effect(name)
    assert info is not None
    amount = named["parameter"]["value"] if named else info.scale
    return SpaceParameter(name, info.lower, info.upper, amount)
