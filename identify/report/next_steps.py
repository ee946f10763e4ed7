"""What to do next, once a fit or a diagnosis has answered: each step a sentence, with the command that does it where there is one."""

import shlex
from typing import NamedTuple

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.shown_units import effect_unit
from thermohyd.identify.diagnosis.result import DiagnosisResult
from thermohyd.identify.fitting.result import DISAGREES, FitResult

from .diagnosis_words import with_unit


class Step(NamedTuple):
    """One step; `command` may be typed as it stands, FOLDER being that of the results."""

    words: str
    command: str = ""


def command(name: str, *arguments: str) -> str:
    """A line to type."""
    return shlex.join(("thermohyd", *name.split(), *arguments))


def path_of(record: BenchRecord) -> str:
    """The record's folder as a command takes it."""
    return str(record.folder) if record.provenance is None else record.provenance.path


def after_fit(result: FitResult) -> list[Step]:
    """What a fit asks for, the most urgent first."""
    bench = path_of(result.record)
    if not result.converged:
        return [
            Step("See whether the record is read as you mean it.", command("check", bench)),
            Step("Then give values of your own in [start] of bench.toml and fit again.", command("fit", bench)),
        ]
    steps = []
    missed = [c for c in result.channels if c.noise_known and c.reduced_chi2 >= DISAGREES]
    if missed:
        tests = _listed(dict.fromkeys(c.test.replace("_", " ") for c in missed))
        words = f"Model and bench disagree beyond noise in {tests}: ask where, and what is missing. Until then error bars say too little."
        steps.append(Step(words, command("diagnose", bench)))
    unknown = list(dict.fromkeys(c.test.replace("_", " ") for c in result.channels if not c.noise_known))
    if unknown:
        words = (
            f"State the noise of {_listed(unknown)} (noise in bench.toml), or repeat a sweep under the same conditions: without it "
            "nobody can tell a good fit from a bad one."
        )
        steps.append(Step(words))
    ended = [p.name for p in result.parameters.values() if p.at_bound and not p.fixed]
    if ended and not missed:
        limit = "its limit" if len(ended) == 1 else "their limits"
        words = f"{_listed(ended)} ended at {limit}: something may be missing that the fit puts there."
        steps.append(Step(words, command("diagnose", bench)))
    open_ = [p.name for p in result.parameters.values() if p.std is None and not p.fixed and not p.at_bound]
    if open_ or result.identifiability.weak_directions:
        what = f"{_listed(open_)} got no error bar" if open_ else "The data leave parameters that trade off"
        words = f"{what}: the sensitivity study names the next sweep that tells most."
        steps.append(Step(words, command("sensitivity", bench, "--model", "model.json")))
    if not missed and not ended and not unknown:
        steps.append(
            Step(
                "The model describes the record. Predict other conditions with it,",
                command("simulate", bench, "--model", "model.json"),
            )
        )
        steps.append(Step("or take it into another program.", command("export fmu", "model.json", "--out", "FOLDER")))
    return steps


def _listed(names: list[str] | dict[str, None]) -> str:
    words = list(names)
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


MOST_NAMED = 3


def after_diagnosis(result: DiagnosisResult) -> list[Step]:
    """What a diagnosis asks for: the measurement that decides first, then what can be done with its model."""
    bench = path_of(result.record)
    asked = [] if result.next_test is None else [Step(_sentence(result.next_test.sentence))]
    if not result.after.converged:
        return [*after_fit(result.after), *asked]
    decides = result.verdict in ("ambiguous", "unexplained")
    steps = asked if decides else []
    faults = [fault.sentence for fault in result.after.faults if not fault.rows and fault.sentence]
    steps += [Step(f"See to the bench first: {sentence.rstrip('.')}.") for sentence in faults]
    if result.verdict == "unexplained":
        learned = any(found.learned for found in (*result.variations, *result.terms))
        if result.terms:
            words = (
                "Write the leading term as an effect of your own, look at whether it has a cause, and diagnose with it."
            )
            steps.append(Step(words, command("effect", "NAME", "--from", "diagnosis.json", "--out", "FOLDER")))
        elif result.variations and not learned:
            words = "If a fitted curve will do, have the leading one added to the model; it is no cause and holds in its range only."
            steps.append(Step(words, command("diagnose", bench, "--learn")))
        if not steps:
            steps.append(
                Step("See whether the record is read as you mean it: units, signs, bad rows.", command("check", bench))
            )
    elif result.verdict == "consistent":
        steps += _unseen(result)
    else:
        names = _listed([effect.name for effect in result.effects]) if result.effects else ""
        if result.verdict == "named" and names:
            words = f"Look for {names} at the valve or the bench. Once something was done about it, measure again and compare."
            steps.append(Step(words, command("compare", bench, "AFTERWARDS")))
        steps.append(
            Step("Until then predict with the model that has it.", command("simulate", bench, "--model", "model.json"))
        )
    return steps if decides else [*steps, *asked]


def _sentence(text: str) -> str:
    """With a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def _unseen(result: DiagnosisResult) -> list[Step]:
    """Nothing was found: what could still be there, and what would show it."""
    bench = path_of(result.record)
    use = "Nothing has to be added: the model may be used as it is."
    if not result.after.judged:
        use = (
            "Nothing has to be added that this record could show. State the noise of each meter and diagnose again, "
            "if the model's agreement is to be judged; until then predict with it as it is."
        )
    steps = [Step(use, command("simulate", bench, "--model", "model.json"))]
    amounts = [
        f"{c.name} up to {words}"
        for c in result.candidates
        if c.state == "testable" and (words := with_unit(c.least, effect_unit(c.name, c.unit)))
    ]
    if result.absorbed or amounts:
        hidden = f"{_listed(list(result.absorbed))} cannot be seen by this record" if result.absorbed else ""
        small = f"smaller amounts may be there, such as {', '.join(amounts[:MOST_NAMED])}" if amounts else ""
        words = f"{'; '.join(filter(None, (hidden, small)))}. A plan says which further test would show them."
        steps.append(Step(words, command("plan", bench)))
    return steps
