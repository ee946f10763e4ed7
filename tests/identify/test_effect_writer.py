"""A term of a diagnosis becomes an effect in a user's folder: it loads, shifts what the term shifted, and refuses what has no stage."""

import json
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from thermohyd.conditions import Conditions
from thermohyd.effects.edges import thinning
from thermohyd.effects.effect import Edges
from thermohyd.effects.library import EFFECTS, effect, effect_info, find_effect, unregister_effect
from thermohyd.identify.bench.errors import BenchInputError
from thermohyd.identify.effect_writer import write_effect
from thermohyd.identify.model.places import PLACES, place_of
from thermohyd.identify.model.term_variables import VARIABLES, asked_with
from thermohyd.identify.model.typed_terms import DEGREE, KNOTS, basis, coefficients_of, unit_of
from thermohyd.identify.users_effects import load_effects
from thermohyd.seed_paper import seed_valve
from thermohyd.valve import metering_edges, true_oil


ENDS = {"constant": (1.0, 1.0), "pressure": (70e5, 210e5), "pressure_drop": (60e5, 200e5), "flow": (0.0, 2e-4)}


def diagnosis(folder: Path, place: str, variable: str, law: str, coefficients: list[float]) -> Path:
    low, high = ENDS.get(variable, (-1.0, 1.0))
    term = {
        "place": place, "variable": variable, "law": law, "value": coefficients[0], "unit": unit_of(place, variable, law),
        "coefficients": coefficients, "range": [low, high], "sentence": f"{place_of(place).noun}: what a test does",
        "confirmed_by": "another test", "gap_closed": 0.9,
    }  # fmt: skip
    path = folder / "diagnosis.json"
    path.write_text(json.dumps({"verdict": "unexplained", "terms": [term]}))
    return path


@pytest.fixture
def loaded(tmp_path):
    """Writes an effect of a term, loads it, and takes it out again."""
    names = []

    def load(name: str, *term):
        write_effect(name, diagnosis(tmp_path, *term), tmp_path / name)
        names.extend(load_effects(tmp_path / name))
        return effect_info(name)

    yield load
    for name in names:
        unregister_effect(name)


ROWS = 5
AT = Conditions(
    position=jnp.linspace(-50e-6, 50e-6, ROWS), supply_pressure=jnp.linspace(80e5, 200e5, ROWS),
    return_pressure=jnp.full(ROWS, 2e5), temperature=jnp.linspace(290.0, 340.0, ROWS), load_pressure=jnp.zeros(ROWS),
    time=jnp.arange(float(ROWS)), direction=jnp.ones(ROWS), run=jnp.zeros(ROWS), rate=jnp.full(ROWS, 1e-5),
)  # fmt: skip


def test_a_flow_into_a_port_with_its_pressure(loaded):
    info = loaded("leak_at_b", "flow_into_b", "pressure", "proportional", [-2e-14])
    assert (info.unit, info.stages, info.coupled) == ("m3/(s Pa)", ("inflow",), False)
    pressure = jnp.stack([jnp.full(ROWS, 90e5), jnp.linspace(80e5, 200e5, ROWS)])
    found = effect("leak_at_b", -2e-14).inflow(pressure, seed_valve().oil, AT)
    np.testing.assert_allclose(found[0], 0.0)
    np.testing.assert_allclose(found[1], -2e-14 * pressure[1])


def test_a_laminar_leak_goes_with_the_oil(loaded):
    """Between the ports, into one and into the return: G mu(40 degC)/mu(T), as those of the library."""
    oil, thins = seed_valve().oil, thinning(seed_valve().oil, AT.temperature)
    loaded("seal", "flow_from_a_to_b", "load", "laminar", [2e-14])
    np.testing.assert_allclose(effect("seal", 2e-14).conductance(oil, AT), 2e-14 * thins)
    loaded("drain_of_a", "flow_into_a", "pressure", "laminar", [-2e-14])
    pressure = jnp.full((2, ROWS), 90e5)
    np.testing.assert_allclose(effect("drain_of_a", -2e-14).inflow(pressure, oil, AT)[0], -2e-14 * 90e5 * thins)
    loaded("around", "flow_into_return", "pressure_drop", "laminar", [2e-14])
    flow = effect("around", 2e-14).reading("leakage_flow", jnp.zeros(ROWS), AT, AT, oil)
    np.testing.assert_allclose(flow, 2e-14 * (AT.supply_pressure - AT.return_pressure) * thins)


def test_what_a_trapped_volume_stores(loaded):
    info = loaded("hose_at_a", "flow_into_a", "pressure_rate", "proportional", [-2e-12])
    assert (info.unit, info.lower, info.stores, info.needs) == ("m3/Pa", 0.0, True, ("time",))
    np.testing.assert_allclose(effect("hose_at_a", 2e-12).compliance(), [[2e-12], [0.0]])


def test_a_smooth_law_keeps_its_shape(loaded):
    own = [2e-6, 1e-6, -0.5e-6, 0.3e-6]
    assert len(own) == DEGREE + 1
    loaded("edge_wave", "edge_radius:pa", "position", "smooth", own)
    valve = seed_valve()
    ideal = metering_edges(valve, AT)
    found: Edges = effect("edge_wave", own[0]).edges(ideal, AT)
    shift = basis("smooth", np.asarray(AT.position), -1.0, 1.0) @ np.array(own)
    np.testing.assert_allclose(found.supply.radius[0], valve.edge_radius + shift, rtol=1e-12)
    np.testing.assert_allclose(found.supply.radius[1], valve.edge_radius, rtol=1e-12)


