"""A term of tests in motion becomes an effect: it adds what the term added, its test passes, and model.json reads the term back."""

import json
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.dynamics.circuit import Seen
from thermohyd.dynamics.machine import AbstractMotionEffect, Motion
from thermohyd.effects.library import effect, effect_info, unregister_effect
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.effect_writer import write_effect
from thermohyd.identify.fitting.motion_terms import Directions, acting, terms_in
from thermohyd.identify.model.places import PLACES, places_in_motion
from thermohyd.identify.model.term_variables import SIGNALS, VARIABLES, asked_with, signal_of
from thermohyd.identify.model.typed_term_file import typed_json, typed_term
from thermohyd.identify.model.typed_terms import DEGREE, TypedTerm, coefficients_of
from thermohyd.identify.report.term_words import law_words, term_sentence
from thermohyd.identify.users_effects import load_effects


SEEN = Seen(
    time=jnp.asarray(0.2), spool=jnp.asarray(3e-5), spool_speed=jnp.asarray(-2e-3), position=jnp.asarray(1e-3),
    velocity=jnp.asarray(0.03), pressure=jnp.asarray([9e6, 12e6]), warming=jnp.asarray([4.0, 5.0]),
    supply_pressure=jnp.asarray(21e6), return_pressure=jnp.asarray(2e5), temperature=jnp.asarray(320.0),
    turned=jnp.asarray(-1.0),
)  # fmt: skip
STILL = Motion(coulomb_friction=jnp.zeros(()), jack_leakage=jnp.zeros(()))
# Where each variable was, in these tests.
ENDS = {"pressure": (5e6, 1.5e7), "pressure_drop": (5e6, 1.5e7), "load": (-5e6, 5e6), "temperature": (0.0, 20.0)}


def term_of(place: str, variable: str, law: str) -> TypedTerm:
    own = tuple(float(v) for v in np.linspace(-2e-13, 1e-13, DEGREE + 1))[: coefficients_of(law)]
    return TypedTerm(place, variable, law, own, *ENDS.get(variable, (-1.0, 1.0)), moving=True)


def diagnosis(folder: Path, term: TypedTerm) -> Path:
    value = abs(term.coefficients[0]) if term.law == "smooth" else term.coefficients[0]  # a spread
    entry = {
        "place": term.place, "variable": term.variable, "law": term.law, "value": value, "unit": term.unit, "moving": True,
        "coefficients": list(term.coefficients), "range": [term.low, term.high], "confirmed_by": "another test",
        "sentence": term_sentence(term, value, None), "gap_closed": 0.9,
    }  # fmt: skip
    path = folder / "diagnosis.json"
    path.write_text(json.dumps({"verdict": "unexplained", "terms": [entry]}))
    return path


def added(of) -> dict[str, np.ndarray]:
    if isinstance(of, AbstractMotionEffect):
        return {"spool_delay": np.asarray(of.motion(STILL).spool_delay)}
    found = of.added(SEEN)
    return {n: np.asarray(getattr(found, n)) for n in type(found).__dataclass_fields__ if getattr(found, n) is not None}


@pytest.mark.parametrize(
    ("place", "variable", "law"),
    [
        ("flow_from_a_to_b", "load", "proportional"),
        ("flow_into_chamber_b", "pressure", "root"),
        ("flow_into_chambers", "pressure_rate", "proportional"),
        ("flow_into_chambers", "pressure_rate", "gaseous"),
        ("flow_into_chamber_b", "pressure_rate", "gaseous"),
        ("heat_of_chamber", "temperature", "proportional"),
        ("force_on_piston", "velocity", "smooth"),
        ("force_on_spool", "direction", "proportional"),
        ("command_lag", "command_rate", "proportional"),
    ],
)
def test_the_effect_adds_what_the_term_added(place, variable, law, tmp_path):
    term = term_of(place, variable, law)
    write_effect("found_there", diagnosis(tmp_path, term), tmp_path / "mine")
    assert load_effects(tmp_path / "mine") == ("found_there",)
    try:
        info = effect_info("found_there")
        stage = "motion" if place == "command_lag" else "circuit"
        assert (info.unit, info.stages, info.effect_class.dynamic) == (term.unit, (stage,), True)
        assert info.effect_class.remembers == (variable == "direction")
        own = added(effect("found_there", abs(term.coefficients[0]) if law == "smooth" else term.coefficients[0]))
        given = terms_in((term,))
        every = added(given.effect(given.coefficients)) | added(given.delay(given.coefficients))
        for name, value in own.items():
            np.testing.assert_allclose(value, every[name], rtol=1e-6)
        scope = {}
        exec(
            (tmp_path / "mine" / "test_found_there.py")
            .read_text()
            .replace("Path(__file__).parent", repr(str(tmp_path / "mine"))),
            scope,
        )
        scope["test_none_of_it_adds_nothing"]()
        scope["test_some_of_it_adds_something"]()
    finally:
        unregister_effect("found_there")


