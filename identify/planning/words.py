"""What a plan says in plain words: headline and sentences; the terminal and the page show exactly this."""

from thermohyd.identify.bench.shown_units import amount

from .result import Addition, PlannedEffect, PlanResult


def headline(result: PlanResult) -> str:
    """How many of the effects these tests will find, in one sentence."""
    seen = [effect for effect in result.effects if effect.seen]
    told = [effect for effect in seen if not effect.confused]
    return (
        f"In usual amounts these tests will find {len(seen)} of {len(result.effects)} effects "
        f"(in {100.0 * result.power:.0f} % of records), and tell {len(told)} of them from all others."
    )


def sentences(result: PlanResult) -> tuple[str, ...]:
    """What follows from the tables."""
    found = []
    for group in result.groups:
        found.append(f"Not told apart in any usual amount: {_in_a_row(group)}.")
    other = [e for e in result.effects if e.confused and not any(e.name in group for group in result.groups)]
    if other:
        found.append(
            "May also be taken for another: "
            + "; ".join(f"{e.name} for {_in_a_row(e.confused[:3], 'or')}{_more(e.confused, 3)}" for e in other)
            + "."
        )
    unseen = [e for e in result.effects if e.least is not None and not e.seen]
    if unseen:
        found.append(
            "Only in more than the largest usual amount: "
            + ", ".join(f"{e.name} from {amount(e.name, e.least or 0.0, e.unit)} on" for e in unseen)
            + "."
        )
    reasons: dict[str, list[str]] = {}
    for effect in result.effects:
        if effect.least is None:
            reasons.setdefault(effect.why, []).append(effect.name)
    found += [f"Not seen: {_in_a_row(names)} ({why})." for why, names in reasons.items()]
    if result.added and (result.added[0].shows or result.added[0].separates):
        found.append(f"To add first: {addition(result.added[0])}.")
    elif result.added:
        found.append("No change of temperature, pressure or rate shows another effect or tells two more apart.")
    return tuple(found)


def addition(run: Addition) -> str:
    """One proposal in words: what to run, what it takes and brings."""
    brings = []
    if run.shows:
        brings.append(f"shows {_in_a_row(run.shows[:4])}{_more(run.shows, 4)}")
    if run.separates:
        pairs = [f"{a} from {b}" for a, b in run.separates]
        brings.append(f"tells {_in_a_row(pairs[:3])}{_more(pairs, 3)} apart")
    return f"the tests {run.words} ({cost(run)}): {' and '.join(brings) or 'nothing more'}"


def cost(run: Addition) -> str:
    return f"{run.rows} rows" if run.seconds is None else f"{run.seconds / 60.0:.0f} min"


def _more(parts: tuple[object, ...] | list[str], shown: int) -> str:
    return f" and {len(parts) - shown} more" if len(parts) > shown else ""


def state(effect: PlannedEffect) -> str:
    """ "seen", "only if large" or "not seen" """
    return "seen" if effect.seen else "only if large" if effect.least is not None else "not seen"


def _in_a_row(parts: tuple[str, ...] | list[str], last: str = "and") -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}"
