"""Backlash, width and hysteresis loss: the rigid program, the elastic limit, and friction that changes no play."""

from dataclasses import replace

import numpy as np
import pytest
from drives import RATED, small_drive
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from reducers import MICROMETRE

from pipeline.model.contact.friction_elements import load_slider, output_sliders, pin_sliders
from pipeline.model.effects.compliance import LinearSpring
from pipeline.model.effects.creep import KelvinVoigt
from pipeline.model.elements import Friction
from pipeline.model.equilibrium.solve import solve
from pipeline.model.geometry.reducer import Bearing
from pipeline.model.geometry.rigid_play.rigid_backlash import general_play, rigid_play
from pipeline.model.load_history.load_cycle import LoadCycle
from pipeline.model.load_history.response import respond

MARKS = LoadCycle.evenly(RATED, 0, 1.0, (0.03, 0.5, 1.0))
ARCMIN = np.pi / 180 / 60
NO_SHRINKING = (Phase.explicit, Phase.generate)
CLEARANCES = st.sampled_from([0.0, 4 * MICROMETRE])
FRICTION = {
    "coulomb": lambda drive: output_sliders(drive.reducer, np.array([150.0]), np.array([1e-6])),
    "load": lambda drive: load_slider(drive.reducer, 0.1, RATED, 1e-6),
    "pins": lambda drive: pin_sliders(drive.reducer, drive.laws, 0.1, RATED),
    "pins_and_coulomb": lambda drive: pin_sliders(drive.reducer, drive.laws, 0.05, RATED).with_others(
        output_sliders(drive.reducer, np.array([100.0]), np.array([1e-6]))
    ),
}
DRIVES = st.fixed_dictionaries(
    {
        "seed": st.integers(0, 10**6),
        "floats": st.booleans(),
        "play": st.floats(-6 * MICROMETRE, 8 * MICROMETRE),
        "crank": st.floats(0, 6.3),
        "bearing": st.sampled_from([Bearing(2e5, 1.0), Bearing(4e6, 1.5)]),
    }
)


@settings(max_examples=20, phases=NO_SHRINKING)
@given(given_drive=DRIVES, kind=st.sampled_from(sorted(FRICTION)), clearance=CLEARANCES)
def test_friction_changes_no_backlash_and_widens_the_loop(given_drive, kind, clearance):
    """But for pins in a disk with a loose bearing, whose friction may hold it short of the end of its play."""
    drive = small_drive(2, clearance=clearance, **given_drive)
    free = respond(drive, MARKS)
    rubbing = respond(replace(drive, elements=(Friction(FRICTION[kind](drive)),)), MARKS)
    np.testing.assert_array_equal(free.hysteresis_loss, 0.0)
    np.testing.assert_allclose(rubbing.clearance_backlash, free.clearance_backlash, rtol=0, atol=1e-7 * ARCMIN)
    converged = rubbing.converged & free.converged
    short = -2e-3 * free.clearance_backlash[converged] if clearance and kind.startswith("pins") else 0.0
    assert np.all(rubbing.hysteresis_loss[converged] >= short)


@settings(max_examples=20, phases=NO_SHRINKING)
@given(given_drive=DRIVES, clearance=CLEARANCES)
def test_backlash_is_the_rigid_program_where_feasible_and_the_limit_of_small_torques_everywhere(given_drive, clearance):
    """The program is HiGHS' on the whole chain; solves at ever smaller torques come down to the same."""
    drive = small_drive(2, clearance=clearance, **given_drive)
    response = respond(drive, MARKS)
    program = general_play(drive.reducer, drive.gap, drive.bearing_clearance)
    feasible = ~program.preloaded
    np.testing.assert_allclose(
        response.clearance_backlash[feasible], program.backlash[feasible], rtol=0, atol=1e-6 * ARCMIN
    )
    start, turn = np.zeros((2, len(drive.reducer.motions))), drive.reducer.output_motion
    minus, plus = (
        solve(drive.elastic, drive.gap, drive.bearing_clearance, start, np.array([1e-2, 1e-4, 1e-6]) * sense * RATED)
        for sense in (-1, 1)
    )
    excess = (plus.motion - minus.motion)[:, :, turn] - response.clearance_backlash[:, None]
    converged = np.all(plus.converged & minus.converged, axis=1) & response.converged
    assert np.all(np.diff(excess[converged], axis=1) < 0)
    assert np.all(excess[converged] > -1e-6 * ARCMIN)
    assert np.all(excess[converged, -1] < 0.03 * ARCMIN)


