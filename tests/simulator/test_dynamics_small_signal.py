"""Small-signal responses against the appendix's formulas, to the figures that docs/physics.md section 11 states for them."""

from dataclasses import replace
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_jit
from helpers.valves import seed_valve, temperature_at

from thermohyd.actuator import Actuator
from thermohyd.actuator_performance import performance
from thermohyd.dynamics.equilibrium import equilibrium, scaling_of
from thermohyd.dynamics.inputs import Kind, step_inputs
from thermohyd.dynamics.linear import frequency_response, linearise
from thermohyd.dynamics.machine import Walls, plant_of
from thermohyd.effects.library import with_effects
from thermohyd.oil import compressed, specific_heat


TS = temperature_at(30.0)
SUPPLY, BACK = 210e5, 4e5
JACK = Actuator(jack_leakage=3e-13)
FREQUENCIES = jnp.geomspace(0.5, 2000.0, 60)


def inputs(kind: Kind = "spool_position", command: float = 0.0):
    return step_inputs(
        np.array([0.0, 1.0]), command, kind, supply_pressure=SUPPLY, return_pressure=BACK, temperature=TS
    )


jitted = quick_jit(partial(linearise, output="piston_velocity"))
program = quick_jit(partial(frequency_response, throw=False), static_argnames=("output", "absolute", "heat"))


def response(*given, **options):
    found = program(*given, **options)
    assert bool(found.found)
    return found


@cache
def poles(heat, setpoint: float) -> np.ndarray:
    """Of the jack alone: in a loop too weak to matter."""
    weak = replace(JACK, amplifier_gain=1e-9)
    plant = plant_of(seed_valve(), weak, inputs("setpoint", setpoint), heat=heat, walls=Walls(), polarity=1)
    linear, found = jitted(plant)
    assert bool(found)
    return np.linalg.eigvals(np.asarray(linear.matrix))


def hydraulic(heat, setpoint: float = 0.0) -> tuple[float, float]:
    """(pulsation, damping) of the least damped pair, which is the jack's on its oil."""
    pair = [s for s in poles(heat, setpoint) if s.imag > 1.0]
    pole = min(pair, key=lambda s: -s.real / abs(s))
    return abs(pole), -pole.real / abs(pole)


@quick_jit
def figures(heat: jax.Array):
    return performance(seed_valve(), JACK, temperature=TS, supply_pressure=SUPPLY, return_pressure=BACK, heat=heat)


def test_isothermal_response_is_the_formula_s():
    own = figures(0.0)
    found = response(
        seed_valve(), JACK, inputs(), FREQUENCIES, output="piston_velocity", absolute=True, heat="isothermal"
    )
    s = 2j * np.pi * np.asarray(FREQUENCIES)
    spool = 2.0 * np.pi * 100.0
    omega, xi = float(own.natural_frequency), float(own.damping_ratio)
    g = 1.0 + float(own.leakage_coefficient) * 2000.0 / 12e-4**2
    formula = float(own.flow_gain) / (12e-4 * g) / (s**2 / omega**2 + 2.0 * xi * s / omega + 1.0)
    formula = formula / (s**2 / spool**2 + 2.0 * 0.7 * s / spool + 1.0)
    np.testing.assert_allclose(found.amplitude_ratio, np.abs(formula), rtol=1e-5)
    np.testing.assert_allclose(found.phase, np.rad2deg(np.unwrap(np.angle(formula))), atol=1e-3)


