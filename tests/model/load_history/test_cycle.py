"""The load cycle: its path, the numbers read off curves of known answers, and the limits of no torque and no gaps."""

import numpy as np
import pytest
from drives import drive_with
from hypothesis import given, settings
from hypothesis import strategies as st
from reducers import ARCMIN, PAPER, SMALL, laws_of, random_compliance, random_errors, reducer_at

from pipeline.model.equilibrium.solve import ElasticReducer, solve
from pipeline.model.geometry.clearance import Errors, gaps
from pipeline.model.geometry.reducer import Bearing
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.load_history.load_cycle import BRANCHES, LoadCycle, solve_cycle
from pipeline.model.load_history.loop_readings import curve_readings
from pipeline.model.metrics import Definitions, library

RATED = 12000.0  # [N mm]
CYCLE = LoadCycle.evenly(RATED, 4, 1.0, (0.03, 0.5, 1.0))


def curve(cycle, angle_of, friction=0.0):
    """Branch names, torque [N m] and angle of the cycle's steps: ``angle_of(torque, sense)`` with a lag by friction
    on both branches, which grows towards the positive end."""
    branch, state = cycle.steps
    torque = cycle.state_torque[state] / 1e3
    sense = np.where(state < len(cycle.state_torque) // 2, 1, -1)
    lag = np.array([-friction, friction, friction, -friction, -friction])[branch] * (1 + torque / 24)
    return np.array(BRANCHES)[branch], torque, (angle_of(torque, sense) + lag)[None]


@pytest.mark.parametrize("levels", [0, 2, 12])
def test_cycle_runs_up_back_down_back_and_up_again_through_every_level(levels):
    cycle = LoadCycle.evenly(RATED, levels, 1.0, (0.03, 0.5, 1.0))
    branch, state = cycle.steps
    torque = cycle.state_torque[state]
    count = len(cycle.fractions)
    assert np.all(np.diff(cycle.fractions) > 0)
    steps = [k / levels for k in range(1, levels + 1)]  # none: the torques of the metrics alone
    for mark in (0.03, 0.5, 1.0, *steps):
        assert np.min(np.abs(cycle.fractions - mark)) < 1e-12
    assert count == len({round(f, 9) for f in (0.03, 0.5, 1.0, *steps)})
    loading_branch = np.concatenate([[0.0], RATED * cycle.fractions])
    path = [loading_branch, loading_branch[-2::-1], -loading_branch, -loading_branch[-2::-1], loading_branch]
    np.testing.assert_array_equal(torque, np.concatenate(path))
    np.testing.assert_array_equal(branch, np.repeat(np.arange(5), [len(p) for p in path]))
    zeros = state[torque == 0]  # out of the play at 0+, back to it, out at 0-, back to it, out at 0+
    assert zeros.tolist() == [0, 0, count + 1, count + 1, 0]
    if levels == 12:
        assert np.count_nonzero(np.diff(torque)) >= 60


def test_levels_of_a_partial_cycle_and_marks_above_its_top():
    cycle = LoadCycle.evenly(RATED, 5, 0.5, (0.03, 0.25, 0.5))
    np.testing.assert_allclose(cycle.fractions, [0.03, 0.1, 0.2, 0.25, 0.3, 0.4, 0.5])
    np.testing.assert_allclose(LoadCycle.evenly(RATED, 7, 0.7, (0.1, 0.3)).fractions, 0.1 * np.arange(1, 8))
    with pytest.raises(ValueError, match="needs 0.6 of the rated torque, the cycle ends at 0.5"):
        LoadCycle.evenly(RATED, 5, 0.5, (0.03, 0.6))


@settings(max_examples=20)
def curve_metrics(branch, torque, angle, *levels):
    """Every metric of curves without friction's limits, read at torques [N m]."""
    definitions, n = Definitions(*levels), len(angle)
    readings = curve_readings(branch, torque, angle, np.zeros((n, 2)), np.zeros(n), definitions)
    return {name: metric.value(readings, definitions) for name, metric in library().items()}


@given(
    play=st.floats(0, 10),
    friction=st.floats(0, 2),
    stiff=st.floats(0.5, 6),
    variant=st.floats(0.5, 6),
    kink=st.floats(0.1, 2.0),
)
def test_metrics_of_a_loop_with_play_friction_and_two_stiffnesses(play, friction, stiff, variant, kink):
    """Angle = +-play/2 + T/stiffness beyond a soft start ``kink`` up to 6 N m, lagging by the friction."""

    def angle(torque, sense):
        stiffness = np.where(sense > 0, stiff, variant)
        return sense * (0.5 * play + kink * np.minimum(np.abs(torque), 6.0) / 6.0) + torque / stiffness

    branch, torque, angles = curve(CYCLE, angle, friction)
    metrics = curve_metrics(branch, torque, np.vstack([angles, 2 * angles]), 0.36, 6.0, 12.0)
    width = play + 2 * friction
    assert metrics["zero_torque_width_arcmin"] == pytest.approx([width, 2 * width], abs=1e-12)
    lost_motion = play + 0.36 * (1 / stiff + 1 / variant) + 2 * kink * 0.06
    assert metrics["lost_motion_arcmin"] == pytest.approx([lost_motion, 2 * lost_motion], rel=1e-12)
    rigidity = 3 / (6 / stiff - friction / 4) + 3 / (6 / variant + friction / 4)
    assert metrics["torsional_rigidity_Nm_per_arcmin"] == pytest.approx([rigidity, rigidity / 2], rel=1e-9)


def test_metrics_are_read_where_the_study_asks():
    cycle = LoadCycle.evenly(RATED, 4, 1.0, (0.05, 0.15, 0.75))
    branch, torque, angle = curve(cycle, lambda t, sense: sense * np.sqrt(np.abs(t)))
    metrics = curve_metrics(branch, torque, angle, 0.6, 1.8, 9.0)
    assert metrics["lost_motion_arcmin"][0] == pytest.approx(2 * np.sqrt(0.6), rel=1e-12)
    assert metrics["torsional_rigidity_Nm_per_arcmin"][0] == pytest.approx(7.2 / (3.0 - np.sqrt(1.8)), rel=1e-12)
    with pytest.raises(ValueError, match="no point at"):
        curve_metrics(branch, torque, angle, 0.48, 1.8, 9.0)


def test_width_and_rigidity_are_those_of_the_last_loop_not_of_the_first_loading():
    """A first branch off the loop changes nothing: the loop closes with the reloading."""
    branch, torque, angle = curve(CYCLE, lambda t, sense: t / 3.0, 0.1)
    virgin = angle.copy()
    virgin[:, branch == "loading+"] *= 0.3
    metrics_first, metrics_second = (curve_metrics(branch, torque, a, 0.36, 6.0, 12.0) for a in (angle, virgin))
    np.testing.assert_equal(metrics_first, metrics_second)


class Unit:
    """Reducers with the errors of a drawing (allowances included), laws, and a disk of random compliance."""

    def __init__(self, profile=PAPER, *, n=12, floats=False, exponent=1.0, clearance=0.0, crank=0.4, allowance=8e-3):
        rng = np.random.default_rng(0)
        self.profile, self.at = profile, (reducer := reducer_at(profile, crank, floats=floats))
        self.laws = laws_of(profile, reducer)
        on_disk = (reducer.contacts.body_a == "disk") | (reducer.contacts.body_b == "disk")
        self.compliance = random_compliance(len(on_disk), rng) * np.outer(on_disk, on_disk)
        drawn_errors = random_errors(profile, reducer, n, 1e-3, rng)
        fits = {"lobe": drawn_errors.lobe + allowance, "roller_diameter": drawn_errors.roller_diameter - 4e-3}
        errors = Errors(**{**vars(drawn_errors), **fits})
        self.gap = gaps(profile, reducer, errors, method="exact", disk_reading="radial", roller_reading="half_diameter")
        self.bearing = Bearing(1e6 if exponent == 1 else 4e6, exponent)
        self.clearance = np.full(n, clearance)

    def states(self, cycle=CYCLE):
        springs = self.at, self.bearing, self.laws, self.compliance
        return solve_cycle(drive_with(self.profile, *springs, self.gap, self.clearance), cycle)

    def play(self):
        return rigid_play(self.at, self.gap, self.clearance)

    def width(self, states, level):
        """Angle between +- the given level (0: the ends of the play), (n,) [arcmin]."""
        angle = ARCMIN * states.motion[:, :, self.at.output_motion]
        return angle[:, level] - angle[:, angle.shape[1] // 2 + level]


UNITS = pytest.mark.parametrize(
    "options",
    [{}, {"floats": True}, {"crank": 0.0}, {"clearance": 3e-3, "n": 4}, {"exponent": 1.5}],
    ids=["paper", "floats", "crank 0", "bearing clearance", "hertzian bearing"],
)


@UNITS
def test_ends_of_play_are_free_of_force_and_as_far_apart_as_the_rigid_play(options):
    unit = Unit(**options)
    states, play = unit.states(), unit.play()
    assert not play.preloaded.any()
    half = states.force.shape[1] // 2
    for end in (0, half):
        np.testing.assert_array_equal(states.force[:, end], 0)
        assert states.converged[:, end].all()
    np.testing.assert_allclose(unit.width(states, 0), ARCMIN * play.backlash, atol=1e-6)
    assert np.all(unit.width(states, 0) > 0.3)


@UNITS
def test_loaded_solution_tends_to_the_rigid_play_in_every_sample(options):
    """At 1e-6 of the rated torque the width is that of the play within 1e-4 arcmin, thrice that on a soft bearing."""
    unit = Unit(**options)
    states = unit.states(LoadCycle(RATED, np.array([1e-6, 1.0])))
    assert states.converged.all()
    increment = unit.width(states, 1) - ARCMIN * unit.play().backlash
    assert np.all(increment > 0)
    assert increment.max() < (3e-4 if unit.bearing.exponent > 1 else 1e-4)


@pytest.mark.parametrize("profile", [PAPER, SMALL], ids=["paper", "small"])
@pytest.mark.parametrize("floats", [False, True])
def test_no_gaps_no_backlash(profile, floats):
    unit = Unit(profile, n=1, floats=floats)
    unit.gap[:] = 0
    states = unit.states()
    assert states.converged.all()
    assert abs(unit.width(states, 0)[0]) < 1e-6
    assert np.all(np.diff(states.motion[0, : states.force.shape[1] // 2, unit.at.output_motion]) > 0)


@UNITS
def test_angle_rises_with_torque_and_every_state_is_an_equilibrium_at_its_torque(options):
    unit = Unit(**options)
    states = unit.states()
    assert states.converged.all()
    half = states.force.shape[1] // 2
    angle = states.motion[:, :, unit.at.output_motion]
    assert np.all(np.diff(angle[:, :half], axis=1) > 0)
    assert np.all(np.diff(angle[:, half:], axis=1) < 0)
    for part in (-1, 0, 1):
        rows = unit.at.contacts.interface == part
        moment = -states.force[:, :, rows] @ unit.at.contacts.arm[rows]
        np.testing.assert_allclose(moment, np.broadcast_to(CYCLE.state_torque, moment.shape), rtol=1e-8, atol=1e-8)


def test_states_do_not_depend_on_the_levels_between_them():
    unit = Unit()
    coarse_states, fine_states = (
        unit.states(LoadCycle(RATED, levels)) for levels in (np.array([0.5, 1.0]), np.linspace(0.1, 1, 10))
    )
    pairs = {1: 5, 2: 10, 4: 16, 5: 21}
    for metrics_first, metrics_second in pairs.items():
        np.testing.assert_allclose(
            coarse_states.force[:, metrics_first],
            fine_states.force[:, metrics_second],
            atol=1e-8 * fine_states.force.max(),
        )
        np.testing.assert_allclose(
            coarse_states.motion[:, metrics_first], fine_states.motion[:, metrics_second], atol=1e-11
        )


@pytest.mark.parametrize(
    "options",
    [{}, {"floats": True}, {"clearance": 3e-3, "n": 4}, {"exponent": 1.5}],
    ids=["paper", "floats", "bearing clearance", "hertzian bearing"],
)
def test_a_unit_preloaded_in_every_part_carries_forces_at_no_torque_and_has_no_play(options):
    unit = Unit(allowance=-6e-3, **options)
    unit.gap[:, PAPER.pins :] -= 10e-3
    assert unit.play().preloaded.all()
    states = unit.states()
    assert states.converged.all()
    assert np.all(states.force[:, 0].sum(axis=1) > 10)
    assert np.abs(unit.width(states, 0)).max() < 1e-6
    np.testing.assert_allclose(states.force[:, 0], states.force[:, states.force.shape[1] // 2], atol=1e-4)


@UNITS
def test_every_state_of_partly_preloaded_units_is_found(options):
    """Pins that interfere, slides that are free: forces of 100 N and of a micronewton side by side at no torque."""
    unit = Unit(allowance=0.0, **options)
    assert np.count_nonzero(unit.play().preloaded) > 2
    states = unit.states()
    assert states.converged.all()
    assert np.all(unit.width(states, 0) > 0)


def test_preloaded_and_free_units_together_are_solved_as_each_alone():
    unit = Unit(allowance=3e-3, n=16)
    preloaded = unit.play().preloaded
    assert 0 < np.count_nonzero(preloaded) < 16
    combined = unit.states()
    whole, loose = unit.gap, unit.clearance
    for sample in (int(np.argmax(preloaded)), int(np.argmin(preloaded))):
        unit.gap, unit.clearance = whole[sample : sample + 1], loose[:1]
        isolated = unit.states()
        for name in ("motion", "force", "iterations", "residual", "converged"):
            np.testing.assert_array_equal(getattr(isolated, name)[0], getattr(combined, name)[sample])


def test_preload_takes_the_limit_of_small_torque():
    """The 0+ and 0- states of a preloaded unit lie between the equilibria at +-1e-6 of the rated torque."""
    unit = Unit(allowance=-3e-3, n=6)
    assert unit.play().preloaded.all()
    ends = unit.states()
    start = np.zeros((6, len(unit.at.motions)))
    angles = []
    for sense in (1, -1):
        torque = np.array([sense * 1e-6 * RATED])
        elastic = ElasticReducer(unit.at, unit.bearing, unit.laws, unit.compliance)
        small = solve(elastic, unit.gap, unit.clearance, start, torque)
        assert small.converged.all()
        angles.append(small.motion[:, 0, unit.at.output_motion])
    for end in (0, ends.force.shape[1] // 2):
        at_end = ends.motion[:, end, unit.at.output_motion]
        assert np.all((at_end < angles[0]) & (at_end > angles[1]))
