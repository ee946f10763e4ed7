"""The record data/whole_servo: every kind of test of one valve and its jack."""

from reference.actuator import Jack
from reference.sample_text import truth_table
from reference.valve import Valve
from reference.whole_record import BACK, NOISE, STATIC, SUPPLY, TEMPERATURE, Whole, files_of


VALVE = Valve(
    edge_radius=10e-6,
    clearance=2.5e-6,
    underlap=7e-6,
    discharge_coefficient=0.68,
    transition_number=90.0,
    null_bias=1.2e-6,
)
JACK = Jack(
    amplifier_gain=0.03, spool_frequency=78.0, spool_damping=0.9, bulk_modulus_factor=0.85, viscous_friction=2400.0
)
SERVO = Whole(
    VALVE, JACK, seed=31, conditions=tuple((t, p) for t in (20.0, 40.0, 60.0) for p in (70.0, 210.0)), points=25
)


def files() -> dict[str, str]:
    """{file name: text}"""
    made = files_of(
        SERVO, "whole servo (synthetic)", "One valve and its jack: static tests, step tests, a frequency response."
    )
    return {**made, "README.md": readme()}


def readme() -> str:
    noise = ", ".join(
        f"{test.replace('_', ' ')} {SERVO.noise[test]:g} {unit}" for test, (_, unit, *_) in STATIC.items()
    )
    runs = "".join(
        f"- `{test}`: {len(plan.steps)} runs of {plan.seconds:g} s, a row every {plan.spacing * 1e3:g} ms"
        + (f", at {' and '.join(f'{p:g}' for p in plan.supplies)} bar in turn" if plan.supplies else "")
        + "\n"
        for test, plan in SERVO.steps.items()
    )
    jack = "".join(
        f"| {name} | {value} |\n"
        for name, value in (
            ("spool_frequency", f"{JACK.spool_frequency:g} Hz"),
            ("spool_damping", f"{JACK.spool_damping:g}"),
            ("bulk_modulus_factor", f"{JACK.bulk_modulus_factor:g}"),
            ("viscous_friction", f"{JACK.viscous_friction:g} N s/m"),
        )
    )
    return f"""# Sample record: a whole servo

Synthetic: made by the project's reference simulator (SciPy), not measured. One valve and the jack that it drives, through
every kind of test: leakage, pressure gain and flow gain, swept up and down at 20, 40 and 60 degC and 70 and 210 bar; a
small-signal response of the closed position loop; and two step tests of it, of different sampling rates:

{runs}
Where a test has no such column, {SUPPLY:g} bar at the supply, {BACK:g} bar at the return and {TEMPERATURE:g} degC.

Ideal valve, isothermal in the static tests; adiabatic chambers; no missing effect. White noise as bench.toml states it
(standard deviations: {noise}; spool position {NOISE["spool_position"]:g} um,
pressures {NOISE["pressure_a"]:g} bar, piston {NOISE["piston_position"]:g} mm; response 1 % and 0.5 deg).

{truth_table(VALVE)}{jack}"""
