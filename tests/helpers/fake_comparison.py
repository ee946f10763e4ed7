"""A ComparisonResult made by hand, for tests of what the user sees: plausible numbers, nothing was compared."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from helpers.fake_diagnosis import UM, fake_diagnosis
from thermohyd.identify.comparison.result import ComparisonResult, Difference, Side


def _row(name: str, state: Any, first: float, second: float, std: float, **more: Any) -> Difference:
    size = second - first
    sides = Side(first, std), Side(second, std)
    return Difference(
        name,
        "parameter",
        "m",
        *sides,
        state,
        size,
        std,
        (size - 2.0 * std, size + 2.0 * std),
        1.3 * std,
        1e-3,
        size / std,
        **more,
    )


def fake_comparison(**changes: Any) -> ComparisonResult:
    """The clearance differs, the edge radius does not, of the underlap nothing is known; `changes` replace fields."""
    both = [fake_diagnosis(kind, points=12) for kind in ("consistent", "named")]
    records = [
        replace(d.record, folder=Path(name), name=name) for d, name in zip(both, ("before", "after"), strict=True)
    ]
    first, second = (replace(d, record=record) for d, record in zip(both, records, strict=True))
    blind = Difference("underlap", "parameter", "m", Side(15.0 * UM, None), None, "cannot tell", why="at its limit")
    result = ComparisonResult(
        names=("before", "after"),
        records=(records[0], records[1]),
        diagnoses=(first, second),
        verdict="different",
        headline="after differs from before in clearance +0.30 +/- 0.02 um.",
        sentences=("No difference: edge_radius +0.01 +/- 0.05 um.",),
        rows=(
            _row("clearance", "differs", 2.0 * UM, 2.3 * UM, 0.02 * UM),
            _row("edge_radius", "same", 15.0 * UM, 15.01 * UM, 0.05 * UM),
            blind,
        ),
        shared=(),
        effects=(),
        level=0.01,
        critical=3.1,
        same_p=0.4,
        one_of=(),
        reduced_chi2=(1.01, 1.02),
        same_bench=True,
        converged=True,
        message="",
        seconds=1.0,
    )
    return replace(result, **changes)
