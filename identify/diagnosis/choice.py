"""Which effects are missing, judged by rows that are not held out."""

from dataclasses import replace

from .case import Case, Progress, with_noise_around
from .held_out import Split, split_rows
from .search import LEVEL, Found, prune, search


# The choice is made on the rows that are not held out; where those show nothing, all rows are asked, at what is left.
STILL_THERE = 12.0  # chi-square that an effect of the first search must be worth once the noise was measured again
LEVEL_OF_CHOICE, LEVEL_OF_ALL_ROWS = 0.6 * LEVEL, 0.4 * LEVEL


def choose(case: Case, say: Progress = lambda _: None) -> tuple[Case, Found, Split]:
    """Search on the rows that are not held out.

    Twice: noise that no repeats measured is measured again beside the model that the first search found. Noise in motion was
    taken for white so far: it is measured where nothing was found, too.
    """
    split = split_rows(case.fitted.tests)
    before, p_values = None, {}
    for last in (False, True):
        say("searching for missing effects")
        chosen = case.problem.with_rows(~split.held)
        base = chosen.fit(start=case.base.values)
        begin = None
        if before is not None:
            begin = prune(chosen, chosen.fit(before.effects, before.values), before.effects, STILL_THERE)[0]
        found = search(chosen, base, case.steps, begin=begin, level=LEVEL_OF_CHOICE, say=say)
        found = replace(found, p_values={n: {**p_values, **found.p_values}.get(n, 1.0) for n in found.effects})
        measured = not found.effects and not case.problem.in_motion
        if last or measured or all(r is not None for r in case.repeats.values()):
            return case, found, split
        if found.effects:
            before, p_values = case.problem.fit(found.effects, found.final.values), found.p_values
        case = with_noise_around(case, before or case.base)
    raise AssertionError
