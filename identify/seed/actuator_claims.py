"""The seed paper's claims about the actuator (stability, rapidity, accuracy, consumption), computed for an example jack at null.

Performance is computed once over all models, pressures and temperatures of the curves; each claim reads its figure there.
"""

from dataclasses import fields, replace

import jax
import jax.numpy as jnp
import numpy as np

from thermohyd.actuator import Actuator
from thermohyd.actuator_performance import Performance, performance
from thermohyd.oil import throttling_rise
from thermohyd.valve import Valve

from .curves import ETA, Claim, SeedCurves, percent, verdict


def performance_of(curves: SeedCurves, valve: Valve, actuator: Actuator) -> dict[str, np.ndarray]:
    """{name of a figure of `Performance`: its values (model, supply, temperature)}, gamma = 2, return pressure zero."""
    temperature, supply = jnp.asarray(curves.temperature), jnp.asarray(curves.supply)[:, None]
    models = [
        jax.device_get(
            performance(valve, actuator, temperature=temperature, supply_pressure=supply, heat=jnp.asarray(eta))
        )
        for eta in ETA
    ]
    return {field.name: np.stack([getattr(model, field.name) for model in models]) for field in fields(Performance)}


JACK = "The paper gives no jack; an example of 12 cm2, 50 kg and 2000 N s/m without leakage is taken."
FAST_SPOOL = 20e3  # Hz
Figures = dict[str, np.ndarray]


def actuator_claims(
    curves: SeedCurves, figures: Figures, valve: Valve, actuator: Actuator, nominal_flow: float
) -> list[Claim]:
    """Claims about the closed loop at null, at the first supply pressure; `figures`: the performance of `actuator`, a jack
    without leakage."""
    undamped = performance_of(curves, valve, replace(actuator, viscous_friction=0.0))
    fast = performance_of(curves, valve, replace(actuator, spool_frequency=FAST_SPOOL))
    return [
        _gains_follow(curves, figures),
        _leakage_coefficient(figures),
        _loop_gain(figures),
        _compensation(figures, undamped),
        _criterion(figures, fast),
        _static_error(figures),
        _load_error(figures),
        _consumption(curves, figures, valve, nominal_flow),
        _conclusion(figures),
    ]


def _growth(figure: np.ndarray, model: int = 0) -> float:
    """The hottest over the coldest value at the first supply pressure."""
    return float(figure[model, 0, -1] / figure[model, 0, 0])


def _gains_follow(curves: SeedCurves, figures: Figures) -> Claim:
    null = curves.at_opening(0.0)
    ratio = curves.flow_gain[..., null] / curves.pressure_gain[..., null] / figures["flow_pressure_gain"]
    off = float(np.abs(ratio - 1.0).max())
    return Claim(
        "k_qp_from_other_gains",
        "Importance of the static performance",
        "K_QP follows from K_QX and K_PX",
        "The flow/pressure gain can be calculated from the other gains.",
        verdict(off < 1e-3),
        f"to {off:.0e}",
        f"K_QX/K_PX is K_QP at null to {off:.0e}, each by differentiation of its own test "
        "(ports connected, blocked, pushed apart); both models, both pressures",
        values={"largest_difference": off},
    )


def _leakage_coefficient(figures: Figures) -> Claim:
    a = figures["leakage_coefficient"]
    return Claim(
        "leakage_coefficient_rises",
        "Discussion",
        "leakage coefficient A rises",
        "As leakage rises with temperature, so does the actuator's leakage coefficient A = a + K_QP at null.",
        verdict(bool(np.all(np.diff(a[:, 0], axis=-1) > 0.0))),
        f"{_growth(a):.0f} times, -40 to 70 °C",
        f"A at null from {a[0, 0, 0]:.3g} to {a[0, 0, -1]:.3g} m3/(s Pa) (HM), {_growth(a):.0f} times; THM {_growth(a, 1):.0f} times",
        values={"cold": float(a[0, 0, 0]), "hot": float(a[0, 0, -1]), "growth": _growth(a)},
    )


