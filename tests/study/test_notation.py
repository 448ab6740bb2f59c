"""Tolerances as a drawing writes them: the standard's tables by its formulas and known codes, and what is refused."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from pipeline.config import load_design, parse_study
from pipeline.config.dimensions import dimension_library
from pipeline.config.tolerance_notation import DEVIATIONS_UM, TOLERANCES_UM, UP_TO_MM, limit_deviations
from pipeline.errors import InputError
from pipeline.sampling.errors import draw
from stages.clearance import rigid_ends

ROOT = Path(__file__).parents[2]
STUDY = tomllib.loads((ROOT / "data/studies/pin_in_hole.toml").read_text())
DESIGN = load_design(STUDY["design"], ROOT)
ENDS = np.array([1.0, *UP_TO_MM])
ABOVE = slice(1, None)
"""The smallest range, up to 3 mm, is the standard's own: its mean size is not that of the formulas."""
MEAN = np.sqrt(ENDS[:-1] * ENDS[1:])


def tolerances(**of_names):
    """Those of the pin-in-hole study: pins of radius 3 mm, output pins of diameter 12 mm."""
    raw = {**STUDY, "tolerances": of_names}
    return parse_study(raw, "drawn", "drawn.toml", lambda name: load_design(name, ROOT)).tolerances


def refused(settings, name="pin_radius"):
    with pytest.raises(InputError) as raised:
        tolerances(**{name: {"distribution": "uniform", **settings}})
    return " | ".join(raised.value.problems)


def test_grades_are_the_standards_formula_rounded():
    unit = 0.45 * MEAN ** (1 / 3) + 0.001 * MEAN
    for grade, units in {5: 7, 6: 10, 7: 16, 8: 25, 9: 40, 10: 64, 11: 100}.items():
        np.testing.assert_allclose(TOLERANCES_UM[grade][ABOVE], (units * unit)[ABOVE], rtol=0.09, atol=0.6)
    unit_constant = 0.8 + 0.02 * MEAN
    for grade in (3, 4):  # in geometric progression from the first to the fifth
        np.testing.assert_allclose(
            TOLERANCES_UM[grade], unit_constant * (7 * unit / unit_constant) ** ((grade - 1) / 4), rtol=0.17, atol=0.8
        )


@pytest.mark.parametrize(
    ("letter", "formula"),
    [
        ("e", lambda d: -11 * d**0.41),
        ("f", lambda d: -5.5 * d**0.41),
        ("g", lambda d: -2.5 * d**0.34),
        ("h", lambda d: 0 * d),
        ("n", lambda d: 5 * d**0.34),
    ],
)
def test_deviations_are_the_standards_formulas_rounded(letter, formula):
    np.testing.assert_allclose(DEVIATIONS_UM[letter][ABOVE], formula(MEAN)[ABOVE], rtol=0.06, atol=1.0)


def test_deviations_that_are_differences_of_grades():
    np.testing.assert_allclose(np.array(DEVIATIONS_UM["m"]), np.subtract(TOLERANCES_UM[7], TOLERANCES_UM[6]), atol=3)
    difference = np.array(DEVIATIONS_UM["p"])[1:] - np.array(TOLERANCES_UM[7])[1:]
    assert np.all((difference >= -0.5) & (difference <= 5.5))


@pytest.mark.parametrize(
    ("code", "lower", "upper"),
    [
        (("H", 6, 14), 0, 11),
        (("h", 5, 4), -5, 0),
        (("g", 6, 25), -20, -7),
        (("f", 7, 40), -50, -25),
        (("js", 6, 10), -4.5, 4.5),
        (("k", 6, 25), 2, 15),
        (("m", 6, 12), 7, 18),
        (("n", 6, 60), 20, 39),
        (("p", 6, 60), 32, 51),
        (("G", 7, 25), 7, 28),
        (("K", 7, 25), -15, 6),
        (("M", 7, 25), -21, 0),
        (("N", 7, 25), -28, -7),
        (("P", 7, 25), -35, -14),
        (("N", 9, 25), -52, 0),
        (("M", 6, 300), -41, -9),
        (("P", 9, 40), -88, -26),
        (("K", 6, 3), -6, 0),
    ],
)
def test_codes_are_those_of_the_standards_tables(code, lower, upper):
    """ISO 286-2, tables of limit deviations."""
    assert limit_deviations(*code) == (lower, upper)


