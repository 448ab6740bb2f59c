"""Equilibrium of rigid bodies, elastic disk and contacts: balance, energy, uniqueness, and that it is found."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reducers import PAPER, laws_of, reducer_at
from scipy.optimize import minimize
from solved_reducers import BEARINGS, EACH_BEARING, PLATES, TORQUES, Model, assert_equilibrium, random_gaps

from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.elastic.condensed_body import elastic_body
from pipeline.model.elastic.disk_mesh import flank_nodes, lobed_disk_mesh
from pipeline.model.elastic.pressure_patches import boundary_patches
from pipeline.model.equilibrium.blocks import with_axis_of_blocks, workspace
from pipeline.model.equilibrium.inverse_update import solve_tangent
from pipeline.model.equilibrium.primal_active_set import solved_afresh
from pipeline.model.equilibrium.solve import (
    ACCEPTED_RESIDUAL,
    ElasticReducer,
    _solve_batch,
    compile_solver,
    friction_of,
    solver_is_compiled,
)
from pipeline.model.geometry.cycloid_profile import disk_rotation
from pipeline.model.geometry.reducer import Bearing


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
    assert not np.any(solution.residual[1] <= ACCEPTED_RESIDUAL)
    for sample in (0, 2):
        for field in ("force", "motion", "iterations", "residual", "converged"):
            np.testing.assert_array_equal(getattr(solution, field)[sample], getattr(good, field)[sample])


def test_an_unstable_compliance_is_reported_not_accepted():
    """Couplings beyond what any elastic body can have leave the Newton steps without a factor; the rows say so."""
    model = Model()
    model.compliance = np.where(np.eye(len(model.laws)) > 0, 1e-6, 1e-3)
    solution = model.solve(random_gaps(model, 2, 13), TORQUES)
    assert not solution.converged.any()
    assert np.all(solution.residual > ACCEPTED_RESIDUAL)


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


def test_a_hard_step_finds_its_start_compiled_ahead():
    """Compiled amid a study it would take 17 s; the signature is that of a step of a real reducer."""
    compile_solver()
    compiled = set(solved_afresh.signatures)
    assert compiled
    model = Model()
    system, order = ElasticReducer(model.at, model.bearing, model.laws, model.compliance).full_system
    gap = np.ascontiguousarray(random_gaps(model, 1, 3)[:, order])
    friction, room = friction_of(Sliders.none(len(system.arm)), order), with_axis_of_blocks(workspace(system))
    _, residual = solved_afresh(system, friction, float(TORQUES[0]), gap[0], np.zeros((1, 1))[0], room)
    assert residual <= ACCEPTED_RESIDUAL
    assert set(solved_afresh.signatures) == compiled


@pytest.mark.parametrize("seed", range(5))
def test_a_tangent_without_symmetry_is_solved_with_pivots(seed):
    rng = np.random.default_rng(seed)
    tangent, right_side = rng.normal(size=(6, 6)), rng.normal(size=6)
    tangent[np.diag_indices(6)] *= 1e-3
    solution = right_side.copy()
    assert solve_tangent.py_func(tangent.copy(), solution)  # compiled parts borrow their arrays from compiled code
    np.testing.assert_allclose(solution, np.linalg.solve(tangent, right_side), rtol=1e-9)
    assert not solve_tangent.py_func(np.zeros((2, 2)), np.ones(2))
