"""Oil that is not the one of its data sheet, and the heat that it keeps."""

from typing import final

import equinox as eqx
from jaxtyping import Array, Float

from ..effect import AbstractHeatEffect, AbstractOilEffect, as_amount
from ..oil import Oil


@final
class PressureViscosity(AbstractOilEffect):
    """mu exp(b p), added to what the oil has of its own.

    Source: Barus (1893); b of mineral oils 1.5e-8 to 2.5e-8 1/Pa (ASME Pressure-Viscosity Report, 1953).
    Amount b >= 0 [1/Pa], typical 1e-8 to 2.5e-8. Shows in the leakage, over the supply pressure.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def oil(self, nominal: Oil) -> Oil:
        own = nominal.pressure_viscosity
        total = self.amount if own is None else own + self.amount
        return eqx.tree_at(lambda o: o.pressure_viscosity, nominal, total, is_leaf=lambda leaf: leaf is None)


@final
class ViscosityShift(AbstractOilEffect):
    """nu (1 + d): another batch, ageing, water.

    Source: ISO 3448 allows 10 % about a grade's nominal viscosity.
    Amount d > -1 [-], typical 0.02 to 0.3. Shows in the leakage away from null and in the flow at small openings.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def oil(self, nominal: Oil) -> Oil:
        factor = 1.0 + self.amount
        own = nominal.viscosity_factor
        total = factor if own is None else own * factor
        return eqx.tree_at(lambda o: o.viscosity_factor, nominal, total, is_leaf=lambda leaf: leaf is None)


@final
class ThrottleHeating(AbstractHeatEffect):
    """Share of the throttling heat that stays in the oil, added to the valve's `heat_retention`: eta + amount.

    Source: the seed paper's adiabatic model (THM, eta = 1) beside its isothermal one (HM, eta = 0); eta = exp(-NTU).
    Amount [-], eta + amount from 0 to 1, typical 0.1 to 1. Shows in the leakage and the pressure gain of cold oil.
    """

    amount: Float[Array, "..."] = eqx.field(converter=as_amount)

    def heat_retention(self, own: Float[Array, "..."]) -> Float[Array, "..."]:
        return own + self.amount
