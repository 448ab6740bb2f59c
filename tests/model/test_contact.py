"""Force laws against their integrals, published formulas and limits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from pipeline.model.contact.laws import (
    SHARE_OF_LIMIT,
    ContactLaws,
    LineContact,
    Material,
    concatenated_laws,
    curved_laws,
    cylinder_share,
    flat_share,
    in_series,
    mesh_compliance,
    meshed_share,
    scaled_laws,
    stiffened_laws,
)
from pipeline.model.contact.line_laws import library as law_library
from pipeline.model.contact.line_laws.contact_law import law_of
from pipeline.model.contact.line_laws.hertz import hertz_laws
from pipeline.model.contact.line_laws.palmgren import palmgren_laws

STRESS = Material(206e3, 0.3, "plane_stress")
STRAIN = Material(206e3, 0.3, "plane_strain")
PIN_RADIUS, WIDTH = 0.8, 0.08
FLAT = LineContact(np.array([1.6]), 3.0, STRESS, STRESS)


def pin_laws(relative_radius, *, material=STRESS, length=1.0, width=WIDTH, radius=PIN_RADIUS):
    """A pin on a meshed flank."""
    contact = LineContact(np.atleast_1d(relative_radius), length, material, material)
    shares = [cylinder_share(contact, material, radius), meshed_share(contact, material, width)]
    return hertz_laws(contact, shares, radius)


def roller_laws(length=2.6):
    contact = LineContact(np.array([1.5]), length, STRESS, STRESS)
    return hertz_laws(contact, 2 * [cylinder_share(contact, STRESS, 1.5), flat_share(contact, STRESS, 5.0)], 1.5)


def palmgren(interfaces, resistance, length=1.0):
    return palmgren_laws(LineContact(np.array([0.8]), length, STRESS, STRESS), interfaces, resistance)


LAWS = {
    "pin on a convex flank": pin_laws(0.2),
    "pin on a flat flank": pin_laws(0.8),
    "pin in a root": pin_laws(70.6),
    "pin in plane strain": pin_laws(5.0, material=STRAIN, length=3.0),
    "roller between flats": roller_laws(),
    "palmgren on a mesh": palmgren(1, mesh_compliance(STRESS, 1.0, PIN_RADIUS, 0.3)),
    "palmgren roller": palmgren(2, 0.0, 2.6),
}
EACH_LAW = pytest.mark.parametrize("laws", LAWS.values(), ids=LAWS)


def limit_of(laws):
    """Limit of the law [N], or a large force where it has none."""
    return laws.force_limit[0] if np.isfinite(laws.force_limit[0]) else 1e6


def reach_of(laws):
    """Forces of all sizes on both sides of the limit [N]."""
    return limit_of(laws) * np.array([1e-8, 1e-5, 1e-2, 0.3, 0.999, 1.0, 1.001, 3.0, 50.0])


def integral(function, top, corner):
    """Integral from 0 to ``top`` of a function with a kink, in x = top s^4, which smooths logarithm and power at 0."""
    kink = [(corner / top) ** 0.25] if 0 < corner < top else None
    return quad(lambda s: function(top * s**4) * 4 * top * s**3, 0, 1, points=kink, epsrel=1e-12, limit=200)[0]


@EACH_LAW
def test_deflection_is_the_derivative_of_the_complementary_energy(laws):
    limit = laws.force_limit[0]
    for force in reach_of(laws):
        energy = integral(lambda f: laws.deflection([f])[0], force, limit)
        assert laws.energy([force])[0] == pytest.approx(energy, rel=1e-10)


@EACH_LAW
@pytest.mark.long
def test_force_is_the_derivative_of_the_stored_energy_by_the_penetration(laws):
    """Stored and complementary energy add to force times deflection; the first is the integral of the force."""
    for force in reach_of(laws)[2:-1]:
        deflection, corner = laws.deflection([force])[0], laws.deflection([limit_of(laws)])[0]
        stored = integral(lambda d: laws.force([d])[0], deflection, corner)
        assert stored + laws.energy([force])[0] == pytest.approx(force * deflection, rel=1e-10)


@EACH_LAW
def test_compliance_is_the_derivative_of_the_deflection(laws):
    for force in reach_of(laws):
        deflection = integral(lambda f: laws.compliance([f])[0], force, laws.force_limit[0])
        assert laws.deflection([force])[0] == pytest.approx(deflection, rel=1e-9)


@EACH_LAW
def test_force_inverts_the_deflection(laws):
    force = np.geomspace(1e-9, 1e3, 60)[:, None] * limit_of(laws)
    np.testing.assert_allclose(laws.force(laws.deflection(force)), force, rtol=1e-11)


@EACH_LAW
def test_deflection_increases_everywhere_without_a_jump_of_value_or_slope_at_the_limit(laws):
    limit = limit_of(laws)
    force = np.geomspace(1e-12, 1e4, 2000)[:, None] * limit
    assert np.all(np.diff(laws.deflection(force), axis=0) > 0)
    assert laws.compliance(force).min() > 0
    lower, upper = limit * (1 - 1e-12), limit * (1 + 1e-12)
    assert laws.deflection([lower])[0] == pytest.approx(laws.deflection([upper])[0], rel=1e-10)
    assert laws.compliance([lower])[0] == pytest.approx(laws.compliance([upper])[0], rel=1e-10)
    if np.isfinite(laws.force_limit[0]):
        np.testing.assert_allclose(
            laws.compliance([[2 * limit], [9 * limit]]), laws.compliance([[limit]] * 2), rtol=1e-12
        )


@EACH_LAW
def test_the_dead_zone_ends_without_a_jump_of_force_or_stiffness(laws):
    np.testing.assert_array_equal(laws.force([[-1.0], [-1e-12], [0.0]]), 0)
    np.testing.assert_array_equal(laws.deflection([[-5.0], [0.0]]), 0)
    np.testing.assert_array_equal(laws.energy([[-5.0], [0.0]]), 0)
    np.testing.assert_array_equal(laws.peak_pressure([[-5.0], [0.0]]), 0)
    force = laws.force(np.array([[1e-5], [1e-20], [1e-50]]))[:, 0]
    stiffness = 1 / laws.compliance(force[:, None])[:, 0]
    assert np.all(force > 0)
    assert np.all(np.diff(force) < 0)
    assert np.all(np.diff(stiffness) < 0)  # falls to zero, like 1/ln(1/F) or F^0.1
    tiny = 1 / laws.compliance([1e-300])[0]
    assert tiny < 0.1 * stiffness[0]


@pytest.mark.parametrize(("relative_radius", "line_load"), [(0.8, 7400), (48, 124), (70.6, 84)])
def test_range_of_a_pin_on_a_meshed_flank_of_its_material(relative_radius, line_load):
    """p < pi E* r w exp(-5/4)/R', 0.9 of which is used (mechanics, section 4)."""
    limit = pin_laws(relative_radius).force_limit[0] / 0.9
    exact = np.pi * 103e3 * PIN_RADIUS * WIDTH * np.exp(-1.25) / relative_radius
    assert limit == pytest.approx(exact, rel=1e-12)
    assert limit == pytest.approx(line_load, rel=4e-3)