def test_every_entry_of_the_table_in_motion_is_written_read_and_said(tmp_path):
    places = places_in_motion(("spool_position", "pressure_a", "pressure_b", "piston_position", "piston_velocity"))
    assert {p.name for p in PLACES.values() if p.moving} < {p.name for p in places}
    fail = lambda sentence: BenchInputError(sentence)
    number, refused = 0, 0
    for place in places:
        for variable in VARIABLES.values():
            if not asked_with(place, variable, moving=True):
                continue
            law = "constant" if variable.name == "constant" else (variable.laws or ("smooth",))[0]
            term = replace(term_of(place.name, variable.name, law), covariance=())
            assert "{" not in law_words(term)
            read = typed_term(json.loads(json.dumps(typed_json(term))), 1, (), fail, lambda value, words: float(value))
            assert read == term
            source = diagnosis(tmp_path, term)
            if place.readings:
                with pytest.raises(BenchInputError, match="no stage of the simulator reads a test in motion"):
                    write_effect(f"entry_{number}", source, tmp_path / "all")
                refused += 1
                continue
            file, _ = write_effect(f"entry_{number}", source, tmp_path / "all")
            compile((tmp_path / "all" / file).read_text(), file, "exec")
            number += 1
    assert number > 40
    assert refused == 5 * 5 + 2


def test_a_short_time_is_said_in_milliseconds():
    lag = term_of("command_lag", "command_rate", "proportional")
    assert term_sentence(lag, 1.515e-3, 2.3e-5).startswith(
        "a lag of the command in proportion to its own rate, (1.515 +- 0.023) ms: what a delay of the command does"
    )
    assert "(1.20 +- 0.10) s: " in term_sentence(lag, 1.2, 0.1)


def test_a_term_in_motion_in_model_json_is_checked():
    fail = lambda sentence: BenchInputError(sentence)
    number = lambda value, words: float(value)
    entry = typed_json(term_of("flow_from_a_to_b", "load", "proportional"))
    with pytest.raises(BenchInputError, match="a term of flow_from_a_to_b does not go with velocity"):
        typed_term(entry | {"variable": "velocity", "moving": False}, 1, (), fail, number)
    soft = term_of("flow_into_chambers", "pressure_rate", "gaseous")
    assert typed_term(json.loads(json.dumps(typed_json(soft))), 1, (), fail, number) == soft
    assert (soft.unit, law_words(soft)) == (
        "m3/Pa", "in proportion to the rate of its own pressure, the more the lower the pressure, as a gas gives way",
    )  # fmt: skip
    with pytest.raises(BenchInputError, match="the law gaseous is one of pressure_rate in motion"):
        typed_term(entry | {"law": "gaseous"}, 1, (), fail, number)
    curved = typed_json(soft) | {"law": "smooth"}
    with pytest.raises(BenchInputError, match="pressure_rate goes by the law proportional or gaseous"):
        typed_term(curved, 1, (), fail, number)
    with pytest.raises(BenchInputError, match='"moving" must be true or false'):
        typed_term(entry | {"moving": 1}, 1, (), fail, number)


def test_a_few_terms_add_what_the_table_of_all_adds():
    """Every law of every place and variable, in parts and among the thousand coefficients of the table's effect."""
    low, high = np.full(len(SIGNALS), -1e30), np.full(len(SIGNALS), 1e30)
    asked = 0
    for place in places_in_motion(()):
        for variable in place.asked_moving:
            for law in (
                ("constant",) if variable == "constant" else ("proportional", "gaseous", "square", "root", "smooth")
            ):
                if not place.moving or (
                    law not in VARIABLES[variable].laws if VARIABLES[variable].laws else law == "gaseous"
                ):
                    continue
                term = term_of(place.name, variable, law)
                own_low, own_high = low.copy(), high.copy()
                for moved in place.moving if variable not in ("constant", "pressure_rate", "command_rate") else ():
                    signal = SIGNALS.index(signal_of(place, moved, variable))
                    own_low[signal], own_high[signal] = term.low, term.high
                given, where = terms_in((term,)), jnp.asarray(acting(place.name, variable, law))
                every = Directions(jnp.asarray(term.coefficients), where, jnp.asarray(own_low), jnp.asarray(own_high))
                few, all_ = (
                    added(of.effect(of.coefficients)) | added(of.delay(of.coefficients)) for of in (given, every)
                )
                for name, value in few.items():
                    np.testing.assert_allclose(
                        value, all_[name], rtol=1e-12, atol=1e-25, err_msg=f"{place.name} {variable} {law}"
                    )
                asked += 1
    assert asked > 100


def test_a_term_is_differentiable_where_nothing_moves():
    """Zero spool, zero velocity, no range: the slopes of roots and moduli stay finite."""
    still = jax.tree.map(jnp.zeros_like, SEEN)
    given = terms_in((term_of("force_on_spool", "opening", "root"),))
    of = lambda spool: given.effect(given.coefficients).added(replace(still, spool=spool)).spool_target
    assert np.isfinite(float(jax.grad(of)(jnp.zeros(()))))
