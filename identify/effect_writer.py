"""Write a typed term of a diagnosis as an effect class in a user's own folder, with its entry and a test. No JAX.

The class inherits from the stage of the circuit where the term's place lies; its amount times the law of the variable is what shifts
the place. What has no stage (a flow that an edge cannot know, say) is refused with the reason.

The module is run by whoever loads it, and the diagnosis may be a stranger's: what is written into code is a finite number, a checked
name, or the `repr` of words from our own tables. Only the file's own name is its owner's, and `_spoken` lets it end nothing.
"""

import keyword
import re
from pathlib import Path

from thermohyd.identify.bench.errors import BenchInputError, quoted
from thermohyd.identify.model.places import OF_READING, SEVERAL
from thermohyd.identify.model.term_variables import REFERENCE_TEMPERATURE
from thermohyd.identify.model.typed_terms import CURVES, TypedTerm
from thermohyd.identify.report.term_words import confirmed_by, term_name

from .motion_effect_writer import stage_in_motion, test_in_motion
from .written_term import Stage, TermRead, read_term, refused


LONGEST_NAME = 60  # of an effect, and of the file that it was read from


def check_name(name: str) -> None:
    """Raise BenchInputError unless an effect may have this name."""
    from thermohyd.effects.library import find_effect

    plain = re.fullmatch(r"[a-z][a-z0-9_]*", name) is not None and len(name) <= LONGEST_NAME
    if not plain or name.startswith("test_") or keyword.iskeyword(name) or keyword.iskeyword(class_name(name)):
        raise BenchInputError(
            f"an effect's name must be a Python identifier in small letters (a to z, 0 to 9, _; not test_), such as port_hose,"
            f" of at most {LONGEST_NAME}, not {quoted(name)}"
        )
    if class_name(name) in _IMPORTED:
        raise BenchInputError(
            f'the class of an effect "{name}" would hide another of its module; give yours another name'
        )
    if find_effect(name) is not None:
        raise BenchInputError(f'the library has an effect "{name}" already; give yours another name')


# What a module may import, which a class of the same name would hide.
_IMPORTED = frozenset({"Added", "Array", "Conditions", "Edges", "EffectInfo", "Float", "Motion", "Oil", "Seen"})
BASE = "from thermohyd.effects.effect import {}"
CONDITIONS, OIL = "from thermohyd.conditions import Conditions", "from thermohyd.oil import Oil"
_CHANNELS_OF = {"leakage_flow": "leakage", "flow": "flow_gain", "load_pressure": "pressure_gain",
                "pressure_a": "pressure_gain", "pressure_b": "pressure_gain"}  # fmt: skip


def stage_of(term: TypedTerm) -> Stage:
    """The stage of a term's place and its methods. Raises BenchInputError where no stage can know the variable."""
    place = term.place
    if term.moving:
        return stage_in_motion(term)
    if place.startswith(OF_READING) or place == "flow_into_return":
        return _reading(term)
    if place in ("flow_into_a", "flow_into_b", "flow_from_a_to_b"):
        return _port(term)
    if place in ("supply_pressure", "return_pressure", "pressure_in_passages") and term.variable == "flow":
        return _line(term)
    if place in ("position", "supply_pressure", "return_pressure", "pressure_in_passages", "oil_temperature"):
        return _condition(term)
    if place == "viscosity":
        return _oil(term)
    if place.split(":")[0] in ("clearance", "underlap", "edge_radius", "edge_flow"):
        return _edge(term)
    raise refused(term, "no stage of the simulator acts there")


# What a variable is of conditions `c`, and what it needs.
_OF_CONDITIONS = {
    "constant": "jnp.ones_like(c.position)",
    "position": "c.position",
    "opening": "jnp.abs(c.position)",
    "pressure": "c.supply_pressure",
    "pressure_drop": "c.supply_pressure - c.return_pressure",
    "temperature": f"c.temperature - {REFERENCE_TEMPERATURE}",
    "direction": "c.direction",
    "rate": "c.rate",
    "time": "c.time - jnp.min(c.time)",
    "load": "c.load_pressure",
}
_NEEDS = {"direction": ("both_directions",), "rate": ("rate",), "time": ("time",)}