def test_holes_of_grade_3_are_moved_by_the_standards_delta():
    """ISO 286-1, Table 5, column of the difference for grade 3; K3 of 14.4 mm in ISO 286-2."""
    delta = (0, 1, 1, 1, 1.5, 1.5, 2, 2, 3, 3, 4, 4, 5)
    for letter, shaft in (("K", "k"), ("M", "m"), ("N", "n"), ("P", "p")):
        uppers = np.array([limit_deviations(letter, 3, size)[1] for size in UP_TO_MM])
        np.testing.assert_allclose(uppers + DEVIATIONS_UM[shaft], delta)
    assert limit_deviations("K", 3, 14.4) == (-3, 0)


@pytest.mark.parametrize("letter", ["h", "k", "n", "H", "N"])
def test_ends_of_the_ranges_belong_to_the_smaller_one(letter):
    assert limit_deviations(letter, 6, 18) == limit_deviations(letter, 6, 14)
    assert limit_deviations(letter, 6, 18.001) == limit_deviations(letter, 6, 24)


def test_a_diameter_on_the_drawing_is_half_of_it_on_a_radius():
    uniform = {"distribution": "uniform"}
    by_radius = tolerances(pin_radius={**uniform, "limits_mm": "+0.000/-0.002", "of": "radius"}).pin_radius
    by_diameter = tolerances(pin_radius={**uniform, "limits_mm": "-0.004/0", "of": "diameter"}).pin_radius
    reference = tolerances(pin_radius={**uniform, "lower_um": -2.0, "upper_um": 0.0}).pin_radius
    assert by_radius == by_diameter == reference
    by_code = tolerances(pin_radius={**uniform, "iso": "6 h5"}).pin_radius
    assert by_code.limits_um == (-2.5, 0.0)
    of_rollers = tolerances(roller_diameter={"distribution": "normal", "iso": "h6"}).roller_diameter
    assert of_rollers.limits_um == (-11.0, 0.0)
    equal = tolerances(pin_radial={**uniform, "limits_mm": "±0.005"}).pin_radial
    assert equal.limits_um == (-5.0, 5.0)


def test_a_ground_profile_takes_the_sign_that_the_file_names():
    """A disk made 10 to 25 um smaller has that much material off, which opens the gaps."""
    written = {"distribution": "uniform", "limits_mm": "-0.010/-0.025"}
    message = refused(written, "disk_profile")
    assert "tolerances.disk_profile.convention is missing; must be" in message
    assert '"drawing" (a larger part is positive: 10 to 25 um of material off, opens the gaps)' in message
    assert '"material_off" (material off is positive: -25 to -10 um, closes the gaps)' in message
    for convention, limits in (("drawing", (10.0, 25.0)), ("material_off", (-25.0, -10.0))):
        for name in ("disk_profile", "lobe_profile"):
            read = getattr(tolerances(**{name: {**written, "convention": convention}}), name)
            assert read.limits_um == limits
    allowance = {"distribution": "uniform", "lower_um": -1.0, "upper_um": 1.0, "allowance_um": 10.0}
    assert tolerances(disk_profile=allowance).disk_profile.allowance_um == 10.0


