"""How good an actuator is at null: stability, rapidity, accuracy, consumption, from the valve's static gains.

The seed paper's Eqs. 1 to 4 and its appendix, in the corrected form of docs/physics.md section 11. The gains are derivatives of the
static model at the hydraulic null, under zero load. The loop gain at which a position loop starts to oscillate is in closed
form, spool dynamics included.
"""

import math
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from thermohyd.effects.effect import (
    AbstractConditionEffect,
    AbstractHeatEffect,
    AbstractNullEffect,
    AbstractReadingEffect,
)

from .actuator import Actuator
from .arguments import ArgumentValueError, Heat, share_of_heat
from .conditions import Conditions
from .numerics import kept
from .oil import Oil, compressed, density, specific_heat
from .ports import port_flows
from .static_tests import return_flow, unloaded_state
from .valve import Valve, coupling, heat_kept, metering_edges, read_out, true_conditions, true_oil


SYMMETRIC_ONLY = (
    "the linear performance is that of a symmetric jack, with piston_area and chamber_volume of both sides; loop_sweep and "
    "frequency_response linearise the equations of an unequal one"
)


def phase_crossover(
    omega_h: Float[Array, "..."], xi_h: Float[Array, "..."], omega_sv: Float[Array, "..."], xi_sv: Float[Array, "..."]
) -> Float[Array, "..."]:
    """The pulsation [rad/s] at which the open loop lags by 180 degrees.

    L(s) = K_l/(s D(s)), D = (1 + 2 xi_h s/omega_h + s^2/omega_h^2)(1 + 2 xi_sv s/omega_sv + s^2/omega_sv^2): the lower
    root W = omega^2 of Re D = W^2/(omega_h omega_sv)^2 - b W + 1 = 0.
    """
    b = 1.0 / jnp.square(omega_h) + 1.0 / jnp.square(omega_sv) + 4.0 * xi_h * xi_sv / (omega_h * omega_sv)
    a = 1.0 / jnp.square(omega_h * omega_sv)
    # Written without the difference of two close numbers; b^2 >= 4 a as (1/omega_h^2 - 1/omega_sv^2)^2 >= 0.
    return jnp.sqrt(2.0 / (b + jnp.sqrt(jnp.square(b) - 4.0 * a)))


def critical_loop_gain(
    omega_h: Float[Array, "..."], xi_h: Float[Array, "..."], omega_sv: Float[Array, "..."], xi_sv: Float[Array, "..."]
) -> Float[Array, "..."]:
    """K_l [1/s] at the limit of stability: omega Im D at the phase crossover; 2 xi_h omega_h where the spool is fast."""
    w = phase_crossover(omega_h, xi_h, omega_sv, xi_sv)
    hydraulic, spool = w / omega_h, w / omega_sv
    return w * (
        2.0 * xi_h * hydraulic * (1.0 - jnp.square(spool)) + 2.0 * xi_sv * spool * (1.0 - jnp.square(hydraulic))
    )


class Performance(eqx.Module):
    """Performance of a position-controlled actuator at null; arrays of the conditions' common shape, SI units.

    Gains of the valve at null: flow_gain K_QX [m2/s], pressure_gain K_PX [Pa/m], flow_pressure_gain K_QP [m3/(s Pa)],
    flow_current_gain K_QI [m3/(s A)], pressure_current_gain K_PI [Pa/A].
    Stability: bulk_modulus beta [Pa], hydraulic_stiffness r_h [N/m], leakage_coefficient A = a + K_QP [m3/(s Pa)],
    natural_frequency omega_h [rad/s], damping_ratio xi_h [-], hydraulic_time_constant tau_h [s], loop_gain K_l [1/s],
    loop_gain_limit gamma xi_h omega_h [1/s], stability_ratio K_l over that limit (stable below 1 where gamma = 2 and the
    spool is fast), critical_loop_gain [1/s] and gain_margin (its ratio to K_l), spool dynamics included.
    Rapidity: time_constant tau_e = 1/K_l [s].
    Accuracy: load_factor K_f [m/(s N)], static_error [m] and static_error_voltage [V] from dry friction, load_error [m].
    Consumption: null_leakage [m3/s], null_consumption [W].
    """

    flow_gain: Float[Array, "..."]
    pressure_gain: Float[Array, "..."]
    flow_pressure_gain: Float[Array, "..."]
    flow_current_gain: Float[Array, "..."]
    pressure_current_gain: Float[Array, "..."]
    bulk_modulus: Float[Array, "..."]
    hydraulic_stiffness: Float[Array, "..."]
    leakage_coefficient: Float[Array, "..."]
    natural_frequency: Float[Array, "..."]
    damping_ratio: Float[Array, "..."]
    hydraulic_time_constant: Float[Array, "..."]
    loop_gain: Float[Array, "..."]
    loop_gain_limit: Float[Array, "..."]
    stability_ratio: Float[Array, "..."]
    critical_loop_gain: Float[Array, "..."]
    gain_margin: Float[Array, "..."]
    time_constant: Float[Array, "..."]
    load_factor: Float[Array, "..."]
    static_error: Float[Array, "..."]
    static_error_voltage: Float[Array, "..."]
    load_error: Float[Array, "..."]
    null_leakage: Float[Array, "..."]
    null_consumption: Float[Array, "..."]


