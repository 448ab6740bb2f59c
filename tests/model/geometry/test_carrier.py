"""Cranks on a carrier: motions of circles, ratio, bearing loads in closed form, backlash, and a unit in balance."""

from dataclasses import replace

import numpy as np
import pytest
from drives import drive_with
from reducers import STEEL
from scipy.optimize import linprog

from pipeline.config.mechanisms.carrier import Carrier
from pipeline.config.mechanisms.crankshaft import FirstStage
from pipeline.config.mechanisms.mechanism import LawInputs
from pipeline.model.contact.laws import LineContact, concatenated_laws
from pipeline.model.contact.line_laws import library
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.contacts import OUTPUT
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.reducer import Bearing, nominal_reducer
from pipeline.model.geometry.rigid_play import vertex_program
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play, rigid_play
from pipeline.model.geometry.rigid_play.vertex_program import optimal_points
from pipeline.model.load_history.load_cycle import LoadCycle, solve_cycle

PROFILE = CycloidProfile(pins=40, pin_circle_radius=77.5, pin_radius=4.0, eccentricity=1.5)
LOBES, SUN, PLANET, CRANK = 39, 20, 40, 0.6
K = 3e5  # of one crank bearing [N/mm]


def carrier(cranks=2, backlash=0.0, rollers=16):
    stage = FirstStage(sun_teeth=SUN, planet_teeth=PLANET, backlash_um=backlash, mesh_stiffness_N_per_mm=2e5)
    return Carrier(
        mechanism="carrier",
        cranks=cranks,
        crank_circle_radius_mm=45.0,
        bearing_radius_mm=15.0,
        bearing_rollers=rollers,
        phase_deg=20.0,
        first_stage=stage,
    )


def laws_of(mechanism, reducer, exponent=1.0):
    inputs = LawInputs(library()["hertz"], {}, STEEL, 15.0, 1.5, Bearing(K, exponent), 0.5)
    pins = LineContact(1 / (1 / 4.0 + reducer.pins.flank_curvature), 15.0, STEEL, STEEL)
    return concatenated_laws([inputs.law.on_mesh(pins, 4.0, 0.5), mechanism.laws(inputs), mechanism.laws_behind()])


@pytest.mark.parametrize("cranks", [2, 3])
def test_motions_close_the_bearings_as_circles_move_and_the_meshes_as_planets_roll(cranks):
    mechanism = carrier(cranks)
    reducer = nominal_reducer(PROFILE, mechanism, CRANK)
    assert reducer.motions == ("disk_x", "disk_y", "disk_phi", "output_phi", *(f"crank {j}_psi" for j in range(cranks)))
    x, y, disk, output, *psi = motion = 1e-7 * np.random.default_rng(2).normal(size=4 + cranks)
    closing_values = reducer.contact_jacobian @ motion
    centre, eccentric = mechanism.centres() * np.exp(-1j * CRANK / LOBES), 1.5 * np.exp(1j * CRANK)
    pitch, teeth = 45.0 * PLANET / (SUN + PLANET), (SUN + PLANET) / PLANET
    for j in range(cranks):
        hole = eccentric + x + 1j * y + centre[j] * np.exp(1j * disk)
        is_within = centre[j] * np.exp(1j * output) + eccentric * np.exp(1j * psi[j])
        rows = np.flatnonzero((reducer.contacts.hole == j) & (reducer.contacts.kind == OUTPUT))
        direction = (reducer.contacts.point[rows] - eccentric - centre[j]) / 15.0
        expected = np.real(np.conj(direction) * (is_within - hole))
        np.testing.assert_allclose(closing_values[rows], expected, atol=1e-11)  # 1e-6 of them
        mesh = np.flatnonzero((reducer.contacts.interface == 1) & (reducer.contacts.end == j))
        rolled = pitch * (psi[j] - teeth * output)
        np.testing.assert_allclose(closing_values[mesh], [rolled, -rolled], atol=1e-15)


