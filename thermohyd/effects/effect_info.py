"""What the program must know of one effect beside its class: one entry of plain data, so that files and reports are read without JAX."""

import math
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from keyword import iskeyword
from typing import Any


STATIC_TESTS = ("leakage", "pressure_gain", "flow_gain", "load_flow")
DYNAMIC_TESTS = ("step", "frequency")
# What a record may have to hold before an effect can be told from everything else, or computed at all.
NEEDS = {
    "time": "the time of every row in the tests that show it",
    "rate": "the rate of the sweep at every row of every test, which follows from the time",
    "several_rates": "sweeps of several rates",
    "both_directions": "sweeps in both directions",
    "measured_spool": "in dynamic tests, the spool's position as a reading",
    "warm_chambers": "in dynamic tests, chambers that keep heat",
}
ELSEWHERE = ("", "sources", "valve", "play", "command", "bench")
OF_SWEEPS = frozenset({"time", "rate", "several_rates", "both_directions"})


@dataclass(frozen=True, kw_only=True)
class EffectInfo:
    """One effect of the library, before any data. Amounts are in `unit` (SI), neutral value 0.

    name: as files, reports and `with_effects` write it. effect: its class, or "module:Class" where the class is to be
    imported on first use only. lower, upper: the box of a fit, `lower = 0` where the sign is known. typical: (small but
    visible, large), of a valve of the seed valve's size. scale: a step that matters. shows: the tests that see it. sentence:
    what it is, as a report says it after the name: no capital, no full stop.

    even: only its square acts, so that the derivative at neutral is zero and finite steps are needed.
    needs: names of `NEEDS` without which a record cannot speak of it. looks_like: what it cannot be told from without them.
    shown: (unit, how many of it are one SI unit) of a report; else what suits the SI unit.
    factor_on: "viscosity" where (1 + amount) multiplies the oil's viscosity: learned terms of it act through this effect.
    adds_to: "heat_retention" where the amount is added to that parameter, whose limits the sum must keep.
    also_in_motion: of a static effect, that step tests show it too.
    caveat: what a report adds to the sentence, unless one of the channels `settled_by` was measured.
    costly: its presence alone makes each step of the ports' balance longer, so that fits without it go without it.
    mirrored_in: the parameter p for which (p, amount) and (p + amount, -amount) are one valve to most readings; "" for none.
    exchanged: the effect that it becomes where supply and return edges change places, which leaves one valve to most readings; "" for
    none.
    elsewhere: where the valve goes into another program: "sources", the C sources of an FMU know the effect by its name
    (identify/export/sources); "valve", those of the static valve do, no motion shows it; "play", those of a servo do, and it has a
    state there; "command", it lies before the loop, where the other program has it; "bench", it is the bench's and stays there;
    "", C knows nothing of it.

    Everything else follows from the class. Raises ValueError or TypeError, with one sentence, for an entry that is none.
    """

    name: str
    effect: type[Any] | str
    unit: str
    lower: float
    upper: float
    typical: tuple[float, float]
    scale: float
    shows: tuple[str, ...]
    sentence: str
    even: bool = False
    needs: tuple[str, ...] = ()
    looks_like: str = ""
    shown: tuple[str, float] | None = None
    factor_on: str = ""
    adds_to: str = ""
    also_in_motion: bool = False
    caveat: str = ""
    settled_by: tuple[str, ...] = ()
    mirrored_in: str = ""
    exchanged: str = ""
    costly: bool = False
    elsewhere: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isidentifier() or iskeyword(self.name):
            raise ValueError(f"an effect's name must be a Python identifier, such as slot_wear, not {self.name!r}")
        if not isinstance(self.effect, type) and not (isinstance(self.effect, str) and ":" in self.effect):
            raise TypeError(f'{self.name}: effect must be a class or "module:Class", not {self.effect!r}')
        numbers = (self.lower, self.upper, self.scale, *self.typical)
        if not all(math.isfinite(number) for number in numbers):
            raise ValueError(f"{self.name}: lower, upper, typical and scale must be finite numbers")
        if not self.lower <= 0.0 < self.upper:
            raise ValueError(f"{self.name}: lower and upper must have the neutral amount, 0, between them")
        if len(self.typical) != 2 or not 0.0 < self.typical[0] <= self.scale <= self.typical[1] <= self.upper:
            raise ValueError(f"{self.name}: must have 0 < typical[0] <= scale <= typical[1] <= upper")
        for field, names, known in (
            ("shows", self.shows, (*STATIC_TESTS, *DYNAMIC_TESTS)),
            ("needs", self.needs, tuple(NEEDS)),
            ("factor_on", (self.factor_on,), ("", "viscosity")),
            ("adds_to", (self.adds_to,), ("", "heat_retention")),
            ("elsewhere", (self.elsewhere,), ELSEWHERE),
        ):
            unknown = [repr(name) for name in names if name not in known]
            if isinstance(names, str) or unknown:
                has = f"has the unknown {', '.join(unknown)}" if unknown else "must be a tuple"
                raise ValueError(f"{self.name}: {field} {has}; known: {', '.join(name for name in known if name)}")
        if not self.shows or not self.unit or not self.sentence:
            raise ValueError(f"{self.name}: shows, unit and sentence must not be empty")

    @cached_property
    def effect_class(self) -> type[Any]:
        """The class, imported on first use."""
        if isinstance(self.effect, type):
            return self.effect
        module, name = self.effect.split(":")
        return getattr(import_module(module), name)

    @cached_property
    def stages(self) -> tuple[str, ...]:
        """Where it acts, by the abstract classes that it inherits from: conditions, oil, ..., motion, force."""
        own = (base.__dict__.get("stage", "") for base in self.effect_class.__mro__)
        return tuple(dict.fromkeys(stage for stage in own if stage))

    @property
    def dynamic(self) -> bool:
        """Whether only dynamic tests show it, so that static ones need not ask for it."""
        return self.effect_class.dynamic

    @property
    def rowwise(self) -> bool:
        """Whether readings still depend on the parameters through their own row only."""
        return self.effect_class.rowwise

    @property
    def small_signal(self) -> bool:
        """Whether it has a small-signal response."""
        return self.effect_class.small_signal

    @property
    def computes_heat(self) -> bool:
        """Whether the balances must compute the heat of throttling for it."""
        return "heat" in self.stages

    @property
    def coupled(self) -> bool:
        """Whether it ties the balances of the ports together (lines, flow between the ports)."""
        return "lines" in self.stages or "crossing" in self.stages

    @property
    def stores(self) -> bool:
        """Whether it ties the rows of a sweep together through what the ports store, and so is no filter on readings."""
        return "storage" in self.stages

    @property
    def on_readings(self) -> bool:
        """Whether it changes what the static bench's instruments say, and so stays on that bench."""
        return "readings" in self.stages

    @property
    def of_sweeps(self) -> bool:
        """Whether it acts along a sweep, so that a single operating point knows nothing of it."""
        return not OF_SWEEPS.isdisjoint(self.needs)