@pytest.mark.parametrize("clearance", [None, {"method": "exact"}])
def test_limits_of_a_profile_need_the_reading_of_the_disk(clearance):
    """A profile tolerance of 8 um is ±4 um along the normal; the default counts half of it, along the radius."""
    limits = {"distribution": "uniform", "limits_mm": "±0.004", "convention": "drawing"}
    raw = {**STUDY, "clearance": clearance, "tolerances": {"lobe_profile": limits}}
    raw = {name: section for name, section in raw.items() if section is not None}
    with pytest.raises(InputError) as raised:
        parse_study(raw, "drawn", "drawn.toml", lambda name: load_design(name, ROOT))
    assert len(raised.value.problems) == 1
    assert "clearance.disk_reading is missing; must stand beside limits_mm of lobe_profile" in raised.value.problems[0]
    assert 'as a profile tolerance of ISO 1101 (0.008 on the drawing is "±0.004")' in raised.value.problems[0]
    raw["clearance"] = {"disk_reading": "normal"}
    study = parse_study(raw, "drawn", "drawn.toml", lambda name: load_design(name, ROOT))
    assert study.tolerances.lobe_profile.limits_um == (-4.0, 4.0)
    raw |= {
        "clearance": {},
        "tolerances": {"lobe_profile": {"distribution": "uniform", "lower_um": 0.0, "upper_um": 1.0}},
    }
    assert parse_study(raw, "um", "um.toml", lambda name: load_design(name, ROOT)).clearance.disk_reading != "normal"


@pytest.mark.parametrize(("order", "diameters"), [(2, 4.0), (3, 0.0)])
def test_amplitudes_of_waves_are_told_in_what_is_measured(order, diameters):
    """Roundness deviation and difference of two-point diameters of a ring with one wave, per amplitude."""
    angles = np.linspace(0, 2 * np.pi, 721)
    diameter = np.cos(order * angles) + np.cos(order * (angles + np.pi))
    assert np.ptp(diameter) == pytest.approx(diameters, abs=1e-9)
    told = "a quarter of Dmax - Dmin" if diameters else "not seen in Dmax - Dmin, which is 0"
    for name in (f"ovality_{order}", f"pin_roundness_{order}"):
        assert f"roundness deviation, {told};" in dimension_library()[name].sign


SIGNED = [name for name, item in dimension_library().items() if item.gap_sign and item.count(DESIGN)]


@pytest.mark.parametrize("name", SIGNED)
def test_the_sign_of_a_dimension_is_what_it_does_to_the_play(name):
    base = {"disk_profile": 30.0, "hole_diameter": 30.0, "roller_diameter": -10.0}
    cases = [{"label": "as it is", **base}, {"label": "more", **base, name: base.get(name, 0.0) + 5.0}]
    raw = {**STUDY, "samples": {"experiment": "cases", "nominal_first": False}, "cases": cases}
    raw["cycle"] = {**STUDY["cycle"], "rigid_angles": 7}
    raw = {key: value for key, value in raw.items() if key not in ("tolerances", "costs", "drivers", "tails")}
    study = parse_study(raw, "signs", "signs.toml", lambda name: load_design(name, ROOT))
    ends = rigid_ends(study, draw(study, 0, 2))
    play = np.mean(ends[:, 0] - ends[:, 1], axis=1)
    assert np.sign(play[1] - play[0]) == dimension_library()[name].gap_sign


def test_the_signed_dimensions_are_those_of_pins_disk_holes_and_bearings():
    assert {"disk_profile", "lobe_profile", "pin_radial", "pin_radius", "hole_diameter"} <= set(SIGNED)
    assert [name for name, item in dimension_library().items() if item.drawing_sign < 0] == [
        "disk_profile",
        "lobe_profile",
    ]


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("pin_radial", {"limits_mm": "±0.01", "convention": "material_off"}, 'must be "drawing", the only sign'),
        ("disk_profile", {"lower_um": 0.0, "upper_um": 1.0, "convention": "drawing"}, "belongs to limits_mm"),
    ],
)
def test_a_sign_that_a_dimension_does_not_have_is_refused(name, settings, message):
    assert message in refused(settings, name)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"limits_mm": "0/-0.004"}, 'tolerances.pin_radius.of; must be "diameter" or "radius"'),
        ({"limits_mm": "4 um", "of": "radius"}, 'tolerances.pin_radius.limits_mm = "4 um"; must be as "+0.000/-0.004"'),
        ({"limits_mm": "0/-0.004", "iso": "6h5"}, 'iso = "6h5"; stands beside limits_mm'),
        ({"iso": "14h5"}, 'iso = "14h5"; its size must be the design\'s diameter, 6 mm'),
        ({"iso": "6x5"}, "letters are e, f, g, h, js"),
        ({"iso": "6h2"}, "grades are 3 to 11"),
        ({"iso": "loose"}, 'must be as "4h5" or "h5"'),
        ({"iso": "6h5", "of": "radius"}, 'of = "radius"; must be "diameter"'),
        ({"of": "radius", "lower_um": -1.0, "upper_um": 0.0}, "belongs to limits_mm; delete it"),
    ],
)
def test_what_no_drawing_says_is_refused(settings, message):
    assert message in refused(settings)


