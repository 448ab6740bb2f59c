"""Temperatures of a study: similarity under a uniform one, closed forms of unequal ones, and what is refused."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from pipeline import assembly
from pipeline.config import load_design, parse_design, parse_study
from pipeline.errors import InputError
from pipeline.model.geometry.clearance import gaps
from pipeline.model.load_history.loop_readings import loop_readings
from pipeline.model.load_history.response import respond
from pipeline.mounting import drive_of
from pipeline.sampling.errors import draw

ROOT = Path(__file__).parents[2]
EXPANSION, SLOPE = 1.2e-5, -3e-4
HOT = dict.fromkeys(("disk_C", "pins_C", "housing_C", "crank_C"), 70.0)
STEEL = {"housing_material": "steel", "crank_material": "steel"}
CRANK_DEG = 20.0


def study(temperature, method="exact", **materials):
    """The pin-in-hole study at some temperatures, of steel that expands and softens."""
    raw = tomllib.loads((ROOT / "data/studies/pin_in_hole.toml").read_text())
    raw["clearance"]["method"] = method
    design_content = load_design(raw["design"], ROOT).model_dump()
    steel = {**design_content["materials"]["steel"], "expansion_per_K": EXPANSION, "modulus_slope_per_K": SLOPE}
    design_content["materials"] = {"steel": steel, **materials}
    if temperature is not None:
        raw["temperature"] = {**STEEL, **temperature}
    return parse_study(raw, "warm", "warm.toml", lambda name: parse_design(design_content, f"{name}.toml"))


def gaps_of(warm_study, samples=5):
    reducer = assembly.reducer(warm_study.design, CRANK_DEG)
    errors = assembly.errors(draw(warm_study, 0, samples))
    return reducer, gaps(assembly.profile(warm_study.design), reducer, errors, **dict(warm_study.clearance))


def test_one_temperature_of_one_material_leaves_a_similar_reducer():
    """All gaps, of every sample, grow by 1 + alpha dT; arms too, so that plays keep their angle."""
    (cold_at, cold), (warm_at, warm) = gaps_of(study(None)), gaps_of(study(HOT))
    growth = 1 + EXPANSION * 50
    np.testing.assert_allclose(warm, growth * cold, atol=1e-12)
    np.testing.assert_allclose(warm_at.contacts.arm, growth * cold_at.contacts.arm, rtol=1e-12, atol=1e-12)
    assert np.ptp(cold) > 0.01


def test_compliance_follows_the_modulus_and_the_thickness():
    """A law's linear part is 1/(E t) times a shape; similar shapes leave the disk's condensed compliance so too."""
    cold, warm = study(None), study(HOT)
    material = warm.design.materials[warm.design.disk.material]
    assert material.youngs_modulus_MPa == pytest.approx(206e3 * (1 + SLOPE * 50))
    factor = 1 / ((1 + SLOPE * 50) * (1 + EXPANSION * 50))
    laws = [assembly.contact_laws(variant, assembly.reducer(variant.design, CRANK_DEG)) for variant in (cold, warm)]
    np.testing.assert_allclose(laws[1].logarithmic, factor * laws[0].logarithmic, rtol=1e-12)


@pytest.mark.parametrize(
    ("part", "slope"),
    [
        ("housing_C", lambda reducer, normal_part, u: -normal_part * 70.0),
        ("pins_C", lambda reducer, normal_part, u: -3.0 * np.ones(40)),
        ("crank_C", lambda reducer, normal_part, u: 1.2 * u),
    ],
)
def test_a_part_that_is_warmer_than_the_disk_opens_or_closes_its_gaps(part, slope):
    """To first order: -n.rho R alpha dT of the pin circle, -r alpha dT of the pins, n.u e alpha dT of the crank."""
    even_angles = {**dict.fromkeys(HOT, 20.0)}
    (reducer, cold), (_, warm) = (
        gaps_of(study(even_angles, "first_order"), 1),
        gaps_of(study({**even_angles, part: 60.0}, "first_order"), 1),
    )
    pins = reducer.pins
    normal_part = np.real(np.conj(pins.normal) * pins.centre / np.abs(pins.centre))
    u = np.real(np.conj(pins.normal) * np.exp(1j * reducer.crank))
    np.testing.assert_allclose((warm - cold)[0, :40], EXPANSION * 40 * slope(reducer, normal_part, u), atol=1e-9)


def test_a_polymer_disk_grows_into_its_steel_pins():
    polymer = {
        "youngs_modulus_MPa": 3000.0,
        "poisson_ratio": 0.4,
        "expansion_per_K": 8e-5,
        "modulus_slope_per_K": -0.005,
    }
    raw = tomllib.loads((ROOT / "data/studies/pin_in_hole.toml").read_text())
    design_content = load_design(raw["design"], ROOT).model_dump()
    design_content["materials"] = {
        "steel": {**design_content["materials"]["steel"], "expansion_per_K": EXPANSION},
        "pom": polymer,
    }
    design_content["disk"]["material"] = "pom"
    raw["temperature"] = {**STEEL, **dict.fromkeys(HOT, 40.0)}
    warm = parse_study(raw, "warm", "warm.toml", lambda name: parse_design(design_content, "pom.toml"))
    _, gap = gaps_of(warm, 1)
    expected = 70.0 * (8e-5 - EXPANSION) * 20  # the pin circle stays behind the disk by this
    assert np.min(gap[0, :40]) == pytest.approx(0.5 * 24e-3 - expected, abs=0.025)
    assert warm.design.materials[warm.design.disk.material].youngs_modulus_MPa == pytest.approx(3000 * 0.9)
    assert "Temperatures: disk 40, pins 40" in warm.description


def test_stated_units_are_shifted_too():
    raw = tomllib.loads((ROOT / "data/studies/pin_in_hole.toml").read_text())
    del raw["tolerances"]
    raw["samples"] = {"experiment": "cases", "nominal_first": False}
    raw["cases"] = [{"label": "unit", "pin_radial": [1.0] * 40}]
    design_content = load_design(raw["design"], ROOT).model_dump()
    design_content["materials"]["steel"]["expansion_per_K"] = EXPANSION
    raw["temperature"] = {**STEEL, **dict.fromkeys(HOT, 20.0), "housing_C": 30.0}
    warm = parse_study(raw, "warm", "warm.toml", lambda name: parse_design(design_content, "d.toml"))
    assert warm.cases[0].pin_radial[7] == pytest.approx(1.0 * (1 + EXPANSION * 10) + 70e3 * EXPANSION * 10)


@pytest.mark.parametrize(
    ("temperature", "message"),
    [
        ({**HOT, "disk_C": 400.0}, "temperature.disk_C = 400.0; must be <= 250"),
        ({"disk_C": 40.0}, "temperature.pins_C is missing"),
        ({**HOT, "disk": 40.0}, "temperature.disk"),
        (
            {**HOT, "housing_material": "brass"},
            'temperature.housing_material = "brass"; no such material in the design',
        ),
        ({**HOT, "crank_material": "iron"}, "materials.iron must have expansion_per_K"),
    ],
)
def test_what_cannot_be_is_refused(temperature, message):
    iron = {"youngs_modulus_MPa": 1e5, "poisson_ratio": 0.25}
    with pytest.raises(InputError) as raised:
        study(temperature, iron=iron)
    assert message in " | ".join(raised.value.problems)


def test_a_material_without_stiffness_left_is_refused():
    wax = {"youngs_modulus_MPa": 500.0, "poisson_ratio": 0.4, "expansion_per_K": 1e-4, "modulus_slope_per_K": -0.05}
    raw = tomllib.loads((ROOT / "data/studies/pin_in_hole.toml").read_text())
    design_content = load_design(raw["design"], ROOT).model_dump()
    design_content["materials"] = {
        "steel": {**design_content["materials"]["steel"], "expansion_per_K": EXPANSION},
        "wax": wax,
    }
    design_content["disk"]["material"] = "wax"
    raw["temperature"] = {**STEEL, **HOT}
    with pytest.raises(InputError, match="temperature.disk_C = 70.0; leaves the material no modulus"):
        parse_study(raw, "warm", "warm.toml", lambda name: parse_design(design_content, "d.toml"))


DRAWN = {"distribution": "uniform", "lower_K": -15.0, "upper_K": 15.0}
WITH_DISK = dict.fromkeys(("pins_C", "housing_C", "crank_C"), "disk")


def without_tolerances(temperature, **settings):
    """A study that draws nothing but temperatures, its gaps those of the drawing."""
    drawn_study = study(temperature, **settings)
    tolerances = {}
    for name, tolerance in drawn_study.tolerances:
        fixed = {"distribution": "fixed", "value_um": 0.0, "allowance_um": tolerance.allowance_um}
        tolerances[name] = tolerance.model_dump() if name.endswith("_growth") else fixed
    return drawn_study.model_copy(update={"tolerances": type(drawn_study.tolerances).model_validate(tolerances)})


def test_a_drawn_temperature_without_spread_is_the_set_one():
    fixed = {"nominal_C": 70.0, "distribution": "fixed", "value_K": 0.0}
    (_, gap_of_set), (_, gap_of_draw) = gaps_of(study(HOT)), gaps_of(study({**HOT, "disk_C": fixed}))
    np.testing.assert_allclose(gap_of_draw, gap_of_set, atol=1e-12)
    fixed_study = study({**HOT, "disk_C": fixed})
    np.testing.assert_array_equal(assembly.modulus(fixed_study.design, draw(fixed_study, 0, 5)), 1.0)


@pytest.mark.parametrize("part", ["disk", "pins", "housing", "crank"])
def test_a_unit_is_drawn_as_it_is_at_its_temperature(part):
    """15 K off the nominal, gaps are those of the study set there, over the disk's growth from here to there."""
    nominal = {**HOT, f"{part}_C": 50.0}
    offset = {"nominal_C": 50.0, "distribution": "fixed", "value_K": 15.0}
    (_, of_draw), (_, of_set) = (
        gaps_of(without_tolerances({**nominal, f"{part}_C": temperature}), 2) for temperature in (offset, 65.0)
    )
    growth = (1 + EXPANSION * 45) / (1 + EXPANSION * 30) if part == "disk" else 1.0
    np.testing.assert_allclose(growth * of_draw[1], of_set[1], atol=2e-8)
    assert np.ptp(of_draw[1] - of_draw[0]) > 1e-5


