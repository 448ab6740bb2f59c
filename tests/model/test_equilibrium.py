"""Equilibrium of rigid bodies, elastic disk and contacts against energy, balance, symmetry and exact cases."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reducers import PAPER, SMALL, laws_of, random_compliance, reducer_at
from scipy.optimize import minimize

from pipeline.model.contact.laws import ContactLaws
from pipeline.model.elastic.condensed_body import elastic_body
from pipeline.model.elastic.disk_mesh import flank_nodes, lobed_disk_mesh
from pipeline.model.elastic.pressure_patches import boundary_patches
from pipeline.model.equilibrium.solve import (
    ACCEPTED,
    ElasticReducer,
    _solve_batch,
    compile_solver,
    solve,
    solver_is_compiled,
)
from pipeline.model.geometry.cycloid_profile import disk_rotation
from pipeline.model.geometry.reducer import Bearing

BEARINGS = {
    "linear": (Bearing(2e5, 1.0), 0.0),
    "clearance": (Bearing(2e5, 1.0), 4e-3),
    "hertzian": (Bearing(4e6, 1.5), 0.0),
    "hertzian with clearance": (Bearing(4e6, 1.5), 4e-3),
    "roller": (Bearing(5e5, 10 / 9), 2e-3),
}
EACH_BEARING = pytest.mark.parametrize(("bearing", "clearance"), BEARINGS.values(), ids=BEARINGS)
PLATES = pytest.mark.parametrize("floats", [False, True], ids=["rotates", "floats"])
TORQUES = np.array([50.0, 1500.0, 12000.0])  # [N mm]


class Model:
    """The small reducer with random compliance; ``solve`` and an independent check of what it returns."""

    def __init__(self, *, floats=False, bearing=BEARINGS["linear"][0], clearance=0.0, law="hertz", crank=0.4, seed=0):
        self.at = reducer_at(SMALL, crank, floats=floats)
        self.laws = laws_of(SMALL, self.at, law)
        self.bearing, self.clearance = bearing, clearance
        self.compliance = random_compliance(len(self.laws), np.random.default_rng(seed))

    def solve(self, gap, torque, start=None):
        n = len(gap)
        start = np.zeros((n, len(self.at.motions))) if start is None else start
        return solve(
            ElasticReducer(self.at, self.bearing, self.laws, self.compliance),
            gap,
            np.full(n, self.clearance),
            start,
            np.asarray(torque),
        )

    def bearing_force(self, motion):
        """Force of the disk on its bearing (..., 2) [N]: stiffness (d - clearance)^exponent along d."""
        shift = motion[..., :2]
        distance = np.linalg.norm(shift, axis=-1, keepdims=True)
        push = self.bearing.stiffness * np.maximum(distance - self.clearance, 0) ** self.bearing.exponent
        return push * shift / np.maximum(distance, 1e-300)

    def unbalanced(self, solution, torque):
        """Largest unbalanced force [N] or moment [N mm] over the largest contact force, over arms of 1 mm at least."""
        total = solution.force @ self.at.contact_jacobian
        total[..., :2] += self.bearing_force(solution.motion)
        total[..., self.at.output_motion] -= torque
        return (
            np.max(np.abs(total) / np.maximum(np.abs(self.at.contact_jacobian).max(axis=0), 1.0)) / solution.force.max()
        )

    def misfit(self, solution, gap):
        """Largest misfit of a closed contact and largest penetration of an open one [mm]."""
        room = gap[:, None] + solution.force @ self.compliance - solution.motion @ self.at.contact_jacobian.T
        in_contact = solution.force > 0
        of_closed = np.abs(room + self.laws.deflection(solution.force))[in_contact]
        return of_closed.max(initial=0), np.max(-room[~in_contact], initial=0)

    def complementary_energy(self, force, gap):
        """Energy whose least value over balanced forces is the solution (linear bearing)."""
        shift = -(force @ self.at.contact_jacobian)[:2]
        return (
            self.laws.energy(force).sum()
            + 0.5 * force @ self.compliance @ force
            + gap @ force
            + shift @ shift / (2 * self.bearing.stiffness)
        )


def random_gaps(model, n, seed, low=-1e-3, high=6e-3):
    return np.random.default_rng(seed).uniform(low, high, (n, len(model.laws)))


def assert_equilibrium(model, solution, gap, torque, tolerance=1e-8):
    assert solution.converged.all()
    assert solution.residual.max() <= ACCEPTED
    assert solution.force.min() >= 0
    assert model.unbalanced(solution, torque) < tolerance
    closing_values, opening = model.misfit(solution, gap)
    assert closing_values < 1e-9 * np.abs(solution.motion).max() + 1e-12
    assert opening < 1e-11


@PLATES
@EACH_BEARING
@pytest.mark.parametrize("law", ["hertz", "palmgren"])
def test_forces_balance_and_contacts_fit(floats, bearing, clearance, law):
    model = Model(floats=floats, bearing=bearing, clearance=clearance, law=law)
    gap = random_gaps(model, 20, 1)
    for sense in (1, -1):
        assert_equilibrium(model, model.solve(gap, sense * TORQUES), gap, sense * TORQUES)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    bearing=st.sampled_from(sorted(BEARINGS)),
    floats=st.booleans(),
    low=st.floats(-8e-3, 2e-3),
    width=st.floats(0, 20e-3),
    torque=st.floats(1e-3, 1e5) | st.floats(-1e5, -1e-3),
    crank=st.floats(0, 6.3),
)
def test_any_gaps_any_torque_converge(seed, bearing, floats, low, width, torque, crank):
    model = Model(floats=floats, bearing=BEARINGS[bearing][0], clearance=BEARINGS[bearing][1], crank=crank, seed=seed)
    gap = random_gaps(model, 3, seed, low, low + width)
    assert_equilibrium(model, model.solve(gap, [torque]), gap, torque)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10**6),
    bearing=st.sampled_from(sorted(BEARINGS)),
    floats=st.booleans(),
    softness=st.floats(-6, -2),
    span=st.sampled_from([0, 3, 6, 12]),
    low=st.floats(-8e-3, 4e-3),
    torque=st.floats(0.1, 1e5) | st.floats(-1e5, -0.1),
)
def test_any_compliance_converges(seed, bearing, floats, softness, span, low, torque):
    """Every contact feels all others: eigenvalues from 10^softness mm/N down to 10^-span of it, at random."""
    model = Model(floats=floats, bearing=BEARINGS[bearing][0], clearance=BEARINGS[bearing][1], seed=seed)
    rng, n = np.random.default_rng(seed), len(model.laws)
    directions, _ = np.linalg.qr(rng.normal(size=(n, n)))
    matrix = (directions * 10 ** (softness - span * rng.uniform(size=n))) @ directions.T
    model.compliance = 0.5 * (matrix + matrix.T)
    gap = random_gaps(model, 3, seed, low, low + 10e-3)
    solution = model.solve(gap, [torque])
    assert_equilibrium(model, solution, gap, torque)


@pytest.fixture(scope="module")
def ring():
    """Compliance of a ring 2.95 mm thin at the lobes' roots, between its pins."""
    mesh = lobed_disk_mesh(flank_nodes(PAPER, 24), 79, 28.4, 0.5, 1.0)
    disk = elastic_body(mesh, 206e3, 0.3, 1.0, "plane_stress", "bore")
    reducer = reducer_at(PAPER, 0.0)
    turn = np.exp(-1j * disk_rotation(PAPER, 0.0))
    position, normal = (reducer.pins.point - PAPER.eccentricity) * turn, reducer.pins.normal * turn
    compliance = np.zeros((len(reducer.contacts),) * 2)
    pins = slice(reducer.n_pins)
    compliance[pins, pins] = disk.compliance(boundary_patches(disk.mesh, "flank", position, normal, 0.16)).matrix
    return compliance


