"""Who closed the gap on the rows held out, and what may be handed over."""

from dataclasses import replace

import pytest
from helpers.small_bench import small_record
from helpers.small_diagnosis import BIAS, opened, small_diagnosis

from thermohyd.identify.diagnosis.credit import credits_of, not_to_be_handed_over
from thermohyd.identify.diagnosis.diagnose import diagnose_case
from thermohyd.identify.diagnosis.result import DiagnosisResult, HeldOut
from thermohyd.identify.report.diagnosis_words import fault_lines


WORTH = {
    frozenset({"names"}): 0.1,
    frozenset({"faults"}): 0.9,
    frozenset({"weights"}): 0.3,
    frozenset({"names", "faults"}): 0.95,
    frozenset({"names", "weights"}): 0.35,
    frozenset({"faults", "weights"}): 0.9,
    frozenset({"names", "faults", "weights"}): 0.98,
}


def test_of_two_groups_a_share_is_the_mean_of_first_in_and_last_in():
    names, faults = credits_of(("names", "faults"), WORTH.__getitem__)
    assert (names.group, names.first_in, names.last_in) == ("names", 0.1, pytest.approx(0.05))
    assert (faults.first_in, faults.last_in) == (0.9, pytest.approx(0.85))
    assert names.share == pytest.approx(0.075)
    assert faults.share == pytest.approx(0.875)


@pytest.mark.parametrize("groups", [("names",), ("names", "weights"), ("names", "faults", "weights")])
def test_shares_add_up_to_what_all_groups_close(groups):
    found = credits_of(groups, WORTH.__getitem__)
    assert sum(credit.share for credit in found) == pytest.approx(WORTH[frozenset(groups)])
    assert all(credit.first_in == WORTH[frozenset({credit.group})] for credit in found)


@pytest.mark.parametrize(
    ("valves", "believed", "worse"),
    [
        ((5.20, 5.60), True, True),
        ((5.20, 5.60), False, True),
        ((1.02, 1.03), True, False),  # 1 of chi-square in 100 rows: by chance
        ((1.02, 1.03), False, True),
        ((5.20, 5.20), False, False),
        ((5.20, 1.00), False, False),
        (None, True, False),
    ],
)
def test_what_predicts_worse_than_the_ideal_valve_is_not_handed_over(valves, believed, worse):
    held = replace(HeldOut(400, "", 4.2, 0.0, 5.2, 1.0, 1.0), valves=valves and (*valves, 100))
    assert not_to_be_handed_over(held, believed=believed) == worse


@pytest.mark.nightly  # a whole diagnosis
@pytest.mark.parametrize("name", ["pilot", "two"])
def test_names_that_stand_alone_have_all_the_credit(name):
    held = small_diagnosis(name).held_out
    assert held is not None
    [credit] = held.credit
    assert (credit.group, credit.first_in, credit.last_in, credit.share) == ("names", *[held.gap_closed] * 3)
    assert held.valves == (held.reduced_chi2_before, held.reduced_chi2_after, held.rows)
    assert small_diagnosis(name).instead is None


def gain_that_falls(share: float):
    """A null bias under which the spool's gain falls by a share from the lower supply pressure to the higher: no effect does that."""
    return lambda rows: BIAS + share * rows.spool_position * (rows.supply_pressure - 70e5) / 140e5


@pytest.mark.nightly  # a whole diagnosis
def test_a_gain_that_falls_with_the_supply_gives_no_invented_label_and_no_unearned_name():
    result: DiagnosisResult = diagnose_case(opened(small_record(valve={"null_bias": gain_that_falls(0.1)}, seed=5)))
    assert result.verdict == "unexplained"
    assert not any(fault.name.startswith("wrong_") for fault in result.after.faults)
    assert not any(rival.name.startswith("wrong_") for effect in result.effects for rival in effect.alternatives)
    assert all(effect.gap_closed >= 0.1 for effect in result.effects)
    assert {suspect.name for suspect in result.suspects} == {"wrong_supply", "viscosity_shift"}
    assert all(suspect.fault or min(suspect.closes or ()) < 0.1 for suspect in result.suspects)
    held = result.held_out
    assert held is not None
    assert held.valves is not None
    assert (result.instead is not None) == (held.valves[1] > held.valves[0])
    assert sum(credit.share for credit in held.credit) == pytest.approx(held.gap_closed)
    assert len(fault_lines(result)) == sum(not fault.rows for fault in result.after.faults)
