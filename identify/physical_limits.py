"""What no bench has: the readings and conditions that give away a wrong unit or a broken sensor."""

ABSOLUTE_VACUUM = -101325.0  # Pa gauge
HIGHEST_PRESSURE = 5e8  # Pa: ten times any valve's
TEMPERATURES = (173.15, 673.15)  # K: outside it no hydraulic oil flows


def impossible(kind: str, value: float) -> str:
    """What is wrong with a pressure [Pa gauge] or temperature [K], as the end of a sentence; empty where nothing is."""
    if kind == "temperature" and value <= 0.0:
        return "is at or below absolute zero (-273.15 degC, 0 K)"
    if kind == "temperature" and not TEMPERATURES[0] <= value <= TEMPERATURES[1]:
        return "lies outside -100 to 400 degC; is the unit right?"
    if kind == "pressure" and value < ABSOLUTE_VACUUM:
        return "is below absolute zero pressure (-1.01325 bar gauge); pressures are gauge"
    if kind == "pressure" and value > HIGHEST_PRESSURE:
        return "is above 5000 bar; is the unit right?"
    return ""


def plausible_range(kind: str) -> tuple[float, float]:
    """The values of a kind in which `impossible` finds nothing (SI)."""
    return {"temperature": TEMPERATURES, "pressure": (ABSOLUTE_VACUUM, HIGHEST_PRESSURE)}[kind]