def test_units_of_one_drawn_temperature_and_material_have_the_angles_of_the_nominal_one():
    drawn_study = without_tolerances({**WITH_DISK, "disk_C": {"nominal_C": 40.0, **DRAWN}})
    _, gap = gaps_of(drawn_study, 4)
    np.testing.assert_allclose(gap, np.broadcast_to(gap[:1], gap.shape), atol=1e-12)
    growth = draw(drawn_study, 0, 4).disk_growth
    warmer = growth / (70e3 * (1 + EXPANSION * 20) * EXPANSION)
    assert np.all(np.abs(warmer) <= 15)
    assert np.ptp(warmer) > 5
    softened = (1 + SLOPE * (20 + warmer)) / (1 + SLOPE * 20)
    grown = (1 + EXPANSION * (20 + warmer)) / (1 + EXPANSION * 20)
    np.testing.assert_allclose(
        assembly.modulus(drawn_study.design, draw(drawn_study, 0, 4)), softened * grown**3, rtol=1e-12
    )


def rotations(case_study):
    """Angle of the output [arcmin] in the limit of no torque and under the torques of the metrics, rigid disks."""
    sampled, reducer = draw(case_study, 1, 2), assembly.reducer(case_study.design, CRANK_DEG)
    loose = assembly.bearing_clearance(case_study.design, sampled.bearing_clearance)
    rigid = np.zeros((len(reducer.contacts), len(reducer.contacts)))
    factor = assembly.modulus(case_study.design, sampled)
    drive = drive_of(case_study, CRANK_DEG, rigid, assembly.errors(sampled), loose, None, factor)
    response = respond(drive, assembly.load_cycle(case_study, 0))
    assert response.converged[0]
    readings = loop_readings(response, np.zeros(1), assembly.definitions(case_study))
    peak = np.max(drive.laws_of_states.peak_pressure(response.equilibria.force))
    return readings.limit_plus[0], readings.high_plus[0] - readings.limit_plus[0], peak


