"""The seed paper's claims about the flow curves and their gain (Figures 7 and 8, Eq. 6), computed."""

import numpy as np

from thermohyd.identify.bench.shown_units import CELSIUS, CST, L_MIN, UM
from thermohyd.identify.flow_curve_fit import FlowCurveFit, TwoTermFit

from .blocked_port_claims import heat_gap
from .curves import Claim, SeedCurves, percent, thickest_within, verdict


SMALL = 0.01  # the opening of Figure 8, which the paper does not state
DISTINCT = 1.5  # two regions of the flow curve are told apart where their gains differ by so much


def bar_flow_gain(curves: SeedCurves, share: float, nominal_flow: float, supply: int = 0) -> np.ndarray:
    """bar K_QX = K_QX X_n/Q_n (Eq. 7) of HM and THM (2, temperatures) at an opening."""
    return curves.flow_gain[:, supply, :, curves.at_opening(share)] * curves.stroke / nominal_flow


def flow_claims(
    curves: SeedCurves, macro: FlowCurveFit, two_terms: list[TwoTermFit], nominal_flow: float
) -> list[Claim]:
    """Claims of the flow-gain test, at the first supply pressure."""
    return [
        _rated(curves, nominal_flow),
        _changes(curves),
        _regions(curves),
        _eq6(curves, macro, two_terms),
        _null_gain(curves, nominal_flow),
        _laminar(curves),
        _models(curves),
    ]


def _rated(curves: SeedCurves, nominal_flow: float) -> Claim:
    full = curves.flow[0, 0, :, -1]
    missing = full[-1] / nominal_flow - 1.0
    return Claim(
        "rated_flow",
        "Thermal-hydraulic modeling",
        "9.8 l/min at 70 bar",
        "The valve delivers 9.8 l/min at full stroke and 70 bar.",
        verdict(abs(missing) < 0.02),
        f"{full[-1] * L_MIN:.2f} l/min",
        f"{full[-1] * L_MIN:.2f} l/min at 30 cSt ({percent(missing, 1, True)}), {full[0] * L_MIN:.2f} at 4000 cSt",
        f"The flow of warm oil is C_q times what the geometry gives; the paper states no C_q. 0.7 is assumed, "
        f"{0.7 * nominal_flow / full[-1]:.2f} would meet 9.8 l/min. Nothing else is tuned to it.",
        {"full_stroke_flow_30cSt": float(full[-1]) * L_MIN, "full_stroke_flow_4000cSt": float(full[0]) * L_MIN},
    )


def _changes(curves: SeedCurves) -> Claim:
    full, large = curves.flow[0, 0, :, -1] * L_MIN, curves.flow_gain[0, 0, :, -1]
    return Claim(
        "flow_gain_changes",
        "Figure 7",
        "thick oil changes the flow gain",
        "Very viscous oil changes the flow gain considerably.",
        verdict(bool(full[0] < 0.5 * full[-1])),
        f"{full[-1]:.2f} to {full[0]:.2f} l/min",
        f"full-stroke flow {full[-1]:.2f} l/min at 30 cSt, {full[curves.at_viscosity(1000e-6)]:.2f} at 1000, {full[0]:.2f} at 4000; "
        f"the slope at full stroke is largest at {curves.temperature[np.argmax(large)] - CELSIUS:.0f} degC",
        "Down to about 0 degC the large openings stay turbulent and only the null region changes; below, the whole stroke does.",
        {"full_stroke_flow_30cSt": float(full[-1]), "full_stroke_flow_4000cSt": float(full[0])},
    )


def _regions(curves: SeedCurves) -> Claim:
    ratio = curves.flow_gain[0, 0, :, -1] / curves.flow_gain[0, 0, :, curves.at_opening(0.0)]
    return Claim(
        "two_regions",
        "Figure 7",
        "two regions of flow gain",
        "The flow curve has two regions: a small gain around null and a larger one at large openings.",
        verdict(bool(np.all(ratio > DISTINCT)), bool(ratio[0] > DISTINCT)),
        f"gains differ {ratio[0]:.0f} to {ratio[-1]:.2f} times",
        f"gain at full stroke over gain at null: {ratio[0]:.0f} at 4000 cSt, {ratio[curves.at_viscosity(300e-6)]:.0f} at 300, "
        f"{ratio[-1]:.2f} at 30",
        f"Thinner than about {_crossing(curves, ratio):.0f} cSt they differ by less than {DISTINCT:g} times: turbulent oil at null, "
        "where underlap opens two edges at once, makes up for the rounding."
        if ratio[-1] < DISTINCT
        else "",
        {"ratio_4000cSt": float(ratio[0]), "ratio_30cSt": float(ratio[-1])},
    )


def _crossing(curves: SeedCurves, ratio: np.ndarray) -> float:
    """Viscosity [cSt] at which the two gains differ by `DISTINCT`; the ratio rises with viscosity."""
    return float(np.exp(np.interp(np.log(DISTINCT), np.log(ratio[::-1]), np.log(curves.viscosity[::-1])))) * CST


