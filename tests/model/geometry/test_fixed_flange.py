"""The housing as the output: against bodies in space with the flange held, and the exact change of numbers."""

from dataclasses import replace

import numpy as np
import pytest
from drives import LINEAR, RATED, drive_with, small_drive
from reducers import SMALL, laws_of, random_compliance
from test_pin_in_hole import reducer_at as pins_in_holes

from pipeline.config.designs.sections import Cycloid
from pipeline.model.contact.friction_elements import pin_sliders
from pipeline.model.geometry.cycloid_profile import disk_rotation
from pipeline.model.geometry.reducer import Bearing, with_fixed_flange
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play, rigid_play
from pipeline.model.load_history.load_cycle import LoadCycle, solve_cycle
from pipeline.model.load_history.winkler import secant_compliance, winkler_readings
from pipeline.model.metrics import Definitions

CRANK, RATIO = 0.7, SMALL.pins / SMALL.lobes
CENTRE = SMALL.eccentricity * np.exp(1j * CRANK)
HOLES = pins_in_holes(SMALL, 7, CRANK)[1]


def in_space(reducer):
    """The contact Jacobian of bodies that move in space; of the output's column: the housing, its flange is held."""
    contacts = reducer.contacts
    jacobian = np.zeros_like(reducer.contact_jacobian)
    for sign, bodies in ((1, contacts.body_a), (-1, contacts.body_b)):
        for column, motion in enumerate(reducer.motions):
            body, component = motion.rsplit("_", 1)
            centre = CENTRE if body == "disk" else 0
            velocity = {"x": 1, "y": 1j, "phi": 1j * (contacts.point - centre)}[component]
            moves = bodies == ("housing" if body == "output" else body)
            jacobian[:, column] += np.where(moves, sign * np.real(np.conj(contacts.normal) * velocity), 0.0)
    return replace(reducer, contact_jacobian=jacobian)


def test_any_small_motion_closes_the_contacts_and_slips_on_the_pins_as_in_space():
    turned_unit = with_fixed_flange(HOLES, SMALL.lobes)
    x, y, disk, housing = motion = np.random.default_rng(1).normal(size=4)
    motion_seen = np.array([x, y, disk - housing * RATIO, housing])  # less what the disk turns by rolling
    np.testing.assert_allclose(
        turned_unit.contact_jacobian @ motion_seen, in_space(HOLES).contact_jacobian @ motion, atol=1e-12
    )
    pins = HOLES.pins
    of_disk = x + 1j * y + 1j * disk * (pins.point - CENTRE)
    slip = np.real(np.conj(1j * pins.normal) * (of_disk - 1j * housing * pins.point))
    sliders = pin_sliders(turned_unit, laws_of(SMALL, HOLES), 0.1, RATED)
    np.testing.assert_allclose(sliders.direction @ motion_seen, slip, atol=1e-12)
    assert np.abs(slip - pin_sliders(HOLES, laws_of(SMALL, HOLES), 0.1, RATED).direction @ motion_seen).max() > 0.1


def states_of(reducer, bearing, clearance):
    rng = np.random.default_rng(3)
    gap, compliance = rng.uniform(1e-3, 6e-3, (4, len(reducer.contacts))), random_compliance(len(reducer.contacts), rng)
    drive = drive_with(SMALL, reducer, bearing, laws_of(SMALL, reducer), compliance, gap, np.full(4, clearance))
    play = (general_play if clearance == 0 else rigid_play)(reducer, gap, drive.bearing_clearance)
    start = play.pose_plus + np.where([name.endswith("_phi") for name in reducer.motions], 1e-5, 0.0)
    return play.backlash, drive.equilibria(start, RATED * np.array([0.05, 0.3, 1.0]))