def _loop_gain(figures: Figures) -> Claim:
    k_l = figures["loop_gain"]
    return Claim(
        "loop_gain_changes",
        "Discussion",
        "loop gain changes strongly",
        "The flow gain at null grows so much with temperature that the effective loop gain changes strongly.",
        verdict(_growth(k_l) > 10.0),
        f"{_growth(k_l):.0f} times, -40 to 70 °C",
        f"K_l from {k_l[0, 0, 0]:.3f} to {k_l[0, 0, -1]:.2f} 1/s at one amplifier gain, {_growth(k_l):.0f} times",
        JACK,
        {"growth": _growth(k_l)},
    )


def _compensation(figures: Figures, undamped: Figures) -> Claim:
    used, used_undamped = _growth(figures["stability_ratio"]), _growth(undamped["stability_ratio"])
    slow = 1.0 / _growth(figures["time_constant"])
    k_l = _growth(figures["loop_gain"])
    return Claim(
        "compensation",
        "Discussion",
        "A and K_QX partially compensate",
        "Rapidity and stability depend on A and on K_QX, whose changes partially compensate.",
        verdict(False, used < k_l),
        f"stability {used:.0f}, rapidity {slow:.0f} times",
        f"from -40 to 70 degC K_l grows {k_l:.0f} times, its share of the limit 2 xi_h omega_h {used:.0f} times with the jack's friction, "
        f"{used_undamped:.2f} times without; the time constant 1/K_l falls {slow:.0f} times either way",
        "Of the limit A r_h/S2 + f/m only the first part follows K_QX: where leakage alone damps, the two cancel, as A/K_QX = 1/K_PX, and "
        "what is left is the oil's stiffness; where friction damps, hardly. On rapidity A acts only through 1 + A f/S2, nearly one.",
        {
            "stability_ratio": used,
            "stability_ratio_without_friction": used_undamped,
            "time_constant": slow,
            "loop_gain": k_l,
        },
    )


def _criterion(figures: Figures, fast: Figures) -> Claim:
    limits = [each["critical_loop_gain"][0, 0] / each["loop_gain_limit"][0, 0] for each in (figures, fast)]
    safe = all(bool(np.all(limit > 0.99)) for limit in limits)
    return Claim(
        "stability_criterion",
        "Eq. 1",
        "stable when K_l < 2 xi_h omega_h",
        "The loop is stable while K_l is below gamma xi_h omega_h with gamma below 2.",
        verdict(safe),
        f"exact if fast, else {limits[0].min():.0f} times safe",
        f"the loop with spool dynamics turns unstable at {limits[1].min():.3f} to {limits[1].max():.3f} times 2 xi_h omega_h "
        f"with a spool of {FAST_SPOOL / 1e3:.0f} kHz, at {limits[0].min():.0f} to {limits[0].max():.0f} times with one of 100 Hz",
        "A spool slower than the hydraulic resonance filters it: the criterion is then safe by far, and no longer a limit.",
        {"fast_low": float(limits[1].min()), "fast_high": float(limits[1].max()), "slow_low": float(limits[0].min())},
    )


def _static_error(figures: Figures) -> Claim:
    error = figures["static_error"]
    hm, thm = (_growth(error, model) - 1.0 for model in (0, 1))
    return Claim(
        "static_error_rises_little",
        "Discussion",
        "static error rises a little",
        "The static error increases a little with temperature, because of the heat of the losses.",
        verdict(0.0 < thm < 0.15 and abs(hm) < 0.01),
        f"HM {percent(hm, 1, True)}, THM {percent(thm, 1, True)}",
        f"from -40 to 70 degC {percent(hm, 2, True)} in HM, {percent(thm, 1, True)} in THM "
        f"({1e6 * error[1, 0, 0]:.2f} to {1e6 * error[1, 0, -1]:.2f} um for 100 N of dry friction)",
        "It is 1/K_PX, so only the heat moves it.",
        {"HM": hm, "THM": thm},
    )