@pytest.mark.parametrize("text", ["dia 0.02", "⌀0.02", "ø .02"])
def test_a_position_is_a_circular_zone(text):
    for name, kind in (("uniform", "uniform_in_disc"), ("normal", "normal_in_disc")):
        zone = tolerances(output_pin_position={"distribution": name, "position": text}).output_pin_position
        assert (zone.name, zone.limits_um, zone.radius_um) == (kind, (0.0, 10.0), 10.0)
    bore = tolerances(hole_diameter={"distribution": "uniform", "iso": "H7"}).hole_diameter
    assert bore.limits_um == (0.0, 18.0)  # 14.4 mm: pins of 6, eccentricity of 1.2, both sides


@pytest.mark.parametrize(
    ("name", "shape", "limit"), [("normal", "dia 0.012", 6.0), ("uniform", "dia 0.02", 8.660254038)]
)
def test_a_position_of_the_housing_pins_is_split_into_two_directions(name, shape, limit):
    """Normal: limits at three sigma, as the zone has. Uniform: the variance of a disc, a quarter of R squared."""
    split = tolerances(pin_position={"distribution": name, "position": shape, "correlation_length_mm": 8.0})
    for coordinate in (split.pin_radial, split.pin_tangential):
        assert coordinate.limits_um == pytest.approx((-limit, limit))
        assert coordinate.correlation_length_mm == 8.0
    if name == "uniform":
        probability = (np.arange(1000) + 0.5) / 1000
        assert np.mean(split.pin_radial.deviation(probability) ** 2) == pytest.approx(10.0**2 / 4, rel=1e-5)


def test_a_position_of_the_housing_pins_stands_alone():
    with pytest.raises(InputError, match="stands beside pin_radial; keep the one or the other"):
        tolerances(
            pin_position={"distribution": "normal", "position": "dia 0.02"},
            pin_radial={"distribution": "normal", "lower_um": -3.0, "upper_um": 3.0},
        )


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("output_pin_position", {"position": "0.02"}, 'position = "0.02"; must be as "dia 0.02"'),
        ("output_pin_position", {"position": "dia 0"}, "above 0"),
        ("output_pin_position", {"position": "dia 0.02", "upper_um": 3.0}, "stands beside position"),
        ("output_pin_position", {"position": "dia 0.02", "distribution": "triangular"}, "must be uniform or normal"),
        ("output_pin_position", {"lower_um": 0.0, "upper_um": 3.0}, 'write position = "dia 0.02"'),
        ("pin_radial", {"position": "dia 0.02"}, "take [tolerances.pin_position] for both directions, or limits_mm"),
        ("eccentricity", {"position": "dia 0.02"}, "is no point in a zone; take limits_mm"),
        ("pin_position", {"lower_um": 0.0, "upper_um": 3.0}, 'pin_position.position is missing; must be as "dia 0.02"'),
        ("pin_position", {"position": "dia 0.02", "distribution": "triangular"}, "must be uniform or normal"),
        ("pin_radial", {"distribution": "uniform_in_disc", "radius_um": 3.0}, "is a number; take one with limits"),
        ("bush_bore", {"lower_um": 0.0, "upper_um": 3.0}, "acts on nothing: it needs bushes"),
    ],
)
def test_what_is_no_zone_is_refused(name, settings, message):
    assert message in refused(settings, name)


def test_a_position_has_no_code_and_is_no_radius():
    assert "has no nominal size" in refused({"iso": "6h5"}, "pin_radial")
    assert "neither a diameter nor a radius" in refused({"limits_mm": "±0.01", "of": "radius"}, "pin_radial")