def test_where_the_formulas_are_approximate():
    omega, xi = hydraulic("isothermal")
    hm, thm = figures(0.0), figures(1.0)
    assert float(hm.natural_frequency) == pytest.approx(omega, rel=1e-6)
    assert float(hm.damping_ratio) == pytest.approx(xi, rel=1e-5)
    warm, _ = hydraulic("adiabatic")
    low, apart = float(hm.natural_frequency) / warm - 1.0, float(thm.natural_frequency) / warm - 1.0
    aside = float(hm.natural_frequency) / hydraulic("isothermal", 15e-3)[0] - 1.0
    print(
        f"isothermal omega_h against adiabatic chambers {low:+.1%}, isentropic {apart:+.1e}, against z = 15 mm {aside:+.1%}"
    )
    # Isothermal and isentropic bulk modulus differ by 1 + alpha^2 T beta/(rho c_p), at the chambers' mean pressure.
    oil, p, warm_oil = seed_valve().oil, jnp.asarray(0.5 * (SUPPLY + BACK)), jnp.asarray(TS)
    inside = compressed(oil, p, warm_oil)
    stiff = warm_oil * inside.bulk_modulus / (inside.density * specific_heat(oil, warm_oil))
    kept = inside.expansion**2 * stiff
    assert low == pytest.approx(float(1.0 / jnp.sqrt(1.0 + kept)) - 1.0, rel=0.05)
    assert abs(apart) < 1e-4
    assert abs(aside) == pytest.approx(0.046, abs=1e-3)


@quick_jit
def steady_speed(force: jax.Array) -> jax.Array:
    jack = replace(JACK, external_force=force)
    plant = plant_of(seed_valve(), jack, inputs(), heat="isothermal", walls=Walls(), polarity=1)
    time = plant.inputs.time[0]
    return equilibrium(plant, scaling_of(plant, plant.surroundings(time)), time)[0].velocity


def test_load_factor_at_rest():
    """K_f from where an open-loop run starts: what a constant force does to the piston's steady speed."""
    slope = (float(steady_speed(jnp.asarray(-10.0))) - float(steady_speed(jnp.asarray(10.0)))) / 20.0
    assert slope == pytest.approx(float(figures(0.0).load_factor), rel=1e-4)


def test_relative_amplitude_delay_and_outputs():
    low = jnp.array([1e-3, 1.0, 50.0])
    loop = inputs("setpoint")
    found = response(
        with_effects(seed_valve(), {"spool_delay": 0.0}), JACK, loop, low, output="piston_position", heat="isothermal"
    )
    assert float(found.amplitude_ratio[0]) == pytest.approx(1.0, abs=1e-4)
    delayed = with_effects(seed_valve(), {"spool_delay": 2e-3})
    late = response(delayed, JACK, loop, low, output="piston_position", heat="isothermal")
    np.testing.assert_allclose(late.phase - found.phase, -360.0 * np.asarray(low) * 2e-3, atol=1e-9)
    spool = response(
        seed_valve(), JACK, inputs(), jnp.array([100.0]), output="spool_position", absolute=True, heat="isothermal"
    )
    assert float(spool.amplitude_ratio[0]) == pytest.approx(1.0 / 1.4, rel=1e-9)
    assert float(spool.phase[0]) == pytest.approx(-90.0, abs=1e-7)


def test_derivative_of_the_response():
    @quick_jit
    def with_slope(friction: jax.Array) -> tuple[jax.Array, jax.Array]:
        return jax.jvp(ratio, (friction,), (jnp.ones(()),))

    def ratio(friction: jax.Array) -> jax.Array:
        jack = replace(JACK, viscous_friction=friction)
        found = frequency_response(
            seed_valve(), jack, inputs(), jnp.array([150.0]), output="piston_velocity", heat="isothermal", throw=False
        )
        return found.amplitude_ratio[0] + 1e-2 * found.phase[0]

    at = jnp.asarray(2000.0)
    difference = float(with_slope(at + 1.0)[0] - with_slope(at - 1.0)[0]) / 2.0
    assert float(with_slope(at)[1]) == pytest.approx(difference, rel=1e-5)


def test_what_has_no_response_is_refused():
    with pytest.raises(ValueError, match="backlash has no small-signal response"):
        frequency_response(with_effects(seed_valve(), {"backlash": 1e-6}), JACK, inputs(), FREQUENCIES)
    with pytest.raises(ValueError, match="no low-frequency asymptote"):
        frequency_response(seed_valve(), JACK, inputs(), FREQUENCIES, output="piston_position")
