"""Check of the condensation: the same mesh solved whole, with its nonlinear springs, in scikit-fem and in CalculiX.

Without condensation the unknowns are every displacement of the disk's mesh and the rigid motions of plate and output;
springs are nonlinear, and one Newton iteration finds all.

Unknown z = (displacement of the mesh [mm], rotations of plate and output [rad], and their shifts where they float);
the disk is not held: its rigid motion is part of the mesh's. A contact's spring acts between the pressure-weighted
mean displacement of its patch and the other body; the bearing's between the bore's mean displacement and ground.
"""

import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.sparse import csc_array, csr_array, hstack
from scipy.sparse.linalg import splu

from pipeline.arrays import Real
from pipeline.checks.calculix.deck import calculix_deck
from pipeline.checks.calculix.program import INSTALL, PROGRAM, ProgramResult, calculix_program, run_calculix
from pipeline.checks.specimen import (
    SHARES,
    Finding,
    Specimen,
    largest_difference,
    loaded_equilibria,
    relative,
    reported_number,
    skipped_check,
)
from pipeline.config import load_study
from pipeline.engine.progress import Meter
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.settings import PROJECT

BALANCE_TOLERANCE = 1e-11
"""Largest force left over on a freedom, over the largest load on one, at which a load step is solved."""
STEP_LIMIT = 200
"""Newton steps after which the unreduced solution has failed."""
FIRST_CLOSURE = 1e-3
"""By which the first contacts are closed at the start [mm]; without any, nothing holds the rigid motions."""
SUFFICIENT = 1e-4
"""Share of the predicted decrease of the energy that a step must achieve (Armijo)."""
SHORTEST = 1e-6
"""Share of a step below which halving ends."""
ROUNDING = 1e-9
"""Share of the energy below which its change by a step is not resolved."""
HELD_BY_NOTHING = 1e-6
"""Share of the stiffest contact that an open one adds to the tangent, so that it is never singular."""


@dataclass(frozen=True)
class Unreduced:
    """The whole system of one sample.

    Attributes
    ----------
    laws : of the contacts.
    gap : (n_contacts,) [mm]
    stiffness : (n, n) of disk and bearing [N/mm].
    contact_jacobian : (n_contacts, n) penetration by a unit of each freedom.
    output : index of the output's rotation.
    free_from : index of the first freedom that is no displacement of the mesh.
    """

    laws: ContactLaws
    gap: Real
    stiffness: csc_array
    contact_jacobian: csr_array
    output: int
    free_from: int

    def forces(self, state: Real) -> Real:
        """Contact forces (n_contacts,) [N]."""
        return self.laws.force(self.contact_jacobian @ state - self.gap)

    def energy(self, state: Real, torque: float) -> float:
        """Potential energy [N mm]."""
        depth = self.contact_jacobian @ state - self.gap
        force = self.laws.force(depth)
        contact_energy = np.sum(force * depth - self.laws.energy(force))
        return float(0.5 * state @ (self.stiffness @ state) + contact_energy - torque * state[self.output])

    def residual(self, state: Real, torque: float) -> Real:
        """Gradient of the energy (n,)."""
        residual: Real = self.stiffness @ state + self.contact_jacobian.T @ self.forces(state)
        residual[self.output] -= torque
        return residual

    def tangent(self, state: Real) -> csc_array:
        """Hessian of the energy (n, n)."""
        force = self.forces(state)
        in_contact = force > 0
        slope = np.zeros(len(force))
        slope[in_contact] = 1 / self.laws[in_contact].compliance(force[in_contact])
        slope = np.maximum(slope, HELD_BY_NOTHING * slope.max())
        return csc_array(self.stiffness + self.contact_jacobian.T @ (self.contact_jacobian * slope[:, None]))


@dataclass(frozen=True)
class WholeSolution:
    """Solutions at the torques of one sense.

    Attributes
    ----------
    angle : (n_torques,) rotation of the output [rad]
    force : (n_torques, n_contacts) [N]
    iterations : (n_torques,) Newton steps, each with a factorisation
    """

    angle: Real
    force: Real
    iterations: np.ndarray


