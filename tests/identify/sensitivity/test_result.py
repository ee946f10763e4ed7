"""A study as a table: every index and slope beside the names of its factor and its figure."""

from types import SimpleNamespace

import numpy as np

from thermohyd.identify.sensitivity.result import SensitivityResult


def test_table_is_in_the_order_of_the_ranking():
    named = lambda *names: tuple(SimpleNamespace(name=name) for name in names)
    slope, first, total = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[0.1, 0.6], [0.2, 0.5]]), np.full((2, 2), 0.9)
    study = SimpleNamespace(
        factors=named("edge_radius", "clearance"),
        outputs=named("null_leakage", "flow_gain"),
        slope=slope,
        tolerances=SimpleNamespace(sobol=SimpleNamespace(first=first, total=total)),
        ranking=lambda: [1, 0],
        elasticity=lambda: 10.0 * slope,
    )
    table = SensitivityResult.to_dataframe(study)  # pyright: ignore[reportArgumentType]
    assert [*table.index] == [
        (factor, output) for factor in ("clearance", "edge_radius") for output in ("null_leakage", "flow_gain")
    ]
    row = table.loc[("clearance", "flow_gain")]
    assert row.to_dict() == {"slope": 4.0, "elasticity": 40.0, "total_index": 0.9, "first_order_index": 0.5}
