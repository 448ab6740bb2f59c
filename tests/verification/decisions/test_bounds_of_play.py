"""The largest and the least play over a tolerance box against every vertex of a small box, and other programs."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from pipeline import assembly
from pipeline.config import load_study
from pipeline.config.studies.tolerances import Tolerances
from pipeline.decisions.bounds import WORST_FOUND, WORST_OF_VALID, _worst_found
from pipeline.decisions.box import Box, coordinate_search
from pipeline.decisions.play_bounds import (
    ATTAINED_BOUND,
    BY_PROGRAM,
    LEAST_BOUND,
    LEAST_FOUND,
    backlash,
    largest_play,
    play_bounds,
)

ROOT = Path(__file__).parent.parent.parent.parent


def play_of(gap, arms):
    """Play of one rotation between contacts: from -min(gap/|arm|) on one side to the same on the other."""
    ratio = gap / np.abs(arms)
    return ratio[arms > 0].min() + ratio[arms < 0].min()


@pytest.mark.parametrize("seed", range(4))
def test_the_program_is_the_largest_of_all_units(seed):
    """A disk that only turns, 6 contacts, 5 errors: no vertex nor random unit has more, the unit found has it."""
    rng = np.random.default_rng(seed)
    arms = np.array([1.0, 2.0, 1.5, -1.0, -2.5, -0.8])
    gap, slopes = rng.uniform(4, 6, 6), rng.normal(size=(6, 5))
    result = largest_play(arms[:, None], 0, gap, slopes, [], np.empty(0))
    units = np.concatenate(
        [np.array(list(itertools.product((-0.5, 0.5), repeat=5))), rng.uniform(-0.5, 0.5, (3000, 5))]
    )
    plays = [play_of(gap + slopes @ unit, arms) for unit in units]
    assert max(plays) <= result.play + 1e-9
    assert play_of(gap + slopes @ result.steps, arms) == pytest.approx(result.play)
    assert result.play > play_of(gap, arms)


def test_an_amplitude_in_any_direction_is_a_disc():
    """Gaps 1 + a cos(t) and 1 - a sin(t): the sum of both sides is largest at -45 degrees, 2 + sqrt(2) a."""
    angle = 2 * np.pi * np.arange(72) / 72
    result = largest_play(
        np.array([[1.0], [-1.0]]),
        0,
        np.ones(2),
        np.empty((2, 0)),
        [0.3 * np.array([np.cos(angle), -np.sin(angle)])],
        np.empty(0),
    )
    assert result.play == pytest.approx(2 + np.sqrt(2) * 0.3, rel=1e-3)


@pytest.mark.parametrize(("clearances", "play"), [((3.0, 0.5), 2 * 1.5), ((0.5, 3.0), 2 * 1.5), ((3.0, 2.0), 2 * 3.0)])
def test_each_disk_gives_way_within_the_clearance_of_its_own_bearing(clearances, play):
    """Two disks between two contacts each, gaps of 1: the output turns by what the tighter one leaves, either way."""
    jacobian = np.zeros((4, 5))
    jacobian[:2, 0], jacobian[2:, 3], jacobian[:, 4] = (1.0, -1.0), (1.0, -1.0), (1.0, -1.0, 1.0, -1.0)
    result = largest_play(jacobian, 4, np.ones(4), np.zeros((4, 1)), [], np.array(clearances))
    assert result.play == pytest.approx(play, rel=1e-9)


def few_errors(**tolerances):
    """The quick study with these tolerances alone, all others at their allowances."""
    study = load_study("quick", ROOT)
    fixed = {
        name: {"distribution": "fixed", "value_um": 0.0, "allowance_um": tolerance.allowance_um}
        for name, tolerance in study.tolerances
    }
    values = fixed | {name: variant.model_dump() for name, variant in study.tolerances if name in tolerances}
    for name, limits in tolerances.items():
        values[name] |= limits
    return study.model_copy(update={"tolerances": Tolerances.model_validate(values)})


def test_a_reducer_with_few_errors_is_bounded_by_all_of_its_vertices():
    """Disk size, eccentricity, a two-lobed ovality: four vertices by 72 directions, and units between them."""
    box = Box.from_study(few_errors(disk_profile={}, eccentricity={}, ovality_2={}))
    bounds = {bound.quantity: bound.value for bound in play_bounds(box, 90.0, "clearance_backlash_arcmin")}
    points = []
    for corner in itertools.product((0.0, 1.0), repeat=2):
        point = box.centre
        point[box.columns] = corner
        points += [point[None], box.rotated_points(point, box.waves["ovality_2"][0])]
    values = backlash(box, 90.0, np.concatenate(points))
    box_points = box.centre + np.zeros((400, 1))
    box_points[:, [*box.columns, *box.waves["ovality_2"][0]]] = np.random.default_rng(1).random((400, 4))
    largest = max(values.max(), backlash(box, 90.0, box_points).max())
    assert largest <= bounds[ATTAINED_BOUND] <= 1.002 * bounds[BY_PROGRAM]
    assert bounds[ATTAINED_BOUND] == pytest.approx(largest, rel=5e-3)
    assert values.min() - 1e-9 <= bounds[LEAST_FOUND] < 1.005 * values.min()  # a climb may end at a lower hill
    assert bounds[LEAST_BOUND] <= values.min() < values.max()
    assert bounds[BY_PROGRAM] == pytest.approx(largest, rel=5e-3)  # gaps bend a little over the zone


def test_a_climb_ends_where_no_error_alone_helps():
    box = Box.from_study(few_errors(disk_profile={}, eccentricity={}, ovality_2={}))
    weight = np.zeros(box.n_columns)
    weight[box.columns] = (1.0, -2.0)
    phase = box.waves["ovality_2"][0, 1]

    def height(points):
        return points @ weight + np.cos(2 * np.pi * (points[:, phase] - 0.25))

    climb = coordinate_search(box, height, box.centre)
    np.testing.assert_allclose(climb.point[box.columns], (1.0, 0.0))
    assert climb.value == pytest.approx(2.0)
    assert climb.is_complete
    cut_off = coordinate_search(box, lambda points: np.where(height(points) > 1.8, np.nan, height(points)), box.centre)
    assert cut_off.value <= 1.8, "a point without a value is no worst case"
    assert not cut_off.is_complete, "and is said to have been met"


def test_output_pins_in_their_zones_play_at_most_as_all_pins_of_a_side_at_its_edge():
    """Pins alone are out of place, every one in the direction that opens its contact: the gaps of both sides grow."""
    study = load_study("pin_in_hole", ROOT)
    zone = {"distribution": "uniform_in_disc", "radius_um": 3.0}
    fixed = {name: {"distribution": "fixed", "value_um": 0.0, "allowance_um": 30.0} for name in ("disk_profile",)}
    study = study.model_copy(update={"tolerances": Tolerances.model_validate({**fixed, "output_pin_position": zone})})
    box = Box.from_study(study)
    assert (len(box.columns), len(box.all_waves)) == (0, study.design.output.pins)
    bounds = {bound.quantity: bound.value for bound in play_bounds(box, 50.0, "clearance_backlash_arcmin")}
    nominal = backlash(box, 50.0, box.centre[None])[0]
    reducer = assembly.reducer(study.design, 50.0)
    arm = reducer.contacts.arm[reducer.output_rows[0]]
    opening = 3e-3 * (1 / arm.max() + 1 / -arm.min()) * 180 * 60 / np.pi
    assert bounds[BY_PROGRAM] == pytest.approx(nominal + opening, rel=1e-3)
    assert bounds[ATTAINED_BOUND] == pytest.approx(nominal + opening, rel=2e-3)
    rng = np.random.default_rng(3)
    points = np.repeat(box.centre[None], 300, axis=0)
    points[:, box.all_waves] = rng.random((300, len(box.all_waves), 2))
    values = backlash(box, 50.0, points)
    assert values.max() <= bounds[ATTAINED_BOUND] * (1 + 1e-9)
    assert bounds[LEAST_BOUND] <= bounds[LEAST_FOUND] <= values.min()


def test_the_worst_under_load_is_sought_from_vertices_too():
    """A ridge that no single error leads to from the centre: both errors at one end together."""
    box = Box.from_study(few_errors(disk_profile={}, eccentricity={}))
    first, second = box.columns[:2]

    def height(points):
        both = (points[:, first] > 0.9) & (points[:, second] < 0.1)
        return np.where(both, 5.0, -np.abs(points[:, first] - 0.5) - np.abs(points[:, second] - 0.5))

    assert coordinate_search(box, height, box.centre).value == 0.0
    assert _worst_found(box, height) == (WORST_FOUND, 5.0)
    cut_off = _worst_found(box, lambda points: np.where(height(points) < -0.9, np.nan, height(points)))
    assert cut_off[0] == WORST_OF_VALID