def test_preload_of_the_pins_leaves_less_play_than_the_other_parts_have_alone():
    """Pins that squeeze an elastic disk close the slots of its rollers; rigid parts that interfere are left out."""
    drive = small_drive(1, scale=0.0, play=0.0, seed=3)
    shift = np.where(np.arange(drive.gap.shape[1]) < drive.reducer.n_pins, -3 * MICROMETRE, 3 * MICROMETRE)
    response = respond(replace(drive, shift=drive.shift + shift), MARKS)
    parts = rigid_play(drive.reducer, drive.gap + shift, np.zeros(1))
    assert parts.preloaded[0]
    assert 0.0 <= response.clearance_backlash[0] < parts.backlash[0]
    assert abs(response.clearance_backlash[0] - parts.backlash[0]) > 1e-3 * ARCMIN


@pytest.mark.parametrize("kind", [None, "coulomb", "pins"])
def test_metric_torques_alone_give_the_points_of_the_full_cycle(kind):
    drive = small_drive(2, seed=5)
    if kind:
        drive = replace(drive, elements=(Friction(FRICTION[kind](drive)),))
    full, brief = (respond(drive, LoadCycle.evenly(RATED, levels, 1.0, (0.03, 0.5, 1.0))) for levels in (10, 0))
    assert np.all(full.converged)
    assert np.all(brief.converged)
    scale = np.ptp(full.angle)
    for branch in range(5):
        for torque in brief.torque[brief.branch == branch]:
            points = [np.flatnonzero((item.branch == branch) & (item.torque == torque))[0] for item in (full, brief)]
            np.testing.assert_allclose(
                full.angle[:, points[0]], brief.angle[:, points[1]], rtol=0, atol=(2e-3 if kind else 1e-8) * scale
            )


def test_width_under_constant_friction_is_the_curve_between_its_torques():
    """Unloaded to T the reducer still carries T + f, in closed form on the frictionless curve."""
    drive, torque = small_drive(2, seed=7), 200.0
    sliders = output_sliders(drive.reducer, np.array([torque]), np.array([1e-9]))
    rubbing = respond(replace(drive, elements=(Friction(sliders),)), MARKS)
    carried_torque = respond(drive, LoadCycle(RATED, np.array([torque / RATED, 1.0])))
    loading_branch, unloading = (np.flatnonzero(carried_torque.torque == sense * torque)[0] for sense in (1, -1))
    np.testing.assert_allclose(
        rubbing.zero_torque_width,
        carried_torque.angle[:, loading_branch] - carried_torque.angle[:, unloading],
        rtol=3e-4,
    )


@pytest.mark.parametrize("kind", [None, "coulomb", "load", "pins"])
def test_torsion_turns_every_loaded_step_by_all_of_its_torque_and_no_play(kind):
    """The flange lies beyond the friction: what the reducer does not carry twists it, too."""
    drive = small_drive(1, seed=2)
    friction = (Friction(FRICTION[kind](drive)),) if kind else ()
    reference = respond(replace(drive, elements=friction), MARKS)
    twisted = respond(replace(drive, elements=(*friction, LinearSpring(2e-8))), MARKS)
    np.testing.assert_allclose((twisted.angle - reference.angle)[0], 2e-8 * reference.torque, rtol=1e-9, atol=1e-18)
    np.testing.assert_array_equal(twisted.play, reference.play)


def test_weak_friction_has_the_frictionless_curve():
    drive = small_drive(2, seed=9)
    weak = output_sliders(drive.reducer, np.array([1e-6]), np.array([1e-5]))
    free, rubbing = respond(drive, MARKS), respond(replace(drive, elements=(Friction(weak),)), MARKS)
    np.testing.assert_allclose(rubbing.angle, free.angle, rtol=0, atol=0.01 * ARCMIN)
    assert free.equilibria.force.shape[1] == 2 * (1 + len(MARKS.fractions))
    assert rubbing.equilibria.force.shape[1] == len(rubbing.torque)


def test_a_drive_that_creeps_is_refused():
    with pytest.raises(ValueError, match="no time"):
        respond(replace(small_drive(1), elements=(KelvinVoigt(1e-8, 3.0),)), MARKS)
