"""The list of contacts: which motion closes which contact, and that action equals reaction."""

import numpy as np
import pytest
from reducers import PAPER, SMALL, errors_of, reducer_at

from pipeline.model.geometry.clearance import exact_gaps
from pipeline.model.geometry.contacts import OUTPUT, PIN

CASES = pytest.mark.parametrize(("profile", "crank", "floats"), [(PAPER, 0.0, False), (SMALL, 1.1, True)])


@CASES
def test_a_motion_of_the_disk_closes_a_pin_as_the_opposite_motion_of_the_pins_does(profile, crank, floats):
    """Moving the disk by q is moving every pin by -q: the exact gaps of such pin errors fall by B q."""
    reducer = reducer_at(profile, crank, floats=floats)
    centre, arm_centre = reducer.pins.centre, profile.eccentricity * np.exp(1j * crank)
    for column, (name, step) in enumerate((("disk_x", 1e-7), ("disk_y", 1e-7), ("disk_phi", 1e-8))):
        assert reducer.motions[column] == name
        shift = -step * {"disk_x": 1.0 + 0j, "disk_y": 1j, "disk_phi": 1j * (centre - arm_centre)}[name]
        normal_part = np.broadcast_to(shift, centre.shape) * np.conj(centre) / np.abs(centre)
        errors = errors_of(profile, reducer, pin_radial=normal_part.real, pin_tangential=normal_part.imag)
        gap = exact_gaps(profile, reducer, errors, "radial")[0]
        jacobian = reducer.contact_jacobian[: profile.pins, column]
        np.testing.assert_allclose(-gap / step, jacobian, atol=2e-4 * np.abs(jacobian).max())


@CASES
def test_contacts_are_numbered_pins_first_and_each_row_from_outside_to_inside(profile, crank, floats):
    reducer = reducer_at(profile, crank, floats=floats)
    contacts = reducer.contacts
    assert np.all(contacts.kind[: profile.pins] == PIN)
    assert np.all(contacts.kind[profile.pins :] == OUTPUT)
    rows = np.abs(contacts.arm[profile.pins :]).reshape(8, -1)  # 2 interfaces, 2 faces, 2 ends
    assert np.all(np.diff(rows, axis=1) < 0)
    assert len(set(contacts.label)) == len(contacts)
    np.testing.assert_array_equal(
        contacts.interface[profile.pins :], np.repeat([0, 1], len(contacts.arm[profile.pins :]) // 2)
    )


@CASES
def test_rollers_press_across_their_slide_with_the_moment_of_their_place(profile, crank, floats):
    reducer = reducer_at(profile, crank, floats=floats)
    contacts, disk_centre = reducer.contacts, profile.eccentricity * np.exp(1j * crank)
    slide = np.exp(1j * (0.5 * np.pi - crank / (profile.pins - 1)))
    for interface, (direction, centre) in enumerate(((slide, disk_centre), (1j * slide, 0j))):
        rows = contacts.interface == interface
        np.testing.assert_allclose(np.real(np.conj(direction) * contacts.normal[rows]), 0, atol=1e-12)
        np.testing.assert_allclose(np.abs(contacts.normal[rows]), 1)
        position = contacts.point[rows] - centre
        np.testing.assert_allclose(np.imag(np.conj(position) * contacts.normal[rows]), contacts.arm[rows], atol=1e-12)
        transverse = np.real(np.conj(contacts.normal[rows]) * position)
        np.testing.assert_allclose(
            transverse, 5.0 if profile is PAPER else 2.0
        )  # outside the tongue: it pushes outwards
        assert np.count_nonzero(contacts.arm[rows] > 0) == np.count_nonzero(contacts.arm[rows] < 0)
        assert set(contacts.body_a[rows]) == {("disk", "plate")[interface]}
        assert set(contacts.body_b[rows]) == {("plate", "output")[interface]}


@CASES
def test_turning_the_whole_chain_or_shifting_both_sides_of_a_contact_closes_nothing(profile, crank, floats):
    reducer = reducer_at(profile, crank, floats=floats)
    rollers = reducer.contact_jacobian[profile.pins :]
    columns = {name: rollers[:, i] for i, name in enumerate(reducer.motions)}
    rotation = columns["disk_phi"] + columns["plate_phi"] + columns["output_phi"]
    np.testing.assert_allclose(rotation, 0, atol=1e-12)
    in_first_row = reducer.contacts.interface[profile.pins :] == 0
    if floats:
        for axis in "xy":
            np.testing.assert_allclose(
                (columns[f"disk_{axis}"] + columns[f"plate_{axis}"])[in_first_row], 0, atol=1e-12
            )
    assert reducer.motions[reducer.output_motion] == "output_phi"
    np.testing.assert_array_equal(columns["output_phi"][in_first_row], 0)


@CASES
def test_a_positive_output_torque_loads_half_of_each_slide_and_the_pins_of_negative_arm(profile, crank, floats):
    """The output pushed counterclockwise leans on the rollers that turn it back, and so does the disk on its pins."""
    reducer = reducer_at(profile, crank, floats=floats)
    output = reducer.contact_jacobian[:, reducer.output_motion]
    second = reducer.contacts.interface == 1
    np.testing.assert_array_equal(output[second], -reducer.contacts.arm[second])
    np.testing.assert_array_equal(
        reducer.contact_jacobian[: profile.pins, reducer.motions.index("disk_phi")], -reducer.pins.arm
    )
