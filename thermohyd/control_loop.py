"""The linear position loop as python-control sees it: transfer functions, state space, frequency response, margins."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .actuator import Actuator
from .actuator_performance import Performance


if TYPE_CHECKING:
    from control import StateSpace, TransferFunction


class Loop(NamedTuple):
    """Plain numbers of one operating point: omega_h, omega_sv [rad/s], xi_h, xi_sv [-], K_l [1/s], K_f [m/(s N)], tau_h [s]."""

    omega_h: float
    xi_h: float
    omega_sv: float
    xi_sv: float
    loop_gain: float
    load_factor: float
    tau_h: float


class Margins(NamedTuple):
    """Margins of the open loop, arrays of shape (points,): gain_margin [-], phase_margin [deg], and where they are read [rad/s].

    phase_margin is the smallest over all crossings of gain 1; crossings that do not exist are infinite or NaN.
    """

    gain_margin: np.ndarray
    phase_margin: np.ndarray
    phase_crossover: np.ndarray
    gain_crossover: np.ndarray


class FrequencyResponse(NamedTuple):
    """Bode data: pulsation (frequencies,) [rad/s]; magnitude [-] and phase [deg, continuous from low pulsations], (points, frequencies)."""

    pulsation: np.ndarray
    magnitude: np.ndarray
    phase: np.ndarray


def loops(found: Performance, actuator: Actuator) -> list[Loop]:
    """The loop at every operating point of `performance(...)`, in its flattened order."""
    names = ("natural_frequency", "damping_ratio", "loop_gain", "load_factor", "hydraulic_time_constant")
    omega_h, xi_h, k_l, k_f, tau_h = (np.ravel(np.asarray(getattr(found, name))) for name in names)
    omega_sv, xi_sv = 2.0 * np.pi * float(actuator.spool_frequency), float(actuator.spool_damping)
    points = zip(omega_h, xi_h, k_l, k_f, tau_h, strict=True)
    return [Loop(float(w), float(xi), omega_sv, xi_sv, float(k), float(f), float(tau)) for w, xi, k, f, tau in points]


def _spool(loop: Loop, spool: bool) -> "TransferFunction":
    from control import TransferFunction

    return TransferFunction([1.0], [1.0 / loop.omega_sv**2, 2.0 * loop.xi_sv / loop.omega_sv, 1.0] if spool else [1.0])


def _transfer(system: Any) -> "TransferFunction":
    """What python-control's operators return for transfer functions, which its types do not say."""
    return system


def _jack(loop: Loop) -> "TransferFunction":
    """1/(s (1 + 2 xi_h s/omega_h + s^2/omega_h^2))."""
    from control import TransferFunction

    return TransferFunction([1.0], [1.0 / loop.omega_h**2, 2.0 * loop.xi_h / loop.omega_h, 1.0, 0.0])


def open_loop(loop: Loop, *, spool: bool = True) -> "TransferFunction":
    """K_l/(s (1 + 2 xi_h s/omega_h + s^2/omega_h^2) G_sv(s)), setpoint error to position; `spool=False`: G_sv = 1."""
    return _transfer(loop.loop_gain * _jack(loop) * _spool(loop, spool))


def closed_loop(loop: Loop, *, spool: bool = True) -> "TransferFunction":
    """Position over setpoint, z/z*."""
    from control import feedback

    return _transfer(feedback(open_loop(loop, spool=spool), 1))


def load_response(loop: Loop, *, spool: bool = True) -> "TransferFunction":
    """Position over external force, z/F_e [m/N]: -K_f (1 + tau_h s) enters before the jack; -K_f/K_l at rest.

    The seed paper's appendix divides K_f by (1 + A f/S^2) once more, which its own K_f already contains.
    """
    from control import feedback, tf

    entry = tf([-loop.load_factor * loop.tau_h, -loop.load_factor], [1.0])
    behind: Any = _transfer(loop.loop_gain * _spool(loop, spool))
    return _transfer(entry * feedback(_jack(loop), behind))


def state_space(loop: Loop, *, spool: bool = True) -> "StateSpace":
    """The closed loop from setpoint to position in state space; its poles are those of `closed_loop`."""
    from control import tf2ss

    system: Any = tf2ss(closed_loop(loop, spool=spool))
    return system


def loop_margins(found: Performance, actuator: Actuator, *, spool: bool = True) -> Margins:
    """Gain and phase margin at every operating point of `performance(...)`.

    >>> import jax; jax.config.update("jax_enable_x64", True)
    >>> from thermohyd import loop_margins, performance, seed_actuator
    >>> from thermohyd.seed_paper import seed_valve
    >>> cold_and_warm = jax.numpy.array([273.15, 343.15])
    >>> found = performance(seed_valve(), seed_actuator(), temperature=cold_and_warm, supply_pressure=70e5)
    >>> print(loop_margins(found, seed_actuator()).phase_margin.round(1))
    [89.9 89.4]
    """
    from control import stability_margins

    rows = []
    for loop in loops(found, actuator):
        gain, phase, _, at_phase, at_gain, _ = stability_margins(open_loop(loop, spool=spool))
        rows.append((gain, phase, at_phase, at_gain))
    return Margins(*np.array(rows, dtype=float).T)


def loop_frequency_response(
    found: Performance,
    actuator: Actuator,
    pulsation: Sequence[float] | np.ndarray,
    *,
    spool: bool = True,
    closed: bool = False,
) -> FrequencyResponse:
    """Bode data of the open loop, or of the closed one, at every operating point of `performance(...)`; pulsation [rad/s]."""
    given = np.asarray(pulsation, dtype=float)
    of = closed_loop if closed else open_loop
    systems = [of(loop, spool=spool) for loop in loops(found, actuator)]
    magnitude = np.array([np.abs(np.atleast_1d(system(1j * given))) for system in systems])
    return FrequencyResponse(given, magnitude, np.array([_phase(system.poles(), given) for system in systems]))


def _phase(poles: np.ndarray, pulsation: np.ndarray) -> np.ndarray:
    """Phase [deg] of 1/prod(s - pole) counted from 0, without jumps on any grid: each pole's own angle, added up."""
    away = 1j * pulsation[:, None] - poles
    return -np.degrees(np.sum(np.angle(np.where(np.real(poles) > 0.0, -away, away)), axis=1))