def _variable(term: TypedTerm, own: dict[str, str] | None = None) -> tuple[str, tuple[str, ...]]:
    """(an expression of conditions `c`, what it needs)."""
    known = _OF_CONDITIONS | (own or {})
    if term.variable not in known or (term.variable == "load" and "load" not in (own or {})):
        raise refused(term, f"no stage there knows {term.variable}")
    return known[term.variable], _NEEDS.get(term.variable, ())


def law_code(term: TypedTerm, value: float) -> str:
    """The function `law(v)` of the module: what the place is shifted by per unit of the amount, which was `value` of a curve."""
    lines = ['def law(v: Float[Array, "..."]) -> Float[Array, "..."]:']
    held = f"jnp.clip(v, {term.low!r}, {term.high!r})"
    if term.law == "constant":
        return "\n".join([*lines, '    """The same everywhere."""', "    return jnp.ones_like(v)"])
    lines.append('    """What was seen of the variable, and its ends beyond."""')
    if term.law == "smooth":
        from numpy.polynomial import legendre, polynomial

        powers = legendre.leg2poly([c / value for c in term.coefficients])
        powers = [float(c) for c in polynomial.polytrim(powers)]
        horner = " + s * (".join(repr(c) for c in powers) + ")" * (len(powers) - 1)
        return "\n".join(
            [*lines, f"    s = ({held} - {term.centre!r}) / {term.reach!r}", f"    return {horner} + 0.0 * s"]
        )
    if term.law == "local":
        at_knots = [c / value for c in term.coefficients]
        return "\n".join(
            [
                *lines,
                f"    knots = jnp.linspace({term.low!r}, {term.high!r}, {len(at_knots)})",
                f"    return jnp.interp({held}, knots, jnp.array({at_knots!r}))",
            ]
        )
    if term.law in ("proportional", "laminar"):
        return "\n".join([*lines, f"    return {held}"])
    if term.law == "square":
        return "\n".join([*lines, f"    held = {held}", "    return held * jnp.abs(held)"])
    if term.law == "cube":
        return "\n".join([*lines, f"    return {held} ** 3"])
    return "\n".join(
        [
            *lines,
            f"    held = {held}",
            "    size = jnp.abs(held)",
            "    # The root's slope at 0 has no end.",
            "    return jnp.sign(held) * jnp.where(size > 0.0, jnp.sqrt(jnp.where(size > 0.0, size, 1.0)), 0.0)",
        ]
    )


def _reading(term: TypedTerm) -> Stage:
    name = "leakage_flow" if term.place == "flow_into_return" else term.place.removeprefix(OF_READING)
    channels = SEVERAL.get(name, (name,))
    own = {"flow": "value", "pressure": "value"} if term.place.startswith(OF_READING) else {}
    v, needs = _variable(term, own)
    shows = tuple(dict.fromkeys(_CHANNELS_OF[c] for c in channels))
    shows += ("load_flow",) if "flow" in channels else ()
    both = (*channels, "supply_flow") if "leakage_flow" in channels and term.place != "flow_into_return" else channels
    thins, imports = _thinned(term, "true.temperature")
    body = f"""    def reading(
        self, channel: str, value: Float[Array, " rows"], read: Conditions, true: Conditions, oil: Oil
    ) -> Float[Array, " rows"]:
        c = true
        return value + self.amount * law({v}){thins} if channel in {tuple(both)!r} else value"""
    if "c." not in v:
        body = body.replace("        c = true\n", "")
    return Stage("AbstractReadingEffect", (CONDITIONS, OIL, *imports), body, needs, shows)


def _thinned(term: TypedTerm, temperature: str) -> tuple[str, tuple[str, ...]]:
    """(the factor of a laminar law as code, what it imports); nothing of any other law."""
    if term.law != "laminar":
        return "", ()
    return f" * thinning(oil, {temperature})", ("from thermohyd.effects.edges import thinning",)


