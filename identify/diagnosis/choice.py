"""Which effects are missing, judged by rows that are not held out."""

from .case import Case, Progress, with_noise_around
from .held_out import Split, split_rows
from .search import LEVEL, Found, search


# The choice is made on the rows that are not held out; where those show nothing, all rows are asked, at what is left.
LEVEL_OF_CHOICE, LEVEL_OF_ALL_ROWS = 0.6 * LEVEL, 0.4 * LEVEL


def choose(case: Case, say: Progress = lambda _: None) -> tuple[Case, Found, Split]:
    """Search on the rows that are not held out.

    Twice: noise that no repeats measured is measured again beside the model that the first search found.
    """
    split = split_rows(case.fitted.tests)
    for last in (False, True):
        say("searching for missing effects")
        chosen = case.problem.with_rows(~split.held)
        base = chosen.fit(start=case.base.values)
        found = search(chosen, base, case.steps, level=LEVEL_OF_CHOICE, say=say)
        if last or not found.effects or all(r is not None for r in case.repeats.values()):
            return case, found, split
        case = with_noise_around(case, case.problem.fit(found.effects, found.final.values))
    raise AssertionError