@pytest.mark.parametrize("cranks", [2, 3])
def test_the_ratio_follows_from_the_columns(cranks):
    reducer = nominal_reducer(PROFILE, carrier(cranks), CRANK)
    sun = np.zeros(len(reducer.contacts))
    meshes = reducer.contacts.interface == 1
    sun[meshes] = (1 - 2 * reducer.contacts.face[meshes]) * 45.0 * SUN / (SUN + PLANET)  # r1 along each flank
    motion, *_ = np.linalg.lstsq(reducer.contact_jacobian, -sun, rcond=None)
    np.testing.assert_allclose(reducer.contact_jacobian @ motion, -sun, atol=1e-10)  # all stay closed
    np.testing.assert_allclose(1 / motion[reducer.output_motion], 1 + PLANET * 40 / SUN, rtol=1e-10)
    np.testing.assert_allclose(motion[4:] / motion[3], -LOBES, rtol=1e-10)


@pytest.mark.parametrize("disks", [1, 2])
@pytest.mark.parametrize("cranks", [2, 3])
def test_the_play_of_crank_bearings_is_that_of_circles_in_holes_that_roll_about_the_pitch_point(cranks, disks):
    """Pins without gaps leave disk k the rotation d_k about its pitch point, e N from the axis.

    The hole of crank j moves by d_k i (c_j - e Z u), the eccentric in it by phi i (c_j + (1 + z1/z2) e u): of the
    carrier's angles phi for which their difference stays in the ring of rollers the largest, two numbers a disk.
    """
    reducer = nominal_reducer(PROFILE, carrier(cranks), CRANK, disks=disks)
    clearance = 1e-3 * np.random.default_rng(8).uniform(2.0, 10.0, (5, disks, cranks))
    zero = Errors.zero(PROFILE.pins, PROFILE.lobes, cranks, n=5)
    errors = replace(zero, hole_diameter=2 * clearance, roller_diameter=np.zeros((5, cranks * (16 + 2))))
    gap = gaps(PROFILE, reducer, errors, method="exact", disk_reading="radial", roller_reading="half_diameter")
    play = rigid_play(reducer, gap, np.full(5, 1.5)).backlash
    np.testing.assert_allclose(general_play(reducer, gap, np.full(5, 1.5)).backlash, play, rtol=1e-9)
    for sample in range(5):
        ends = []
        for k, pose in enumerate(reducer.disks):
            centre = carrier(cranks).centres() * np.exp(1j * pose.rotation)
            way = 1j * np.array([centre + (1 + SUN / PLANET) * pose.eccentric, -centre + LOBES * pose.eccentric])
            direction = np.exp(1j * (pose.rotation + 2 * np.pi * np.arange(16) / 16))
            closing = np.real(np.conj(direction)[:, None, None] * way).transpose(2, 0, 1).reshape(-1, 2)
            room = np.repeat(clearance[sample, k], 16)
            ends.append([-linprog([s, 0], closing, room, bounds=(None, None)).fun for s in (-1, 1)])
        np.testing.assert_allclose(play[sample], np.min(ends, axis=0).sum(), rtol=1e-8)


@pytest.mark.parametrize("cranks", [2, 3])
def test_backlash_of_the_first_stage_reaches_the_output_divided(cranks):
    reducer = nominal_reducer(PROFILE, carrier(cranks, backlash=30.0), CRANK)
    play = general_play(reducer, reducer.contacts.gap[None], np.full(1, 1.5))
    pitch = 45.0 * PLANET / (SUN + PLANET)
    np.testing.assert_allclose(play.backlash, 0.030 / pitch / (40 + SUN / PLANET), rtol=1e-7)


