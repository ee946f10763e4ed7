"""The seed paper's claims about the tests with closed use ports, computed: leakage (Figures 3 to 5) and pressure gain (Figure 6).

The pressure/opening gain is computed as slope and as secant, which differ where the curve bends.
"""

import numpy as np

from thermohyd.identify.bench.shown_units import CST, L_MIN

from .curves import LITTLE, Claim, SeedCurves, percent, thickest_within, verdict


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


PRESSURE_OPENINGS = (0.01, 0.03)  # Figure 6


def bar_slope(curves: SeedCurves, share: float, nominal_pressure: float, supply: int = 0) -> np.ndarray:
    """bar K_PX = K_PX X_n/P_n (Eq. 5) of HM and THM (2, temperatures): the slope of the load pressure at an opening."""
    return curves.pressure_gain[:, supply, :, curves.at_opening(share)] * curves.stroke / nominal_pressure


def bar_secant(curves: SeedCurves, share: float, nominal_pressure: float, supply: int = 0) -> np.ndarray:
    """The same from the load pressure that an opening reaches: (p_A - p_B) X_n/(x P_n)."""
    return curves.load_pressure[:, supply, :, curves.at_opening(share)] / share / nominal_pressure


def pressure_claims(curves: SeedCurves, nominal_pressure: float) -> list[Claim]:
    """Claims of the pressure-gain test, at the first supply pressure."""
    return [
        _constant(curves, nominal_pressure),
        _falls(curves, nominal_pressure),
        _above(curves, nominal_pressure),
        _little(curves, nominal_pressure),
    ]


def _constant(curves: SeedCurves, nominal_pressure: float) -> Claim:
    gains = {share: bar_slope(curves, share, nominal_pressure)[0] for share in (0.0, *PRESSURE_OPENINGS)}
    spread = max(float(np.ptp(gain) / gain[0]) for gain in gains.values())
    figures = ", ".join(f"{gain[0]:.2f} at {percent(share, 0)}" for share, gain in gains.items())
    if curves.edge_law == "lubrication":
        ends = ", ".join(f"{gain[0]:.2f} to {gain[-1]:.2f} at {percent(share, 0)}" for share, gain in gains.items())
        computed = f"{ends} opening from -40 to 70 degC: it depends on temperature with this law"
        why = (
            "Cold oil feels the film along the whole gap, warm oil the narrowest place alone: the two change differently with the "
            "opening, so which of them rules shows in the gain. The orifice law puts both at the narrowest place."
        )
    else:
        computed = f"{figures} opening, the same at every temperature to {spread:.0e}"
        why = "Every law Q/(w nu) = F(h sqrt(dp/rho)/nu) makes it so inside the underlap; compressibility leaves the last digits."
    return Claim(
        "hm_pressure_gain_constant",
        "Figure 6",
        "HM pressure gain constant",
        "In HM bar K_PX does not change with temperature.",
        verdict(spread < 1e-3),
        f"spread {spread:.0e}",
        computed,
        why,
        {"spread": spread, **{f"bar_K_PX_{100 * share:g}%": float(gain[0]) for share, gain in gains.items()}},
    )