def _eq6(curves: SeedCurves, macro: FlowCurveFit, two_terms: list[TwoTermFit]) -> Claim:
    worst = np.array([fit.worst for fit in macro.fits])
    share, stroke = worst / macro.stroke, macro.stroke
    x0, q0, k = np.array([fit.values for fit in macro.fits]).T
    null_gain = 1.0 / (x0 / q0 + k) / curves.flow_gain[0, 0, :, curves.at_opening(0.0)]
    warm = thickest_within(curves.viscosity, share, 0.02) * CST
    double = max(fit.worst for fit in two_terms)
    return Claim(
        "eq6_reproduces",
        "Eq. 6",
        "Eq. 6 reproduces the flow curve",
        "X = X0 tanh(Q/Q0) + k Q reproduces the change of gain around null, its parameters varying with temperature.",
        verdict(bool(share.max() < 0.02 and np.all(np.abs(null_gain - 1.0) < 0.25)), bool(share[-1] < 0.02)),
        f"{percent(share.max())} off; < 2 % to {warm:.0f} cSt",
        f"over the whole stroke each temperature's own fit misses the opening by at most {worst.max() * UM:.1f} um "
        f"({percent(share.max())} of stroke, {curves.temperature[np.argmax(worst)] - CELSIUS:.0f} degC), by less than 2 % up to "
        f"{warm:.0f} cSt; with smooth laws in temperature by {macro.worst * UM:.1f} um ({percent(macro.worst / stroke)}). "
        f"Its null gain is {null_gain[0]:.1f} times the model's at 4000 cSt and {null_gain[-1]:.2f} times at 30",
        "Cold oil is laminar over the whole stroke: the flow grows as the gap squared, X as sqrt(Q), without the asymptote that Eq. 6 "
        f"supposes. A second tanh term brings the worst error to {double * UM:.1f} um ({percent(double / stroke)}).",
        {
            "worst_own_fit_um": float(worst.max()) * UM,
            "worst_smooth_um": macro.worst * UM,
            "worst_two_terms_um": double * UM,
            "null_gain_ratio_4000cSt": float(null_gain[0]),
            "null_gain_ratio_30cSt": float(null_gain[-1]),
            "cSt_within_2_percent": warm,
        },
    )


def _null_gain(curves: SeedCurves, nominal_flow: float) -> Claim:
    gains = bar_flow_gain(curves, SMALL, nominal_flow)
    ratio = gains[:, -1] / gains[:, 0]
    return Claim(
        "small_opening_flow_gain_rises",
        "Figure 8, Discussion",
        "flow gain at null rises strongly",
        "At small openings the flow gain rises very strongly with temperature.",
        verdict(bool(np.all(np.diff(gains) > 0.0) and ratio.min() > 10.0)),
        f"{ratio[0]:.0f} times, -40 to 70 °C",
        f"bar K_QX at {percent(SMALL, 0)} opening from {gains[0, 0]:.4f} at -40 degC to {gains[0, -1]:.3f} at 70 degC: "
        f"{ratio[0]:.0f} times (HM); THM {gains[1, 0]:.4f} to {gains[1, -1]:.3f}, {ratio[1]:.0f} times",
        values={"bar_K_QX_cold": float(gains[0, 0]), "bar_K_QX_hot": float(gains[0, -1]), "ratio": float(ratio[0])},
    )


def _laminar(curves: SeedCurves) -> Claim:
    scaled = curves.flow_gain[0, 0, :, curves.at_opening(SMALL)] * curves.viscosity
    loss = 1.0 - scaled / scaled.max()
    warm = curves.viscosity[loss < 0.05].min() * CST
    return Claim(
        "laminar_at_small_openings",
        "Figure 8",
        "... because the flow is laminar",
        "The reason is laminar flow: the gain follows the viscosity.",
        verdict(bool(loss.max() < 0.05), bool(loss[0] < 0.05)),
        f"from {warm:.0f} to 4000 cSt",
        f"gain x viscosity is constant within 5 % from 4000 to {warm:.0f} cSt; at 30 cSt it has lost {percent(loss[-1], 0)}",
        "In the warmest oil the null region leaves the laminar range.",
        {"loss_30cSt": float(loss[-1]), "laminar_down_to_cSt": float(warm)},
    )


def _models(curves: SeedCurves) -> Claim:
    gaps = [heat_gap(curves, "flow_gain", SMALL, supply) for supply in (0, 1)]
    within = [thickest_within(curves.viscosity, gap) * CST for gap in gaps]
    at = curves.at_viscosity(300e-6)
    return Claim(
        "flow_gain_gap_below_5_percent",
        "Conclusion",
        "heat changes the flow gain by < 5 %",
        "With the throttling heat kept in the oil, the small-opening flow gain changes by less than 5 %.",
        verdict(within[0] >= 4000.0, within[0] > 300.0),
        f"{percent(gaps[0][at])} at 300 cSt, {percent(gaps[0][0])} at 4000",
        f"THM above HM by less than 5 % up to {within[0]:.0f} cSt at 70 bar ({percent(gaps[0][at])} at 300, "
        f"{percent(gaps[0][0])} at 4000) and up to {within[1]:.0f} cSt at 210 bar ({percent(gaps[1][at])} at 300, "
        f"{percent(gaps[1][0])} at 4000)",
        f"As for leakage: {gaps[1][at] / gaps[0][at]:.1f} times the gap at three times the pressure.",
        {"cSt_within_5_percent_70bar": within[0], "cSt_within_5_percent_210bar": within[1]},
    )
