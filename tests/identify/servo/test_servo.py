"""A whole sweep against the independent simulator, the linear formulas and differences."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.chromium import PROGRAM, browser
from helpers.report_page import check_in_browser, check_text
from reference.dynamic_bench import Bench, response
from reference.step_test import readings
from reference.valve import Valve
from rich.console import Console

from thermohyd.dynamics.simulate import step_figures
from thermohyd.identify.servo import study as tables, words
from thermohyd.identify.servo.report import print_servo, servo_files, servo_page


BENCH = Bench(valve=Valve(edge_radius=15e-6, clearance=2e-6, underlap=15e-6, discharge_coefficient=0.7))
FEW = ("--temperatures", "-20 0 40 70 degC")
FILES = {".thermohyd.json", "servo.json", "report.html"} | {
    f"{n}.{kind}" for n in ("step", "trend", "bode") for kind in ("png", "svg")
}
COLD, BEFORE, WARM, AFTER = range(4)


def bench(kelvin: float, adiabatic: bool, **changes) -> Bench:
    return replace(BENCH, temperature=kelvin - 273.15, adiabatic=adiabatic, **changes)


@pytest.mark.parametrize("model", ["THM", "HM"])
def test_closed_loop_is_the_reference_s(study, model):
    """Its own Jacobian by differences, of the loop as it is: breaking the loop and closing it again is checked too."""
    loop = study.loops[model]
    rows = np.searchsorted(loop.pulsation, [0.5, 10.0, 120.0, 1000.0])
    for i in (COLD, WARM):
        frequencies = tuple(loop.pulsation[rows] / (2.0 * np.pi))
        expected = response(bench(study.subject.temperatures[i], model == "THM", frequencies=frequencies))
        np.testing.assert_allclose(loop.closed[i, rows], expected, rtol=2e-5, atol=1e-9)
        size = np.abs(loop.closed[i])
        below = loop.pulsation < 0.99 * float(loop.figures.bandwidth[i])
        assert np.all(size[below] > np.sqrt(0.5))
    assert loop.stable.all()


@pytest.mark.parametrize("model", ["THM", "HM"])
def test_derivatives_with_temperature_are_exact(study, model):
    loop, warm = study.loops[model], study.subject.temperatures
    for name in ("gain_margin", "phase_margin", "gain_crossover", "phase_crossover", "bandwidth"):
        figure, slope = (np.asarray(getattr(part, name)) for part in (loop.figures, loop.slope))
        difference = (figure[AFTER] - figure[BEFORE]) / (warm[AFTER] - warm[BEFORE])
        assert slope[WARM] == pytest.approx(difference, rel=1e-4, abs=1e-7), name


def test_isothermal_margins_are_the_linear_formulas(study):
    figures, linear = study.loops["HM"].figures, study.linear["HM"]
    np.testing.assert_allclose(figures.gain_margin, linear.gain_margin, rtol=1e-5)
    np.testing.assert_allclose(figures.phase_margin, linear.phase_margin, rtol=1e-6)


@pytest.mark.parametrize("model", ["THM", "HM"])
def test_steps_are_the_reference_s(study, model):
    sweep, step = study.steps[model], study.subject.step
    for i in (COLD, WARM):
        rows = np.flatnonzero(np.asarray(sweep.readings.time[i]) <= 0.12)[::4]
        time = np.asarray(sweep.readings.time[i])[rows]
        own = bench(study.subject.temperatures[i], model == "THM")
        machine = own.machine(own.run(0.0))
        full = lambda value, like=time: np.full(like.size, value)
        run = replace(
            machine.run, time=time, command=np.interp(time, [0.0, 1e-3], [0.0, step]), supply_pressure=full(210e5),
            return_pressure=full(2e5), temperature=full(study.subject.temperatures[i]), external_force=full(0.0),
        )  # fmt: skip
        expected = readings(replace(machine, run=replace(run, command=_exact(run.command, time, step))), rtol=1e-7)
        names = ("spool_position", "pressure_a", "pressure_b", "piston_position", "piston_velocity")
        found = np.stack([np.asarray(getattr(sweep.readings, name))[i][rows] for name in names], axis=1)
        assert np.all(np.max(np.abs(found - expected), axis=0) < 5e-5 * np.ptp(expected, axis=0))


def _exact(command: np.ndarray, time: np.ndarray, step: float) -> np.ndarray:
    """The reference draws lines between the rows that it is given: the end of the ramp must be one of them."""
    assert 1e-3 in time
    return np.where(time >= 1e-3, step, command)


def test_figures_are_those_of_the_readings(study):
    sweep = study.steps["THM"]
    time, position = np.asarray(sweep.readings.time), np.asarray(sweep.readings.piston_position)
    for i in (COLD, WARM):
        own = step_figures(time[i], position[i], study.subject.step)
        np.testing.assert_allclose([figure[i] for figure in sweep.figures], own)
    assert np.all(np.diff(sweep.figures.time_to_90[[COLD, WARM]]) < 0.0)
    assert np.all(study.steps["HM"].heating == 0.0)
    assert np.all(sweep.heating > 1.0)


def test_as_a_table(study):
    table = study.to_dataframe()
    assert table.index.names == ["model", "temperature"]
    warm = table.loc["THM"].iloc[WARM]
    assert warm["phase_margin"] == np.asarray(study.loops["THM"].figures.phase_margin)[WARM]
    assert warm["settling_time"] == study.steps["THM"].figures.settling_time[WARM]
    assert len(table) == 2 * len(study.subject.temperatures)
    assert "phase margin" in study._repr_html_()


def test_a_loop_beyond_its_margins_is_said_to_be(stiffer):
    """At 70 degC at rest; below, where it is stable at rest, after a large step: as the margin of large motions says."""
    for model in ("THM", "HM"):
        assert stiffer.loops[model].stable.tolist() == [True, True, True, False]
        np.testing.assert_array_equal(
            stiffer.loops[model].stable, np.asarray(stiffer.loops[model].figures.gain_margin) > 1.0
        )
        assert np.all(stiffer.large_margin(model) < 1.0)
        assert np.all(np.asarray(stiffer.steps[model].figures.swing) > 0.05)
    said = words.sentences(stiffer)
    assert "UNSTABLE at 70 degC" in said[0]
    assert "KEEPS SWINGING after a step of 5 mm at 0, 20 and 40 degC" in said[1]
    assert tables.rows(stiffer, "THM")[3][7] == tables.UNSTABLE
    assert not any(words.alarming(sentence) for sentence in said[2:])


def test_seed_valve_to_files_and_json(run, study, tmp_path):
    ran = run(*FEW, "--step", "1 mm", "--out", tmp_path / "out", "--json")
    assert ran.exit_code == 0, ran.stderr
    assert {file.name for file in (tmp_path / "out").iterdir()} == FILES
    said = json.loads(ran.stdout)
    assert said == json.loads((tmp_path / "out" / "servo.json").read_text())
    assert said["conditions"]["step"] == pytest.approx(1e-3)
    np.testing.assert_allclose(said["conditions"]["temperature"], [253.15, 273.15, 313.15, 343.15])
    figures = said["models"]["THM"]["small_signal"]
    np.testing.assert_allclose(figures["gain_margin"][0], study.loops["THM"].figures.gain_margin[0], rtol=1e-6)
    for text in ("The loop is stable from -20 to 70 degC", "THM: the oil keeps its heat", "written:"):
        assert text in ran.stderr
    assert max(len(line) for line in ran.stderr.splitlines() if not line.startswith("written:")) <= 80
    assert (tmp_path / "out" / "report.html").read_text().count("data:image/svg+xml") == 3


def test_page_and_terminal_of_an_unstable_loop(stiffer):
    console = Console(record=True, width=80, file=io.StringIO())
    print_servo(stiffer, console)
    shown = console.export_text()
    assert "unst." in shown
    assert max(map(len, shown.splitlines())) <= 80
    page = str(servo_files(stiffer)["report.html"])
    check_text(page)
    assert "must fall to" in page[page.index("What to do next") : page.index("<h2>")]
    assert "unexplained" in page
    assert '<td class="number bad">unst.</td>' in page


@pytest.mark.skipif(PROGRAM is None, reason="no Chromium here (apt-get install chromium)")
def test_page_in_a_browser(study, tmp_path):
    (tmp_path / "report.html").write_text(servo_page(study, {}), encoding="utf-8")
    with browser() as tab:
        check_in_browser(tab, tmp_path / "report.html")


def test_a_force_beyond_the_supply_fails_with_a_sentence(run, tmp_path):
    (tmp_path / "mine.toml").write_text('[actuator]\nexternal_force = "90 kN"\n')
    ran = run(*FEW, "--settings", tmp_path / "mine.toml", "--out", tmp_path / "out")
    assert ran.exit_code == 1
    assert "no equilibrium" in ran.stderr
    assert not (tmp_path / "out").exists()
