"""The dynamic sample records: data/seed_actuator, and data/hidden_dynamic with effects that the program must find."""

from reference.actuator import Dynamic
from reference.dynamic_bench import Bench, frequency_table, plain, step_table, toml
from reference.sample_text import csv_text


FREQUENCIES = tuple(round(2.0 * 1.25**i, 3) for i in range(20))
LIVELY = {"steps": (3.0, -6.0, 1.5), "seconds": 0.3}
SEED = plain(11, **LIVELY, frequencies=FREQUENCIES)
# Name of the record: what is hidden in it.
HIDDEN = {
    "servo_1": (plain(21, **LIVELY, dynamic=Dynamic(coulomb_friction=150.0)), {"coulomb_friction": 150.0}),
    "servo_2": (plain(22, **LIVELY, dynamic=Dynamic(spool_delay=1.5e-3)), {"spool_delay": 1.5e-3}),
    "servo_3": (plain(23, **LIVELY), {}),
}

README = """# Sample record: an actuator on the seed valve

Synthetic: made by the project's reference simulator (SciPy), not measured. A jack of 12 cm2 and 50 kg in a closed position
loop: three steps of the setpoint at 210 bar and 40 degC, and a small-signal response. Adiabatic chambers, no missing
effect, white noise as bench.toml states it. The valve's own parameters are given in bench.toml and held.

The truth, which the program never reads:

| parameter | value |
|---|---|
| spool_frequency | 85 Hz |
| spool_damping | 0.8 |
| bulk_modulus_factor | 0.8 |
| viscous_friction | 2600 N s/m |
"""

HIDDEN_README = """# Dynamic records with a hidden effect

Synthetic: made by the project's reference simulator (SciPy), not measured. The actuator of `seed_actuator` with, in some
records, physics that the plain model lacks. `truth.json` says what; the program never reads it. Try
`thermohyd diagnose data/hidden_dynamic/servo_1`.
"""


def files_of(bench: Bench, comment: str, name: str) -> dict[str, str]:
    """{file name: text}"""
    found = {"bench.toml": toml(bench, f"# {comment}", name), "step.csv": csv_text([], step_table(bench))}
    if bench.frequencies:
        found["frequency.csv"] = csv_text([], frequency_table(bench))
    return found


def truth() -> dict:
    """What truth.json says of every hidden record."""
    jack = SEED.jack
    own = {
        name: getattr(jack, name)
        for name in ("spool_frequency", "spool_damping", "bulk_modulus_factor", "viscous_friction")
    }
    return {name: {"parameters": own, "effects": effects} for name, (_, effects) in HIDDEN.items()}