def test_the_half_width_bounds_the_range_where_the_geometry_does_first():
    laws = pin_laws(0.8, width=2.0)
    contact = LineContact(np.array([0.8]), 1.0, STRESS, STRESS)
    assert contact.half_width(laws.force_limit)[0] == pytest.approx(0.5 * PIN_RADIUS, rel=1e-12)


@pytest.mark.parametrize("material", [STRESS, STRAIN], ids=["plane_stress", "plane_strain"])
@settings(max_examples=20)
@given(radius=st.floats(0.2, 20), line_load=st.floats(0.1, 500), length=st.floats(0.5, 20))
def test_two_cylinder_shares_are_the_compression_between_two_flats(material, radius, line_load, length):
    """Johnson (1985), eq. 5.57: (2p/(pi E')) [2 ln(4R/b) - 1], the flats' own deflection apart."""
    contact = LineContact(np.array([radius]), length, material, material)
    a, c = cylinder_share(contact, material, radius)
    modulus = 206e3 if material is STRESS else 206e3 / (1 - 0.09)
    b = np.sqrt(4 * line_load * radius / (np.pi * modulus / 2))
    assert contact.half_width([line_load * length])[0] == pytest.approx(b, rel=1e-12)
    force = line_load * length
    shortening = 2 * force * (a - c * np.log(force))[0]
    exact = 2 * line_load / (np.pi * modulus) * (2 * np.log(4 * radius / b) - 1)
    assert shortening == pytest.approx(exact, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("material", [STRESS, STRAIN], ids=["plane_stress", "plane_strain"])
@pytest.mark.parametrize("width", [0.01, 0.1, 0.5])
def test_mesh_and_correction_together_are_the_flat_half_plane_whatever_the_patch(material, width):
    """(2p/(pi E')) [ln(2d/b) - nu'/2] down to the depth d (Johnson 1985, 5.6), for any patch half width."""
    contact = LineContact(np.array([0.8]), 2.0, material, material)
    a, c = meshed_share(contact, material, width)
    mesh_part = mesh_compliance(material, 2.0, 3.0, width)
    modulus, lateral = (206e3, 0.3) if material is STRESS else (206e3 / 0.91, 0.3 / 0.7)
    for force in (1.0, 100.0):
        b = np.sqrt(4 * force / 2.0 * 0.8 / (np.pi * modulus / 2))
        exact = 2 * force / 2.0 / (np.pi * modulus) * (np.log(2 * 3.0 / b) - lateral / 2)
        assert mesh_part * force + force * (a - c * np.log(force))[0] == pytest.approx(exact, rel=1e-12)
        flat_a, flat_c = flat_share(contact, material, 3.0)
        assert force * (flat_a - flat_c * np.log(force))[0] == pytest.approx(exact, rel=1e-12)


def test_contact_modulus_of_two_materials():
    soft = Material(70e3, 0.33, "plane_strain")
    contact = LineContact(np.array([1.0]), 1.0, STRAIN, soft)
    assert 1 / contact.contact_modulus == pytest.approx((1 - 0.3**2) / 206e3 + (1 - 0.33**2) / 70e3, rel=1e-12)


@pytest.mark.parametrize("interfaces", [1, 2])
def test_palmgrens_approach_and_its_exponents(interfaces):
    """3.84e-5 Q^0.9/L^0.8 mm for each contact in series (Palmgren 1959, p. 50)."""
    assert palmgren(interfaces, 0.0).deflection([1.0])[0] == pytest.approx(interfaces * 3.84e-5, rel=1e-12)
    laws, longer = palmgren(interfaces, 0.0), palmgren(interfaces, 0.0, 3.0)
    assert laws.deflection([700.0])[0] / laws.deflection([7.0])[0] == pytest.approx(100**0.9, rel=1e-12)
    assert longer.deflection([7.0])[0] / laws.deflection([7.0])[0] == pytest.approx(3**-0.8, rel=1e-12)
    assert np.isinf(laws.force_limit[0])


def test_palmgrens_law_on_a_mesh_leaves_out_what_the_mesh_holds_and_is_refused_where_nothing_is_left():
    mesh_part = mesh_compliance(STRESS, 1.0, PIN_RADIUS, 0.3)
    assert mesh_part == pytest.approx(2 / (np.pi * 206e3) * (np.log(1.6 / 0.3) - 0.25 - 0.15), rel=1e-12)
    laws = palmgren(1, mesh_part)
    force = np.array([[1.0], [50.0]])
    np.testing.assert_allclose(laws.deflection(force) + mesh_part * force, 3.84e-5 * force**0.9, rtol=1e-12)
    flat = laws.force_limit[0] / 0.9
    assert 0.9 * 3.84e-5 * flat**-0.1 == pytest.approx(mesh_part, rel=1e-12)
    with pytest.raises(ValueError, match="Palmgren's law decreases beyond"):
        palmgren(1, 4e-5)


@settings(max_examples=20)
@given(relative_radius=st.floats(0.1, 100), line_load=st.floats(0.01, 1e3), length=st.floats(0.5, 20))
def test_peak_pressure_carries_the_load_on_an_ellipse(relative_radius, line_load, length):
    """Hertz: p0 = 2 p/(pi b), of a contact in plane strain whatever the state of the bodies (Johnson 1985, 4.2)."""
    contact = LineContact(np.array([relative_radius]), length, STRESS, STRAIN)
    laws = hertz_laws(contact, [cylinder_share(contact, STRESS, 2.0)], 2.0)
    b = np.sqrt(4 * line_load * relative_radius * 2 * (1 - 0.3**2) / (np.pi * 206e3))
    assert laws.peak_pressure([line_load * length])[0] == pytest.approx(2 * line_load / (np.pi * b), rel=1e-12)
    published = 190.6 * np.sqrt(line_load / relative_radius)  # steel: Harris, Rolling Bearing Analysis
    assert laws.peak_pressure([line_load * length])[0] == pytest.approx(published, rel=0.005)


@settings(max_examples=30)
@given(
    relative_radius=st.floats(0.1, 500),
    radius=st.floats(0.2, 10),
    width=st.floats(0.01, 0.5),
    modulus=st.floats(1e3, 1e6),
    length=st.floats(0.1, 50),
)
def test_laws_of_any_design_increase_and_can_be_inverted(relative_radius, radius, width, modulus, length):
    material = Material(modulus, 0.3, "plane_stress")
    laws = pin_laws(relative_radius, material=material, length=length, width=width, radius=radius)
    force = np.geomspace(1e-6, 1e4, 200)[:, None]
    assert np.all(np.diff(laws.deflection(force), axis=0) > 0)
    np.testing.assert_allclose(laws.force(laws.deflection(force)), force, rtol=1e-9)


def test_law_of_longer_contacts_is_that_of_their_line_load():
    force = np.array([[0.1], [10.0], [1e5]])
    law_of_unit_length, law_of_four = pin_laws(3.0), pin_laws(3.0, length=4.0)
    np.testing.assert_allclose(law_of_four.deflection(4 * force), law_of_unit_length.deflection(force), rtol=1e-12)
    np.testing.assert_allclose(
        law_of_four.peak_pressure(4 * force), law_of_unit_length.peak_pressure(force), rtol=1e-12
    )


def test_records_are_joined_and_taken_apart_in_order():
    joined = concatenated_laws([LAWS["pin in a root"], LAWS["palmgren roller"], LAWS["roller between flats"]])
    assert len(joined) == 3
    force = np.array([[5.0, 60.0, 700.0]])
    parts = [
        LAWS[name].deflection([f])[0]
        for name, f in zip(("pin in a root", "palmgren roller", "roller between flats"), force[0], strict=True)
    ]
    np.testing.assert_array_equal(joined.deflection(force)[0], parts)
    assert isinstance(joined[1], ContactLaws)
    np.testing.assert_array_equal(joined[[2, 0]].deflection(force[:, [2, 0]])[0], [parts[2], parts[0]])


@EACH_LAW
def test_laws_are_scaled_and_stiffened_by_their_meaning(laws):
    force = reach_of(laws)[:, None]
    np.testing.assert_allclose(scaled_laws(laws, 1.7).deflection(force), 1.7 * laws.deflection(force), rtol=1e-13)
    stiffer = stiffened_laws(laws, np.array([2.5]))
    np.testing.assert_allclose(stiffer.deflection(2.5 * force), laws.deflection(force), rtol=1e-12)
    np.testing.assert_allclose(stiffer.compliance(2.5 * force), laws.compliance(force) / 2.5, rtol=1e-12)
    np.testing.assert_allclose(stiffer.energy(2.5 * force), 2.5 * laws.energy(force), rtol=1e-12)


def test_laws_joined_keep_their_contacts_and_add_up_in_series():
    groups, force = [LAWS["pin in a root"], LAWS["palmgren on a mesh"]], np.array([[5.0, 60.0]])
    joined = concatenated_laws(groups)
    parts = [laws.deflection([f])[0] for laws, f in zip(groups, force[0], strict=True)]
    np.testing.assert_array_equal(joined.deflection(force)[0], parts)
    np.testing.assert_array_equal(joined[[1, 0]].deflection(force[:, ::-1])[0], parts[::-1])
    for laws in groups:
        np.testing.assert_allclose(in_series(laws, laws).deflection([9.0]), 2 * laws.deflection([9.0]), rtol=1e-14)
    assert joined.content != concatenated_laws([groups[0], palmgren(2, 0.0, 2.6)]).content


def test_laws_on_a_solid_body_are_the_compression_between_both_depths():
    """Johnson 5.57 for the cylinder, 5.6 for the body down to a radius; Palmgren's whole approach; a stated spring."""
    radius, length, force = 2.0, 3.0, 150.0
    contact = LineContact(np.array([1.6]), length, STRESS, STRESS)
    half_width = np.sqrt(4 * force / length * 1.6 / (np.pi * STRESS.modulus / 2))
    cylinder, body = np.log(4 * radius / half_width) - 0.5, np.log(2 * radius / half_width) - 0.5 * STRESS.lateral
    solid = {name: law_of(name, 4e4).on_solid(contact, radius).deflection(force)[0] for name in law_library()}
    assert solid["hertz"] == pytest.approx(2 * force / (np.pi * STRESS.modulus * length) * (cylinder + body), rel=1e-12)
    assert solid["palmgren"] == pytest.approx(3.84e-5 * force**0.9 / length**0.8, rel=1e-12)
    assert solid["linear"] == pytest.approx(force / 4e4, rel=1e-12)


@EACH_LAW
@pytest.mark.parametrize("factor", [1 / 3, 3.0])
def test_curved_laws_fall_as_many_times_behind_a_linear_one(laws, factor):
    """Of a power 1 - m is multiplied, of a logarithm what it takes off the slope; what a mesh holds is in neither."""
    usual_force = 0.01 * float(laws.force_limit[0]) if np.isfinite(laws.force_limit[0]) else 300.0
    curved, held = curved_laws(laws, factor, usual_force), np.minimum(laws.linear, 0.0) * (laws.power > 0)
    np.testing.assert_allclose(curved.deflection([usual_force]), laws.deflection([usual_force]), rtol=1e-12)

    def shortfall(of_laws):
        approach = of_laws.deflection([usual_force]) - held * usual_force
        return approach - (of_laws.compliance([usual_force]) - held) * usual_force

    np.testing.assert_allclose(shortfall(curved), factor * shortfall(laws), rtol=1e-9)
    forces = np.geomspace(1e-6, 1e3, 60)[:, None] * usual_force
    compliance = curved.compliance(forces)
    assert np.all(compliance > 0)
    assert np.all(np.diff(compliance, axis=0) <= 1e-12 * compliance[:-1])
    np.testing.assert_allclose(curved.force(curved.deflection(forces)), forces, rtol=1e-9)
    assert np.all(curved.force_limit <= laws.force_limit)


@pytest.mark.parametrize("power", [0.8, 0.7, 2 / 3])
def test_a_hertz_law_curved_further_tends_to_the_power_of_the_force_that_falls_behind_as_far(power):
    """Within 2 % of F^m from a seventh to seven times the usual force, where Hertz' law is up to 40 % away."""
    laws, usual_force = roller_laws(), 200.0
    shortfall = float(laws.logarithmic[0] * usual_force / laws.deflection([usual_force])[0])
    forces = np.geomspace(1 / 7, 7, 9)[:, None]
    curved = curved_laws(laws, (1 - power) / shortfall, usual_force).deflection(usual_force * forces)
    expected = laws.deflection([usual_force])[0] * forces**power
    np.testing.assert_allclose(curved[:, 0], expected[:, 0], rtol=0.02)
    assert np.max(np.abs(laws.deflection(usual_force * forces)[:, 0] / expected[:, 0] - 1)) > 0.15


@EACH_LAW
@pytest.mark.parametrize("factor", [0.3, 1.7, 4.0])
def test_a_curved_law_ends_before_its_slope_vanishes(laws, factor):
    """The slope of the law proper falls to zero, if at all, beyond its limit by the share that was kept free."""
    curved = curved_laws(laws, factor, 0.01 * float(laws.force_limit[0]) if np.isfinite(laws.force_limit[0]) else 300.0)
    limit = float(curved.force_limit[0])
    beyond = replace(curved, force_limit=np.array([np.inf]))
    if limit < float(laws.force_limit[0]):
        at_zero = beyond.compliance([limit / SHARE_OF_LIMIT])[0]
        assert abs(at_zero) < 1e-9 * beyond.compliance([0.01 * limit])[0]
    assert beyond.compliance([min(limit, 1e12)])[0] > 0


def test_laws_as_curved_as_they_are_and_linear_ones_stay():
    laws = LAWS["pin in a root"]
    assert curved_laws(laws, 1.0, 100.0) is laws
    linear = law_of("linear", 1e5).on_mesh(FLAT, PIN_RADIUS, WIDTH)
    for name in ("linear", "logarithmic", "power", "force_limit"):
        np.testing.assert_array_equal(getattr(curved_laws(linear, 3.0, 100.0), name), getattr(linear, name))


def test_hertz_law_of_two_bodies_is_curved_as_said():
    """The coefficient of the logarithm is 0.09 to 0.12 of the secant compliance, Palmgren's 1 - m is 0.1."""
    laws = roller_laws()
    forces = np.array([[100.0], [1000.0]])
    share = laws.logarithmic * forces / laws.deflection(forces)
    np.testing.assert_allclose(share, [[0.09], [0.12]], atol=0.01)
