"""Output pins in holes of the disk: geometry, gaps, rigid play and balance against circles and closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import drive_with
from reducers import ARCMIN, PAPER, SMALL, STEEL, errors_of, pins_in_holes, random_compliance

from pipeline import assembly
from pipeline.config import load_study
from pipeline.config.distributions import library
from pipeline.config.mechanisms.pin_in_hole import Bush
from pipeline.config.studies.tolerances import Case
from pipeline.model.contact.laws import LineContact, concatenated_laws, cylinder_share, meshed_share
from pipeline.model.contact.line_laws.hertz import hertz_laws
from pipeline.model.geometry.clearance import exact_gaps, gaps
from pipeline.model.geometry.contacts import OUTPUT
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.reducer import Bearing, nominal_reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play, rigid_play, separated_play
from pipeline.model.load_history.load_cycle import LoadCycle, solve_cycle
from pipeline.sampling.errors import draw

ROOT = Path(__file__).parents[3]

EVEN_LOBES = CycloidProfile(pins=13, pin_circle_radius=10.0, pin_radius=1.0, eccentricity=0.5)
CLEARANCE = 4e-3
CASES = pytest.mark.parametrize(
    ("profile", "pins", "crank"),
    [(SMALL, 6, 0.0), (SMALL, 7, 1.1), (EVEN_LOBES, 3, 4.0), (EVEN_LOBES, 8, np.pi), (PAPER, 10, 2.3)],
)


def reducer_at(profile, pins, crank, clearance=CLEARANCE, phase=0.4):
    mechanism = pins_in_holes(profile, pins, clearance, float(np.degrees(phase)))
    return mechanism, nominal_reducer(profile, mechanism, crank)


def hole_and_pin(profile, mechanism, crank, pose=(0.0, 0.0, 0.0, 0.0)):
    """Centres of holes and pins after rigid motions of disk (x, y, phi) and output (phi), from the circles alone."""
    x, y, disk, output = pose
    turn = -crank / profile.lobes
    holes = mechanism.centres() * np.exp(1j * (turn + disk)) + profile.eccentricity * np.exp(1j * crank) + x + 1j * y
    return holes, mechanism.centres() * np.exp(1j * (turn + output))


def circle_gap(profile, mechanism, crank, pose=(0.0, 0.0, 0.0, 0.0)):
    holes, pins = hole_and_pin(profile, mechanism, crank, pose)
    return mechanism.hole_radius(profile.eccentricity) - mechanism.pin_radius_mm - np.abs(holes - pins)


@CASES
def test_the_contact_lies_on_the_wall_where_hole_and_pin_are_nearest(profile, pins, crank):
    mechanism, reducer = reducer_at(profile, pins, crank)
    values = reducer.contacts.kind == OUTPUT
    holes, centres = hole_and_pin(profile, mechanism, crank)
    point, normal = reducer.contacts.point[values], reducer.contacts.normal[values]
    np.testing.assert_allclose(np.abs(point - holes), mechanism.hole_radius(profile.eccentricity))
    np.testing.assert_allclose(np.abs(point - centres), mechanism.pin_radius_mm + CLEARANCE)
    np.testing.assert_allclose(point + (mechanism.pin_radius_mm + CLEARANCE) * normal, centres)  # into the pin
    np.testing.assert_allclose(reducer.contacts.gap[values], circle_gap(profile, mechanism, crank))
    np.testing.assert_allclose(reducer.contacts.curvature[values], -1 / mechanism.hole_radius(profile.eccentricity))
    disk_centre = profile.eccentricity * np.exp(1j * crank)
    for centre in (0, disk_centre):
        np.testing.assert_allclose(np.imag(np.conj(point - centre) * normal), reducer.contacts.arm[values], atol=1e-12)
    assert list(reducer.contacts.label[values]) == [f"output pin {k}" for k in range(pins)]
    assert (reducer.contacts.arm[values] > 1e-9).any()
    assert (reducer.contacts.arm[values] < -1e-9).any()


@CASES
def test_motions_close_the_gaps_of_the_circles(profile, pins, crank):
    mechanism, reducer = reducer_at(profile, pins, crank)
    values = reducer.contacts.kind == OUTPUT
    assert reducer.motions == ("disk_x", "disk_y", "disk_phi", "output_phi")
    for column in range(4):
        pose = np.zeros(4)
        pose[column] = 1e-6
        closing_values = circle_gap(profile, mechanism, crank, -pose) - circle_gap(profile, mechanism, crank, pose)
        np.testing.assert_allclose(closing_values / 2e-6, reducer.contact_jacobian[values, column], atol=1e-6)


def test_a_shift_across_the_normal_leaves_out_what_the_notes_say():
    mechanism, reducer = reducer_at(SMALL, 6, 0.7)
    shift = 0.02j * np.exp(0.7j)
    gap = circle_gap(SMALL, mechanism, 0.7, (shift.real, shift.imag, 0, 0))
    np.testing.assert_allclose(CLEARANCE - gap, 0.02**2 / (2 * SMALL.eccentricity), rtol=2e-3)


@CASES
@pytest.mark.parametrize("reading", ["half_diameter", "diameter"])
def test_errors_of_pins_and_eccentricity_are_those_of_the_circles(profile, pins, crank, reading):
    mechanism, reducer = reducer_at(profile, pins, crank)
    rng = np.random.default_rng(5)
    diameter, eccentricity = 1e-2 * rng.uniform(-1, 1, (3, pins)), 1e-2 * rng.uniform(-1, 1, 3)
    errors = errors_of(profile, reducer, 3, roller_diameter=diameter, eccentricity=eccentricity)
    computed_gaps = gaps(profile, reducer, errors, method="exact", disk_reading="radial", roller_reading=reading)
    for k in range(3):
        shift = eccentricity[k] * np.exp(1j * crank)
        expected = circle_gap(profile, mechanism, crank, (shift.real, shift.imag, 0, 0)) - diameter[k] / 2
        np.testing.assert_allclose(computed_gaps[k, profile.pins :], expected, atol=1e-14)
    np.testing.assert_array_equal(computed_gaps[:, : profile.pins], exact_gaps(profile, reducer, errors, "radial"))


@CASES
def test_separated_play_is_the_general_programs_and_the_closed_form(profile, pins, crank):
    _, reducer = reducer_at(profile, pins, crank)
    gap = np.random.default_rng(1).uniform(1e-3, 12e-3, (20, len(reducer.contacts)))
    separated, general = separated_play(reducer, gap), general_play(reducer, gap, np.zeros(len(gap)))
    np.testing.assert_allclose(separated.backlash, general.backlash, rtol=1e-9)
    expected = np.zeros(len(gap))
    for part in (reducer.contacts.kind == OUTPUT, reducer.contacts.kind != OUTPUT):
        for sign in (1, -1):
            of_side = part & (sign * reducer.contacts.arm > 1e-9)
            expected += np.min(gap[:, of_side] / np.abs(reducer.contacts.arm[of_side]), axis=1)
    np.testing.assert_allclose(separated.backlash, expected, rtol=1e-12)
    tight = gap - 6e-3
    separated, general = separated_play(reducer, tight), general_play(reducer, tight, np.zeros(len(gap)))
    assert np.count_nonzero(general.preloaded) > 5
    np.testing.assert_allclose(separated.overlap, general.overlap, rtol=1e-9, atol=1e-14)


@CASES
def test_a_bearing_clearance_widens_the_play_and_no_contact_is_penetrated_at_its_ends(profile, pins, crank):
    _, reducer = reducer_at(profile, pins, crank)
    gap = np.random.default_rng(2).uniform(1e-3, 12e-3, (6, len(reducer.contacts)))
    tight, previous = separated_play(reducer, gap).backlash, 0.0
    for clearance in (1e-9, 1e-3, 5e-3):
        play = rigid_play(reducer, gap, np.full(6, clearance))
        assert np.all(play.backlash >= np.maximum(tight, previous) * (1 - 1e-9))
        for pose in (play.pose_plus, play.pose_minus):
            np.testing.assert_allclose((pose @ reducer.contact_jacobian.T - gap).max(axis=1), 0, atol=1e-12)
            assert np.all(np.abs(pose[:, 0] + 1j * pose[:, 1]) <= clearance * (1 + 1e-9) + 1e-12)
        if clearance == 1e-9:
            np.testing.assert_allclose(play.backlash, tight, rtol=1e-5)
        previous = play.backlash
    assert np.all(previous > tight * 1.01)


@pytest.mark.parametrize(("pins", "crank"), [(6, 0.3), (7, 4.4)])
def test_output_pins_balance_the_torque_and_their_resultant_loads_the_bearing_along_the_eccentric(pins, crank):
    mechanism, reducer = reducer_at(SMALL, pins, crank)
    n_pins, width = SMALL.pins, 0.15
    on_flank = LineContact(1 / (1 + reducer.pins.flank_curvature), 2.0, STEEL, STEEL)
    in_holes = LineContact(
        np.full(pins, 1 / (1 / 0.6 - 1 / mechanism.hole_radius(SMALL.eccentricity))), 2.0, STEEL, STEEL
    )
    laws = concatenated_laws(
        [
            hertz_laws(c, [cylinder_share(c, STEEL, r), meshed_share(c, STEEL, width)], r)
            for c, r in ((on_flank, 1.0), (in_holes, 0.6))
        ]
    )
    rng = np.random.default_rng(3)
    compliance = random_compliance(len(reducer.contacts), rng)
    gap = rng.uniform(0, 3e-3, (4, len(reducer.contacts)))
    bearing, cycle = Bearing(1e5, 1.0), LoadCycle.evenly(2e3, 4, 1.0, (0.03, 0.5, 1.0))
    states = solve_cycle(drive_with(SMALL, reducer, bearing, laws, compliance, gap, np.zeros(4)), cycle)
    assert states.converged.all()
    arm, normal = reducer.contacts.arm[n_pins:], reducer.contacts.normal[n_pins:]
    np.testing.assert_allclose(
        states.force[..., n_pins:] @ arm, np.broadcast_to(-cycle.state_torque, (4, len(cycle.state_torque))), atol=1e-5
    )
    on_disk = states.force[..., :n_pins] @ reducer.pins.normal - states.force[..., n_pins:] @ normal
    spring = 1e5 * (states.motion[..., 0] + 1j * states.motion[..., 1])
    np.testing.assert_allclose(on_disk, spring, atol=1e-5 * np.abs(spring).max())
    assert np.ptp(ARCMIN * states.motion[..., reducer.output_motion]) > 1


@CASES
def test_errors_of_holes_and_places_of_pins_are_those_of_the_circles(profile, pins, crank):
    mechanism, reducer = reducer_at(profile, pins, crank)
    rng = np.random.default_rng(7)
    shape = (3, pins)
    way = 1e-2 * (rng.uniform(-1, 1, shape) + 1j * rng.uniform(-1, 1, shape))
    diameter, eccentricity = 1e-2 * rng.uniform(-1, 1, shape), 1e-2 * rng.uniform(-1, 1, 3)
    errors = errors_of(profile, reducer, 3, pin_off_hole=way, hole_diameter=diameter, eccentricity=eccentricity)
    reading = {"disk_reading": "radial", "roller_reading": "half_diameter"}
    exact = gaps(profile, reducer, errors, method="exact", **reading)[:, profile.pins :]
    first_order = gaps(profile, reducer, errors, method="first_order", **reading)[:, profile.pins :]
    turn = np.exp(-1j * crank / profile.lobes)
    for k in range(3):
        shift = eccentricity[k] * np.exp(1j * crank)
        holes, centres = hole_and_pin(profile, mechanism, crank, (shift.real, shift.imag, 0, 0))
        room = mechanism.hole_radius(profile.eccentricity) + diameter[k] / 2 - mechanism.pin_radius_mm
        np.testing.assert_allclose(exact[k], room - np.abs(holes - centres - turn * way[k]), atol=1e-14)
    transverse = np.abs(way) ** 2 / (2 * (profile.eccentricity - 0.02))
    assert np.all(np.abs(exact - first_order) <= transverse)
    assert np.abs(exact - first_order).max() > 0.1 * transverse.max()


def test_holes_of_each_disk_are_its_own_and_pins_are_shared():
    study = load_study("two_disks", ROOT)
    names = ("output_pin_position", "hole_position")
    zone = {"distribution": "uniform_in_disc", "radius_um": 10.0}
    wide = {name: library()["uniform_in_disc"].model_validate(zone) for name in names}
    wide["hole_diameter"] = library()["uniform"](distribution="uniform", lower_um=0.0, upper_um=18.0)
    study = study.model_copy(update={"tolerances": study.tolerances.model_copy(update=wide)})
    sampled = draw(study, 1, 4)
    pins, holes = (
        getattr(sampled, f"{name}_amplitude") * np.exp(1j * getattr(sampled, f"{name}_phase")) for name in names
    )
    errors, n = assembly.errors(sampled), study.design.output.pins
    assert (pins.shape, holes.shape) == ((3, n), (3, 2 * n))
    assert len(np.unique(np.abs(holes))) == 6 * n
    for disk in (0, 1):
        of_disk = errors.of_disk(disk)
        np.testing.assert_allclose(of_disk.pin_off_hole, 1e-3 * (pins - holes[:, disk * n : (disk + 1) * n]))
        np.testing.assert_allclose(of_disk.hole_diameter, 1e-3 * sampled.hole_diameter[:, disk * n : (disk + 1) * n])
    reducer = assembly.reducer(study.design, 40.0)
    gap = gaps(assembly.profile(study.design), reducer, errors, **dict(study.clearance))
    narrow = replace(errors, pin_off_hole=0 * errors.pin_off_hole, hole_diameter=0 * errors.hole_diameter)
    added = gap - gaps(assembly.profile(study.design), reducer, narrow, **dict(study.clearance))
    for disk, rows in enumerate(reducer.output_rows):
        direction = np.conj(reducer.contacts.normal[rows]) * np.exp(1j * reducer.disks[disk].rotation)
        expected = np.real(direction * errors.pin_off_hole[:, disk]) + errors.hole_diameter[:, disk] / 2
        np.testing.assert_allclose(added[:, rows], expected, atol=4e-4 * 0.5)
        assert np.abs(added[:, rows] - expected).max() > 1e-8


def test_a_bush_that_fits_looser_counts_as_a_smaller_one():
    study = load_study("pin_in_hole", ROOT)
    bush = Bush(outer_radius_mm=study.design.output.pin_radius_mm, clearance_um=20.0, material="steel")
    thinner = {"bush": bush, "pin_radius_mm": bush.outer_radius_mm - 2.0}
    design = study.design.model_copy(update={"output": study.design.output.model_copy(update=thinner)})
    case = {"bush_bore": 6.0, "output_pin_diameter": -4.0, "roller_diameter": -1.0}
    samples = study.samples.model_copy(update={"experiment": "cases", "count": 1, "nominal_first": False})
    listed_study = study.model_copy(
        update={"design": design, "cases": (Case.model_validate({"label": "loose", **case}),), "samples": samples}
    )
    errors = assembly.errors(draw(listed_study, 0, 1))
    np.testing.assert_allclose(errors.roller_diameter, -11e-3)
    reducer = assembly.reducer(design, 0.0)
    gap = gaps(assembly.profile(design), reducer, errors, **dict(study.clearance))[0, reducer.output_rows[0]]
    np.testing.assert_allclose(gap, reducer.contacts.gap[reducer.output_rows[0]] + 5.5e-3, atol=1e-14)
