"""The reducer without condensation, in one Newton iteration.

Its unknowns are every displacement of the disk's mesh and the rigid motions of plate and output; springs are nonlinear.

Unknown z = (displacement of the mesh [mm], rotations of plate and output [rad], and their shifts where they float);
the disk is not held: its rigid motion is part of the mesh's. A contact's spring acts between the pressure-weighted
mean displacement of its patch and the other body; the bearing's between the bore's mean displacement and ground.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array, csr_array, hstack
from scipy.sparse.linalg import splu

from pipeline.arrays import Real
from pipeline.checks.specimen import Specimen
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play

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
        residual = self.stiffness @ state + self.contact_jacobian.T @ self.forces(state)
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
            system.tangent(state),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
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