@pytest.mark.parametrize("sense", [1, -1])
def test_a_thin_ring_reaches_equilibrium(ring, sense):
    """It bends under one pin by a hundred times what the contact gives, so a contact that closes opens many others."""
    model = Model()
    model.at = reducer_at(PAPER, 0.0)
    model.laws, model.compliance = laws_of(PAPER, model.at), ring
    assert np.linalg.eigvalsh(ring)[-1] > 20 * np.max(np.diag(ring))
    gap = random_gaps(model, 30, 8, 0.0, 12e-3)
    torque = sense * np.array([360.0, 6000.0, 12000.0])
    assert_equilibrium(model, model.solve(gap, torque), gap, torque)
    single_solutions = np.concatenate([model.solve(gap, [load]).force for load in torque], axis=1)
    np.testing.assert_allclose(model.solve(gap, torque).force, single_solutions, atol=1e-7 * single_solutions.max())


@PLATES
@pytest.mark.parametrize("sense", [1, -1])
def test_solution_is_the_least_complementary_energy_that_scipy_finds(floats, sense):
    """Forces of any size in balance with the load have more energy; SLSQP over all 28 forces, in units of 100 N."""
    model = Model(floats=floats, bearing=Bearing(2e4, 1.0))
    torque, gap = sense * 3000.0, random_gaps(model, 1, 3)
    solution = model.solve(gap, [torque])
    unit, free = 100.0, model.at.contact_jacobian[:, 2:].T
    load = np.zeros(len(free))
    load[model.at.output_motion - 2] = torque

    def slope(x):
        force = unit * x
        planar = model.at.contact_jacobian[:, :2]
        total = model.laws.deflection(force) + model.compliance @ force + gap[0]
        return unit * (total + planar @ (planar.T @ force) / model.bearing.stiffness)

    result = minimize(
        lambda x: model.complementary_energy(unit * x, gap[0]),
        np.full(len(model.laws), 1.0),
        jac=slope,
        method="SLSQP",
        bounds=[(0, None)] * len(model.laws),
        options={"maxiter": 1000, "ftol": 1e-16},
        constraints={"type": "eq", "fun": lambda x: free @ x - load / unit, "jac": lambda x: free},
    )
    force = solution.force[0, 0]
    assert np.abs(free @ result.x * unit - load).max() < 1e-6
    np.testing.assert_allclose(unit * result.x, force, atol=1e-4 * force.max())
    model_value = model.complementary_energy(force, gap[0])
    assert model_value <= result.fun + 1e-9 * abs(result.fun)
    assert model_value == pytest.approx(result.fun, rel=1e-7)