class NullState(eqx.Module):
    """The valve at null: its gains, its leakage, and the stiffness of the oil in the use ports; arrays of shape (rows,)."""

    flow_gain: Float[Array, " rows"]
    pressure_gain: Float[Array, " rows"]
    flow_pressure_gain: Float[Array, " rows"]
    leakage: Float[Array, " rows"]
    bulk_modulus: Float[Array, " rows"]


def without_instruments(valve: Valve) -> Valve:
    """The valve as an actuator meets it: at its hydraulic null, without what only the test bench's instruments added."""
    kept = tuple(
        effect
        for effect in valve.effects
        if not isinstance(effect, AbstractConditionEffect | AbstractNullEffect)
        and not (isinstance(effect, AbstractReadingEffect) and effect.instrument)
    )
    return replace(valve, effects=kept, null_bias=0.0 * valve.null_bias)


def with_heat(valve: Valve, heat: Heat | float | Array | None) -> Valve:
    """The valve with the share eta of heat kept: 0 or "isothermal" (HM) to 1 or "adiabatic" (THM), and without effects on eta.

    None leaves it as it is.
    """
    if heat is None:
        return valve
    kept = tuple(effect for effect in valve.effects if not isinstance(effect, AbstractHeatEffect))
    return replace(valve, effects=kept, heat_retention=jnp.asarray(share_of_heat(heat), dtype=jnp.result_type(float)))


def null_state(valve: Valve, conditions: Conditions) -> NullState:
    """Gains and leakage at null, under zero load; `conditions` are at position 0 of a valve without bias.

    At null the two ports mirror each other: a small motion or load pressure raises one as much as it lowers the other, and
    changes neither their mean nor the lines. So both gains are slopes of one port's explicit balance at the blocked ports'
    pressures, and K_PX = K_QX/K_QP. The chambers' bulk modulus, at the port's temperature, is the isothermal one where no
    heat is kept (HM) and the isentropic one where all is (THM), as in the dynamic model; between, 1/beta follows eta.
    """
    true, oil, eta = true_conditions(valve, conditions), true_oil(valve), heat_kept(valve)
    ports, inside = unloaded_state(valve, oil, true)
    pressure, warm = ports.pressure[0], ports.temperature[0]
    edges = metering_edges(valve, true)

    def surplus(x: Float[Array, " rows"], load: Float[Array, " rows"]) -> Float[Array, " rows"]:
        """Mass flow that port A has left for the load, its pressure raised by half the load pressure."""
        flows = port_flows(edges, oil, eta, replace(inside, position=x))
        supply_drop = inside.supply_pressure - pressure - 0.5 * load
        return_drop = pressure + 0.5 * load - inside.return_pressure
        inflow = flows.inflow(supply_drop)
        return (inflow - flows.outflow(return_drop, flows.port_temperature(supply_drop)))[0]

    zero, one = jnp.zeros_like(conditions.position), jnp.ones_like(conditions.position)
    rho = density(oil, pressure, warm)
    flow_gain = jax.jvp(lambda x: surplus(x, zero), (zero,), (one,))[1] / rho
    flow_pressure_gain = -jax.jvp(lambda load: surplus(zero, load), (zero,), (one,))[1] / rho
    for path in coupling(valve).crossings:
        flow_pressure_gain = flow_pressure_gain + path.conductance(oil, true)
    leakage = return_flow(ports, oil, eta, inside, true)
    return NullState(
        flow_gain=flow_gain,
        flow_pressure_gain=flow_pressure_gain,
        pressure_gain=flow_gain / flow_pressure_gain,
        leakage=read_out(valve, "leakage_flow", leakage, conditions, true, oil),
        bulk_modulus=_chamber_modulus(oil, eta, pressure, warm),
    )


def _chamber_modulus(
    oil: Oil, eta: Float[Array, "..."] | None, pressure: Float[Array, " rows"], warm: Float[Array, " rows"]
) -> Float[Array, " rows"]:
    inside = compressed(oil, pressure, warm)
    if eta is None:
        return inside.bulk_modulus
    heat = inside.density * specific_heat(oil, warm)
    return 1.0 / (1.0 / inside.bulk_modulus - eta * jnp.square(inside.expansion) * warm / heat)