def test_a_local_law_keeps_its_shape(loaded):
    own = (1e-6 * np.random.default_rng(1).standard_normal(KNOTS)).tolist()
    loaded("wound", "position", "position", "local", own)
    true = effect("wound", own[0]).true_conditions(AT, AT)
    shift = basis("local", np.asarray(AT.position), -1.0, 1.0) @ np.array(own)
    np.testing.assert_allclose(true.position, AT.position + shift, rtol=1e-12)


def test_a_warming_of_the_oil_in_the_valve(loaded):
    loaded("warm_body", "oil_temperature", "constant", "constant", [2.5])
    true = effect("warm_body", 2.5).true_conditions(AT, AT)
    np.testing.assert_allclose(true.temperature, AT.temperature + 2.5, rtol=1e-15)


@pytest.mark.parametrize(
    ("place", "edges"), [("clearance", "pa pb at bt"), ("clearance:supply", "pa pb"), ("clearance:at", "at")]
)
def test_a_clearance_that_its_own_pressure_widens(loaded, place, edges):
    """All edges: what the library's pressure_clearance does."""
    name = f"wide_{place.replace(':', '_')}"
    loaded(name, place, "pressure", "proportional", [2e-14])
    ideal = metering_edges(seed_valve(), AT)
    found, known = (effect(one, 2e-14).edges(ideal, AT) for one in (name, "pressure_clearance"))
    for side, pair in (("supply", ("pa", "pb")), ("return_", ("at", "bt"))):
        own = getattr(found, side).clearance_per_pressure
        wanted = np.broadcast_to(getattr(known, side).clearance_per_pressure, (2, 1))
        own = np.zeros((2, 1)) if own is None else np.broadcast_to(own, (2, 1))
        np.testing.assert_allclose(own, wanted * [[float(edge in edges)] for edge in pair], rtol=1e-15)


def test_oil_that_follows_the_operating_point(loaded):
    loaded("thick_oil", "viscosity", "pressure", "proportional", [1e-8])
    thick = effect("thick_oil", 1e-8)
    oil = true_oil(replace(seed_valve(), effects=(thick,)), AT)
    assert oil.viscosity_factor is not None
    np.testing.assert_allclose(oil.viscosity_factor, 1.0 + 1e-8 * np.asarray(AT.supply_pressure))


def _terms():
    for place in [*PLACES, "reading:leakage_flow", "reading:load_pressure", "reading:flows"]:
        for variable in VARIABLES.values():
            if asked_with(place_of(place), variable):
                laws = ["constant"] if variable.name == "constant" else ["proportional", "smooth"]
                laws += ["local"] if variable.name in place_of(place).followed else []
                laws += ["root", "square"] if variable.powers else []
                laws += ["cube"] if variable.powers and place.startswith("reading:") else []
                laws += ["laminar"] if place_of(place).leaks and variable.unit == "Pa" else []
                yield from ((place, variable.name, law) for law in laws)


def _without_a_stage(place: str, variable: str, law: str) -> bool:
    """Oil that is warmer at an edge, whatever it goes with; a clearance that its pressure widens by another law than the library's."""
    widens = place.startswith("clearance") and variable in ("pressure", "pressure_drop")
    return place_of(place).warms or (widens and (variable, law) != ("pressure", "proportional"))


def test_every_entry_of_the_table_is_written_or_refused(tmp_path):
    """Text that Python compiles, or one line that says why there is no stage."""
    written, refused, reasons = 0, 0, set()
    for number, (place, variable, law) in enumerate(_terms()):
        own = [-1e-9] * coefficients_of(law)
        name = f"term_{number}"
        try:
            files = write_effect(name, diagnosis(tmp_path, place, variable, law, own), tmp_path / "all")
        except BenchInputError as error:
            reasons.add(str(error).split(" cannot")[1].split(":")[0])
            refused += not _without_a_stage(place, variable, law)
            continue
        assert not _without_a_stage(place, variable, law)
        for file in files:
            compile((tmp_path / "all" / file).read_text(), file, "exec")
        written += 1
    assert reasons == {" be written as an effect"}
    assert written > 3 * refused


def test_what_cannot_be_done_is_said_in_one_line(tmp_path):
    path = diagnosis(tmp_path, "flow_into_a", "pressure", "proportional", [1e-14])
    cases = {
        "Not A Name": "must be a Python identifier in small letters",
        "hysteresis": 'the library has an effect "hysteresis" already',
    }
    for name, message in cases.items():
        with pytest.raises(BenchInputError, match=message):
            write_effect(name, path, tmp_path / "out")
    with pytest.raises(BenchInputError, match="has 1 terms, so --term is 1 to 1"):
        write_effect("mine", path, tmp_path / "out", 2)
    path.write_text('{"verdict": "named", "terms": []}')
    with pytest.raises(BenchInputError, match="no term: nothing is left unexplained there"):
        write_effect("mine", path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_module_that_cannot_be_loaded_is_named(tmp_path):
    with pytest.raises(BenchInputError, match="is no folder of effects"):
        load_effects(tmp_path / "none")
    (tmp_path / "mine.py").write_text("1 / 0\n")
    with pytest.raises(BenchInputError, match=r"mine\.py: cannot be loaded: ZeroDivisionError"):
        load_effects(tmp_path)
    (tmp_path / "mine.py").write_text("x = 1  # of another length, or what was compiled of the first would do\n")
    with pytest.raises(BenchInputError, match="has no effect"):
        load_effects(tmp_path)
    assert all(find_effect(name) is not None for name in EFFECTS)
