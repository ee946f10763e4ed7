"""Figures of steps and loops against closed forms and python-control; whole sweeps: tests/identify/servo."""

from typing import Any

import control
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.quick_compile import quick_jit
from helpers.valves import seed_valve

from thermohyd.actuator import Actuator
from thermohyd.dynamics.linear import Linearised, broken, loop_figures
from thermohyd.dynamics.simulate import step_figures
from thermohyd.dynamics.temperature_sweep import loop_sweep, step_sweep
from thermohyd.effects.library import with_effects


PRESSURES: dict[str, Any] = {"supply_pressure": 210e5, "return_pressure": 2e5}


def second_order(damping: float, omega: float, time: np.ndarray) -> np.ndarray:
    swift = omega * np.sqrt(1.0 - damping**2)
    decay = np.exp(-damping * omega * time)
    return 1.0 - decay * (np.cos(swift * time) + damping * omega / swift * np.sin(swift * time))


def test_step_figures_of_a_second_order_response():
    time = np.linspace(0.0, 4.0, 40_001)
    damping, omega = 0.3, 20.0
    found = step_figures(time, 3.0 + 0.5 * second_order(damping, omega, time), 0.5)
    assert found.overshoot == pytest.approx(np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2)), rel=1e-6)
    for level, reached in ((0.9, found.time_to_90), (0.1, found.time_to_90 - found.rise_time)):
        assert second_order(damping, omega, np.array([reached]))[0] == pytest.approx(level, abs=1e-6)
    after = time > found.settling_time
    share = second_order(damping, omega, time)
    assert np.max(np.abs(share[after] - 1.0)) <= 0.02
    assert abs(second_order(damping, omega, np.array([found.settling_time]))[0] - 1.0) == pytest.approx(0.02, abs=1e-6)
    downwards = step_figures(time, -0.5 * second_order(damping, omega, time), -0.5)
    assert np.allclose(downwards, found, rtol=1e-12, atol=1e-12)


def test_what_a_run_does_not_reach_is_nan():
    time = np.linspace(0.0, 1.0, 1001)
    slow = step_figures(time, 1.0 - np.exp(-time), 1.0)
    assert np.isnan(slow.time_to_90)
    assert np.isnan(slow.settling_time)
    assert slow.overshoot == 0.0
    swinging = step_figures(time, 1.0 - np.cos(60.0 * time), 1.0)
    assert np.isnan(swinging.settling_time)
    assert swinging.swing == pytest.approx(2.0, abs=0.1)


def chain(gain: float, damping: float) -> Any:
    """gain/(s (spool) (jack)) with a lightly damped jack behind the spool."""
    s: Any = control.tf("s")
    return gain / (
        s * (s**2 / 628.0**2 + 1.4 * s / 628.0 + 1.0) * (s**2 / 1300.0**2 + 2.0 * damping * s / 1300.0 + 1.0)
    )


@quick_jit
def figures_with_slope(opened: Linearised):
    """Figures and their derivatives with the loop's gain."""
    raised = lambda gain: loop_figures(Linearised(opened.matrix, gain * opened.drive, opened.read))[0]
    return jax.jvp(raised, (jnp.ones(()),), (jnp.ones(()),))


@pytest.mark.parametrize(("gain", "damping"), [(20.0, 0.02), (300.0, 0.02), (400.0, 0.3), (900.0, 0.02)])
def test_margins_are_those_of_python_control(gain, damping):
    plain = chain(gain, damping)
    system: Any = control.ss(plain)
    matrix, drive, read = (np.asarray(part) for part in (system.A, system.B, system.C))
    opened = Linearised(jnp.asarray(matrix), jnp.asarray(drive[:, 0]), jnp.asarray(read[0]))
    found, slope = figures_with_slope(opened)
    gm, pm, _, wpc, wgc, _ = control.stability_margins(plain)
    assert float(found.gain_margin) == pytest.approx(gm, rel=1e-6)
    assert float(found.phase_margin) == pytest.approx(pm, rel=1e-4, abs=1e-4)
    assert float(found.phase_crossover) == pytest.approx(wpc, rel=1e-6)
    assert float(found.gain_crossover) == pytest.approx(wgc, rel=1e-6)
    closed: Any = control.feedback(plain, 1)
    half = abs(complex(closed(1j * float(found.bandwidth))))
    assert half == pytest.approx(np.sqrt(0.5), rel=1e-6)
    tops = np.abs(closed(1j * np.geomspace(1.0, 3000.0, 200_001)))
    assert float(found.peak) == pytest.approx(max(1.0, tops.max()), rel=1e-5)
    # The gain margin is what is left over the gain; the phase crossing does not see the gain.
    assert float(slope.gain_margin) == pytest.approx(-gm, rel=1e-6)
    assert float(slope.phase_crossover) == pytest.approx(0.0, abs=1e-6 * wpc)
    turned = -1.0 / (control_slope(plain, wgc))
    assert float(slope.gain_crossover) == pytest.approx(turned, rel=1e-4)


def control_slope(system, w: float) -> float:
    """d ln|L|/d omega."""
    ends = [float(np.log(abs(complex(system(1j * w * (1.0 + h)))))) for h in (1e-6, -1e-6)]
    return (ends[0] - ends[1]) / (2e-6 * w)


def test_opening_the_loop_undoes_the_feedback():
    closed = Linearised(jnp.array([[-5.0, 1.0], [0.0, -2.0]]), jnp.array([3.0, 1.0]), jnp.array([2.0, 0.0]))
    at = jnp.array([0.1, 3.0, 50.0])
    through, back = broken(closed).gain(at), closed.gain(at)
    np.testing.assert_allclose(back, through / (1.0 + through), rtol=1e-13)


def test_what_cannot_be_swept_is_refused():
    with pytest.raises(ValueError, match="backlash has no small-signal response"):
        loop_sweep(with_effects(seed_valve(), {"backlash": 1e-6}), Actuator(), [300.0], **PRESSURES)
    with pytest.raises(ValueError, match="not zero"):
        step_sweep(seed_valve(), Actuator(), [300.0], step=0.0, seconds=1.0, **PRESSURES)
