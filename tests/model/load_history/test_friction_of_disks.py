"""Rubbing pins of several disks: equal disks are one under its share, and a loop takes energy."""

from dataclasses import replace

import numpy as np
import pytest
from drives import LINEAR, drive_with
from reducers import SMALL, equal_disks, laws_of_disks, pins_in_holes

from pipeline.model.contact.friction_elements import Sliders, pin_sliders
from pipeline.model.elements import Friction
from pipeline.model.equilibrium.blocks import with_axis_of_blocks, workspace
from pipeline.model.equilibrium.newton import ACCEPTED_RESIDUAL
from pipeline.model.equilibrium.primal_active_set import INTERIOR_STEPS, solved_afresh
from pipeline.model.equilibrium.solve import friction_of, solve
from pipeline.model.geometry.reducer import nominal_reducer
from pipeline.model.load_history.load_cycle import LoadCycle
from pipeline.model.load_history.response import respond

RATED = 12000.0  # [N mm]
OUTPUT = pins_in_holes(SMALL, 6, phase_deg=23.0)


def drive_of(disks, scatter=0.0):
    """One unit with gaps of 1 to 1 + ``scatter`` um."""
    reducer = nominal_reducer(SMALL, OUTPUT, 0.3, disks=disks)
    gap = 1e-3 * (1 + scatter * np.random.default_rng(1).uniform(size=(1, len(reducer.contacts))))
    laws = laws_of_disks(SMALL, reducer)
    return drive_with(SMALL, reducer, LINEAR, laws, equal_disks(reducer), gap, np.zeros((1, disks)))


def loop(disks, coefficient, torque=RATED, scatter=0.0):
    """Its response up to a torque [N mm]."""
    drive = drive_of(disks, scatter)
    sliders = pin_sliders(drive.reducer, drive.laws, coefficient, torque)
    drive = replace(drive, rated_torque=torque, elements=(Friction(sliders),))
    response = respond(drive, LoadCycle.evenly(torque, 12, 1.0, (0.03, 0.5, 1.0)))
    assert response.converged[0]
    return response


def dissipated(response):
    """Energy [N mm] of the closed loop from the first top to the last one."""
    closed = slice(int(np.flatnonzero(response.branch == 0)[-1]), None)
    return np.trapezoid(response.torque[closed], response.angle[0, closed])


@pytest.mark.parametrize("disks", [2, 3])
def test_equal_rubbing_disks_are_one_under_its_share_of_the_torque(disks):
    whole, part = loop(disks, 0.1), loop(1, 0.1, RATED / disks)
    assert np.ptp(part.angle) > 1e-4
    np.testing.assert_allclose(whole.angle, part.angle, rtol=0, atol=1e-9 * np.ptp(part.angle))
    np.testing.assert_allclose(dissipated(whole), disks * dissipated(part), rtol=1e-7)


@pytest.mark.parametrize("disks", [2, 3])
def test_the_loop_of_unequal_disks_takes_energy_which_vanishes_with_the_friction(disks):
    rough, smooth, hardly = (loop(disks, coefficient, scatter=2.0) for coefficient in (0.1, 0.001, 1e-9))
    energies = [dissipated(response) for response in (rough, smooth, hardly)]
    assert energies[0] > 30 * energies[1] > 0
    assert abs(energies[2]) < 1e-4 * energies[0]
    straight = [np.abs(response.angle - hardly.angle).max() for response in (rough, smooth)]
    assert 50 < straight[0] / straight[1] < 200  # in proportion to the coefficient


@pytest.mark.parametrize("disks", [1, 2])
def test_a_step_solved_from_no_start_is_that_of_newton(disks):
    drive, torque = drive_of(disks, scatter=2.0), np.array([0.5 * RATED])
    system, order = drive.elastic.full_system
    clearance, work = np.zeros((1, disks)), workspace(system)
    friction, room = friction_of(Sliders.none(len(system.arm)), order), with_axis_of_blocks(work)
    _, residual = solved_afresh(system, friction, torque[0], drive.gap[0, order], clearance[0], room)
    assert residual <= ACCEPTED_RESIDUAL
    newton = solve(drive.elastic, drive.gap, clearance, 1.01 * work.motion[None], torque)
    assert newton.iterations[0, 0] < INTERIOR_STEPS
    np.testing.assert_allclose(work.force, newton.force[0, 0, order], rtol=0, atol=1e-7 * np.max(newton.force))
    np.testing.assert_allclose(work.motion[-1], newton.motion[0, 0, -1], rtol=1e-7)
