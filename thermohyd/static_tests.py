"""The static bench tests as pure functions: readings, one per operating point (docs/physics.md section 6; ISO 10770-1, ARP490).

All of them take a `Valve` and `Conditions` of shape (rows,) and return arrays of shape (rows,), SI units. They are
compiled once per shape, and can be jitted, vmapped and differentiated, forward and reverse, in every field of the valve
and of the conditions. The ports obey the plain balance, or the coupled one where the valve's effects tie the balances together.

The static gains K_QX, K_PX, K_QP and their non-dimensional forms are derivatives of these tests.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .conditions import Conditions
from .coupled_ports import coupled_loaded_ports, coupled_unloaded_ports
from .numerics import kept
from .oil import Oil, density
from .port_storage import PortsBefore, StoredPorts, stored_ports
from .ports import Joined, Ports, loaded_ports, return_temperature, unloaded_ports
from .valve import Valve, coupling, heat_kept, metering_edges, read_out, true_conditions, true_oil


def unloaded_state(valve: Valve, oil: Oil, true: Conditions, joined: Joined = False) -> tuple[Ports, Conditions]:
    """Closed use ports, or where `joined` connected without loss: (ports, conditions with the pressures that the edges see)."""
    edges, heat, ties = metering_edges(valve, true), heat_kept(valve), coupling(valve)
    if ties.lines or (ties.crossings and joined is not True):
        return coupled_unloaded_ports(edges, oil, heat, true, ties, joined)
    return unloaded_ports(edges, oil, heat, true, ties.inflows, joined), true


def loaded_state(valve: Valve, oil: Oil, true: Conditions) -> Ports:
    """Ports under the imposed `true.load_pressure`."""
    assert true.load_pressure is not None
    edges, heat, ties = metering_edges(valve, true), heat_kept(valve), coupling(valve)
    if ties.lines or ties.crossings:
        return coupled_loaded_ports(edges, oil, heat, true, true.load_pressure, ties)[0]
    return loaded_ports(edges, oil, heat, true, true.load_pressure, ties.inflows)


def return_flow(
    ports: Ports, oil: Oil, heat: Float[Array, "..."] | None, inside: Conditions, true: Conditions
) -> Float[Array, " rows"]:
    """What leaves both ports, as a volume at return conditions [m3/s]; `inside`: with the pressures that the edges see."""
    warm = return_temperature(ports, oil, heat, inside)
    return jnp.sum(ports.outflow, axis=0) / density(oil, true.return_pressure, warm)


@kept
def blocked_port_readings(valve: Valve, conditions: Conditions) -> dict[str, Float[Array, " rows"]]:
    """All that the two tests with closed use ports read: leakage_flow, supply_flow [m3/s], pressure_a, pressure_b,
    load_pressure [Pa].

    leakage_flow is read in the return (volume at return conditions), supply_flow in the supply (at supply conditions): one
    mass flow unless the ports store oil, which needs conditions with the time of every row.
    """
    return _blocked_readings(valve, conditions)[0]


@kept
def blocked_port_readings_after(
    valve: Valve, conditions: Conditions, before: PortsBefore
) -> tuple[dict[str, Float[Array, " rows"]], Float[Array, "2"]]:
    """`blocked_port_readings` of a piece of a longer log, whose ports may store oil, and what the next piece begins with.

    The first row of a piece is the last one of the piece before, at the pressures that this ended with. Second: the pressures
    of the ports at the last row [Pa].
    """
    readings, ports = _blocked_readings(valve, conditions, before)
    return readings, ports.pressure[:, -1]


def _blocked_readings(
    valve: Valve, conditions: Conditions, before: PortsBefore | None = None
) -> tuple[dict[str, Float[Array, " rows"]], Ports]:
    true = true_conditions(valve, conditions)
    oil = true_oil(valve, true)
    ports, inside = unloaded_state(valve, oil, true)
    ties = coupling(valve)
    if ties.storage:
        stored = stored_ports(valve, oil, conditions, true, ports, inside, ties, begun=before)
        ports, inside = stored.ports, stored.inside
    values = _blocked_values(valve, oil, true, ports, inside)
    return _read_out_all(valve, values, conditions, true, oil), ports


def stored_port_rows(
    valve: Valve, conditions: Conditions, push: Float[Array, "2 rows"]
) -> tuple[dict[str, Float[Array, " rows"]], StoredPorts]:
    """`blocked_port_readings` of a valve whose ports store oil, every row by itself, and what ties the rows together.

    See `port_storage.stored_ports`. For whoever needs the Jacobian of many parameters at the cost of a few.
    """
    true = true_conditions(valve, conditions)
    oil = true_oil(valve, true)
    steady = unloaded_state(valve, oil, true)
    stored = stored_ports(valve, oil, conditions, true, *steady, coupling(valve), push)
    values = _blocked_values(valve, oil, true, stored.ports, stored.inside)
    return _read_out_all(valve, values, conditions, true, oil), stored


def _blocked_values(
    valve: Valve, oil: Oil, true: Conditions, ports: Ports, inside: Conditions
) -> dict[str, Float[Array, " rows"]]:
    """What there is to read at closed ports, before any instrument."""
    return {
        "leakage_flow": return_flow(ports, oil, heat_kept(valve), inside, true),
        "supply_flow": jnp.sum(ports.inflow, axis=0) / density(oil, true.supply_pressure, true.temperature),
        "pressure_a": ports.pressure[0],
        "pressure_b": ports.pressure[1],
        "load_pressure": ports.pressure[0] - ports.pressure[1],
    }


def _read_out_all(
    valve: Valve, values: dict[str, Float[Array, " rows"]], conditions: Conditions, true: Conditions, oil: Oil
) -> dict[str, Float[Array, " rows"]]:
    return {channel: read_out(valve, channel, value, conditions, true, oil) for channel, value in values.items()}


def leakage_flow(valve: Valve, conditions: Conditions) -> Float[Array, " rows"]:
    """Leakage test: flow to return with the use ports blocked [m3/s], volume at return conditions."""
    return blocked_port_readings(valve, conditions)["leakage_flow"]


def load_pressure(valve: Valve, conditions: Conditions) -> Float[Array, " rows"]:
    """Pressure-gain test: load pressure p_A - p_B with the use ports blocked [Pa]."""
    return blocked_port_readings(valve, conditions)["load_pressure"]


def port_pressures(valve: Valve, conditions: Conditions) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
    """Pressure-gain test with a gauge on each port: (p_A, p_B) [Pa]."""
    readings = blocked_port_readings(valve, conditions)
    return readings["pressure_a"], readings["pressure_b"]


@kept
def control_flow(valve: Valve, conditions: Conditions) -> Float[Array, " rows"]:
    """Flow-gain test: flow from A to B with the use ports connected [m3/s], volume at the ports' pressure and temperature."""
    true = true_conditions(valve, conditions)
    oil = true_oil(valve, true)
    ports, _ = unloaded_state(valve, oil, true, joined=True)
    return read_out(valve, "flow", _flow_through(ports, oil), conditions, true, oil)