@PLATES
def test_output_turns_by_the_slope_of_the_complementary_energy(floats):
    """Castigliano's theorem, with gaps: d energy/d torque is the angle, at any step of a solved cycle."""
    model, step = Model(floats=floats), 0.1
    gap = random_gaps(model, 1, 4)
    for torque in (300.0, -9000.0):
        solution = model.solve(gap, [torque - step, torque, torque + step])
        energy = [model.complementary_energy(force, gap[0]) for force in solution.force[0]]
        angle = solution.motion[0, 1, model.at.output_motion]
        assert (energy[2] - energy[0]) / (2 * step) == pytest.approx(angle, rel=1e-6)


@PLATES
@pytest.mark.parametrize("name", ["linear", "clearance", "hertzian with clearance"])
def test_forces_are_unique_from_twenty_random_starts(floats, name):
    model = Model(floats=floats, bearing=BEARINGS[name][0], clearance=BEARINGS[name][1])
    gap = np.repeat(random_gaps(model, 1, 5), 20, axis=0)
    size = np.array([0.05, 0.05, 0.01, 0.02, 0.03, 0.05, 0.05])[: len(model.at.motions)]
    start = size * np.random.default_rng(6).uniform(-1, 1, (20, len(size)))
    torque = [-2000.0, 700.0]
    solution = model.solve(gap, torque, start)
    assert_equilibrium(model, solution, gap, np.array(torque))
    for step in range(2):
        force = solution.force[:, step]
        np.testing.assert_allclose(force, np.broadcast_to(force[0], force.shape), atol=1e-8 * force.max())
        held_value = solution.motion[:, step]
        np.testing.assert_allclose(held_value, np.broadcast_to(held_value[0], held_value.shape), atol=1e-9)


@PLATES
def test_each_step_is_independent_of_the_steps_before_it(floats):
    model = Model(floats=floats, bearing=BEARINGS["clearance"][0], clearance=BEARINGS["clearance"][1])
    gap, torque = random_gaps(model, 5, 7), np.array([100.0, 4000.0, -50.0, 900.0])
    ascending, descending = model.solve(gap, torque), model.solve(gap, torque[::-1])
    np.testing.assert_allclose(ascending.force, descending.force[:, ::-1], atol=1e-8 * ascending.force.max())
    isolated = model.solve(gap[2:3], torque)
    for name in ("force", "motion", "iterations", "residual"):
        np.testing.assert_array_equal(getattr(isolated, name)[0], getattr(ascending, name)[2])


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


@PLATES
@pytest.mark.parametrize("name", ["linear", "clearance"])
def test_a_sample_without_solution_keeps_its_row_and_spoils_no_other(floats, name):
    model = Model(floats=floats, bearing=BEARINGS[name][0], clearance=BEARINGS[name][1])
    gap = random_gaps(model, 3, 12)
    good = model.solve(gap, TORQUES)
    spoiled = gap.copy()
    spoiled[1, 4] = np.nan
    solution = model.solve(spoiled, TORQUES)
    assert solution.force.shape == good.force.shape
    assert not solution.converged[1].any()
    assert not np.any(solution.residual[1] <= ACCEPTED)
    for sample in (0, 2):
        for field in ("force", "motion", "iterations", "residual", "converged"):
            np.testing.assert_array_equal(getattr(solution, field)[sample], getattr(good, field)[sample])


def test_an_unstable_compliance_is_reported_not_accepted():
    """Couplings beyond what any elastic body can have leave the Newton steps without a factor; the rows say so."""
    model = Model()
    model.compliance = np.where(np.eye(len(model.laws)) > 0, 1e-6, 1e-3)
    solution = model.solve(random_gaps(model, 2, 13), TORQUES)
    assert not solution.converged.any()
    assert np.all(solution.residual > ACCEPTED)


def test_solver_compiled_ahead_solves_any_layout_of_torques():
    """A reversed torque array or every second torque would be compiled for again, which takes seconds."""
    compile_solver()
    assert solver_is_compiled()
    compiled = set(_solve_batch.signatures)
    model = Model()
    gap = random_gaps(model, 1, 3)
    forward = model.solve(gap, TORQUES[:2].copy())
    backward = model.solve(gap, TORQUES[1::-1])
    np.testing.assert_allclose(backward.force[:, ::-1], forward.force, atol=1e-6)
    model.solve(gap, TORQUES[::2])
    assert set(_solve_batch.signatures) == compiled
