"""petab_select as a peer: what its choices count for, and whether its searches find the best model (where it is installed)."""

import pytest


EFFECTS = ("hysteresis", "land_leakage", "pilot_leakage", "position_lag", "supply_edge_wear")
GAINS = {
    "hysteresis": 200.0,
    "land_leakage": 30.0,
    "pilot_leakage": 7.5,
}  # chi-square; an effect that is not there gains 0.5


def truth(*hidden, ports_measured=False):
    return {
        "kind": "single" if hidden else "none",
        "effects": dict.fromkeys(hidden, 1.0),
        "ports_measured": ports_measured,
    }


@pytest.mark.parametrize(
    ("hidden", "named", "inside", "nothing_false", "exact"),
    [
        ((), (), None, True, True),
        ((), ("hysteresis",), None, False, False),
        (("hysteresis",), ("hysteresis",), True, True, True),
        (("hysteresis",), ("hysteresis", "position_lag"), True, False, False),
        (("hysteresis", "position_lag"), ("hysteresis",), False, True, False),
        (("flow_saturation",), ("return_back_pressure",), True, True, True),  # exact rivals
    ],
)
def test_a_choice_is_judged_by_what_is_hidden(of_benchmarks, hidden, named, inside, nothing_false, exact):
    tables = of_benchmarks("_petab_tables")
    case = tables.as_case(truth(*hidden), named)
    assert (tables.inside(case), tables.nothing_false(case), tables.exact(case)) == (inside, nothing_false, exact)


def test_rivals_that_gauges_tell_apart_are_no_rivals(of_benchmarks):
    tables = of_benchmarks("_petab_tables")
    assert tables.exact(tables.as_case(truth("supply_edge_wear"), ["return_edge_wear"]))
    assert not tables.exact(tables.as_case(truth("supply_edge_wear", ports_measured=True), ["return_edge_wear"]))


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("method", ["forward", "famos"])
@pytest.mark.parametrize(("criterion", "best"), [("AICc", 3), ("BIC", 2)])
def test_petab_select_finds_the_best_model(of_benchmarks, tmp_path, method, criterion, best):
    pytest.importorskip("petab_select")
    petab = of_benchmarks("_petab_select")
    asked = []

    def nllh(effects):
        asked.append(effects)
        return 0.5 * (5000.0 - sum(GAINS.get(name, 0.5) for name in effects))

    space = petab.write_space(tmp_path, ["clearance", "null_bias"], {"null_bias": (0.0, 1.0)}, EFFECTS, 3000)
    choice = petab.chosen(space, method, criterion, nllh, 100)
    assert choice.effects == tuple(GAINS)[:best]
    assert choice.complete
    assert choice.models == len(asked) == len(set(asked)) < 2 ** len(EFFECTS)
    free, data = 2 + best, 3000 + 1
    penalty = {"AICc": 2 * free + 2 * free * (free + 1) / (data - free - 1), "BIC": free * 8.006700845440367}
    assert choice.criterion == pytest.approx(2.0 * nllh(frozenset(choice.effects)) + penalty[criterion])
    assert not petab.chosen(space, method, criterion, nllh, 5).complete
