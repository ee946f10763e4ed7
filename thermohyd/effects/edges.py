"""Effects on the edges and lands of the spool, and leakage past them.

Edges that are not as drawn (wear of a pair or of one edge, another lap); flow over lands that the concentric, slotted ideal
does not have (an eccentric spool, lands between the slots); a hydraulic null that moves with temperature or supply pressure;
a radial clearance that changes with temperature or pressure; leakage through the first stage, the bushing's seals, and from
one port to the other.
"""

from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from thermohyd.conditions import Conditions
from thermohyd.edge import MeteringEdge
from thermohyd.oil import Oil, at_temperature

from .effect import (
    AbstractCrossingEffect,
    AbstractEdgeEffect,
    AbstractNullEffect,
    AbstractReadingEffect,
    AbstractStorageEffect,
    Edges,
    as_amount,
)


@final
class SupplyEdgeWear(AbstractEdgeEffect):
    """Radius of the edges P-A and P-B: r + d.

    Source: erosion by particles, fastest where the drop is largest (Vaughan, Pomeroy, Tilley, Wear 216, 1998).
    Amount d >= 0 [m], typical 1 to 20 um. Shows in the leakage peak and raises the null pressure (p_A + p_B)/2.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return eqx.tree_at(lambda e: e.supply.radius, ideal, ideal.supply.radius + self.amount)


@final
class ReturnEdgeWear(AbstractEdgeEffect):
    """Radius of the edges A-T and B-T: r + d.

    Source: as for the supply edges; cavitating return flow does it too.
    Amount d >= 0 [m], typical 1 to 20 um. Shows in the leakage peak and lowers the null pressure (p_A + p_B)/2.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return eqx.tree_at(lambda e: e.return_.radius, ideal, ideal.return_.radius + self.amount)


# Of a pair of edges the one at port A, and the one at port B, beside the rows.
PORT_A, PORT_B = np.array([[1.0], [0.0]]), np.array([[0.0], [1.0]])


@final
class EdgeWearPA(AbstractEdgeEffect):
    """Radius of the edge P-A alone, which opens with +x: r + d.

    Source: as for the supply edges, on the side that the valve works on most (a load that pulls one way).
    Amount d >= 0 [m], typical 1 to 20 um. Shows on one side of the leakage peak; near null it raises p_A alone.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return eqx.tree_at(lambda e: e.supply.radius, ideal, ideal.supply.radius + self.amount * PORT_A)


@final
class EdgeWearPB(AbstractEdgeEffect):
    """Radius of the edge P-B alone, which opens with -x: r + d.

    Source: as for the supply edges, on the side that the valve works on most (a load that pulls one way).
    Amount d >= 0 [m], typical 1 to 20 um. Shows on one side of the leakage peak; near null it raises p_B alone.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return eqx.tree_at(lambda e: e.supply.radius, ideal, ideal.supply.radius + self.amount * PORT_B)


@final
class EdgeWearAT(AbstractEdgeEffect):
    """Radius of the edge A-T alone, which opens with -x: r + d.

    Source: as for the return edges, on the side that the valve works on most (a load that pulls one way).
    Amount d >= 0 [m], typical 1 to 20 um. Shows on one side of the leakage peak; near null it lowers p_A alone.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return eqx.tree_at(lambda e: e.return_.radius, ideal, ideal.return_.radius + self.amount * PORT_A)


@final
class EdgeWearBT(AbstractEdgeEffect):
    """Radius of the edge B-T alone, which opens with +x: r + d.

    Source: as for the return edges, on the side that the valve works on most (a load that pulls one way).
    Amount d >= 0 [m], typical 1 to 20 um. Shows on one side of the leakage peak; near null it lowers p_B alone.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return eqx.tree_at(lambda e: e.return_.radius, ideal, ideal.return_.radius + self.amount * PORT_B)


