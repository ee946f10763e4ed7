"""The registry against its classes, the order of effects, row by row or not, and one more as CONTRIBUTING adds it."""

import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_jit
from helpers.valves import seed_valve
from reference.valve import Effects

from thermohyd.conditions import operating_points
from thermohyd.effects.library import EFFECTS, effect, unregister_effect, whole_library, with_effects
from thermohyd.static_tests import leakage_flow
from thermohyd.valve import rowwise


def test_the_effects_of_the_reference():
    # The reference takes what ports store beside its effects.
    assert set(EFFECTS) == {*Effects.__dataclass_fields__, "port_compliance_a", "port_compliance_b"}
    assert len({info.effect_class for info in EFFECTS.values()}) == 33


@pytest.mark.parametrize("name", EFFECTS)
def test_registry_line(name):
    info = EFFECTS[name]
    assert info.lower <= 0.0 < info.upper
    assert 0.0 < info.typical[0] <= info.scale <= info.typical[1] <= info.upper
    assert set(info.shows) <= {"leakage", "pressure_gain", "flow_gain", "load_flow"}
    assert len(info.stages) == (2 if name in ("pressure_offset", "load_pressure_scale") else 1)
    assert info.sentence[0].islower()
    assert not info.sentence.endswith(".")
    text = str(info.effect_class.__doc__)
    assert "Source:" in text
    assert "Amount" in text
    assert "Shows" in text
    assert float(effect(name).amount) == 0.0


def test_unknown_name_is_told_the_known_ones():
    with pytest.raises(KeyError, match=r"unknown effect 'supply_drop'; known: .*supply_droop"):
        effect("supply_drop")


def test_listing_order_does_not_matter():
    names = ["flowmeter_offset", "position_lag", "hysteresis", "flowmeter_lag", "position_scale", "flowmeter_scale"]
    one = with_effects(seed_valve(), dict.fromkeys(names, 0.1)).effects
    two = with_effects(seed_valve(), dict.fromkeys(reversed(names), 0.1)).effects
    assert [type(e) for e in one] == [type(e) for e in two]
    order = [type(e).__name__ for e in one]
    assert order.index("PositionScale") < min(order.index("Hysteresis"), order.index("PositionLag"))
    assert order.index("FlowmeterLag") < order.index("FlowmeterScale") < order.index("FlowmeterOffset")


def test_only_lag_and_storage_tie_rows_together():
    tied = [name for name in EFFECTS if not EFFECTS[name].rowwise]
    assert tied == ["port_compliance_a", "port_compliance_b", "flowmeter_lag"]
    assert [EFFECTS[name].stores for name in tied] == [True, True, False]
    assert rowwise(with_effects(seed_valve(), {"hysteresis": 1e-6}))
    assert not rowwise(with_effects(seed_valve(), {"hysteresis": 1e-6, "flowmeter_lag": 0.0}))


def test_one_more_effect_as_contributing_adds_it():
    page = (Path(__file__).parents[2] / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = page.split("## Adding an effect")[1].split("\n## ")[0]
    blocks = re.findall(r"```python\n(.*?)```", section, flags=re.DOTALL)
    assert len(blocks) == 2
    namespace = {"__name__": "contributing"}
    try:
        for block in blocks:
            exec(block, namespace)
        c = operating_points(jnp.linspace(-5e-5, 5e-5, 5), supply_pressure=70e5, temperature=313.15)
        leakage = quick_jit(leakage_flow)
        ideal, worn = leakage(seed_valve(), c), leakage(with_effects(seed_valve(), {"slot_wear": 0.1}), c)
        np.testing.assert_allclose(np.asarray(worn), 1.1 * np.asarray(ideal), rtol=1e-12)
        assert np.array_equal(leakage(with_effects(seed_valve(), {"slot_wear": 0.0}), c), ideal)
    finally:
        unregister_effect("slot_wear")
    assert "slot_wear" not in whole_library()
