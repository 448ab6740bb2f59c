"""Two and three disks: how they mesh, what each meets of the errors, and the play that they leave one output."""

from dataclasses import replace

import numpy as np
import pytest
from drives import LINEAR, RATED, drive_with
from reducers import PAPER, SMALL, equal_disks, errors_of, laws_of_disks, pins_in_holes

from pipeline.model.geometry.clearance import gaps
from pipeline.model.geometry.contacts import OUTPUT, PIN
from pipeline.model.geometry.cycloid_profile import CycloidProfile, disk_rotation
from pipeline.model.geometry.reducer import Bearing, nominal_reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play, rigid_play, separated_play
from pipeline.model.load_history.load_cycle import LoadCycle, first_poses, solve_cycle

EVEN_LOBES = CycloidProfile(pins=13, pin_circle_radius=10.0, pin_radius=1.0, eccentricity=0.5)
CASES = pytest.mark.parametrize(
    ("profile", "disks", "crank"), [(SMALL, 2, 0.3), (SMALL, 3, 1.1), (EVEN_LOBES, 2, 4.0), (PAPER, 3, 2.3)]
)
READING = {"disk_reading": "radial", "roller_reading": "half_diameter"}


def reducer_at(profile, crank, disks, pins=6):
    mechanism = pins_in_holes(profile, pins, phase_deg=23.0)
    return mechanism, nominal_reducer(profile, mechanism, crank, disks=disks)


def angles(reducer):
    """Directions of the eccentrics [rad]."""
    return [pose.crank for pose in reducer.disks]


def errors_of_disks(profile, reducer, n=1, **arguments):
    """Zero errors but for those given [mm]; one diameter of each output pin, however many disks it reaches through."""
    per_pin = np.count_nonzero(reducer.contacts.kind == OUTPUT) // reducer.n_disks
    zero = errors_of(profile, reducer, n)
    zero = replace(zero, roller_diameter=np.zeros((n, per_pin)))
    return replace(zero, **{name: np.zeros_like(getattr(zero, name)) + value for name, value in arguments.items()})


@CASES
def test_every_disk_meshes_at_its_own_eccentric_and_all_holes_leave_the_output_pins_free(profile, disks, crank):
    mechanism, reducer = reducer_at(profile, crank, disks)
    assert reducer.motions[: 2 * disks + 1] == (
        *(f"disk {k}_{axis}" for k in range(disks) for axis in "xy"),
        "disk 0_phi",
    )
    np.testing.assert_allclose(np.diff(angles(reducer)), 2 * np.pi / disks)
    for method in ("exact", "first_order"):
        gap = gaps(profile, reducer, errors_of_disks(profile, reducer), method=method, **READING)
        np.testing.assert_allclose(gap, 0, atol=1e-12)
    output_pins = mechanism.centres() * np.exp(1j * disk_rotation(profile, crank))
    wall = mechanism.hole_radius(profile.eccentricity)
    for disk, angle in enumerate(angles(reducer)):
        holes = profile.eccentricity * np.exp(1j * angle) + output_pins
        contacts = np.flatnonzero((reducer.disk_of_contact == disk) & (reducer.contacts.kind == OUTPUT))
        np.testing.assert_allclose(np.abs(reducer.contacts.point[contacts] - holes), wall)
        np.testing.assert_allclose(np.abs(reducer.contacts.point[contacts] - output_pins), mechanism.pin_radius_mm)


@CASES
def test_a_disk_feels_its_own_motions_as_if_it_were_alone(profile, disks, crank):
    _, reducer = reducer_at(profile, crank, disks)
    for disk, angle in enumerate(angles(reducer)):
        rows, other_contacts = reducer.disk_of_contact == disk, reducer.disk_of_contact != disk
        columns = [reducer.motions.index(f"disk {disk}_{name}") for name in ("x", "y", "phi")]
        assert not np.any(reducer.contact_jacobian[np.ix_(other_contacts, columns)])
        _, isolated = reducer_at(profile, angle, 1)
        pins = rows & (reducer.contacts.kind == PIN)
        np.testing.assert_allclose(
            reducer.contact_jacobian[np.ix_(pins, columns)], isolated.contact_jacobian[: profile.pins, :3], atol=1e-12
        )
    assert list(reducer.contacts.kind) == [PIN] * reducer.n_pins + [OUTPUT] * (len(reducer.contacts) - reducer.n_pins)


