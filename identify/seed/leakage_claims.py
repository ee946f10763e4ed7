"""The seed paper's claims about leakage (Figures 3 to 5), computed."""

import numpy as np

from .claim import LITTLE, Claim, percent, thickest_within, verdict
from .curves import SeedCurves


L_MIN, CST = 6e4, 1e6
BARS = (0.0, 0.025, 0.05)  # Figure 4
BAR_VISCOSITY = 300e-6


def leakage_claims(curves: SeedCurves) -> list[Claim]:
    """Claims of the leakage test, at the first supply pressure, the second beside it."""
    return [_peak(curves), _similar(curves), _bars(curves), _rises(curves), _three_times(curves)]


def heat_gap(curves: SeedCurves, name: str, share: float, supply: int = 0) -> np.ndarray:
    """THM over HM, less one, of a curve (an attribute of `SeedCurves`) at an opening, for every temperature."""
    hm, thm = getattr(curves, name)[:, supply, :, curves.at_opening(share)]
    return thm / hm - 1.0


def _peak(curves: SeedCurves) -> Claim:
    null = curves.at_opening(0.0)
    off = np.abs(curves.opening[np.argmax(curves.leakage, axis=-1)])
    return Claim(
        "leakage_peaks_at_null",
        "Consumption, Figure 3",
        "leakage peaks at null",
        "Leakage is largest at the neutral position.",
        verdict(bool(np.all(off == 0.0))),
        f"{off.size} of {off.size} curves" if not off.any() else f"off by {percent(off.max())}",
        f"largest at {percent(off.max(), 0)} opening in all {off.size} curves (HM and THM, 70 and 210 bar)",
        values={"largest_offset_of_peak": float(off.max()), "null": float(curves.leakage[0, 0, -1, null]) * L_MIN},
    )


def _similar(curves: SeedCurves) -> Claim:
    leakage = curves.leakage[:, 0]
    on_figure = float(np.abs(leakage[1] - leakage[0]).max() / leakage[0].max())
    gap = heat_gap(curves, "leakage", 0.0)
    return Claim(
        "leakage_models_similar",
        "Figure 3",
        "HM and THM leakage look alike",
        "The leakage curves of HM and THM look alike at every temperature.",
        verdict(on_figure < LITTLE),
        f"{percent(on_figure)} of full scale",
        f"they differ by at most {percent(on_figure)} of the figure's full scale; at null by {percent(gap[-1])} of the leakage itself at "
        f"30 cSt and {percent(gap[0])} at 4000 cSt",
        "The relative gap grows with viscosity, but where it is large the leakage is too small to see on the figure.",
        {"gap_of_full_scale": on_figure, "gap_30cSt": float(gap[-1]), "gap_4000cSt": float(gap[0])},
    )


def _bars(curves: SeedCurves) -> Claim:
    at = curves.at_viscosity(BAR_VISCOSITY)
    gaps = [float(heat_gap(curves, "leakage", share)[at]) for share in BARS]
    flows = [curves.leakage[:, 0, at, curves.at_opening(share)] * L_MIN for share in BARS]
    bars = "; ".join(
        f"{percent(s)}: {hm:.5f} and {thm:.5f} l/min ({percent(g, 1, True)})"
        for s, (hm, thm), g in zip(BARS, flows, gaps, strict=True)
    )
    return Claim(
        "leakage_bars",
        "Figure 4",
        "THM leaks slightly more at 300 cSt",
        "At 300 cSt and 0, 2.5 and 5 % opening THM leaks slightly more than HM.",
        verdict(all(0.0 < gap < LITTLE for gap in gaps)),
        ", ".join(f"{100 * gap:+.1f}" for gap in gaps) + " %",
        f"HM and THM at {bars}",
        values={f"gap_{100 * share:g}%": gap for share, gap in zip(BARS, gaps, strict=True)},
    )


def _rises(curves: SeedCurves) -> Claim:
    rises = bool(np.all(np.diff(curves.leakage, axis=2) > 0.0))
    null = curves.leakage[:, 0, :, curves.at_opening(0.0)] * L_MIN
    return Claim(
        "leakage_rises_with_temperature",
        "Figure 5, Discussion",
        "leakage rises with temperature",
        "Leakage rises with temperature, at every opening.",
        verdict(rises),
        f"{null[0, -1] / null[0, 0]:.0f} times, -40 to 70 °C",
        f"at every opening, in both models; at null HM from {null[0, 0]:.5f} l/min at 4000 cSt to {null[0, -1]:.4f} at 30 cSt "
        f"({null[0, -1] / null[0, 0]:.0f} times), THM from {null[1, 0]:.5f} to {null[1, -1]:.4f}",
        "Laminar, so almost as 1/nu: 133 times thinner oil.",
        {
            "null_HM_4000cSt": float(null[0, 0]),
            "null_HM_30cSt": float(null[0, -1]),
            "ratio": float(null[0, -1] / null[0, 0]),
        },
    )


def _three_times(curves: SeedCurves) -> Claim:
    at = curves.at_viscosity(BAR_VISCOSITY)
    low, high = (heat_gap(curves, "leakage", 0.0, supply) for supply in (0, 1))
    within = [thickest_within(curves.viscosity, gap) * CST for gap in (low, high)]
    return Claim(
        "leakage_gap_below_5_percent",
        "Conclusion",
        "heat changes leakage by < 5 %",
        "With the throttling heat kept in the oil, leakage changes by less than 5 %.",
        verdict(within[0] >= 4000.0, within[0] > 300.0),
        f"{percent(low[at])} at 300 cSt, {percent(low[0])} at 4000",
        f"at null at 70 bar: up to {within[0]:.0f} cSt ({percent(low[at])} at 300 cSt, {percent(low[0])} at 4000); at 210 bar: up to "
        f"{within[1]:.0f} cSt ({percent(high[at])} at 300 cSt, {percent(high[0])} at 4000)",
        f"The oil warms in proportion to the pressure drop, 3 to 4 K per 70 bar, and the colder it is the more a kelvin "
        f"thins it: 210 bar give {high[at] / low[at]:.1f} times the gap of 70 bar at 300 cSt, "
        f"{high[-1] / low[-1]:.1f} times at 30, where the null region is no longer laminar. The paper does not state its supply pressure.",
        {
            "cSt_within_5_percent_70bar": within[0],
            "cSt_within_5_percent_210bar": within[1],
            "gap_300cSt_70bar": float(low[at]),
            "gap_300cSt_210bar": float(high[at]),
        },
    )
