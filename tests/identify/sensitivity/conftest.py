"""These tests compile the large programs of a study for several valves and run them once, on few rows: quickly compiled
is enough, and what a study fills up to one size is filled up to a small one."""

import pytest
from helpers.quick_compile import quick_compile

from thermohyd.identify.sensitivity import curves as row_slopes, static_figures as outputs, study


SMALL = {
    row_slopes: {"ROWS": 128},
    outputs: {"CHUNK": 128},
    study: {"DERIVATIVE_SAMPLES": 16, "POSITIONS": 31, "POSTERIOR_EVALUATIONS": 512},
}


@pytest.fixture(autouse=True, scope="module")
def quick():
    usual = {module: {name: getattr(module, name) for name in sizes} for module, sizes in SMALL.items()}
    with quick_compile():
        for module, sizes in SMALL.items():
            vars(module).update(sizes)
        yield
        for module, sizes in usual.items():
            vars(module).update(sizes)
