"""What is hidden in which record of a set.

Sets 1, 2 and 4: 46 single effects, 10 records with none, 10 pairs, 10 from outside the library. Set 3: each effect once, so
small that it is at the edge of what the record can show, and 27 records with none.
"""

from dataclasses import dataclass

import numpy as np

from reference.hidden_bench import Bench, random_bench
from reference.hidden_size import delta, parameter_columns, whitened
from reference.hidden_strengths import EITHER_SIGN, FAMILIES, OUTSIDE, STRENGTHS
from reference.valve import Effects


# Set 1 is for development, the others are looked at once at the end; sets 4 to 9 by leave_one_out.py alone.
SEEDS = {1: 20260101, 2: 77003, 3: 515151, 4: 20261128, 5: 909192, 6: 606361, 7: 264575, 8: 282842, 9: 316227}
NOTHING_WRONG = 120  # records of set 6
FAINT = (3.0, 8.0)  # noise units that an effect of set 3 leaves beside the six parameters
LEAST_OF_A_PAIR = 6.0  # noise units that each of two effects leaves beside the parameters and the other one


@dataclass(frozen=True)
class Hidden:
    """A record's bench, and what is hidden there: `effects` of the library {name: amount}, or one from outside.

    kind: "none", "single", "pair" or "outside"; strength: "faint", "weak" or "strong" of a single one.
    """

    bench: Bench
    kind: str
    effects: dict[str, float]
    outside: tuple[str, float] | None
    strength: str
    declared: bool
    seed: tuple[int, ...]  # of the noise


def plan(seed_set: int) -> list[Hidden]:
    """The records of a set, in an order that tells nothing; the same ones every time."""
    seed = SEEDS[seed_set]
    shuffle = np.random.default_rng([seed, 999])
    cases = _cases(seed_set)
    declared = shuffle.permutation(np.arange(len(cases)) % 2 == 0)
    gauges = shuffle.permutation(np.arange(len(cases)) % 4 == 0)
    made = []
    for i, (kind, name, strength) in enumerate(cases):
        random = np.random.default_rng([seed, i])
        # Noise alternates, and over an effect's two strengths it is once white and once correlated.
        correlated = (i // 2 + i) % 2 == 1
        while True:
            effects = _effects(random, kind, name, strength)
            ports = bool(gauges[i]) and "pressure_offset" not in effects
            bench = random_bench(random, correlated=correlated, ports_measured=ports)
            if kind != "pair" or min(deltas(bench, effects).values()) >= LEAST_OF_A_PAIR:
                break
        if strength == "faint":
            effects = _scaled(bench, effects, random.uniform(*FAINT))
        outside = (name, OUTSIDE[name] * random.uniform(0.8, 1.25)) if kind == "outside" else None
        made.append(Hidden(bench, kind, effects, outside, strength, bool(declared[i]), (seed, i, 1)))
    return [made[i] for i in shuffle.permutation(len(made))]


def _cases(seed_set: int) -> list[tuple[str, str, str]]:
    """(kind, name, strength) of each record, before they are shuffled."""
    if seed_set == 3:
        return [*(("single", name, "faint") for name in STRENGTHS), *(("none", "", "") for _ in range(27))]
    if seed_set == 6:
        return [("none", "", "")] * NOTHING_WRONG
    return [
        *(("single", name, strength) for name in STRENGTHS for strength in ("weak", "strong")),
        *(("none", "", "") for _ in range(10)),
        *(("pair", "", "") for _ in range(10)),
        *(("outside", name, "") for name in OUTSIDE),
    ]


def _scaled(bench: Bench, effects: dict[str, float], wanted: float) -> dict[str, float]:
    """A single effect made as large as leaves `wanted` noise units beside the six parameters."""
    ((name, amount),) = effects.items()
    for _ in range(4):  # most effects are nearly linear, wear and eccentricity are not
        factor = wanted / deltas(bench, {name: amount})[name]
        amount *= float(np.clip(factor, 0.4, 2.5)) ** 0.7
    return {name: float(f"{amount:.4g}")}


def _effects(random: np.random.Generator, kind: str, name: str, strength: str) -> dict[str, float]:
    sign = lambda name: float(random.choice([-1.0, 1.0])) if name in EITHER_SIGN else 1.0
    if kind == "single":
        return {name: sign(name) * STRENGTHS[name][1 if strength == "strong" else 0]}
    if kind != "pair":
        return {}
    families = random.choice(list(FAMILIES), 2, replace=False)
    names = [str(random.choice(FAMILIES[family])) for family in families]
    size = lambda name: float(np.sqrt(np.prod(STRENGTHS[name])) * random.uniform(0.7, 1.4))
    return {name: sign(name) * size(name) for name in names}


def deltas(bench: Bench, effects: dict[str, float]) -> dict[str, float]:
    """Noise units that each effect leaves beside the six parameters and the other effects (linearised)."""
    columns = parameter_columns(bench)
    full = bench.ideal(bench.valve, Effects(**effects))
    signatures = {}
    for name in effects:
        without = bench.ideal(bench.valve, Effects(**{k: v for k, v in effects.items() if k != name}))
        signatures[name] = whitened(bench, {k: full[k] - without[k] for k in full})
    return {
        name: delta(signature, np.column_stack([columns, *(s for other, s in signatures.items() if other != name)]))
        for name, signature in signatures.items()
    }