def _load_error(figures: Figures) -> Claim:
    error = figures["load_error"]
    hm, thm = (_growth(error, model) - 1.0 for model in (0, 1))
    a, k = _growth(figures["leakage_coefficient"]), _growth(figures["flow_gain"])
    return Claim(
        "load_error_depends_on_both_gains",
        "Eq. 4",
        "load error depends on K_QP and K_QX",
        "The position error under load depends on both the flow/pressure and the flow/current gain.",
        verdict(a > 2.0 and k > 2.0),
        f"HM {percent(hm, 1, True)}, THM {percent(thm, 1, True)}",
        f"A grows {a:.0f} times and K_QI {k:.0f} times from -40 to 70 degC; the error, their ratio, changes by "
        f"{percent(hm, 2, True)} (HM) and {percent(thm, 1, True)} (THM)",
        "Without jack leakage the ratio is 1/K_PX: both matter, but temperature cancels. A leaking jack would not cancel.",
        {"HM": hm, "THM": thm, "leakage_coefficient": a, "flow_gain": k},
    )


def _consumption(curves: SeedCurves, figures: Figures, valve: Valve, nominal_flow: float) -> Claim:
    watts, leakage = figures["null_consumption"][0, 0], figures["null_leakage"][0, 0]
    supply = jnp.asarray(curves.supply[0])
    rise = float(jax.jit(throttling_rise)(valve.oil, supply, 0.5 * supply, jnp.asarray(curves.temperature[-1])))
    share = leakage / nominal_flow
    return Claim(
        "consumption",
        "Consumption",
        "null leakage costs power, warms oil",
        "Leakage at null is a lasting loss of the hydraulic circuit, and warms the oil.",
        verdict(bool(watts[-1] > 10.0), bool(watts[-1] > 1.0)),
        f"{watts[0]:.1f} to {watts[-1]:.0f} W",
        f"{watts[-1]:.0f} W at 70 degC ({percent(share[-1])} of the rated flow), {watts[0]:.2f} W at -40 degC "
        f"({percent(share[0], 2)}); the oil that leaks leaves {rise:.1f} K warmer at 70 degC",
        "Only where the oil is warm.",
        {
            "watt_30cSt": float(watts[-1]),
            "watt_4000cSt": float(watts[0]),
            "share_of_rated_flow_30cSt": float(share[-1]),
            "rise": rise,
        },
    )


def _conclusion(figures: Figures) -> Claim:
    names = ("null_leakage", "flow_gain", "pressure_gain")
    growth = {name: [_growth(figures[name], model) for model in (0, 1)] for name in names}
    little = max(abs(value - 1.0) for value in growth["pressure_gain"])
    return Claim(
        "viscosity_matters_for_flows",
        "Conclusion",
        "viscosity moves flows, not K_PX",
        "The change of viscosity is very important for leakage and flow gain, and of little importance for the pressure gain.",
        verdict(min(growth["null_leakage"] + growth["flow_gain"]) > 10.0 and little < 0.1),
        f"{growth['null_leakage'][0]:.0f}, {growth['flow_gain'][0]:.0f} times; {percent(growth['pressure_gain'][1] - 1.0, 1, True)}",
        f"from -40 to 70 degC at null: leakage {growth['null_leakage'][0]:.0f} times, flow gain {growth['flow_gain'][0]:.0f} times, "
        f"pressure gain {percent(growth['pressure_gain'][0] - 1.0, 3, True)} (HM) and "
        f"{percent(growth['pressure_gain'][1] - 1.0, 1, True)} (THM)",
        values={name: values[0] for name, values in growth.items()} | {"pressure_gain_THM": growth["pressure_gain"][1]},
    )
