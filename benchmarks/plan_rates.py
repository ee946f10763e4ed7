"""Does `plan` say before any measurement what diagnoses of records then find, and what they confuse?

    plan_rates.py [--records 84] [--seed 1] [--processes 1]     predicted beside observed, and a picture in build/plan_rates
    plan_rates.py --show ...                                    only the table of the answers so far

Random valves by the reference simulator, three static tests of 256 rows at three temperatures and two supplies, stated white noise. Each
record hides one effect of the library, in turn, in 0.6, 1 or 1.6 times the amount that the plan says is found in 90 % of records.
The plan knows the conditions, the noise and the valve's parameters ("expected"), or takes the nominal valve ("nominal").
"""

import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest


sys.path.insert(0, str(Path(__file__).parent))

from _hidden_run import ROOT, answers_of_seeds, plain
from compare_pairs import share


WORK = ROOT / "build" / "plan_rates"
FACTORS = (0.6, 1.0, 1.6)  # of the least visible amount
LEFT_OUT = ("port_compliance_a", "port_compliance_b")  # their records take a simulation in time
BINS = ((0.0, 0.05), (0.05, 0.35), (0.35, 0.65), (0.65, 0.95), (0.95, 1.0))
NOISE = 2.5  # times that of the small bench


VALVES = 4  # random ones, in turn: a plan each


def valve_of(seed: int, number: int) -> dict[str, float]:
    random = np.random.default_rng([15, seed, number % VALVES])
    return {
        "edge_radius": random.uniform(4e-6, 18e-6),
        "clearance": random.uniform(1.5e-6, 4e-6),
        "underlap": random.uniform(1e-6, 15e-6),
        "discharge_coefficient": random.uniform(0.62, 0.76),
        "transition_number": random.uniform(70.0, 140.0),
        "null_bias": random.uniform(-3e-6, 3e-6),
    }


def _stated(record: Any) -> Any:
    """The record with its noise said as bench.toml says it, so that a plan may do without the readings."""
    from dataclasses import replace

    tests = {
        name: replace(test, stated_noise={c.name: float(c.std[0]) for c in test.channels})
        for name, test in record.tests.items()
    }
    return replace(record, tests=tests)


@cache
def views_of(seed: int, which: int | None) -> Any:
    """What the plan says of one of the random valves, or (None) of the nominal one."""
    sys.path.insert(0, str(ROOT / "tests"))
    from thermohyd.identify.cli.jax_setup import set_up_jax

    set_up_jax()
    from helpers.small_bench import small_record

    from thermohyd.identify.model.model import Model
    from thermohyd.identify.planning.planned_problem import prospect_of
    from thermohyd.identify.planning.visible import view_of

    empty = _stated(small_record(noise=NOISE))
    model = None if which is None else Model(empty.valve, empty.oil, valve_of(seed, which))
    return view_of(prospect_of(empty, model))


def with_chances(answer: dict[str, Any]) -> dict[str, Any]:
    """The answer with what both plans say of it: {"found": chance, "rivals": {effect: chance}}."""
    from thermohyd.identify.planning.visible import chance_of_finding, chance_of_rival

    effect, amount, chances = answer["effect"], abs(answer["amount"]), {}
    for which, valve in (("expected", answer["number"] % VALVES), ("nominal", None)):
        view = views_of(answer["seed"], valve)
        others = [s.name for s in view.sights if s.name != effect]
        chances[which] = {
            "found": chance_of_finding(view.sights[view.place(effect)], amount, view.critical),
            "rivals": {other: chance_of_rival(view, effect, other, amount) for other in others},
        }
    return {**answer, "chances": chances}


