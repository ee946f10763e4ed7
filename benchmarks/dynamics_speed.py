"""A position servo's step response: one run, a batch, derivatives, beside SciPy's and CasADi's stiff solvers.

One scenario: the conformance valve and jack, a setpoint that ramps twice within 1.5 s, adiabatic chambers. Every contender
runs at the loosest of its tolerances that leaves 1e-5 of each reading's range against a tight reference, on the same rows.
Claimed: at least 10 times faster than Radau and LSODA on plain NumPy (66 and 94 times on one core); 1000 runs by `simulate_many`
at least 5 times cheaper each than a run alone (20 times on two cores, 0.76 against 16 ms); 10 derivatives within 8
simulations (forward 4.1). Wanted and not reached: the same in reverse (11).
Batches: `python benchmarks/dynamics_speed.py 1000` (default), 10000 on a GPU.
"""

import importlib.util
import sys
from dataclasses import replace

import jax


jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from _peers import compare, machine
from helpers.machines import actuator_of, apart, inputs_of, valve_of
from reference.actuator import Machine, Run
from reference.conformance_dynamic import machine_of
from reference.step_test import readings

from thermohyd.dynamics.integrate import Gradient
from thermohyd.dynamics.simulate import simulate_step
from thermohyd.dynamics.simulate_many import simulate_many


ACCURACY = 1e-5
VALVE_NAMES = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")
JACK_NAMES = ("spool_frequency", "spool_damping", "bulk_modulus_factor", "viscous_friction")
TOLERANCES = 10.0 ** np.arange(-4.0, -10.5, -0.5)


def scenario() -> Machine:
    base = machine_of("closed_adiabatic")
    time = np.linspace(0.0, 1.5, 301)
    setpoint = np.interp(time, [0.0, 0.02, 0.025, 0.75, 0.755, 1.5], [0.0, 0.0, 5e-3, 5e-3, -3e-3, -3e-3])
    full = lambda value: np.full(len(time), float(value))
    return replace(base, run=Run("setpoint", time, setpoint, full(210e5), full(2e5), full(313.15), full(2000.0)))


def of(theta, given: Machine):
    """(valve, actuator) with the 10 parameters at `theta` times their own values."""
    valve, jack = valve_of(given), actuator_of(given)
    scaled = lambda module, names, part: replace(
        module, **{name: getattr(module, name) * part[i] for i, name in enumerate(names)}
    )
    return scaled(valve, VALVE_NAMES, theta[:6]), scaled(jack, JACK_NAMES, theta[6:])


def loosest(run, expected: np.ndarray) -> float:
    """The loosest tolerance at which a contender keeps the accuracy, and at the next tighter one too."""
    good = []
    for tolerance in TOLERANCES:
        good.append(float(np.max(apart(run(float(tolerance)), expected))) < ACCURACY)
        if len(good) > 1 and good[-1] and good[-2]:
            return float(TOLERANCES[len(good) - 2])
    raise RuntimeError("the accuracy is not reached")


def report(medians: dict[str, float], base: str) -> None:
    for name, seconds in medians.items():
        print(f"  {name:58s} {1e3 * seconds:10.2f} ms   {seconds / medians[base]:8.2f} x")


def main() -> None:
    batch = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    print(machine(), "on", jax.devices()[0].device_kind)
    given = scenario()
    inputs = inputs_of(given)
    ones = jnp.ones(10)

    def table(theta, rtol, gradient: Gradient = "forward"):
        valve, jack = of(theta, given)
        r = simulate_step(valve, jack, inputs, rtol=rtol, atol=rtol, gradient=gradient, throw=False)
        return jnp.stack([r.spool_position, r.pressure_a, r.pressure_b, r.piston_position, r.piston_velocity], axis=1)

    single = jax.jit(table)
    expected = np.asarray(single(ones, 1e-11))
    peer = readings(given, 1e-9)
    print(f"  the two tight references differ by {np.max(apart(peer, expected)):.1e} of the range")
    own = loosest(lambda tolerance: np.asarray(single(ones, tolerance)), expected)
    scipy_tolerance = {
        method: loosest(lambda tolerance: readings(given, tolerance, method), expected)  # noqa: B023
        for method in ("Radau", "LSODA")
    }
    symbolic, casadi_tolerance = {}, {}
    if importlib.util.find_spec("casadi") is None:
        print("  CasADi is not installed: its solvers are left out")
    else:
        from _casadi_servo import casadi_runs

        for solver in ("cvodes", "idas"):
            run = lambda tolerance, solver=solver: casadi_runs(given, solver, tolerance)[0](np.ones(10))
            casadi_tolerance[f"CasADi {solver}"] = loosest(run, expected)
            value, derivatives = casadi_runs(given, solver, casadi_tolerance[f"CasADi {solver}"])
            symbolic[f"CasADi {solver}, one run"] = lambda value=value: value(np.ones(10))
            symbolic[f"CasADi {solver}, run and 10 derivatives (forward)"] = lambda d=derivatives: d(np.ones(10))
    print(f"  tolerances for {ACCURACY:.0e} of the range: thermohyd {own:.0e}, " + ", ".join(
        f"{method} {tolerance:.0e}" for method, tolerance in (scipy_tolerance | casadi_tolerance).items()))  # fmt: skip

    forward = jax.jit(lambda theta: jax.jacfwd(table)(theta, own))
    # A fit's sum of squares: one number, ten parameters.
    size = np.ptp(expected, axis=0)
    loss = lambda theta: jnp.sum(jnp.square((table(theta, own, "reverse") - expected) / size))
    reverse = jax.jit(jax.grad(loss))
    name = "thermohyd, one run"
    medians = compare(
        {
            name: lambda: jax.block_until_ready(single(ones, own)),
            "thermohyd, run and 10 derivatives (forward)": lambda: jax.block_until_ready(forward(ones)),
            "thermohyd, gradient of a sum of squares (reverse)": lambda: jax.block_until_ready(reverse(1.01 * ones)),
            **{
                f"SciPy {method} on plain NumPy": lambda method=method: readings(given, scipy_tolerance[method], method)
                for method in scipy_tolerance
            },
            **symbolic,
        },
        5,
    )
    report(medians, name)

    thetas = jnp.asarray(1.0 + 0.05 * np.random.default_rng(0).uniform(-1.0, 1.0, (batch, 10)))
    valves, jacks = jax.jit(jax.vmap(lambda theta: of(theta, given)))(thetas)
    many = lambda: jax.block_until_ready(simulate_many(valves, jacks, inputs, rtol=own, atol=own))
    # The single run beside it again: a machine's pace changes with what else it does.
    together = compare({f"thermohyd, {batch} runs": many, "alone": lambda: jax.block_until_ready(single(ones, own))}, 5)
    alone = together.pop("alone")
    seconds = next(iter(together.values())) / batch
    print(f"  {f'one of {batch} runs together':58s} {1e3 * seconds:10.3f} ms   1/{alone / seconds:.1f} of a single run")


if __name__ == "__main__":
    main()