@CASES
@pytest.mark.parametrize("method", ["exact", "first_order"])
def test_a_disk_meets_the_shared_pins_and_its_own_errors(profile, disks, crank, method):
    """Gaps of a disk are those of a reducer of that disk alone, with its eccentric's phase as a turn of the crank."""
    rng, n = np.random.default_rng(disks), 2
    _, reducer = reducer_at(profile, crank, disks)
    pins = {
        name: 2e-3 * rng.uniform(-1, 1, (n, profile.pins)) for name in ("pin_radial", "pin_tangential", "pin_radius")
    }
    lobe, eccentricity = 2e-3 * rng.uniform(0, 1, (n, disks, profile.lobes)), 1e-3 * rng.uniform(-1, 1, (n, disks))
    diameter, phase = 2e-3 * rng.uniform(-1, 1, (n, 6)), np.zeros((n, disks))
    errors = {"eccentricity": eccentricity, "eccentric_phase": phase, "roller_diameter": diameter}
    whole = replace(errors_of_disks(profile, reducer, n), **pins, **errors, lobe=lobe)
    computed_gaps = gaps(profile, reducer, whole, method=method, **READING)
    for disk, angle in enumerate(angles(reducer)):
        _, isolated = reducer_at(profile, angle, 1)
        own_value = {"lobe": lobe[:, disk], "eccentricity": eccentricity[:, disk], "eccentric_phase": np.zeros(n)}
        expected = gaps(profile, isolated, replace(whole, **own_value), method=method, **READING)
        np.testing.assert_allclose(computed_gaps[:, reducer.disk_of_contact == disk], expected, atol=1e-13)


@pytest.mark.parametrize("disk", [0, 1])
def test_the_phase_of_an_eccentric_is_a_turn_of_its_crank_and_a_rotation_of_the_disk(disk):
    """Brute force: at the crank where its eccentric stands, the nominal disk has no gap once it has turned there."""
    way, crank = 20e-3, 0.7
    mechanism, reducer = reducer_at(SMALL, crank, 2)
    phase = np.zeros((1, 2))
    phase[0, disk] = way
    computed_gaps = gaps(
        SMALL, reducer, replace(errors_of_disks(SMALL, reducer), eccentric_phase=phase), method="exact", **READING
    )[0]
    other_contacts = reducer.disk_of_contact != disk
    np.testing.assert_allclose(computed_gaps[other_contacts], 0, atol=1e-12)
    angle = angles(reducer)[disk]
    centre = SMALL.eccentricity * np.exp(1j * angle) + way * 1j * np.exp(1j * angle)
    psi = np.linspace(0, 2 * np.pi, 400_001)
    flank = SMALL.flank(psi) * np.exp(1j * disk_rotation(SMALL, angle)) + centre
    pins = reducer.pins.centre[: SMALL.pins]
    nearest = np.array([np.min(np.abs(flank - pin)) for pin in pins]) - SMALL.pin_radius
    own_pins = (reducer.disk_of_contact == disk) & (reducer.contacts.kind == PIN)
    np.testing.assert_allclose(computed_gaps[own_pins], nearest, atol=2e-8)
    holes = mechanism.centres() * np.exp(1j * disk_rotation(SMALL, crank)) + centre
    stand_off = np.abs(holes - mechanism.centres() * np.exp(1j * disk_rotation(SMALL, crank)))
    own_holes = (reducer.disk_of_contact == disk) & (reducer.contacts.kind == OUTPUT)
    np.testing.assert_allclose(computed_gaps[own_holes], SMALL.eccentricity - stand_off, atol=1e-14)
    # the disk closes every gap by turning with its eccentric, to the second order of the turn
    turn = -way / (SMALL.eccentricity * SMALL.lobes)
    residuals = computed_gaps - turn * reducer.contact_jacobian[:, reducer.motions.index(f"disk {disk}_phi")]
    np.testing.assert_allclose(residuals[own_pins], 0, atol=5 * way**2)