def _port(term: TypedTerm) -> Stage:
    port = {"flow_into_a": 0, "flow_into_b": 1}.get(term.place)
    if term.variable == "pressure_rate":
        if port is None or term.law != "proportional" or term.coefficients[0] > 0.0:
            raise refused(
                term, "a stage knows what one port stores as its pressure rises: a flow in proportion to -dp/dt"
            )
        body = f"""    substeps: int = eqx.field(static=True, default=8)

    def compliance(self) -> Float[Array, "2 #rows"]:
        return self.amount * np.array([[{1.0 - port}], [{float(port)}]])"""
        return Stage(
            "AbstractStorageEffect", (), body, ("time",), ("leakage", "pressure_gain"), sign=-1.0, lower_is_zero=True
        )
    if port is None:
        if term.law not in ("proportional", "laminar") or term.variable not in ("pressure", "pressure_drop", "load"):
            raise refused(term, "a path between the ports lets through in proportion to p_A - p_B")
        thins, imports = _thinned(term, "conditions.temperature")
        body = f"""    def conductance(self, oil: Oil, conditions: Conditions) -> Float[Array, "..."]:
        return self.amount{thins or " + 0.0 * conditions.temperature"}"""
        return Stage("AbstractCrossingEffect", (CONDITIONS, OIL, *imports), body, (), ("leakage", "pressure_gain", "load_flow"),
                     lower_is_zero=term.coefficients[0] > 0.0)  # fmt: skip
    own = {"pressure": f"pressure[{port}]", "pressure_drop": f"c.supply_pressure - pressure[{port}]"}
    v, needs = _variable(term, own)
    thins, imports = _thinned(term, "c.temperature")
    pair = "[flow, 0.0 * flow]" if port == 0 else "[0.0 * flow, flow]"
    body = f"""    def inflow(self, pressure: Float[Array, "2 rows"], oil: Oil, conditions: Conditions) -> Float[Array, "2 #rows"]:
        c = conditions
        flow = self.amount * law({v}){thins} + 0.0 * c.position
        return jnp.stack({pair})"""
    return Stage("AbstractInflowEffect", (CONDITIONS, OIL, *imports), body, needs)


def _line(term: TypedTerm) -> Stage:
    losses = {
        "supply_pressure": "-self.amount * law(supply_flow), jnp.zeros_like(return_flow)",
        "return_pressure": "jnp.zeros_like(supply_flow), self.amount * law(return_flow)",
        "pressure_in_passages": "self.amount * law(supply_flow), self.amount * law(return_flow)",
    }[term.place]
    body = f"""    def losses(
        self, supply_flow: Float[Array, "..."], return_flow: Float[Array, "..."]
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        return {losses}"""
    return Stage("AbstractLineEffect", (), body, (), ("flow_gain", "load_flow"))


def _condition(term: TypedTerm) -> Stage:
    v, needs = _variable(term)
    fields = {"position": {"position": 1}, "supply_pressure": {"supply_pressure": 1}, "return_pressure": {"return_pressure": 1},
              "pressure_in_passages": {"supply_pressure": -1, "return_pressure": 1},
              "oil_temperature": {"temperature": 1}}[term.place]  # fmt: skip
    where = ", ".join(f"c.{name}" for name in fields)
    new = ", ".join(f"so_far.{name} {'+' if sign > 0 else '-'} shift" for name, sign in fields.items())
    both = (f"({where})", f"({new})") if len(fields) > 1 else (where, new)
    body = f"""    def true_conditions(self, so_far: Conditions, read: Conditions) -> Conditions:
        c = read
        shift = self.amount * law({v})
        return eqx.tree_at(lambda c: {both[0]}, so_far, {both[1]})"""
    return Stage("AbstractConditionEffect", (CONDITIONS,), body, needs)


def _oil(term: TypedTerm) -> Stage:
    v, needs = _variable(term)
    body = f"""    def oil(self, nominal: Oil) -> Oil:
        return nominal  # where no operating points are known, as in motion, the term is not either

    def oil_at(self, nominal: Oil, true: Conditions) -> Oil:
        c = true
        own, factor = nominal.viscosity_factor, 1.0 + self.amount * law({v})
        total = factor if own is None else own * factor
        return eqx.tree_at(lambda o: o.viscosity_factor, nominal, total, is_leaf=lambda leaf: leaf is None)"""
    return Stage("AbstractOilEffect", (CONDITIONS, OIL), body, needs)


# {quantity of an edge: (field of `MeteringEdge`, what it becomes)}; the clearance also as its own mean pressure widens it.
_OF_AN_EDGE = {
    "edge_radius": ("radius", "jnp.maximum({0} + shift, 0.0)"),
    "clearance": ("clearance", "jnp.maximum({0} + shift, 1e-8)"),
    "underlap": ("underlap", "{0} + shift"),
    "edge_flow": ("slot_width", "{0} * (1.0 + shift)"),
    "widening": ("clearance_per_pressure", "shift if {0} is None else {0} + shift"),
}


