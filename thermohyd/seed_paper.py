"""The servovalve, the oil and the conditions of the seed paper.

"Thermal-hydraulic lumped parameters model of servovalve to predict performance sensitivity to temperature", INSA Toulouse.
What it leaves open is chosen (docs/physics.md section 1): 70 bar supply, C_q 0.7, lambda_c 100, ASTM D341 through its extremes.
"""

import math

from .edge import EdgeLaw
from .oil import oil_from_definition
from .oil_definition import OilDefinition, walther_coefficients
from .valve import Valve


STROKE = 213e-6  # X_n, m
NOMINAL_PRESSURE = 70e5  # P_n, Pa
NOMINAL_FLOW = 9.8 / 6e4  # Q_n, m3/s
SUPPLY_PRESSURES = (70e5, 210e5)  # Pa; at the first its "less than 5 %" holds, the second is a usual aircraft supply
COLDEST, HOTTEST = 233.15, 343.15  # K: its -40 and +70 degC
THICKEST, THINNEST = 4000e-6, 30e-6  # m2/s: its range of viscosity
VISCOSITIES = (30e-6, 100e-6, 300e-6, 1000e-6, 4000e-6)  # m2/s: where its curves are drawn here


def seed_oil_definition() -> OilDefinition:
    """ASTM D341 through (-40 degC, 4000 cSt) and (70 degC, 30 cSt)."""
    a, b = walther_coefficients([COLDEST, HOTTEST], [THICKEST, THINNEST])
    return OilDefinition(a, b, name="seed oil", source="ASTM D341 through the extremes that the seed paper gives")


def seed_valve(edge_law: EdgeLaw = "orifice") -> Valve:
    """The paper's MOOG 76101: full stroke 213 um, four slots of 3 mm, edge radius 15 um, clearance 2 um, underlap 15 um.

    edge_law: "orifice" is the paper's.
    """
    return Valve(
        oil=oil_from_definition(seed_oil_definition()),
        stroke=STROKE,
        slot_width=12e-3,
        edge_radius=15e-6,
        clearance=2e-6,
        underlap=15e-6,
        edge_law=edge_law,
    )


def temperature_at(viscosity: float) -> float:
    """Temperature [K] at which the seed oil has a kinematic viscosity [m2/s]: its D341 law, solved for T."""
    oil = seed_oil_definition()
    return 10.0 ** ((oil.viscosity_a - math.log10(math.log10(1e6 * viscosity + 0.7))) / oil.viscosity_b)
