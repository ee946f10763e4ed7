"""Which balance a valve's ports obey: the plain one, or the coupled one where its effects tie the balances together."""

from .conditions import Conditions
from .coupled_loaded_ports import coupled_loaded_ports
from .coupled_ports import coupled_blocked_ports, coupled_connected_ports
from .loaded_ports import loaded_ports
from .oil import Oil
from .ports import Ports, blocked_ports, connected_ports
from .valve import Valve, coupling, heat_kept, metering_edges


def blocked_state(valve: Valve, oil: Oil, true: Conditions) -> tuple[Ports, Conditions]:
    """Closed use ports: (ports, conditions with the pressures that the edges see)."""
    edges, heat, ties = metering_edges(valve, true), heat_kept(valve), coupling(valve)
    if ties.lines or ties.crossings:
        return coupled_blocked_ports(edges, oil, heat, true, ties)
    return blocked_ports(edges, oil, heat, true), true


def connected_state(valve: Valve, oil: Oil, true: Conditions) -> Ports:
    """Use ports joined without loss; a path between the ports carries nothing then."""
    edges, heat, ties = metering_edges(valve, true), heat_kept(valve), coupling(valve)
    if ties.lines:
        return coupled_connected_ports(edges, oil, heat, true, ties)[0]
    return connected_ports(edges, oil, heat, true)


def loaded_state(valve: Valve, oil: Oil, true: Conditions) -> Ports:
    """Ports under the imposed `true.load_pressure`."""
    assert true.load_pressure is not None
    edges, heat, ties = metering_edges(valve, true), heat_kept(valve), coupling(valve)
    if ties.lines or ties.crossings:
        return coupled_loaded_ports(edges, oil, heat, true, true.load_pressure, ties)[0]
    return loaded_ports(edges, oil, heat, true, true.load_pressure)