@final
class UnequalUnderlap(AbstractEdgeEffect):
    """Underlap of the edges A-T and B-T: U + d.

    Source: the grinding tolerance of the spool's lands (null cut).
    Amount d [m], either sign, typical 1 to 10 um. Shows in the leakage peak and the null pressure (p_A + p_B)/2.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return eqx.tree_at(lambda e: e.return_.underlap, ideal, ideal.return_.underlap + self.amount)


def on_both(ideal: Edges, field: str, value) -> Edges:
    """Both pairs of edges with one of their fields replaced by value(its present content)."""

    def changed(edge: MeteringEdge) -> MeteringEdge:
        return eqx.tree_at(
            lambda e: getattr(e, field), edge, value(getattr(edge, field)), is_leaf=lambda leaf: leaf is None
        )

    return Edges(supply=changed(ideal.supply), return_=changed(ideal.return_))


@final
class Eccentricity(AbstractEdgeEffect):
    """Flow of an overlapped land times 1 + 1.5 e^2 (laminar flow in an eccentric annulus).

    Source: Piercy, Hooper, Winny, Phil. Mag. 15 (1933); Merritt, Hydraulic Control Systems, eq. 3-39.
    Amount 0 <= e <= 1 (1: the spool lies on its sleeve), typical 0.3 to 1. Even in e: the derivative at neutral is zero,
    so look at it in finite steps. Shows in the leakage away from null and in the pressure gain of overlapped edges.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        factor = 1.0 + 1.5 * jnp.square(self.amount)
        return on_both(ideal, "land_factor", lambda own: factor if own is None else own * factor)


@final
class LandLeakage(AbstractEdgeEffect):
    """Parallel to every edge, over the lands between its slots: G = k c^3/(12 mu), k = (pi d - w)/L_land.

    Source: Poiseuille flow between parallel plates (Merritt, section 3-4); c is the clearance with its own effects.
    Amount k >= 0 [-], typical 1 to 30. Shows in the leakage at all positions, laminar: it grows with temperature.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return on_both(ideal, "land_leakage", lambda own: self.amount if own is None else own + self.amount)


REFERENCE_TEMPERATURE = 313.15  # K, 40 degC: where the clearance is stated
# A spool without clearance seizes; the flow laws need a gap, so a far too negative amount stops here [m].
SMALLEST_CLEARANCE = 1e-8


@final
class NullShiftTemperature(AbstractNullEffect):
    """x0 + k (T - 40 degC), T the true temperature of the oil supplied.

    Source: unequal expansion of spool, sleeve and feedback wire; the null shift with temperature of ARP490 and ISO 10770-1.
    Amount k [m/K], either sign, typical 1 to 50 nm/K. Shows as curves that move along the position, over temperature.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def null_bias(
        self, own: Float[Array, "..."], true: Conditions, null_pressure: Float[Array, "..."] | None
    ) -> Float[Array, "..."]:
        return own + self.amount * (true.temperature - REFERENCE_TEMPERATURE)


@final
class NullShiftPressure(AbstractNullEffect):
    """x0 + k (P_s - P_0), P_s at the gauge, P_0 the supply pressure at which the valve's null bias is stated.

    Source: a first stage whose halves are not alike; the null shift with supply pressure of ARP490 and ISO 10770-1.
    Amount k [m/Pa], either sign, typical 0.5e-14 to 2e-13 (0.05 to 2 um at 100 bar). Shows as curves that move along the
    position, over the supply pressure. Raises ValueError for a valve without `null_pressure`.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def null_bias(
        self, own: Float[Array, "..."], true: Conditions, null_pressure: Float[Array, "..."] | None
    ) -> Float[Array, "..."]:
        if null_pressure is None:
            raise ValueError(
                "null_shift_pressure needs a Valve with null_pressure, the supply pressure at which its null_bias holds"
            )
        return own + self.amount * (true.supply_pressure - null_pressure)


@final
class ThermalClearance(AbstractEdgeEffect):
    """c + k (T - 40 degC), T the true temperature of the oil supplied; at least 0.01 um.

    Source: unequal expansion of spool and sleeve, k = (alpha_sleeve - alpha_spool) d/2.
    Amount k [m/K], either sign, typical 1 to 20 nm/K. Shows in the leakage away from null, over temperature.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        growth = self.amount * (conditions.temperature - REFERENCE_TEMPERATURE)

        def wider(clearance: Float[Array, "..."]) -> Float[Array, "..."]:
            return jnp.maximum(clearance + growth, SMALLEST_CLEARANCE)

        return on_both(ideal, "clearance", wider)


