"""What a comparison says in plain words: headline, sentences, notes; the terminal and the page show exactly this."""

from typing import TYPE_CHECKING

from thermohyd.identify.bench.record import BenchRecord
from thermohyd.identify.bench.shown_units import DisplayUnit, beside

from .result import ComparisonResult, Difference, Explanation


if TYPE_CHECKING:
    from .both_models import Diagnosed


def names_of(first: BenchRecord, second: BenchRecord) -> tuple[str, str]:
    """What the two records are called: their folders, or A and B where those are no names for two."""
    names = tuple(record.folder.resolve().name or record.name for record in (first, second))
    if names[0] == names[1]:
        parents = tuple(record.folder.resolve().parent.name for record in (first, second))
        names = tuple(f"{parent}/{name}" for parent, name in zip(parents, names, strict=True))
    return (names[0], names[1]) if names[0] != names[1] else ("A", "B")


def with_unit(value: float, std: float | None, unit: DisplayUnit) -> str:
    """ "+0.52 +/- 0.03 um" """
    shown = None if std is None else std * unit.factor
    words = beside(value * unit.factor, shown)
    words = words if words.startswith("-") else f"+{words}"
    words += "" if shown is None else f" +/- {beside(shown, shown)}"
    return words if unit.label in ("", "-") else f"{words} {unit.label}"


def headline(result: ComparisonResult) -> str:
    """What differs, in one sentence."""
    a, b = result.names
    if not result.converged:
        return f"The joint fit of {a} and {b} did not converge: no difference can be trusted."
    if result.differing:
        listed = [
            f"{_or_rivals(row)} {with_unit(row.difference or 0.0, row.std, row.shown)}" for row in result.differing
        ]
        return f"{b} differs from {a} in {_in_a_row(listed)}."
    if result.same_p < result.level:
        listed = [_set(result, explanation) for explanation in result.one_of[:MOST_SETS]]
        what = f" in {_in_a_row(listed, 'or')}" if listed else ", but no single parameter or effect can be named"
        return f"{b} differs from {a} (p = {result.same_p:.1g} for all together){what}."
    if result.verdict == "undecided":
        return f"No difference between {a} and {b} is beyond chance, but this cannot be relied on: see below."
    return f"{a} and {b} are the same within what these records can tell."


MOST_SETS = 4  # in a sentence


def _set(result: ComparisonResult, explanation: Explanation) -> str:
    parts = []
    for name in explanation.names:
        value, std = explanation.values[name]
        parts.append(f"{name} {with_unit(value, std, result.row(name).shown)}")
    return " with ".join(parts)


def _or_rivals(row: Difference) -> str:
    return f"{row.name} (or {_in_a_row([*row.alternatives], 'or')})" if row.alternatives else row.name


def sentences(result: ComparisonResult) -> tuple[str, ...]:
    """What follows from the table."""
    found = []
    rest = [row for row in result.rows if row.state == "same"]
    if result.same_p < result.level:
        if result.differing:
            sets = [_set(result, explanation) for explanation in result.one_of[:MOST_SETS]]
            what = f"; it may be {_in_a_row(sets, 'or')}" if sets else ""
            found.append(f"Something else differs too (p = {result.same_p:.1g} for the others together){what}.")
        found.append("No single one of these is beyond chance with all others free: they trade off against each other.")
    elif result.differing:
        alone = [
            f"{row.name} {with_unit(row.alone, row.alone_std, row.shown)}"
            for row in result.differing
            if row.alone is not None
        ]
        if alone:
            found.append(
                f"If nothing else differs, which the records allow (p = {result.same_p:.2g}): {_in_a_row(alone)}."
            )
    if rest:
        found.append(f"No difference: {_in_a_row([_same(row) for row in rest])} (95 % intervals of the differences).")
    for row in result.differing:
        if row.alternatives:
            others = _in_a_row([*row.alternatives], "or")
            span = "; all other error bars span both" if row.kind == "effect" else ""
            found.append(f"The data do not tell {row.name} from {others}: the number holds if it is {row.name}{span}.")
    blind = [row for row in result.rows if row.state == "cannot tell"]
    if blind:
        found.append(f"The data cannot tell: {'; '.join(_blind(row, result) for row in blind)}.")
    if result.shared:
        names = _in_a_row([entry.name for entry in result.shared])
        found.append(f"Taken as one in both records, which the data allow: {names}.")
    for name, diagnosis in zip(result.names, result.diagnoses, strict=True):
        if diagnosis.verdict == "unexplained":
            found.append(
                f"{name} has a misfit that nothing explains: differences may be its consequence, and error bars are widened by it."
            )
    return tuple(found)


def _same(row: Difference) -> str:
    assert row.ci95 is not None
    unit = row.shown
    low, high = (beside(end * unit.factor, row.std and row.std * unit.factor) for end in row.ci95)
    return f"{row.name} ({low} to {high}{'' if unit.label in ('', '-') else f' {unit.label}'})"


def _blind(row: Difference, result: ComparisonResult) -> str:
    if row.least is None or any(row.name in explanation.names for explanation in result.one_of):
        return f"{row.name} ({row.why})"
    unit = row.shown
    size = beside(row.least * unit.factor, row.std and row.std * unit.factor)
    return f"{row.name} (a difference would show from {size}{'' if unit.label in ('', '-') else f' {unit.label}'} on)"


def notes(a: "Diagnosed", b: "Diagnosed", refused: dict[str, float]) -> tuple[str, ...]:
    """What a reader of the table should know of how it was made."""
    found = [
        f"{name} would be one in both records of a bench, but the data refuse it (p = {p:.1g}): it has a value in each"
        for name, p in refused.items()
    ]
    names = tuple(dict.fromkeys((*a.fit.physics, *b.fit.physics)))
    for name in names:
        lacking = [d.name for d in (a, b) if name not in d.fit.physics]
        found += [f"{name} is in the model of one record only: {other} cannot speak of it" for other in lacking]
    if a.record.valve.slot_width != b.record.valve.slot_width:
        found.append("the records state different slot widths: each parameter is that of its own valve")
    if _oil(a.record) != _oil(b.record):
        found.append("the records state different oils: nothing of the oil is taken as one")
    for d in (a, b):
        found += [f"{d.name}, a fault of the bench: {fault.sentence}" for fault in d.diagnosis.after.faults]
    return tuple(found)


def _oil(record: BenchRecord) -> tuple[object, ...]:
    return (record.oil.viscosity_a, record.oil.viscosity_b, record.oil.density)


def warnings(a: "Diagnosed", b: "Diagnosed", converged: bool, message: str) -> tuple[str, ...]:
    own = () if converged else (f"the joint fit did not converge: {message}",)
    return (*own, *(f"{d.name}: {warning}" for d in (a, b) for warning in d.diagnosis.warnings))


def _in_a_row(parts: list[str], last: str = "and") -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}"