def _falls(curves: SeedCurves, nominal_pressure: float) -> Claim:
    slopes = {share: bar_slope(curves, share, nominal_pressure)[1] for share in PRESSURE_OPENINGS}
    secants = {share: bar_secant(curves, share, nominal_pressure)[1] for share in PRESSURE_OPENINGS}
    falls = {share: bool(np.all(np.diff(gain) < 0.0)) for share, gain in slopes.items()}
    secants_fall = all(bool(np.all(np.diff(gain) < 0.0)) for gain in secants.values())
    figures = "; ".join(
        f"slope at {percent(share, 0)}: {gain[0]:.2f} to {gain[-1]:.2f}" for share, gain in slopes.items()
    )
    chords = "; ".join(
        f"secant to {percent(share, 0)}: {gain[0]:.2f} to {gain[-1]:.2f}" for share, gain in secants.items()
    )
    return Claim(
        "thm_pressure_gain_falls",
        "Figure 6",
        "THM pressure gain falls when warmer",
        "In THM bar K_PX decreases somewhat as the temperature rises, at 1 and at 3 % opening.",
        verdict(all(falls.values()), falls[0.01] or secants_fall),
        "1 %: yes; 3 %: secant only" if falls[0.01] and not falls[0.03] else figures,
        f"from -40 to 70 degC: {figures}; {chords}",
        "At 3 % the slope of the load pressure itself rises: THM reaches the supply pressure sooner, so its curve is already "
        "bending there. The pressure reached per opening (the secant) does what the paper says at both openings.",
        {f"slope_change_{100 * share:g}%": float(gain[-1] / gain[0] - 1.0) for share, gain in slopes.items()}
        | {f"secant_change_{100 * share:g}%": float(gain[-1] / gain[0] - 1.0) for share, gain in secants.items()},
    )


def _above(curves: SeedCurves, nominal_pressure: float) -> Claim:
    slope = {share: heat_gap(curves, "pressure_gain", share) for share in PRESSURE_OPENINGS}
    secant = {share: heat_gap(curves, "load_pressure", share) for share in PRESSURE_OPENINGS}
    above = all(bool(np.all(gap > 0.0)) for gap in slope.values())
    small = max(float(np.abs(gap).max()) for gap in slope.values()) < LITTLE
    secant_above = all(bool(np.all(gap > 0.0)) for gap in secant.values())
    within = thickest_within(curves.viscosity, secant[0.01]) * CST
    figures = "; ".join(
        f"slope at {percent(share, 0)}: {percent(gap[0], 1, True)} to {percent(gap[-1], 1, True)}"
        for share, gap in slope.items()
    )
    chords = "; ".join(
        f"secant to {percent(share, 0)}: {percent(gap[0], 1, True)} to {percent(gap[-1], 1, True)}"
        for share, gap in secant.items()
    )
    at_210 = heat_gap(curves, "pressure_gain", 0.01, 1)
    return Claim(
        "thm_pressure_gain_above",
        "Figure 6",
        "THM pressure gain above HM, < 5 %",
        "THM's bar K_PX is always above HM's, by less than 5 %.",
        verdict(above and small, secant_above or bool(np.all(slope[0.01] > 0.0))),
        f"{percent(slope[0.01][0], 1, True)} at 1 %, {percent(slope[0.03][0], 1, True)} at 3 %",
        f"THM against HM from -40 to 70 degC: {figures}; {chords}. At 210 bar "
        f"the slope at 1 %: {percent(at_210[0], 1, True)} to {percent(at_210[-1], 1, True)}",
        f"The slope at 3 % lies below HM's, for the reason given above. Secants lie above at both openings, within 5 % up to "
        f"{within:.0f} cSt at 1 %.",
        {
            f"slope_gap_{100 * share:g}%_{t}": float(gap[i])
            for share, gap in slope.items()
            for t, i in (("cold", 0), ("hot", -1))
        }
        | {
            f"secant_gap_{100 * s:g}%_{t}": float(g[i])
            for s, g in secant.items()
            for t, i in (("cold", 0), ("hot", -1))
        },
    )


def _little(curves: SeedCurves, nominal_pressure: float) -> Claim:
    change = bar_slope(curves, 0.0, nominal_pressure)
    change = change[:, -1] / change[:, 0] - 1.0
    return Claim(
        "pressure_gain_nearly_constant",
        "Discussion",
        "pressure gain nearly constant",
        "The pressure gain hardly depends on temperature; only THM shows a slight reduction as it rises.",
        verdict(abs(change[0]) < 1e-3 and -0.1 < change[1] < 0.0),
        f"HM {percent(change[0], 1, True)}, THM {percent(change[1], 1, True)}",
        f"null gain from -40 to 70 degC: HM {percent(change[0], 3, True)}, THM {percent(change[1], 1, True)}",
        values={"change_HM": float(change[0]), "change_THM": float(change[1])},
    )
