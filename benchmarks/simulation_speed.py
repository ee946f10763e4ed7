"""Solved operating points per second, the cost of the six-column Jacobian, and memory against the number of rows.

Claimed: at least 1,500,000 solved blocked-port operating points (both ports) per second on 2 cores; the six-column
Jacobian at most 4 times one simulation; memory linear in the rows.
"""

from dataclasses import replace

import jax


jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from _peers import NOMINAL, compare, machine, record_of_3000_rows

from thermohyd.conditions import Conditions
from thermohyd.effects.library import with_effects
from thermohyd.identify.fitting.static_readings import base_valve, static_data, with_parameters
from thermohyd.identify.fitting.static_residuals import FitArgs, plain_residual, residual_and_columns, residual_of
from thermohyd.static_tests import blocked_port_readings, control_flow
from thermohyd.valve import Valve


NAMES = ("edge_radius", "clearance", "underlap", "discharge_coefficient", "transition_number", "null_bias")


def random_conditions(rows: int) -> Conditions:
    """Positions over the stroke (denser near null), 70 to 210 bar, -30 to 70 degC."""
    rng = np.random.default_rng(0)
    x = 213e-6 * rng.uniform(-1, 1, rows) * rng.uniform(0, 1, rows)
    pressure, temperature = rng.uniform(7e6, 21e6, rows), rng.uniform(243, 343, rows)
    return Conditions(*map(jnp.asarray, (x, pressure, np.zeros(rows), temperature)))


def points_per_second(valve: Valve) -> None:
    def blocked(valve: Valve, conditions: Conditions):
        found = blocked_port_readings(valve, conditions)
        return found["pressure_a"], found["pressure_b"]

    for rows in (3_000, 100_000, 1_000_000):
        conditions = random_conditions(rows)
        for name, model in (("blocked ports", blocked), ("connected ports", control_flow)):
            compiled = jax.jit(model).lower(valve, conditions).compile()
            seconds = compare({name: lambda: jax.block_until_ready(compiled(valve, conditions))}, 5)[name]  # noqa: B023
            memory = compiled.memory_analysis()
            held = "" if memory is None else f", {memory.temp_size_in_bytes / rows:6.0f} bytes of scratch per row"
            print(f"  {rows:9,d} rows, {name:15s} {rows / seconds / 1e6:6.2f} million points per second{held}")


def jacobian_cost() -> None:
    record = record_of_3000_rows()
    std = {(t.name, c.name): c.std for t in record.tests.values() for c in t.channels if c.std is not None}
    valve = base_valve(record, dict(zip(NAMES, NOMINAL.tolist(), strict=True)))
    args = FitArgs(valve, static_data(record.tests, std), jnp.zeros(6), jnp.zeros(6))
    p = jnp.asarray(NOMINAL)
    simulate = jax.jit(lambda p: residual_of(NAMES)(p, args))
    columns = jax.jit(lambda p: residual_and_columns(NAMES, p, args))
    forward = jax.jit(jax.jacfwd(lambda p: plain_residual(NAMES, p, args)))
    medians = compare(
        {
            "one simulation of 3024 rows": lambda: jax.block_until_ready(simulate(p)),
            "simulation and six columns, row by row in reverse": lambda: jax.block_until_ready(columns(p)),
            "six columns by jacfwd": lambda: jax.block_until_ready(forward(p)),
        },
        21,
    )
    base = medians["one simulation of 3024 rows"]
    for name, seconds in medians.items():
        print(f"  {name:52s} {1e3 * seconds:6.2f} ms   {seconds / base:5.2f} simulations")


def other_models() -> None:
    """Eight sweeps of 60 rows with blocked ports: the ideal valve, the lubrication law, and ports that store oil."""
    rows = 60
    x = np.tile(60e-6 * np.interp(np.arange(rows), [0, 30, 59], [-1.0, 1.0, -1.0]), 8)
    full = lambda value: jnp.full(x.size, value)
    run, time = np.repeat(np.arange(8.0), rows), np.tile(np.linspace(0.0, 60.0, rows), 8)
    points = Conditions(
        jnp.asarray(x), full(210e5), full(2e5), full(313.15), time=jnp.asarray(time), run=jnp.asarray(run)
    )
    ideal = base_valve(record_of_3000_rows(), dict(zip(NAMES, NOMINAL.tolist(), strict=True)))
    storing = with_effects(ideal, {"port_compliance_a": 6e-13, "port_compliance_b": 3e-13})
    valves = {"ideal valve": ideal, "lubrication law": replace(ideal, edge_law="lubrication"), "storage": storing}

    def once(valve: Valve):
        found = blocked_port_readings(valve, points)
        return jnp.stack([found["leakage_flow"], found["load_pressure"]])

    def six(valve: Valve):
        of = lambda p: once(with_parameters(valve, NAMES, p))
        return jax.jacfwd(of)(jnp.asarray(NOMINAL))

    for what, function in (("one sweep", once), ("six columns by jacfwd", six)):
        compiled = {name: jax.jit(function).lower(valve).compile() for name, valve in valves.items()}
        runs = {name: lambda name=name: jax.block_until_ready(compiled[name](valves[name])) for name in valves}  # noqa: B023
        medians = compare(runs, 21)
        for name, seconds in medians.items():
            ratio = seconds / medians["ideal valve"]
            print(f"  {what:22s} {name:16s} {1e3 * seconds:6.2f} ms   {ratio:5.2f} of the ideal valve's")


def main() -> None:
    print(machine())
    record = record_of_3000_rows()
    points_per_second(base_valve(record, dict(zip(NAMES, NOMINAL.tolist(), strict=True))))
    jacobian_cost()
    other_models()


if __name__ == "__main__":
    main()