def _flow_through(ports: Ports, oil: Oil) -> Float[Array, " rows"]:
    """From port A to port B through a meter between them [m3/s], at their pressure and temperature."""
    through = ports.inflow[0] - ports.outflow[0]
    if ports.crossing is not None:
        through = through + ports.crossing[0]
    return through / density(oil, ports.pressure[0], ports.temperature[0])


def unloaded_readings(valve: Valve, conditions: Conditions, joined: Joined) -> dict[str, Float[Array, " rows"]]:
    """Those of `blocked_port_readings` and `flow`, of rows whose use ports are closed, or where `joined` connected: one balance for
    all tests without a load, for whoever compiles it once. Of a row what its test does not read means nothing. Raises ValueError for ports
    that store oil, whose rows follow each other.
    """
    if coupling(valve).storage:
        raise ValueError(
            "ports that store oil are those of blocked_port_readings: here every row is a balance of its own"
        )
    true = true_conditions(valve, conditions)
    oil = true_oil(valve, true)
    ports, inside = unloaded_state(valve, oil, true, joined)
    values = _blocked_values(valve, oil, true, ports, inside)
    # No flow and no load pressure where there can be none: an instrument may have no derivative there, and a derivative that is not
    # asked for is still counted, times 0.
    whole = true.supply_pressure - true.return_pressure
    values["load_pressure"] = jnp.where(joined, whole, values["load_pressure"])
    values["flow"] = jnp.where(joined, _flow_through(ports, oil), values["leakage_flow"])
    return _read_out_all(valve, values, conditions, true, oil)


