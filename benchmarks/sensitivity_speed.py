"""All sensitivities against one simulation, and a Sobol study against the NumPy reference in a loop over its samples.

Claimed: all sensitivities of all curves to all parameters at most 6 times one simulation; a 65,536-sample Sobol study of
the three static tests in under 20 s on 2 cores and at least 30 times faster than the NumPy reference in a loop.
"""

import time

import jax


jax.config.update("jax_enable_x64", True)

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from _peers import compare, machine
from reference import static_tests
from reference.oil import Oil, walther
from reference.valve import Effects, Rows, Valve

from thermohyd.conditions import Conditions
from thermohyd.identify.sensitivity.curves import COLUMNS, nominal_rows, readings_and_slopes, three_tests
from thermohyd.identify.sensitivity.factors import factors_of
from thermohyd.identify.sensitivity.global_measures import sobol_indices, sobol_samples
from thermohyd.identify.sensitivity.source import seed_model
from thermohyd.identify.sensitivity.static_figures import IS_NULL, OUTPUTS, SHARES, StaticTests
from thermohyd.identify.sensitivity.varied import valve_of_model


MODEL = seed_model()
SEED_OIL = [[-40.0, 4000.0], [70.0, 30.0]]  # degC, cSt
AT = (313.15, 70e5, 0.0)
SAMPLES = 65_536
OF_THE_LOOP = 256  # samples that the NumPy loop really does; its time is scaled to all of them


def jacobian_cost() -> None:
    """Curves of 128 positions at 8 temperatures and 4 supply pressures, one piece of `slopes_at`."""
    share = np.linspace(-1.0, 1.0, 128)
    x, ps, t = (
        a.reshape(-1)
        for a in np.meshgrid(
            MODEL.valve.stroke * share * np.abs(share), [35e5, 70e5, 105e5, 210e5], np.linspace(243.15, 343.15, 8)
        )
    )
    conditions = Conditions(*map(jnp.asarray, (x, ps, np.zeros(len(x)), t)))
    valve = valve_of_model(MODEL)
    cold = eqx.tree_at(lambda v: v.heat_retention, valve, None)
    values = nominal_rows(valve, len(x))
    simulate = eqx.filter_jit(three_tests)
    medians = compare(
        {
            f"one simulation of 3 x {len(x)} readings": lambda: jax.block_until_ready(simulate(valve, conditions)),
            "... isothermal, no heat computed": lambda: jax.block_until_ready(simulate(cold, conditions)),
            f"simulation and all {len(COLUMNS)} sensitivities": lambda: jax.block_until_ready(
                readings_and_slopes(valve, conditions, values)
            ),
        },
        21,
    )
    base = next(iter(medians.values()))
    for name, seconds in medians.items():
        print(f"  {name:48s} {1e3 * seconds:7.2f} ms   {seconds / base:5.2f} simulations")


def reference_sample(sample: dict[str, float], oil: Oil) -> None:
    """What `StaticTests.outputs` simulates of one sample, as a NumPy user would write it: the three tests at 26 positions."""
    x = np.where(IS_NULL, SHARES * MODEL.valve.stroke + sample["null_bias"], SHARES * sample["stroke"])
    column = np.ones_like(x)
    rows = Rows(
        x, sample["supply_pressure"] * column, sample["return_pressure"] * column, sample["temperature"] * column
    )
    names = (
        "slot_width",
        "edge_radius",
        "clearance",
        "underlap",
        "discharge_coefficient",
        "transition_number",
        "null_bias",
    )
    valve = Valve(**{name: sample[name] for name in names})  # pyright: ignore[reportArgumentType]
    effects = Effects(throttle_heating=sample["heat_retention"], viscosity_shift=sample["viscosity"] - 1.0)
    for test in ("leakage", "pressure_gain", "flow_gain"):
        static_tests.TESTS[test](valve, oil, rows, effects)


def sobol_study() -> None:
    """65,536 samples of 14 factors: every one through the three tests, then indices of 8 figures with intervals."""
    factors = factors_of(MODEL, *AT)
    tests = StaticTests(valve_of_model(MODEL), factors, *AT)
    low, high = (np.array([getattr(f, end) for f in factors]) for end in ("low", "high"))
    base = SAMPLES // (len(factors) + 2)
    tests.outputs(low[None])  # compiled once; both contenders start warm
    began = time.perf_counter()
    samples = low + (high - low) * sobol_samples(len(factors), base)
    drawn = time.perf_counter()
    values, _ = tests.outputs(samples)
    simulated = time.perf_counter()
    sobol_indices(values, tests.names, tuple(output.name for output in OUTPUTS))
    done = time.perf_counter()
    assert len(samples) == SAMPLES
    print(f"  {SAMPLES:,} samples of {len(factors)} factors, {3 * len(SHARES)} readings each:")
    print(f"    drawing {drawn - began:.1f} s, simulating {simulated - drawn:.1f} s, indices {done - simulated:.1f} s")
    print(f"    the whole study {done - began:.1f} s")

    a, b = walther(SEED_OIL)
    plain = [dict(zip(tests.names, map(float, row), strict=True)) for row in samples[:: SAMPLES // OF_THE_LOOP]]
    oils = [Oil(a, b, density=870.0 * sample["density"]) for sample in plain]
    reference_sample(plain[0], oils[0])
    began = time.perf_counter()
    for sample, oil in zip(plain, oils, strict=True):
        reference_sample(sample, oil)
    loop = (time.perf_counter() - began) * SAMPLES / len(plain)
    again = time.perf_counter()
    tests.outputs(samples)
    ours = time.perf_counter() - again
    print(f"    NumPy reference in a loop: {loop:.0f} s (timed on {len(plain)} samples, scaled)")
    print(
        f"    simulating alone {loop / ours:.0f} times as fast; the whole study against the loop {loop / (done - drawn):.0f}"
    )


def main() -> None:
    print(machine())
    jacobian_cost()
    sobol_study()


if __name__ == "__main__":
    main()