def ask(job: tuple[int, int]) -> dict[str, Any]:
    """One record: the plan's chances for the hidden effect, and what the diagnosis found; a failure is an answer too."""
    seed, number = job
    sys.path.insert(0, str(ROOT / "tests"))
    from thermohyd.identify.cli.jax_setup import keep_memory_flat, set_up_jax

    set_up_jax()
    from helpers.small_bench import small_record

    from thermohyd.effects.library import EFFECTS
    from thermohyd.identify.diagnosis.diagnose import diagnose

    names = [name for name in EFFECTS if name not in LEFT_OUT]
    effect, factor = names[number % len(names)], FACTORS[(number // len(names) + number) % len(FACTORS)]
    valve, name = valve_of(seed, number), f"record_{number:03d}"
    try:
        view = views_of(seed, number % VALVES)
        sight = view.sights[view.place(effect)]
        amount = factor * sight.amount * (1.0 if number % 2 or EFFECTS[effect].lower == 0.0 else -1.0)
        record = small_record({effect: amount}, seed=1000 * seed + number, noise=NOISE, valve=valve)
        found = diagnose(record, model_form=False)
    except Exception as error:
        return {"record": name, "error": f"{type(error).__name__}: {error}"}
    finally:
        keep_memory_flat()
    alike = {e.name: [a.name for a in e.alternatives] for e in found.effects}
    return plain(
        {
            "record": name,
            "headline": f"{effect} x {factor}: {found.headline}",
            "effect": effect,
            "factor": factor,
            "amount": amount,
            "visible": sight.visible,
            "verdict": found.verdict,
            "named": alike,
            "suspects": [s.name for s in found.suspects],
            "seed": seed,
            "number": number,
            "seconds": found.seconds,
        }
    )


def is_found(answer: dict[str, Any]) -> bool:
    """Whether the effect is named, or a rival of what is."""
    return any(answer["effect"] in (name, *others) for name, others in answer["named"].items())


def stood_beside(answer: dict[str, Any]) -> set[str]:
    """What the diagnosis could not tell from the hidden effect."""
    groups = [{name, *others} for name, others in answer["named"].items()]
    return set().union(*(group for group in groups if answer["effect"] in group)) - {answer["effect"]}


def binned(pairs: list[tuple[float, bool]]) -> list[tuple[float, int, int]]:
    """(mean chance, hits, of) of each bin that holds some."""
    found = []
    for low, high in BINS:
        own = [(chance, hit) for chance, hit in pairs if low <= chance < high or (high == 1.0 == chance)]
        if own:
            found.append((float(np.mean([c for c, _ in own])), sum(hit for _, hit in own), len(own)))
    return found


def pairs_of(good: list[dict[str, Any]], which: str) -> dict[str, list[tuple[float, bool]]]:
    """{what: (chance, whether it happened)}; rivals of found effects only."""
    found = [a for a in good if is_found(a)]
    return {
        "found": [(a["chances"][which]["found"], is_found(a)) for a in good],
        "rivals": [(c, n in stood_beside(a)) for a in found for n, c in a["chances"][which]["rivals"].items()],
    }


def table(answers: dict[str, dict[str, Any]]) -> str:
    good = [a for a in answers.values() if "error" not in a]
    lines = [f"{len(good)} records with one hidden effect"]
    for factor in FACTORS:
        own = [a for a in good if a["factor"] == factor]
        for which in ("expected", "nominal"):
            mean = np.mean([a["chances"][which]["found"] for a in own] or [np.nan])
            lines.append(
                f"  {factor} x least, {which} valve: predicted {mean:.0%}, found {share(sum(map(is_found, own)), len(own))}"
            )
    for which in ("expected", "nominal"):
        for what, pairs in pairs_of(good, which).items():
            lines.append(f"{what}, {which} valve: predicted, observed")
            lines += [f"  {chance:6.1%}  {share(hits, of)}" for chance, hits, of in binned(pairs)]
    missed = [a for a in good if not is_found(a) and a["chances"]["expected"]["found"] > 0.85]
    lines += [
        f"missed at {a['chances']['expected']['found']:.0%}: {a['record']} {a['headline']}; suspects {a['suspects']}"
        for a in missed
    ]
    early = [a for a in good if is_found(a) and a["chances"]["expected"]["found"] < 0.15]
    lines += [f"found at {a['chances']['expected']['found']:.0%}: {a['record']} {a['headline']}" for a in early]
    lines += [f"failed: {a['record']}: {a['error']}" for a in answers.values() if "error" in a]
    return "\n".join(lines)


def picture(answers: dict[str, dict[str, Any]], path: Path) -> None:
    """Predicted against observed, with 95 % intervals (Wilson)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    good = [a for a in answers.values() if "error" not in a]
    figure = Figure(figsize=(9.0, 4.4))
    for axes, (what, title) in zip(
        figure.subplots(1, 2), (("found", "effect found"), ("rivals", "rival not told apart")), strict=True
    ):
        axes.plot((0, 1), (0, 1), color="#8a8a8a", linewidth=0.8)
        for which, colour, shift in (("expected", "#2f6fb0", 0.0), ("nominal", "#d99a00", 0.012)):
            for chance, hits, of in binned(pairs_of(good, which)[what]):
                band = binomtest(hits, of).proportion_ci(method="wilson")
                rate = hits / of
                axes.errorbar(
                    chance + shift,
                    rate,
                    [[max(rate - band.low, 0.0)], [max(band.high - rate, 0.0)]],
                    color=colour,
                    marker="o",
                )
                axes.annotate(str(of), (chance + shift, rate), xytext=(5, -9), textcoords="offset points", fontsize=7)
            axes.plot([], [], color=colour, marker="o", label=f"{which} valve")
        axes.set_xlabel("predicted before any measurement")
        axes.set_ylabel("observed")
        axes.set_title(f"{title} (records or pairs beside each point)", fontsize=9)
        axes.legend(frameon=False, fontsize=8)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    FigureCanvasAgg(figure).print_png(str(path))


def main() -> None:
    seed, found = answers_of_seeds(__doc__ or "", "record", 84, WORK, 3, ask)
    found = {name: answer if "error" in answer else with_chances(answer) for name, answer in found.items()}
    print(table(found))
    picture(found, WORK / f"seed{seed}.png")


if __name__ == "__main__":
    main()