def test_a_drawn_unit_gives_way_as_the_one_set_at_its_temperature():
    """The play to rounding; deflection and pressure to some expansions, by which stated stiffnesses do not scale."""
    draw_settings = {"nominal_C": 50.0, "distribution": "fixed", "value_K": 15.0}
    cold, warm_study = (without_tolerances(dict.fromkeys(HOT, celsius)) for celsius in (50.0, 65.0))
    unit = without_tolerances({**WITH_DISK, "disk_C": draw_settings})
    of_cold, of_set, of_draw = (np.array(rotations(case_study)) for case_study in (cold, warm_study, unit))
    assert of_draw[0] == pytest.approx(of_set[0], abs=1e-9)
    np.testing.assert_allclose(of_draw[1:], of_set[1:], rtol=4 * EXPANSION * 15)
    assert abs(of_cold[2] / of_set[2] - 1) > 2e-3


@pytest.mark.parametrize(
    ("temperature", "message"),
    [
        ({**HOT, "disk_C": {**DRAWN}}, "temperature.disk_C.nominal_C is missing"),
        (
            {**HOT, "disk_C": {"nominal_C": 40.0, **DRAWN, "lower_K": 20.0}},
            "temperature.disk_C.upper_K = 15.0; must be >",
        ),
        (
            {**HOT, "disk_C": {"nominal_C": 40.0, **DRAWN, "top_K": 20.0}},
            "temperature.disk_C.top_K = 20.0; unknown key",
        ),
        ({**HOT, "disk_C": {"nominal_C": 240.0, **DRAWN}}, "temperature.disk_C.upper_K = 15.0; is 255 degrees C"),
        ({**HOT, "pins_C": "disc"}, 'temperature.pins_C = "disc"; must be a number, a distribution or the part'),
        ({**HOT, "pins_C": "crank", "crank_C": "pins"}, 'temperature.pins_C = "crank"'),
        (
            {**HOT, "pins_C": {"nominal_C": 70.0, **DRAWN, "lower_K": -99.0, "upper_K": 99.0}},
            "pins and disk soften unlike",
        ),
    ],
)
def test_draws_that_cannot_be_are_refused(temperature, message):
    with pytest.raises(InputError) as raised:
        study(temperature)
    assert message in " | ".join(raised.value.problems)


def test_growths_are_no_tolerances_of_a_study_without_temperatures():
    raw = tomllib.loads((ROOT / "data/studies/pin_in_hole.toml").read_text())
    raw["tolerances"]["disk_growth"] = {"distribution": "uniform", "lower_um": -5.0, "upper_um": 5.0}
    with pytest.raises(InputError, match=r"disk_growth; acts on nothing: it needs disk_C in \[temperature\] with"):
        parse_study(raw, "warm", "warm.toml", lambda name: load_design(name, ROOT))
