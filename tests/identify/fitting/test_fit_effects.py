"""Effects that the user frees by name in a fit."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.small_bench import VALVE, small_record

from thermohyd.identify import fit
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.model.model_file import model_json


def test_a_loop_is_fitted_where_it_is_asked_for():
    """The amount, its error bar and the parameters are right; the model carries the effect to predictions."""
    record = small_record({"hysteresis": 1.2e-6}, seed=5)
    found = fit(record, effects=("hysteresis",))
    assert found.converged
    loop = found.parameters["hysteresis"]
    assert loop.unit == "m"
    assert loop.std is not None
    assert abs(loop.value - 1.2e-6) < 4.0 * loop.std
    assert loop.std < 0.05e-6
    for name in ("clearance", "underlap", "null_bias"):
        estimate = found.parameters[name]
        assert estimate.std is not None
        assert abs(estimate.value - getattr(VALVE, name)) < 4.0 * estimate.std, name
    assert 0.8 < found.reduced_chi2 < 1.2
    assert model_json(found)["effects"]["hysteresis"]["value"] == loop.value
    # A record of one direction knows nothing of it, and no library has a name that was mistyped.
    one_way = {name: replace(test, direction=np.ones(test.rows)) for name, test in record.tests.items()}
    with pytest.raises(BenchInputError, match="hysteresis cannot be fitted: all sweeps run in one direction"):
        fit(replace(record, tests=one_way), effects=["hysteresis"])
    with pytest.raises(
        BenchInputError, match='there is no effect "hysterisis" of static tests; known: supply_edge_wear'
    ):
        fit(record, effects=["hysterisis"])