def whole_system(specimen: Specimen) -> Unreduced:
    """The whole system of a sample, its bearing linear and without clearance."""
    reducer, disk, rows = specimen.reducer, specimen.disk, specimen.disk_rows
    other_motions = [i for i, motion in enumerate(reducer.motions) if not motion.startswith("disk")]
    loads = disk.loads(specimen.patches)
    selection = csr_array((-np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(len(reducer.contacts), len(rows)))
    jacobian = csr_array(hstack([selection @ loads.T, csr_array(reducer.contact_jacobian[:, other_motions])]))
    bore = csc_array(disk.reference[:, :2])
    supported_stiffness = disk.stiffness + specimen.bearing.stiffness * (bore @ bore.T)
    size = jacobian.shape[1]
    stiffness = supported_stiffness.tocoo()
    assembled_stiffness = csc_array((stiffness.data, (stiffness.row, stiffness.col)), shape=(size, size))
    output = disk.freedoms.size + other_motions.index(reducer.output_motion)
    return Unreduced(specimen.laws, specimen.gap, assembled_stiffness, jacobian, output, disk.freedoms.size)


def solve_unreduced(specimen: Specimen, system: Unreduced, torque: Real) -> WholeSolution:
    """Full Newton with a line search on the energy, from the end of the free play, load after load.

    Raises
    ------
    ArithmeticError
        If a load step is not solved.
    """
    state = _first_state(specimen, system, float(np.sign(torque[0])))
    angles, forces, iterations = [], [], []
    for load in torque:
        state, steps = _newton(system, state, float(load))
        angles.append(state[system.output])
        forces.append(system.forces(state))
        iterations.append(steps)
    return WholeSolution(np.array(angles), np.array(forces), np.array(iterations))


def _first_state(specimen: Specimen, system: Unreduced, sense: float) -> Real:
    """Rigid bodies a little beyond the end of their free play, every part of the chain closed."""
    reducer, disk = specimen.reducer, specimen.disk
    play = rigid_play(reducer, specimen.gap[None], np.array([specimen.bearing_clearance]))
    pose = (play.pose_plus if sense > 0 else play.pose_minus)[0].copy()
    turn = sense * FIRST_CLOSURE / np.abs(reducer.contact_jacobian[:, reducer.motions.index("disk_phi")]).max()
    rotations = [i for i, motion in enumerate(reducer.motions) if motion.endswith("_phi")]
    pose[rotations] += turn * np.arange(1, len(rotations) + 1)
    other_motions = [i for i, motion in enumerate(reducer.motions) if not motion.startswith("disk")]
    centre = np.array([reducer.motions.index(f"disk_{name}") for name in ("x", "y", "phi")])
    return np.concatenate([disk.rigid_motions @ pose[centre], pose[other_motions]])


def _newton(system: Unreduced, state: Real, torque: float) -> tuple[Real, int]:
    arm = abs(system.contact_jacobian[:, [system.output]]).max()
    for iteration in range(STEP_LIMIT):
        residual = system.residual(state, torque)
        moments = np.abs(residual)
        moments[system.free_from :] /= arm
        if moments.max() < BALANCE_TOLERANCE * abs(torque) / arm:
            return state, iteration
        factors = splu(
            system.tangent(state), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        state = state + _length(system, state, -factors.solve(residual), residual, torque)
    raise ArithmeticError(f"whole system not solved at {torque:g} N mm: {moments.max():.2g} N left over")


def _length(system: Unreduced, state: Real, step: Real, residual: Real, torque: float) -> Real:
    """The step, halved until the energy falls; near the solution the energy is rounding and the whole step is taken."""
    energy_before, slope = system.energy(state, torque), float(residual @ step)
    length = 1.0
    while length > SHORTEST:
        change = system.energy(state + length * step, torque) - energy_before
        if change <= SUFFICIENT * length * slope or abs(slope) < ROUNDING * abs(energy_before):
            return length * step
        length *= 0.5
    return step


ANGLE_LIMIT = 5e-3
"""Share by which the angle of an independent solver may differ: its mesh is not ours."""
FORCE_LIMIT = 1e-2
"""Share of the largest force by which a contact force may differ."""
ALGEBRA_LIMIT = 1e-6
"""Of the condensation alone, every arm that of the mesh's polygon."""
PLANE_STRAIN_LIMIT = 1e-4
"""Of CalculiX in plane strain, whose finite rotations and tables of springs differ from ours."""
COARSE_STUDY = "quick"
"""Study whose mesh CalculiX solves, whatever the mesh of the other checks."""
GIB = 2.0**30
"""Bytes of a gibibyte."""


def on_mesh(specimen: Specimen) -> Reducer:
    """The reducer with the arms that the patches have on the mesh's polygon, within its distance from the flank."""
    reducer, rows = specimen.reducer, specimen.disk_rows
    jacobian = reducer.contact_jacobian.copy()
    resultant = specimen.disk.loads(specimen.patches).T @ specimen.disk.rigid_motions
    jacobian[rows, reducer.motions.index("disk_phi")] = -resultant[:, 2]
    return replace(reducer, contact_jacobian=jacobian)


def _agreement(
    name: str, angle: np.ndarray, force: np.ndarray, solution: Equilibria, output: int, limits: tuple[float, float]
) -> Iterator[Finding]:
    """Angle, and forces as a share of the largest, of another solution (n_torques,), (n_torques, n_contacts)."""
    largest_force = force.max(axis=1, keepdims=True)
    yield relative(f"output angle, {name} [rad]", angle, solution.motion[0, :, output], limits[0])
    yield largest_difference(
        f"contact forces, {name}, over the largest [N]", force, solution.force[0], limits[1], largest_force
    )


def _cost(name: str, seconds: float, peak_bytes: float) -> Iterator[Finding]:
    yield reported_number(f"{name}: time [s]", seconds)
    yield reported_number(f"{name}: peak memory [GiB]", peak_bytes / GIB)


def check_unreduced(specimen: Specimen) -> Iterator[Finding]:
    """Whole reducer in scikit-fem: every freedom of the same mesh, nonlinear springs on the patch means, 5 loads."""
    torque = SHARES * specimen.rated_torque
    output = specimen.reducer.output_motion
    with Meter() as condensing:
        loaded_equilibria(specimen, torque)
        condensed_in = condensing.seconds
    start = time.perf_counter()
    condensed_states = loaded_equilibria(specimen, torque)  # the disk is condensed and the solver compiled by now
    solved_in = time.perf_counter() - start
    with Meter() as meter:
        solution: WholeSolution = solve_unreduced(specimen, whole_system(specimen), torque)
        whole_in = meter.seconds
    yield from _agreement(
        "unreduced", solution.angle, solution.force, condensed_states, output, (ANGLE_LIMIT, FORCE_LIMIT)
    )
    same_arms = loaded_equilibria(specimen, torque, reducer=on_mesh(specimen))
    name = "unreduced, arms of the mesh"
    yield from _agreement(name, solution.angle, solution.force, same_arms, output, (ALGEBRA_LIMIT, ALGEBRA_LIMIT))
    yield reported_number("freedoms of the whole system", specimen.disk.freedoms.size)
    yield reported_number("Newton steps of the whole system, 5 loads", float(solution.iterations.sum()))
    yield from _cost("condensation and 5 loads", condensed_in, condensing.peak_bytes)
    yield reported_number("5 loads, condensed: time [s]", solved_in)
    yield from _cost("5 loads, unreduced", whole_in, meter.peak_bytes)


def check_calculix(specimen: Specimen) -> Iterator[Finding]:
    """Whole reducer in CalculiX, coarse mesh: plane strain, 3 loads; then the gap of expanded elements in plane stress.

    Both solve one mesh, so a coarse one serves: on the paper's CalculiX takes the better part of an hour.
    """
    if calculix_program() is None:
        yield skipped_check(f"needs CalculiX: no program {PROGRAM}; {INSTALL}")
        return
    coarse = specimen.meshed_as(load_study(COARSE_STUDY, PROJECT).reduce)
    output = coarse.reducer.output_motion
    for stress, shares in (("plane_strain", SHARES[::2]), ("plane_stress", SHARES[-1:])):
        torque = shares * coarse.rated_torque
        bodies = coarse if coarse.study.design.disk.stress == stress else coarse.in_stress(stress)
        solution = loaded_equilibria(bodies, torque)
        with tempfile.TemporaryDirectory() as folder:
            answer: ProgramResult = run_calculix(calculix_deck(bodies, torque, solution), Path(folder))
        if stress == "plane_strain":
            limits = (PLANE_STRAIN_LIMIT, PLANE_STRAIN_LIMIT)
            yield from _agreement("CalculiX in plane strain", answer.angle, answer.force, solution, output, limits)
            yield reported_number("iterations of CalculiX, 3 loads", float(answer.iterations))
            yield from _cost("3 loads, CalculiX", answer.seconds, answer.peak_bytes)
        else:
            yield reported_number(
                "output angle at the rated torque, CalculiX's plane stress beside ours [rad]",
                float(solution.motion[0, -1, output]),
                float(answer.angle[-1]),
            )
            gap = np.abs(solution.motion[0, :, output] / answer.angle - 1).max()
            yield reported_number(
                "gap of CalculiX's expanded elements in plane stress, output angle, relative", float(gap)
            )