def _edge(term: TypedTerm) -> Stage:
    quantity, _, part = term.place.partition(":")
    if quantity == "clearance" and term.variable in ("pressure", "pressure_drop"):
        if (term.variable, term.law) != ("pressure", "proportional"):
            raise refused(term, "an edge knows no pressure but its own mean, in proportion to which it may widen")
        quantity, law, needs = "widening", "", ()
    else:
        v, needs = _variable(term)
        law = f" * law({v})"
    field, change = _OF_AN_EDGE[quantity]
    sides = {"": ("supply", "return_"), "supply": ("supply",), "return": ("return_",)}.get(
        part, ("supply",) if part.startswith("p") else ("return_",)
    )
    alone = (
        f" * np.array([[{float(part.strip('pt') == 'a')}], [{float(part.strip('pt') == 'b')}]])"
        if len(part) == 2
        else ""
    )
    where = ", ".join(f"e.{side}.{field}" for side in sides)
    new = ", ".join(change.format(f"ideal.{side}.{field}") for side in sides)
    both = (f"({where})", f"({new})") if len(sides) > 1 else (where, new)
    absent = ", is_leaf=lambda leaf: leaf is None" if quantity == "widening" else ""
    conditions = "        c = conditions\n" if law else ""
    body = f"""    def edges(self, ideal: Edges, conditions: Conditions) -> Edges:
{conditions}        shift = self.amount{law}{alone}
        return eqx.tree_at(lambda e: {both[0]}, ideal, {both[1]}{absent})"""
    return Stage("AbstractEdgeEffect, Edges", (CONDITIONS,), body, needs)


def class_name(name: str) -> str:
    """ "port_hose" -> "PortHose"."""
    return "".join(part.capitalize() for part in name.split("_"))


def _spoken(text: str) -> str:
    """A stranger's text in a docstring: what is neither a letter, a figure nor one of " ._-+()" becomes "?"."""
    return "".join(c if c.isalnum() or c in " ._-+()" else "?" for c in text[:LONGEST_NAME])


def effect_module(name: str, read: TermRead, source: str) -> str:
    """The text of the module: law, class, entry. source: the name of the file that the term was read from."""
    term = read.term
    stage = stage_of(term)
    linear_of_its_own = "law(" not in stage.body
    amount = abs(read.value) if term.law in CURVES else stage.sign * term.coefficients[0]
    size = abs(amount)
    lower = 0.0 if stage.lower_is_zero else -30.0 * size
    head = term_name(term)
    confirm = confirmed_by(term.place, term.variable, term.law, moving=term.moving)
    base_and_amount = "as_amount" if term.moving else f"{stage.base}, as_amount"
    imports = sorted(
        {
            *stage.imports,
            BASE.format(base_and_amount),
            "from thermohyd.effects.effect_info import EffectInfo",
        }
    )
    body_uses_np = "np." in stage.body
    closed = (
        ""
        if read.gap_closed is None
        else f" It closed {100.0 * read.gap_closed:.0f} % of what was left there on rows held out."
    )
    lines = [
        f'"""{class_name(name)}: {head}.',
        "",
        f"Written by thermohyd effect from {_spoken(source)}: a place and a variable that a record asked for, not yet a cause.{closed}",
        f"What would confirm it: {confirm}.",
        '"""',
        "",
        f"from typing import {'ClassVar, ' * stage.remembers}final",
        "",
        "import equinox as eqx",
        *(["import jax.numpy as jnp"] if "jnp." in stage.body or not linear_of_its_own else []),
        *(["import numpy as np"] if body_uses_np else []),
        "from jaxtyping import Array, Float",
        "",
        *imports,
        "",
        "",
    ]
    if not linear_of_its_own:
        lines += [law_code(term, read.value), "", ""]
    base = stage.base.split(",")[0]
    lines += [
        "@final",
        f"class {class_name(name)}({base}):",
        f'    """{head}.',
        "",
        f"    Amount [{term.unit}], 0 where there is none; {amount:.4g} in the record that asked for it.",
        '    """',
        "",
        '    amount: Float[Array, "..."] = eqx.field(converter=as_amount)',
        *(["    remembers: ClassVar[bool] = True"] if stage.remembers else []),
        *([""] if not stage.body.lstrip().startswith("substeps") else []),
        stage.body,
        "",
        "",
        "ENTRY = EffectInfo(",
        f"    name={name!r},",
        f"    effect={class_name(name)},",
        f"    unit={term.unit!r},",
        f"    lower={lower!r},",
        f"    upper={30.0 * size!r},",
        f"    typical=({0.1 * size!r}, {3.0 * size!r}),",
        f"    scale={0.5 * size!r},",
        f"    shows={stage.shows!r},",
        f"    sentence={head!r},",
        *([f"    needs={stage.needs!r},"] if stage.needs else []),
        ")",
        "",
    ]
    return "\n".join(lines)