@CASES
def test_separated_play_is_the_general_programs(profile, disks, crank):
    _, reducer = reducer_at(profile, crank, disks)
    gap = np.random.default_rng(1).uniform(1e-3, 12e-3, (12, len(reducer.contacts)))
    tight = np.zeros(len(gap))
    separated, general = separated_play(reducer, gap), general_play(reducer, gap, tight)
    np.testing.assert_allclose(separated.backlash, general.backlash, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(separated.overlap, general.overlap, rtol=1e-8, atol=1e-13)
    for pose in (separated.pose_plus, separated.pose_minus):
        penetration = (pose @ reducer.contact_jacobian.T - gap).max(axis=1)
        np.testing.assert_allclose(penetration, separated.overlap, atol=1e-12)
    # disks that work against each other though each has play of its own
    gap[:, reducer.disk_of_contact == 1] += (
        12e-3 * reducer.contact_jacobian[reducer.disk_of_contact == 1, reducer.motions.index("output_phi")]
    )
    separated, general = separated_play(reducer, gap), general_play(reducer, gap, tight)
    assert np.count_nonzero(separated.preloaded) > 3
    np.testing.assert_allclose(separated.overlap, general.overlap, rtol=1e-8, atol=1e-13)
    for pose in (separated.pose_plus, separated.pose_minus):
        np.testing.assert_allclose((pose @ reducer.contact_jacobian.T - gap).max(axis=1), separated.overlap, atol=1e-11)
    # and one of them too large among its pins
    gap[:, (reducer.disk_of_contact == 0) & (reducer.contacts.kind == PIN)] -= 20e-3
    separated, general = separated_play(reducer, gap), general_play(reducer, gap, tight)
    assert np.all(separated.preloaded)
    np.testing.assert_allclose(separated.overlap, general.overlap, rtol=1e-8, atol=1e-13)


@pytest.mark.parametrize("disks", [2, 3])
def test_a_phase_error_of_one_eccentric_takes_its_turn_of_the_output_off_the_play(disks):
    """Closed form: the interval of that disk moves by s/(e lobes) against the others', which are all alike."""
    crank, clearance = 0.9, 10e-3
    _, reducer = reducer_at(EVEN_LOBES, crank, disks)
    symmetric = errors_of_disks(EVEN_LOBES, reducer, 1, pin_radius=-clearance, roller_diameter=-2 * clearance)
    free = separated_play(reducer, gaps(EVEN_LOBES, reducer, symmetric, method="first_order", **READING)).backlash[0]
    # the plays of disks at other phases of the pins differ: the least of each sense counts
    for way in (0.0, 4e-3, -4e-3, 12e-3):
        phase = np.zeros((1, disks))
        phase[0, 1] = way
        errors = replace(symmetric, eccentric_phase=phase)
        gap = gaps(EVEN_LOBES, reducer, errors, method="first_order", **READING)
        ends = []
        for disk in range(disks):
            rows = reducer.disk_of_contact == disk
            pins, holes = rows & (reducer.contacts.kind == PIN), rows & (reducer.contacts.kind == OUTPUT)
            shift = -(way if disk == 1 else 0.0) / (EVEN_LOBES.eccentricity * EVEN_LOBES.lobes)
            lateral_shift = shift**2 * EVEN_LOBES.eccentricity * EVEN_LOBES.lobes**2 / 2  # of the holes, second order
            parts = ((clearance, reducer.contacts.arm[pins]), (clearance - lateral_shift, reducer.contacts.arm[holes]))
            ends.append([sense * sum(room / np.max(-sense * arm) for room, arm in parts) + shift for sense in (1, -1)])
        expected = np.min(ends, axis=0)[0] - np.max(ends, axis=0)[1]
        play = separated_play(reducer, gap)
        assert play.backlash[0] == pytest.approx(expected, rel=1e-6)
        assert play.backlash[0] <= free * (1 + 1e-12)


def test_each_disk_is_free_within_its_own_bearing():
    _, reducer = reducer_at(SMALL, 0.3, 2)
    gap = np.random.default_rng(3).uniform(1e-3, 12e-3, (4, len(reducer.contacts)))
    clearance = np.array([[0.0, 0.0], [2e-3, 0.0], [0.0, 3e-3], [2e-3, 3e-3]])
    play = rigid_play(reducer, gap, clearance)
    for pose in (play.pose_plus, play.pose_minus):
        assert np.all((pose @ reducer.contact_jacobian.T - gap).max(axis=1) <= 1e-12)
        reach = np.hypot(pose[:, [0, 2]], pose[:, [1, 3]])
        assert np.all(reach <= clearance * (1 + 1e-9) + 1e-13)
    wider = [rigid_play(reducer, gap[[0]], clearance[[k]]).backlash[0] for k in range(4)]
    assert wider[0] <= min(wider[1], wider[2]) <= max(wider[1], wider[2]) <= wider[3]
    assert wider[3] > wider[0] * 1.01
    equal_backlash = rigid_play(reducer, gap, np.full(4, 2e-3)).backlash
    np.testing.assert_array_equal(equal_backlash, rigid_play(reducer, gap, np.full((4, 2), 2e-3)).backlash)


def loaded(profile, reducer, torques, gap=0.0):
    """Frictionless equilibria of one unit at ascending torques of one sense [N mm]."""
    gaps_of_contacts = np.full((1, len(reducer.contacts)), gap)
    drive = drive_with(
        profile, reducer, LINEAR, laws_of_disks(profile, reducer), equal_disks(reducer), gaps_of_contacts, np.zeros(1)
    )
    play = separated_play(reducer, gaps_of_contacts)
    pose = play.pose_plus if torques[0] > 0 else play.pose_minus
    return drive.equilibria(first_poses(drive, pose, torques[0]), torques)


@pytest.mark.parametrize(("profile", "disks"), [(SMALL, 2), (SMALL, 3), (PAPER, 2)])
@pytest.mark.parametrize("gap", [0.0, 2e-3])
def test_perfect_disks_carry_equal_shares_and_turn_as_one_does_under_its_share(profile, disks, gap):
    """Where the number of disks divides pins and holes they are one picture turned, and nothing shared gives way."""
    _, reducer = reducer_at(profile, 0.3, disks)
    _, isolated = reducer_at(profile, 0.3, 1)
    torques = np.array([300.0, 3000.0, 12000.0])
    for sense in (1, -1):
        whole, part = (
            loaded(profile, reducer, sense * torques, gap),
            loaded(profile, isolated, sense * torques / disks, gap),
        )
        assert np.all(whole.converged)
        assert np.all(part.converged)
        output = reducer.contact_jacobian[:, reducer.output_motion]
        carried_torque = [
            whole.force[0][:, reducer.disk_of_contact == k] @ output[reducer.disk_of_contact == k] for k in range(disks)
        ]
        for of_disk in carried_torque:
            np.testing.assert_allclose(of_disk, sense * torques / disks, rtol=1e-9)
        np.testing.assert_allclose(
            whole.motion[0, :, reducer.output_motion], part.motion[0, :, isolated.output_motion], rtol=1e-9
        )
        thrust = reducer.thrust(whole.force)[0]
        np.testing.assert_allclose(thrust, np.repeat(isolated.thrust(part.force)[0], disks, axis=1), rtol=1e-8)


@pytest.mark.parametrize("disks", [2, 3])
def test_a_disk_that_carries_nothing_is_let_go_without_another_start(disks, monkeypatch):
    """Its contacts touch with rounding alone, none of which is balanced: that is no imbalance of the reducer."""
    monkeypatch.setattr("pipeline.model.equilibrium.solve.solved_afresh", lambda *_: pytest.fail("started again"))
    _, reducer = reducer_at(SMALL, 0.3, disks)
    gap = np.where(reducer.disk_of_contact == 0, 0.0, 0.05)[None]
    compliance = equal_disks(reducer)
    drive = drive_with(SMALL, reducer, LINEAR, laws_of_disks(SMALL, reducer), compliance, gap, np.zeros(1))
    torques = np.array([300.0, 900.0, 2000.0])
    start = first_poses(drive, separated_play(reducer, gap).pose_plus, torques[0])
    last_rotation = reducer.motions.index(f"disk {disks - 1}_phi")
    idle = reducer.disk_of_contact == disks - 1
    for pressed_in in (1e-3, 2e-2):  # the last disk's deepest contact [mm], at the start
        turned = start.copy()
        arm = reducer.contact_jacobian[idle, last_rotation]
        depth = reducer.contact_jacobian[idle] @ start[0] - gap[0, idle]
        turned[0, last_rotation] += np.min(((pressed_in - depth) / arm)[arm > 0.1])
        states = drive.equilibria(turned, torques)
        assert np.all(states.converged)
        assert np.all(states.force[0][:, reducer.disk_of_contact != 0] == 0)
        carried = states.force[0] @ reducer.contact_jacobian[:, reducer.output_motion]
        np.testing.assert_allclose(carried, torques, rtol=1e-9)


LOOSE = [(2e-3, 1.0), (0.0, 1.5), (2e-3, 1.5)]
"""Clearance [mm] and exponent of every bearing."""


def on_bearings(profile, reducer, torques, clearance, exponent, gap=1e-3):
    """Equilibria of one unit whose bearings have these clearances (1, n_disks) [mm], at ascending torques [N mm]."""
    gaps_of_contacts = np.full((1, len(reducer.contacts)), gap)
    springs = Bearing(LINEAR.stiffness, exponent), laws_of_disks(profile, reducer), equal_disks(reducer)
    drive = drive_with(profile, reducer, *springs, gaps_of_contacts, clearance)
    play = rigid_play(reducer, gaps_of_contacts, clearance)
    states = drive.equilibria(first_poses(drive, play.pose_plus, torques[-1]), torques[::-1])
    assert np.all(states.converged)
    return replace(states, motion=states.motion[:, ::-1], force=states.force[:, ::-1])


def thrust_on_eccentrics(reducer, force):
    """Force on each bearing (..., n_disks) [N], complex, its real part along the eccentric."""
    resultant = (force @ reducer.planar).reshape(*force.shape[:-1], reducer.n_disks, 2)
    return (resultant[..., 0] + 1j * resultant[..., 1]) * np.exp(-1j * np.array(angles(reducer)))


@pytest.mark.parametrize(("clearance", "exponent"), LOOSE)
@pytest.mark.parametrize(("profile", "disks"), [(SMALL, 2), (SMALL, 3)])
def test_equal_disks_on_equal_loose_bearings_share_the_torque(profile, disks, clearance, exponent):
    """Each is one disk under its share; across its eccentric a bearing bears T/(n_disks e Z), whatever else."""
    (_, reducer), (_, isolated) = (reducer_at(profile, 0.3, count) for count in (disks, 1))
    torques = np.array([300.0, 3000.0, 12000.0])
    whole = on_bearings(profile, reducer, torques, np.full((1, disks), clearance), exponent)
    part = on_bearings(profile, isolated, torques / disks, np.full((1, 1), clearance), exponent)
    rotation = whole.motion[0, :, reducer.output_motion]
    np.testing.assert_allclose(rotation, part.motion[0, :, isolated.output_motion], rtol=1e-8)
    thrust = thrust_on_eccentrics(reducer, whole.force)[0]
    single_thrust = thrust_on_eccentrics(isolated, part.force)[0]
    np.testing.assert_allclose(thrust, np.repeat(single_thrust, disks, axis=1), atol=1e-7 * np.max(np.abs(thrust)))
    across = torques / (disks * profile.eccentricity * profile.lobes)
    np.testing.assert_allclose(np.abs(thrust.imag), np.repeat(across[:, None], disks, axis=1), rtol=1e-8)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_each_disk_leans_on_its_own_bearing_by_its_law(exponent):
    """F = K (d - c)^n of each, with a clearance of its own; the moments of the bearings balance the torque."""
    _, reducer = reducer_at(SMALL, 0.3, 3)
    clearance, torques = np.array([[0.0, 1e-3, 4e-3]]), np.array([300.0, 3000.0, 12000.0])
    states = on_bearings(SMALL, reducer, torques, clearance, exponent)
    shift = states.motion[0, :, :6].reshape(3, 3, 2)
    depth = np.maximum(np.hypot(shift[..., 0], shift[..., 1]) - clearance, 0.0)
    thrust = thrust_on_eccentrics(reducer, states.force)[0]
    np.testing.assert_allclose(
        LINEAR.stiffness * depth**exponent, np.abs(thrust), atol=1e-6 * np.max(np.abs(thrust)), rtol=1e-6
    )
    moment = SMALL.eccentricity * np.abs(np.sum(thrust.imag, axis=1))
    np.testing.assert_allclose(moment, torques / SMALL.lobes, rtol=1e-8)
    assert np.ptp(np.abs(thrust[1])) > 0.02 * np.max(np.abs(thrust[1]))


def test_units_of_three_disks_on_loose_bearings_all_find_equilibrium():
    """Where a disk carries nothing its bearing and its one contact balance in rounding: six of these had no state."""
    _, reducer = reducer_at(SMALL, 0.3, 3)
    rng = np.random.default_rng(3)
    gap = np.abs(rng.normal(2e-3, 1e-3, (60, len(reducer.contacts))))
    clearance = rng.uniform(1e-3, 6e-3, (60, 3))
    springs = Bearing(LINEAR.stiffness, 1.5), laws_of_disks(SMALL, reducer), equal_disks(reducer)
    drive = drive_with(SMALL, reducer, *springs, gap, clearance)
    cycle = LoadCycle.evenly(12000.0, 0, 1.0, (0.03, 0.5, 1.0))
    states = solve_cycle(drive, cycle)
    assert np.all(states.converged)
    carried = states.force @ reducer.contact_jacobian[:, reducer.output_motion]
    np.testing.assert_allclose(carried, np.broadcast_to(cycle.state_torque, carried.shape), atol=1e-5)
    disks = np.arange(3) == reducer.disk_of_contact[:, None]
    assert np.any((states.force @ disks)[:, cycle.state_torque != 0] == 0)  # else the case is another one


def test_the_play_beside_a_preloaded_disk_ends_where_a_small_torque_does():
    """Forces of the limit are 1e-8 of the preload's: from the end of rigid bodies its rounding hid which side holds."""
    _, reducer = reducer_at(PAPER, 5.05, 3)
    gap = np.full((1, len(reducer.contacts)), -4e-3)
    springs = Bearing(1.2e6, 1.5), laws_of_disks(PAPER, reducer), equal_disks(reducer)
    drive = drive_with(PAPER, reducer, *springs, gap, np.array([[3e-3, 9e-3, 2.5e-3]]))
    assert rigid_play(reducer, gap, drive.bearing_clearance).preloaded[0]
    angles = [
        solve_cycle(drive, LoadCycle(RATED, np.array(shares))).motion[0, :, reducer.output_motion]
        for shares in ([0.03, 1.0], [1e-5, 1.0])
    ]
    turn = np.ptp(angles[0])
    limits, small_torques = angles[0][[0, 3]], angles[1][[1, 4]]
    assert limits[0] - limits[1] > 0.1 * turn
    np.testing.assert_allclose(limits, small_torques, rtol=0, atol=1e-3 * turn)
