"""Effects that only an actuator in motion shows (docs/physics.md section 8.3).

On the command and the spool: delay, the jets' flow force, play. On the piston: dry friction of its seals and its load, also
near rest. In the chambers: air bubbles, leakage past the piston, heat into the metal.
"""

from typing import ClassVar, final

import equinox as eqx
from jaxtyping import Array, Float

from thermohyd.dynamics.machine import AbstractMotionEffect, Motion

from .effect import as_amount


@final
class SpoolDelay(AbstractMotionEffect):
    """The command acts a time tau later; before its start it was what it was at the start.

    Source: sampling and computing of a digital controller, the first stage's transport. In closed loop the setpoint is delayed,
    not the loop. Amount tau >= 0 [s], typical 0.2 to 10 ms. Shows as a response that begins late, and as a phase -360 deg f tau.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.later(self.amount)


@final
class FlowForce(AbstractMotionEffect):
    """Jets close the spool against a stage of finite stiffness: x_c - k F, F = cos 69 deg sum of +-|Q| sqrt(2 rho |dp|).

    Plus for the edges that open with +x. Source: steady flow force of sharp orifices (Merritt, section 5-6); leakage over the
    lands between the slots makes no jet. Amount k >= 0 [m/N], typical 1e-8 to 2e-6. Shows as less flow gain, the more the
    larger the pressure drop.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("flow_force", self.amount)


@final
class CoulombFriction(AbstractMotionEffect):
    """Dry friction F_c tanh(v/v_ref) against the piston's motion, v_ref = 1 mm/s; adds to the record's own.

    Source: Coulomb friction, smoothed about rest (Merritt, section 6-7; Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica
    30, 1994). Amount F_c >= 0 [N], typical 20 to 1000. Shows in the pressures, which step by 2 F_c/S where the piston turns, and
    in a piston that stays where it was.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("coulomb_friction", self.amount)


@final
class StribeckFriction(AbstractMotionEffect):
    """More friction near rest: (F_s - F_c) exp(-(v/v_s)^2) tanh(v/v_ref), v_s = 10 mm/s, v_ref = 1 mm/s.

    Source: Stribeck (1902); the exponential form of Bo and Pavelescu, Wear 82 (1982).
    Amount F_s - F_c >= 0 [N], typical 20 to 1000. Shows as stick-slip: pressure peaks where the piston breaks away.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("stribeck_friction", self.amount)


@final
class Backlash(AbstractMotionEffect):
    """Play of width b on the spool's command: y' = (x_c - y - w)/tau_p, w = clip(x_c - y, +-b/2), passes x_c - w on.

    Source: feedback wire, ball and linkage of a mechanical-feedback stage; the play operator (Krasnoselskii, Pokrovskii 1983),
    relaxed over tau_p = 0.1 ms. Amount b >= 0 [m] of spool travel, typical 0.5 to 10 um. Shows as a loop that hunts: a limit
    cycle about the setpoint, and a dead zone where the command turns. It has no small-signal response.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)
    small_signal: ClassVar[bool] = False

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("backlash", self.amount)


@final
class EntrainedAir(AbstractMotionEffect):
    """Share phi of the volume at atmospheric pressure as bubbles, polytropic n = 1.4; softens the oil where pressure is low.

    Source: Merritt, section 2-4; Manring, Hydraulic Control Systems, section 2.3. The air's mass and heat are neglected.
    Amount phi >= 0 [-], typical 0.002 to 0.05. Shows as a slower, lower resonance; the lower the chamber's pressure, the more.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("entrained_air", self.amount)


@final
class JackLeakage(AbstractMotionEffect):
    """Past the piston, from A to B: Q = a (p_A - p_B), mass at the mean pressure and upstream temperature; adds to the record's.

    Source: laminar gap of the seal (Merritt, section 6-1). At one temperature it cannot be told from `cross_port_leakage`.
    Amount a >= 0 [m3/(s Pa)], typical 1e-14 to 1e-11. Shows as damping of the resonance, and as an error under load.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("jack_leakage", self.amount)


@final
class WallHeat(AbstractMotionEffect):
    """Each chamber exchanges h_w A_w (T_w - T) with its walls, held at the supply's temperature T_w = T_s.

    Source: Newton's law of cooling; between the adiabatic chamber (0) and the isothermal one (large). Without part in an
    isothermal run. Amount h_w A_w >= 0 [W/K], typical 1 to 100. Shows in the pressures: warmer oil is thinner and expands.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def motion(self, so_far: Motion) -> Motion:
        return so_far.plus("wall_heat", self.amount)
