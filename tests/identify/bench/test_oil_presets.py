"""Oil presets: every one is there, with a source, and its charted viscosity comes out."""

import pytest

from thermohyd.data import oil_preset, oil_presets, sample_record
from thermohyd.oil_definition import kinematic_viscosity_of


NAMES = (
    "mil-prf-5606",
    "mil-prf-83282",
    "mil-prf-87257",
    "mil-prf-6083",
    "skydrol-ld-4",
    "iso-vg-22",
    "iso-vg-32",
    "iso-vg-32-vi150",
    "iso-vg-46",
)


def test_all_presets_are_there_with_their_sources():
    presets = oil_presets()
    assert tuple(presets) == NAMES
    assert all(oil.source and oil.name == name for name, oil in presets.items())


@pytest.mark.parametrize(("name", "grade"), [("iso-vg-22", 22), ("iso-vg-32", 32), ("iso-vg-46", 46)])
def test_an_iso_grade_is_the_viscosity_at_40_degrees_within_its_tolerance(name, grade):
    assert kinematic_viscosity_of(oil_preset(name), 313.15) == pytest.approx(grade * 1e-6, rel=0.1)


def test_mil_prf_5606_has_its_density_and_specific_heat_back_at_the_temperatures_of_the_source():
    oil = oil_preset("mil-prf-5606")
    assert oil.density * (1 - oil.expansion * (278.15 - 288.15)) == pytest.approx(856.0, abs=1e-3)
    assert oil.density * oil.expansion == pytest.approx(0.68, rel=1e-5)
    assert oil.specific_heat + oil.specific_heat_slope * 23.0 == pytest.approx(1968.0)


@pytest.mark.parametrize("spelling", ["MIL-PRF-5606", "mil prf 5606", "mil_prf_5606", " mil-prf-5606 "])
def test_spelling_of_a_name_does_not_matter(spelling):
    assert oil_preset(spelling) is oil_preset("mil-prf-5606")


def test_an_unknown_name_gets_the_closest_one():
    with pytest.raises(ValueError, match=r'^no oil preset "mil-h-5606"; did you mean "mil-prf-5606"\?$'):
        oil_preset("mil-h-5606")
    with pytest.raises(ValueError, match=r'^no sample record "seed-valve"; did you mean "seed_valve"\?$'):
        sample_record("seed-valve")


def test_sample_records_are_folders_with_a_bench_file():
    assert (sample_record("seed_valve") / "bench.toml").is_file()