@pytest.mark.parametrize(("cranks", "disks"), [(2, 1), (3, 1), (2, 2), (3, 2), (2, 3)])
def test_play_without_input_bearings_is_that_of_the_general_program(cranks, disks):
    """Scattered gaps, some of which interfere: backlash, overlap and its verdict; poses forbid nothing."""
    reducer = nominal_reducer(PROFILE, carrier(cranks, backlash=30.0), CRANK, disks=disks)
    gap = reducer.contacts.gap + np.repeat([0.03, 0.0], 6)[:, None]
    gap = gap + np.random.default_rng(disks).normal(0, 0.006, (12, len(reducer.contacts)))
    play, program = rigid_play(reducer, gap, np.zeros(12)), general_play(reducer, gap, np.full((12, disks), 1.5))
    assert 0 < program.preloaded.sum() < 12
    np.testing.assert_array_equal(play.preloaded, program.preloaded)
    np.testing.assert_allclose(play.backlash, program.backlash, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(play.overlap, program.overlap, rtol=1e-9, atol=1e-13)
    for pose in (play.pose_plus, play.pose_minus):
        assert np.all(pose @ reducer.contact_jacobian.T <= gap + play.overlap[:, None] + 1e-12)
    alone = rigid_play(reducer, gap[7:8], np.zeros(1))  # an answer does not depend on the units before it
    np.testing.assert_array_equal(alone.pose_plus, play.pose_plus[7:8])


def test_programs_that_are_given_up_are_solved_by_the_general_one(monkeypatch):
    rng, solve = np.random.default_rng(8), vertex_program._solve
    rows, objective = rng.standard_normal((30, 4)), np.array([0.0, 0.0, 0.0, 1.0])
    limits = rng.uniform(-0.3, 3.0, (12, 30))
    points, exist = optimal_points(objective, rows, limits, np.zeros((12, 0)))

    def gives_up(*arguments, **names):
        solve(*arguments, **names)
        arguments[-1][:] = 2

    monkeypatch.setattr(vertex_program, "_solve", gives_up)
    others, others_exist = optimal_points(objective, rows, limits, np.zeros((12, 0)))
    np.testing.assert_array_equal(others_exist, exist)
    assert 0 < exist.sum() < 12
    np.testing.assert_allclose(others[exist] @ objective, points[exist] @ objective, rtol=1e-8)


def test_motions_of_discs_end_on_their_edges_where_the_objective_points():
    """Discs of the radii 0.5 and 1, then 1.5 and 0.2, beside an unknown that two rows hold within 7."""
    objective, rows = np.array([0.3, -0.4, 1.2, 0.5, -2.0]), np.outer([1.0, -1.0], np.eye(5)[4])
    points, exist = optimal_points(objective, rows, np.full((2, 2), 7.0), np.array([[0.5, 1.0], [1.5, 0.2]]))
    assert exist.all()
    for point, radii in zip(points, ((0.5, 1.0), (1.5, 0.2)), strict=True):
        ends = np.concatenate([radii[0] * np.array([0.6, -0.8]), radii[1] * np.array([12, 5]) / 13, [-7.0]])
        np.testing.assert_allclose(point, ends, atol=1e-4)
        assert objective @ point == pytest.approx(objective @ ends, rel=1e-8)


def test_a_motion_that_nothing_stops_is_no_play():
    rows = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
    with pytest.raises(ArithmeticError, match="unbounded"):
        optimal_points(np.array([0.0, -1.0]), rows, np.ones((1, 3)), np.zeros((1, 0)))


@pytest.mark.parametrize("cranks", [2, 3])
def test_bearings_of_two_perfect_disks_carry_the_closed_form(cranks):
    """Every contact a linear spring to both sides, so that no part of the solver is asked."""
    torque, mechanism = 4e5, carrier(cranks)
    reducer = nominal_reducer(PROFILE, mechanism, CRANK, disks=2)
    stiffness = np.where(reducer.contacts.kind == OUTPUT, K / 8, 2e5)
    load = np.eye(len(reducer.motions))[reducer.output_motion] * torque
    motion = np.linalg.solve(reducer.contact_jacobian.T @ (stiffness[:, None] * reducer.contact_jacobian), load)
    force = stiffness * (reducer.contact_jacobian @ motion)
    tangential = torque * PLANET * LOBES / (SUN + PLANET * 40) / (2 * cranks * 45.0)
    centres = mechanism.centres() * np.exp(1j * reducer.disks[0].rotation) / 45.0
    for k, rows in enumerate(reducer.output_rows):
        pins = reducer.disk_of_contact == k
        pins &= reducer.contacts.kind != OUTPUT
        on_pins = np.sum(force[pins] * reducer.contacts.normal[pins])
        for j in range(cranks):
            bearing = rows[(reducer.contacts.hole[rows] == j)]
            on_disk = -np.sum(force[bearing] * reducer.contacts.normal[bearing])
            expected = -on_pins / cranks + 1j * centres[j] * tangential
            assert abs(on_disk - expected) < 1e-9 * torque / 45.0


def test_a_ring_of_rollers_has_the_law_of_its_bearing_in_every_direction():
    mechanism = carrier(rollers=16)
    reducer = nominal_reducer(PROFILE, mechanism, CRANK)
    for exponent, scatter in ((1.0, 1e-12), (1.5, 4e-3)):
        laws = laws_of(mechanism, reducer, exponent)
        rows = np.flatnonzero((reducer.contacts.hole == 0) & (reducer.contacts.kind == OUTPUT))
        for direction in np.exp(1j * np.linspace(0, 1, 7)):
            depth = 0.02 * np.real(np.conj(-reducer.contacts.normal[rows]) * direction)
            pushed = laws[rows].force(depth)
            resultant = np.sum(pushed * -reducer.contacts.normal[rows]) / (K * 0.02**exponent)
            np.testing.assert_allclose(resultant, direction, atol=max(scatter, 1e-9))


@pytest.mark.parametrize("cranks", [2, 3])
def test_a_loaded_unit_is_in_balance_and_its_disk_carries_its_share(cranks):
    mechanism, torque = carrier(cranks, backlash=10.0), 4e5
    reducer = nominal_reducer(PROFILE, mechanism, CRANK)
    rng = np.random.default_rng(4)
    gap = reducer.contacts.gap + np.where(
        reducer.contacts.kind == OUTPUT, 2e-3, rng.uniform(0, 8e-3, (2, len(reducer.contacts)))
    )
    drive = drive_with(
        PROFILE, reducer, Bearing(K, 1.0), laws_of(mechanism, reducer), np.zeros(2 * (len(reducer.contacts),)), gap, 0
    )
    drive = replace(drive, bearing_clearance=np.full(2, 1.5), rated_torque=torque)
    cycle = LoadCycle.evenly(torque, 4, 1.0, (0.03, 0.5))
    states = solve_cycle(drive, cycle)
    assert states.converged.all()
    load = np.zeros((*states.force.shape[:2], len(reducer.motions)))
    load[..., reducer.output_motion] = cycle.state_torque
    np.testing.assert_allclose(states.force @ reducer.contact_jacobian, load, atol=1e-6 * torque)
    share = np.sum(states.force[..., : reducer.n_pins] * reducer.pins.arm, axis=2)
    expected = -cycle.state_torque * PLANET * LOBES / (SUN + PLANET * 40)
    np.testing.assert_allclose(share, np.broadcast_to(expected, share.shape), atol=1e-6 * torque)


@pytest.mark.parametrize("seed", range(6))
def test_the_first_basis_is_found_from_afar_where_the_objective_is_one_unknown(seed):
    rng = np.random.default_rng(seed)
    rows, objective = rng.normal(size=(40, 5)), np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    basis = vertex_program._basis_from_far(objective, rows)
    assert basis is not None
    vertex = np.linalg.solve(rows[basis], np.ones(5))
    best = linprog(-objective, A_ub=rows, b_ub=np.ones(40), bounds=(None, None))
    assert objective @ vertex == pytest.approx(-best.fun, rel=1e-8)