def performance_at(
    null: NullState,
    stroke: Float[Array, ""],
    actuator: Actuator,
    supply_pressure: Float[Array, " rows"],
    gamma: Float[Array, ""],
) -> Performance:
    """The appendix's formulas on a valve's state at null; `stroke` X_n ties the current to the spool.

    Raises ArgumentValueError for an unequal jack: at rest its ports are no mirror of each other, and chambers that differ make its
    characteristic polynomial one of third order, which omega_h and xi_h do not describe.
    """
    j = actuator
    if not j.symmetric:
        raise ArgumentValueError(SYMMETRIC_ONLY)
    area = j.areas
    area2 = jnp.square(area)
    by_current = stroke / j.rated_current
    k_qi, k_pi = null.flow_gain * by_current, null.pressure_gain * by_current
    leak = j.jack_leakage + null.flow_pressure_gain  # A
    beta = null.bulk_modulus * j.bulk_modulus_factor
    stiffness = 2.0 * beta * area2 / j.volumes  # r_h
    g = 1.0 + leak * j.viscous_friction / area2
    omega = jnp.sqrt(g * stiffness / j.moving_mass)
    losses = leak * j.moving_mass / area2 + j.viscous_friction / stiffness
    xi = losses / (2.0 * jnp.sqrt(g * j.moving_mass / stiffness))
    k_l = j.amplifier_gain * k_qi * j.sensor_gain / (g * area)
    k_f = leak / (area2 * g)
    limit = gamma * xi * omega
    critical = critical_loop_gain(omega, xi, 2.0 * math.pi * j.spool_frequency, j.spool_damping)
    # A leaking jack holds less pressure per current than closed ports do: K_PI K_QP/A, which is K_PI without the leak.
    volts = j.coulomb_friction * leak / (null.flow_pressure_gain * area * k_pi * j.amplifier_gain)
    return Performance(
        flow_gain=null.flow_gain,
        pressure_gain=null.pressure_gain,
        flow_pressure_gain=null.flow_pressure_gain,
        flow_current_gain=k_qi,
        pressure_current_gain=k_pi,
        bulk_modulus=beta,
        hydraulic_stiffness=stiffness,
        leakage_coefficient=leak,
        natural_frequency=omega,
        damping_ratio=xi,
        hydraulic_time_constant=area2 / (leak * stiffness),
        loop_gain=k_l,
        loop_gain_limit=limit,
        stability_ratio=k_l / limit,
        critical_loop_gain=critical,
        gain_margin=critical / k_l,
        time_constant=1.0 / k_l,
        load_factor=k_f,
        static_error=volts / j.sensor_gain,
        static_error_voltage=volts,
        load_error=k_f / k_l * j.external_force,
        null_leakage=null.leakage,
        null_consumption=null.leakage * supply_pressure,
    )


def null_conditions(
    temperature: Float[Array, "..."], supply_pressure: Float[Array, "..."], return_pressure: Float[Array, "..."]
) -> Conditions:
    """Conditions of shape (rows,) at null from arrays of one shape."""
    flat = supply_pressure.reshape(-1)
    return Conditions(jnp.zeros_like(flat), flat, return_pressure.reshape(-1), temperature.reshape(-1))


@kept
def _performance(valve: Valve, actuator: Actuator, conditions: Conditions, gamma: Array) -> Performance:
    return performance_at(null_state(valve, conditions), valve.stroke, actuator, conditions.supply_pressure, gamma)


def performance(
    valve: Valve,
    actuator: Actuator,
    *,
    temperature: ArrayLike,
    supply_pressure: ArrayLike,
    return_pressure: ArrayLike = 0.0,
    heat: Heat | float | Array | None = None,
    gamma: float = 2.0,
) -> Performance:
    """Performance of the actuator on the valve, at null: the seed paper's Eqs. 1 to 4 and appendix (docs/physics.md section 11).

    temperature [K], supply_pressure, return_pressure [Pa, gauge] broadcast to the shape of every figure. heat: the share eta
    of the throttling heat that the oil keeps, 0 or "isothermal" (HM), 1 or "adiabatic" (THM); None: the valve's own. gamma: of Eq. 1,
    below 2. Raises ArgumentValueError for a jack of unequal sides; `frequency_response` and `loop_sweep` linearise its own equations.
    Effects of the valve act, those of the bench's instruments do not: conditions are the true ones. It can be
    jitted, vmapped and differentiated in everything, forward and reverse. Exact for small motions about null at mid stroke
    (HM, THM); half way to the end of a jack's stroke omega_h is some per cent low.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> from thermohyd import performance, seed_actuator
    >>> from thermohyd.seed_paper import seed_valve
    >>> cold_and_warm = jax.numpy.array([273.15, 343.15])
    >>> found = performance(seed_valve(), seed_actuator(), temperature=cold_and_warm, supply_pressure=70e5)
    >>> for name in ("natural_frequency", "damping_ratio", "loop_gain", "static_error"):
    ...     print(name, *(f"{figure:.4g}" for figure in getattr(found, name)))
    natural_frequency 1348 1106
    damping_ratio 0.01642 0.02948
    loop_gain 0.5352 4.689
    static_error 8.792e-06 8.792e-06
    """
    temperature, supply, back = jnp.broadcast_arrays(
        *(jnp.asarray(a, dtype=jnp.result_type(float)) for a in (temperature, supply_pressure, return_pressure))
    )
    built = with_heat(without_instruments(valve), heat)
    conditions = null_conditions(temperature, supply, back)
    found = _performance(built, actuator, conditions, jnp.asarray(gamma, dtype=jnp.result_type(float)))
    return jax.tree.map(lambda figure: figure.reshape(temperature.shape), found)