@final
class PressureClearance(AbstractEdgeEffect):
    """c + k p, p the mean pressure of the edge.

    Source: the sleeve widens under pressure (thick-walled cylinder, Lame).
    Amount k >= 0 [m/Pa], typical 0.5e-14 to 5e-14 (0.05 to 0.5 um at 100 bar). Shows in the leakage away from null, over
    the supply pressure.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
        return on_both(ideal, "clearance_per_pressure", lambda own: self.amount if own is None else own + self.amount)


def thinning(oil: Oil, temperature: Float[Array, "..."]) -> Float[Array, "..."]:
    """mu(0, 40 degC)/mu(0, T): how much more a laminar leak lets through at T [K] than at 40 degC."""
    reference = jnp.full_like(temperature, REFERENCE_TEMPERATURE)
    return at_temperature(oil, reference).viscosity / at_temperature(oil, temperature).viscosity


# What the leakage test's meter may read: the flow to the return, or that from the supply.
LEAKAGE = frozenset({"leakage_flow", "supply_flow"})


@final
class PilotLeakage(AbstractReadingEffect):
    """Leakage test: Q + K sqrt(P_s - P_t), at the gauges' pressures.

    Source: nozzles and flapper of the first stage are orifices (Merritt, section 7-2); the tare flow of ARP490.
    Amount K >= 0 [m3/s/sqrt(Pa)], typical 1e-10 to 5e-9 (0.2 l/min at 70 bar: 1.3e-9). Shows in the leakage, at every
    position alike, nearly independent of temperature.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]:
        if channel not in LEAKAGE:
            return value
        drop = true.supply_pressure - true.return_pressure
        flows = drop > 0.0
        return value + self.amount * jnp.where(flows, jnp.sqrt(jnp.where(flows, drop, 1.0)), 0.0)


@final
class BushingLeakage(AbstractReadingEffect):
    """Leakage test: Q + G (P_s - P_t) mu(0, 40 degC)/mu(0, T), at the gauges' pressures.

    Source: a laminar gap around the bushing or past a seal (Poiseuille).
    Amount G >= 0 [m3/(s Pa)], typical 1e-14 to 1e-12 (0.2 l/min at 70 bar: 5e-13). Shows in the leakage, at every position
    alike, with the oil's thinning.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)
    stated_at: ClassVar[float | None] = REFERENCE_TEMPERATURE

    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]:
        if channel not in LEAKAGE:
            return value
        drop = true.supply_pressure - true.return_pressure
        return value + self.amount * drop * thinning(oil, true.temperature)


@final
class CrossPortLeakage(AbstractCrossingEffect):
    """Between the ports A and B: Q = G (p_A - p_B) mu(0, 40 degC)/mu(0, T); solved together with both ports.

    Source: a laminar gap past the spool's middle land, or a test manifold's seal (Poiseuille). The mass is taken at the mean
    pressure and the upstream temperature; with connected ports it vanishes.
    Amount G >= 0 [m3/(s Pa)], typical 1e-14 to 1e-12. Shows in the pressure gain (slope and saturation), and in the leakage.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)
    stated_at: ClassVar[float | None] = REFERENCE_TEMPERATURE

    def conductance(self, oil: Oil, conditions: Conditions) -> Float[Array, "..."]:
        return self.amount * thinning(oil, conditions.temperature)


@final
class PortComplianceA(AbstractStorageEffect):
    """Blocked port A in time: C dp/dt = Q_in - Q_out, flows as volumes at the port's pressure and temperature.

    Source: the gauge, hose and trapped air at the port give way to its pressure, and the oil itself does (continuity of a
    volume, Merritt, section 3-5). Where valve and actuator are tested in motion, the chambers are the jack's.
    Amount C >= 0 [m3/Pa], typical 2e-14 (steel block) to 3e-12 (hose). Shows as peaks that are higher and later the faster
    the sweep, unequally up and down. Readings depend on the rows before them: not row by row.
    The time between two rows is cut into `substeps` steps of order 5 where that is needed most, into fewer elsewhere.
    Raises ValueError where the conditions have no time.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)
    substeps: int = eqx.field(static=True, default=8)

    def compliance(self) -> Float[Array, "2 #rows"]:
        return self.amount * PORT_A


@final
class PortComplianceB(AbstractStorageEffect):
    """Blocked port B in time: C dp/dt = Q_in - Q_out, as at port A.

    Source: the gauge, hose and trapped air at the port. Amount C >= 0 [m3/Pa], typical 2e-14 to 3e-12. Shows on the other
    side of null.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)
    substeps: int = eqx.field(static=True, default=8)

    def compliance(self) -> Float[Array, "2 #rows"]:
        return self.amount * PORT_B