def test_module(name: str, term: TypedTerm) -> str:
    """The text of a test: the amount 0 changes nothing, an amount changes what the entry says."""
    if term.moving:
        return test_in_motion(name, term)
    return f'''"""{class_name(name)}: neutral at 0, and something to see at a usual amount. Run: pytest {f"test_{name}.py"}"""

from pathlib import Path

import jax
import numpy as np


jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp

from thermohyd.conditions import Conditions
from thermohyd.effects.library import effect_info, with_effects
from thermohyd.identify.users_effects import load_effects
from thermohyd.seed_paper import seed_valve
from thermohyd.static_tests import blocked_port_readings, control_flow, load_flow


NAME = "{name}"
load_effects(Path(__file__).parent)


def readings(amount):
    """Every reading of a sweep up and down at two temperatures and pressures."""
    x = np.tile(np.concatenate([np.linspace(-60e-6, 60e-6, 25), np.linspace(60e-6, -60e-6, 25)]), 2)
    run = np.repeat([0.0, 1.0], 50)
    time = np.tile(np.linspace(0.0, 50.0, 50), 2)
    points = Conditions(
        position=jnp.asarray(x),
        supply_pressure=jnp.asarray(np.where(run > 0, 140e5, 70e5)),
        return_pressure=jnp.full(100, 2e5),
        temperature=jnp.asarray(np.where(run > 0, 333.15, 303.15)),
        load_pressure=jnp.asarray(10e5 * np.sin(time)),
        time=jnp.asarray(time),
        direction=jnp.asarray(np.where(np.gradient(x) > 0, 1.0, -1.0)),
        run=jnp.asarray(run),
        rate=jnp.asarray(np.gradient(x, 1.0)),
    )
    valve = seed_valve() if amount is None else with_effects(seed_valve(), {{NAME: amount}})
    found = blocked_port_readings(valve, points)
    return {{**found, "flow": control_flow(valve, points), "load_flow": load_flow(valve, points)}}


def test_none_of_it_changes_nothing():
    plain, neutral = readings(None), readings(0.0)
    for name, value in plain.items():
        np.testing.assert_allclose(neutral[name], value, rtol=1e-6, atol=1e-6 * float(jnp.max(jnp.abs(value))), err_msg=name)


def test_some_of_it_shows():
    plain, with_it = readings(None), readings(effect_info(NAME).scale)
    moved = [float(jnp.nanmax(jnp.abs(with_it[name] - plain[name])) / jnp.max(jnp.abs(plain[name]))) for name in plain]
    assert max(moved) > 1e-7
'''


def effect_files(name: str, read: TermRead, source: str) -> dict[str, bytes | str]:
    """{file name: text} of a folder of effects."""
    return {f"{name}.py": effect_module(name, read, source), f"test_{name}.py": test_module(name, read.term)}


def write_effect(name: str, diagnosis: Path, folder: Path, number: int = 1) -> tuple[str, ...]:
    """Write a term of a diagnosis.json as an effect; both files or none. Returns their names.

    Raises BenchInputError, where a file is there already too, and OSError.
    """
    from thermohyd.identify.report.files import write_all

    check_name(name)
    files = effect_files(name, read_term(diagnosis, number), diagnosis.name)
    for file in files:
        if (folder / file).exists():
            raise BenchInputError("is there already; choose another name or folder", file=folder / file)
    write_all(folder, files)
    return tuple(files)
