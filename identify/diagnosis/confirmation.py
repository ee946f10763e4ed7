"""Does the gap close on rows that took no part, and would another effect in the named one's place have done as well?"""

from collections.abc import Callable

import numpy as np

from .held_out import Split
from .library_fit import LibraryFit, LibraryProblem
from .result import HeldOut


SEED = 20110913


def held_out_result(
    whole: LibraryProblem,
    final_whole: LibraryProblem,
    split: Split,
    base: LibraryFit,
    final: LibraryFit,
    exchanged: dict[str, LibraryFit],
    what: str,
) -> HeldOut:
    """Judge fits of the other rows on the rows kept back. final_whole: the problem with the terms that `final` learned."""
    before, after = mean_square(whole, base, split), mean_square(final_whole, final, split)
    exchange = {name: closed(before, mean_square(whole, fit, split)) for name, fit in exchanged.items()}
    return HeldOut(
        rows=int(split.held.sum()),
        what=what,
        before=max(before - 1.0, 0.0),
        after=max(after - 1.0, 0.0),
        reduced_chi2_before=before,
        reduced_chi2_after=after,
        gap_closed=closed(before, after),
        exchange=exchange,
    )


def mean_square(whole: LibraryProblem, fit: LibraryFit, split: Split) -> float:
    """Mean squared whitened misfit of the rows kept back: 1 where a model is right."""
    at = whole.evaluate(fit.values, fit.effects)
    return float(np.mean(at.residual[: len(split.held)][split.held] ** 2))


def closed(before: float, after: float) -> float:
    """Share of the excess over noise that is gone; 0 where there was none."""
    gap = before - 1.0
    return float(np.clip((before - after) / gap, -1.0, 1.0)) if gap > 0.0 else 0.0


def exchange_fits(
    problem: LibraryProblem,
    final: LibraryFit,
    ranked: list[str],
    spared: set[str],
    say: Callable[[str], None] = lambda _: None,
) -> dict[str, LibraryFit]:
    """Refits with the runner-up, and with an effect drawn by lot, in the place of the first named effect.

    ranked: candidates, the best first. spared: the named ones and their equals.
    """
    if not final.effects:
        return {}
    rest = [name for name in ranked if name not in spared]
    chosen = rest[:1]
    if len(rest) > 2:
        chosen.append(str(np.random.default_rng(SEED).choice(rest[1:])))
    others = final.effects[1:]
    say("exchange test")
    return {name: problem.fit((*others, name), {**final.values, final.effects[0]: 0.0}) for name in chosen}