@kept
def load_flow(valve: Valve, conditions: Conditions) -> Float[Array, " rows"]:
    """Load-flow test: flow through the load from A to B [m3/s] under the imposed `conditions.load_pressure`.

    Volume at the mean port pressure and the temperature of the port that the flow leaves, so that it is `control_flow` at
    zero load pressure. Raises ValueError where the conditions have no load pressure.
    """
    if conditions.load_pressure is None:
        raise ValueError("the load-flow test needs conditions with a load_pressure")
    true = true_conditions(valve, conditions)
    oil = true_oil(valve, true)
    ports = loaded_state(valve, oil, true)
    surplus = ports.inflow - ports.outflow
    if ports.crossing is not None:
        surplus = surplus + ports.crossing
    # Port A gives what port B takes; the mean of both keeps the balance's rounding out of the reading.
    through = 0.5 * (surplus[0] - surplus[1])
    origin = jnp.where(through > 0.0, ports.temperature[0], ports.temperature[1])
    value = through / density(oil, jnp.mean(ports.pressure, axis=0), origin)
    return read_out(valve, "flow", value, conditions, true, oil)


@kept
def _slope(reading, valve: Valve, conditions: Conditions, field: str) -> Float[Array, " rows"]:
    """d(reading)/d(field of the conditions), row by row: one forward-mode pass, as rows do not depend on each other."""

    def of(value: Float[Array, " rows"]) -> Float[Array, " rows"]:
        return reading(valve, eqx.tree_at(lambda c: getattr(c, field), conditions, value))

    value = getattr(conditions, field)
    return jax.jvp(of, (value,), (jnp.ones_like(value),))[1]


def flow_gain(valve: Valve, conditions: Conditions) -> Float[Array, " rows"]:
    """K_QX = dQ/dx of the flow-gain test [m2/s]."""
    return _slope(control_flow, valve, conditions, "position")


def pressure_gain(valve: Valve, conditions: Conditions) -> Float[Array, " rows"]:
    """K_PX = d(p_A - p_B)/dx with blocked ports [Pa/m]."""
    return _slope(load_pressure, valve, conditions, "position")


def flow_pressure_gain(valve: Valve, conditions: Conditions) -> Float[Array, " rows"]:
    """K_QP = -dQ/dp_L of the load flow [m3/(s Pa)], at `conditions.load_pressure` (0 where there is none)."""
    if conditions.load_pressure is None:
        conditions = eqx.tree_at(
            lambda c: c.load_pressure,
            conditions,
            jnp.zeros_like(conditions.position),
            is_leaf=lambda leaf: leaf is None,
        )
    return -_slope(load_flow, valve, conditions, "load_pressure")


def nondimensional_pressure_gain(
    valve: Valve, conditions: Conditions, nominal_pressure: float | Array
) -> Float[Array, " rows"]:
    """bar K_PX = K_PX X_n / P_n (the seed paper's Eq. 5), X_n the stroke, P_n [Pa] the nominal valve pressure drop."""
    return pressure_gain(valve, conditions) * valve.stroke / nominal_pressure


def nondimensional_flow_gain(
    valve: Valve, conditions: Conditions, nominal_flow: float | Array
) -> Float[Array, " rows"]:
    """bar K_QX = K_QX X_n / Q_n (the seed paper's Eq. 7), Q_n [m3/s] the rated flow."""
    return flow_gain(valve, conditions) * valve.stroke / nominal_flow
