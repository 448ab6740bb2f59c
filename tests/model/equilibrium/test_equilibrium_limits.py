"""Equilibrium in exact cases and limits: the mirrored reducer, springs by hand, no gaps, hardly any torque."""

import numpy as np
import pytest
from reducers import SMALL, laws_of, reducer_at
from solved_reducers import EACH_BEARING, PLATES, TORQUES, Model, assert_equilibrium, random_gaps

from pipeline.model.contact.laws import ContactLaws
from pipeline.model.equilibrium.newton import BALANCE_TOLERANCE
from pipeline.model.equilibrium.residual import IDLE
from pipeline.model.geometry.reducer import Bearing


@PLATES
@EACH_BEARING
def test_the_mirrored_reducer_carries_the_mirrored_forces(floats, bearing, clearance):
    """At crank 0 with a slide along the crank the reducer is its own mirror image: pins and rollers change places."""
    model = Model(floats=floats, bearing=bearing, clearance=clearance)
    model.at = reducer_at(SMALL, 0.0, floats=floats, slide_angle=0.0)
    model.laws = laws_of(SMALL, model.at)
    position, normal, part = model.at.contacts.point, model.at.contacts.normal, model.at.contacts.interface
    distance = np.abs(position[:, None] - np.conj(position)) + np.abs(normal[:, None] - np.conj(normal))
    distance = distance + np.abs(part[:, None] - part)
    image = np.argmin(distance, axis=1)
    assert distance[np.arange(len(image)), image].max() < 1e-12
    gap = random_gaps(model, 4, 8)
    solution = model.solve(gap, TORQUES)
    model.compliance = model.compliance[np.ix_(image, image)]
    mirrored = model.solve(gap[:, image], -TORQUES)
    np.testing.assert_allclose(mirrored.force, solution.force[..., image], atol=1e-8 * solution.force.max())
    signs = np.array([{"x": 1, "y": -1, "phi": -1}[name.split("_")[1]] for name in model.at.motions])
    np.testing.assert_allclose(mirrored.motion, signs * solution.motion, atol=1e-10)


def linear_laws(n, compliance):
    """Springs of one ``compliance`` [mm/N] each."""
    unit_values = np.ones(n)
    return ContactLaws(
        compliance * unit_values, 0 * unit_values, 0 * unit_values, unit_values, np.inf * unit_values, unit_values
    )


@pytest.mark.parametrize("sense", [1, -1])
def test_linear_springs_in_rigid_bodies_turn_as_by_hand(sense):
    """No gaps, a stiff bearing: T (1/sum l^2 + 2/sum x^2) over the loaded contacts, times the spring's compliance."""
    model = Model(bearing=Bearing(1e13, 1.0))
    pin_compliance, n = 1e-5, len(model.laws)
    model.laws, model.compliance = linear_laws(n, pin_compliance), np.zeros((n, n))
    torque, arm = sense * 5000.0, model.at.contacts.arm
    solution = model.solve(np.zeros((1, n)), [torque])
    angle = 0.0
    for part in (-1, 0, 1):
        rows = model.at.contacts.interface == part
        is_loaded = rows & (sense * arm < 0)
        angle += torque * pin_compliance / np.sum(arm[is_loaded] ** 2)
        assert np.all(solution.force[0, 0, is_loaded] > 0)
        assert np.all(solution.force[0, 0, rows & ~is_loaded] == 0)
        np.testing.assert_allclose(
            solution.force[0, 0, is_loaded], -torque * arm[is_loaded] / np.sum(arm[is_loaded] ** 2), rtol=1e-6
        )
    assert solution.motion[0, 0, model.at.output_motion] == pytest.approx(angle, rel=1e-6)


def test_elastic_bodies_and_springs_add_up():
    """A compliance c on the diagonal is c more in every linear spring."""
    model, n = Model(), len(Model().laws)
    gap = random_gaps(model, 3, 9)
    model.laws, model.compliance = linear_laws(n, 3e-6), 4e-6 * np.eye(n)
    elastic = model.solve(gap, TORQUES)
    model.laws, model.compliance = linear_laws(n, 7e-6), np.zeros((n, n))
    springs = model.solve(gap, TORQUES)
    np.testing.assert_allclose(elastic.force, springs.force, atol=1e-8 * springs.force.max())
    np.testing.assert_allclose(elastic.motion, springs.motion, atol=1e-11)


@EACH_BEARING
def test_zero_gaps_are_no_special_case(bearing, clearance):
    for floats in (False, True):
        model = Model(floats=floats, bearing=bearing, clearance=clearance)
        gap = np.zeros((2, len(model.laws)))
        torque = np.array([1e-2, 10.0, 12000.0, -1e-2])
        assert_equilibrium(model, model.solve(gap, torque), gap, torque)


def test_a_preloaded_reducer_is_in_balance_at_hardly_any_torque():
    model = Model()
    gap = random_gaps(model, 5, 10, low=-6e-3, high=-1e-3)
    torque = np.array([1e-5, -1e-5])
    solution = model.solve(gap, torque)
    assert_equilibrium(model, solution, gap, torque)
    assert np.all(solution.force.sum(axis=2) > 10)
    assert np.abs(np.diff(solution.motion, axis=1)).max() < 1e-9


def test_forces_grow_with_torque_and_gaps_beyond_reach_stay_open():
    model = Model()
    gap = random_gaps(model, 4, 11, low=0.0)
    gap[:, 3] = 1.0
    solution = model.solve(gap, np.geomspace(1, 12000, 12))
    assert np.all(solution.force[..., 3] == 0)
    assert np.all(np.diff(solution.motion[..., model.at.output_motion], axis=1) > 0)
    assert np.all(np.diff(solution.force.max(axis=2), axis=1) > 0)
    turned_back = model.solve(gap, -np.geomspace(1, 12000, 12)).motion[..., model.at.output_motion]
    assert np.all(np.diff(turned_back, axis=1) < 0)


def test_a_preloaded_disk_on_a_soft_hub_is_solved_without_another_start(monkeypatch):
    """All that turns the disk couples all its contacts: forces that pull must leave with what they deflect.

    With penetrations judged after they have left, contacts alternate for ever here.
    """
    monkeypatch.setattr("pipeline.model.equilibrium.solve.solved_afresh", lambda *_: pytest.fail("started again"))
    model = Model()
    arm = model.at.contact_jacobian[:, model.at.motions.index("disk_phi")]
    share = arm / np.abs(arm).max()
    model.compliance = 4e-4 * np.outer(share, share) + 2e-5 * np.diag(arm != 0)
    gap = random_gaps(model, 20, 3, low=-8e-3, high=3e-3)
    torque = np.array([1e-4, 1500.0, 12000.0, -1500.0])
    assert_equilibrium(model, model.solve(gap, torque), gap, torque)


def test_what_may_be_unbalanced_of_an_idle_body_is_the_rounding_of_the_largest_force():
    """Less could not be met (a unit of ``rv_80e`` then has no equilibrium), more would let a light load go."""
    assert np.finfo(float).eps < IDLE * BALANCE_TOLERANCE < 100 * np.finfo(float).eps
