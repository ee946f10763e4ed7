"""What a command on several records says of the time left."""

import pytest

from thermohyd.identify.cli.several_records import time_left


@pytest.mark.parametrize(
    ("took", "left", "words"),
    [
        ([], 8, ""),
        ([40.0], 7, ", about 5 min left"),
        ([40.0, 9.0], 6, ", about 54 s left"),  # the first one compiled
        ([40.0, 9.0, 11.0], 1, ", about 10 s left"),
        ([0.1, 0.1], 1, ", about 1 s left"),
    ],
)
def test_the_time_left_goes_by_the_records_that_compile_nothing(took, left, words):
    assert time_left(took, left) == words
