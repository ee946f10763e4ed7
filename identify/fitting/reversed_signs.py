"""Which readings have the wrong sign: a load pressure or flow that falls as the spool opens is taken with its sign turned. No JAX."""

from dataclasses import replace

import numpy as np

from thermohyd.identify.bench.test_record import Channel, TestRecord


SIGNED = {"load_pressure": "p_A - p_B", "flow": "the flow from A to B"}
# Correlation with the position below which a channel is reversed beyond doubt; a sound one has it near +1.
REVERSED = -0.5


def _reversed(position: np.ndarray, value: np.ndarray) -> bool:
    if np.ptp(position) == 0.0 or np.ptp(value) == 0.0:
        return False
    return float(np.corrcoef(position, value)[0, 1]) < REVERSED


def reversed_channels(test: TestRecord) -> tuple[str, ...]:
    """Channels of a test whose sign contradicts the convention that +x gives positive flow and load pressure."""
    if test.name == "load_flow":  # its flow follows the imposed load pressure as well
        return ()
    # The sign of a free gain is the fit's to find.
    signed = (c for c in test.channels if c.name in SIGNED and not c.signal)
    return tuple(c.name for c in signed if _reversed(test.spool_position, c.value))


def with_signs_turned(test: TestRecord, names: tuple[str, ...]) -> TestRecord:
    """The test with the readings of the named channels negated."""

    def turned(channel: Channel) -> Channel:
        return replace(channel, value=-channel.value) if channel.name in names else channel

    return replace(test, channels=tuple(turned(c) for c in test.channels))


def warning_of(test: TestRecord, name: str) -> str:
    """What the user must know about a reversed channel."""
    return (
        f"{test.name}: {name} falls as the spool moves to +x, so its sign was turned: it is taken as minus {SIGNED[name]}. "
        "If every test is reversed, it is the polarity in [valve] that is wrong"
    )