@pytest.mark.parametrize(("bearing", "clearance"), [(LINEAR, 0.0), (Bearing(3e5, 1.5), 4e-3)])
@pytest.mark.parametrize("reducer", [HOLES, small_drive(crank=CRANK, floats=True).reducer], ids=["holes", "plate"])
def test_forces_play_and_rotation_are_those_of_bodies_in_space(reducer, bearing, clearance):
    play, states = states_of(with_fixed_flange(reducer, SMALL.lobes), bearing, clearance)
    space_play, space = states_of(in_space(reducer), bearing, clearance)
    assert states.converged.all()
    assert space.converged.all()
    np.testing.assert_allclose(play, space_play, rtol=1e-8)
    np.testing.assert_allclose(states.force, space.force, rtol=1e-6, atol=1e-6 * space.force.max())
    np.testing.assert_allclose(
        states.motion[..., reducer.output_motion], space.motion[..., reducer.output_motion], rtol=1e-6, atol=1e-12
    )


@pytest.mark.parametrize("clearance", [0.0, 3e-3])
@pytest.mark.parametrize("floats", [False, True])
def test_a_loop_is_that_of_the_flange_times_the_change_of_ratio_on_both_axes(clearance, floats):
    flange = small_drive(2, crank=CRANK, floats=floats, clearance=clearance)
    housing = replace(flange, reducer=with_fixed_flange(flange.reducer, SMALL.lobes), rated_torque=RATIO * RATED)
    cycle = LoadCycle.evenly(RATED, 6, 1.0, (0.05, 0.5))
    scaled = LoadCycle.evenly(RATIO * RATED, 6, 1.0, (0.05, 0.5))
    of_flange, of_housing = solve_cycle(flange, cycle), solve_cycle(housing, scaled)
    assert of_housing.converged.all()
    mirror = np.roll(np.arange(len(cycle.state_torque)), len(cycle.state_torque) // 2)
    np.testing.assert_array_equal(cycle.state_torque[mirror], -cycle.state_torque)
    output = flange.reducer.output_motion
    np.testing.assert_allclose(
        of_housing.motion[..., output], -of_flange.motion[:, mirror, output] / RATIO, rtol=1e-6, atol=1e-12
    )
    np.testing.assert_allclose(of_housing.force, of_flange.force[:, mirror], atol=1e-6 * of_flange.force.max())


def test_the_rough_model_of_the_tails_knows_the_fixed_flange():
    flange = small_drive(3, crank=CRANK)
    housing = replace(flange, reducer=with_fixed_flange(flange.reducer, SMALL.lobes), rated_torque=RATIO * RATED)
    states = flange.equilibria(rigid_play(flange.reducer, flange.gap, np.zeros(3)).pose_plus, np.array([RATED]))
    compliance = secant_compliance(flange, states.force)
    levels = np.array([0.05, 0.5, 1.0]) * RATED / 1e3
    of_flange = winkler_readings(flange, compliance, Definitions(*levels))
    of_housing = winkler_readings(housing, compliance, Definitions(*(RATIO * levels)))
    np.testing.assert_allclose(of_housing.high_plus, -of_flange.high_minus / RATIO, rtol=1e-9)
    np.testing.assert_allclose(of_housing.lost_motion_minus, -of_flange.lost_motion_plus / RATIO, rtol=1e-9)
    np.testing.assert_allclose(of_housing.peak_pressure, of_flange.peak_pressure, rtol=1e-9)


def test_the_crank_turns_as_often_as_there_are_pins_while_the_housing_turns_once():
    housing = 2 * np.pi
    crank = housing * SMALL.pins - housing  # against the housing, the flange standing
    np.testing.assert_allclose(disk_rotation(SMALL, crank), -housing)
    section = Cycloid(
        pins=12, pin_circle_radius_mm=10.0, pin_radius_mm=1.0, eccentricity_mm=0.55, rated_torque_Nm=1.0, fixed="flange"
    )
    assert (section.ratio, section.model_copy(update={"fixed": "housing"}).ratio) == (12, 11)
