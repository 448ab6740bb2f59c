"""Check of the equilibrium: balance, uniqueness, mirror symmetry, and SciPy's minimum of the potential energy."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, root

from pipeline.arrays import Complex, Real
from pipeline.checks.specimen import (
    SHARES,
    Finding,
    Specimen,
    at_least,
    largest_difference,
    loaded_equilibria,
    relative,
    vanishing,
)
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.equilibrium.solve import ElasticReducer, Equilibria, solve
from pipeline.model.geometry.reducer import Bearing, Reducer
from pipeline.model.units import UM_PER_MM

LIMIT = 1e-8
"""Largest difference from another solver: what its own tolerances allow."""
STARTS = 20
"""Random starts that must end at one solution."""
START_SCATTER = 3e-2
"""Of the random starts: a disk shifted by this [mm], bodies turned by a tenth of it [rad]."""
SPAN = 30.0
"""Radius [mm] at which rotations count as lengths in the energy."""


def _imbalance(specimen: Specimen, states: Equilibria, torque: Real) -> tuple[Real, Real]:
    """Force (n_torques,) and moments (n_torques, 3 bodies) left over, as shares of the sums of their terms."""
    contacts, force = specimen.reducer.contacts, states.force[0]
    forces, moments = [], []
    for body in ("disk", "plate", "output"):
        sign = np.where(contacts.body_b == body, 1.0, 0.0) - np.where(contacts.body_a == body, 1.0, 0.0)
        terms = force * sign * contacts.arm
        total, scale = terms.sum(axis=1), np.abs(terms).sum(axis=1)
        moments.append((total + torque if body == "output" else total) / scale)
        if body == "disk":
            push = force * sign
            bearing_force = specimen.bearing.stiffness * (states.motion[0, :, 0] + 1j * states.motion[0, :, 1])
            forces = np.abs(push @ contacts.normal - bearing_force) / np.abs(push).sum(axis=1)
    return np.asarray(forces), np.stack(moments, axis=-1)


def _misfit(specimen: Specimen, states: Equilibria) -> Real:
    """Deflection of closed contacts less their penetration, and penetration of open ones, over the largest."""
    force = states.force[0]
    approach = states.motion[0] @ specimen.reducer.contact_jacobian.T - specimen.gap
    deflection = specimen.laws.deflection(force) + force @ specimen.compliance
    misfit: Real = np.where(force > 0, np.abs(approach - deflection), np.maximum(approach - deflection, 0.0))
    return misfit / float(deflection.max())


def mirror_permutation(reducer: Reducer) -> np.ndarray:
    """Permutation (n_contacts,) of the contacts by the mirror about the crank's axis, at crank 0.

    Raises
    ------
    ValueError
        If a contact has no mirror image, as at any other crank angle.
    """
    points: Complex = np.conj(reducer.contacts.point)
    interface = reducer.contacts.interface
    distance = np.abs(points[:, None] - reducer.contacts.point) + np.where(interface[:, None] == interface, 0.0, 1e3)
    partner: np.ndarray = np.argmin(distance, axis=1)
    if np.abs(points - reducer.contacts.point[partner]).max() > 1e-9:
        raise ValueError("the contacts are not mirrored about the crank's axis; take crank angle 0")
    return partner


@dataclass(frozen=True)
class PotentialEnergy:
    """Potential energy of patch displacements u and rigid motions q: 1/2 u K u + springs + bearing - torque.

    The formulation in displacements, whose forces are derivatives; the solver's is its dual. Of a linear bearing
    without clearance. Lengths [um], rotations as um at ``SPAN``, forces [N].

    Attributes
    ----------
    laws : of the contacts.
    gap : (n_contacts,) [mm]
    approach : (n_contacts, n_state) penetration by a unit of the state.
    stiffness : (n_state, n_state) [N/um] of disk and bearing.
    load : (n_state,) [N]
    """

    laws: ContactLaws
    gap: Real
    approach: Real
    stiffness: Real
    load: Real

    @classmethod
    def from_specimen(cls, specimen: Specimen, torque: float) -> "PotentialEnergy":
        """The energy of the sample at an output torque [N mm]."""
        reducer, rows = specimen.reducer, specimen.disk_rows
        scale = np.array([1 / SPAN if name.endswith("_phi") else 1.0 for name in reducer.motions])
        n = len(rows)
        patches = np.zeros((len(reducer.contacts), n))
        patches[rows, np.arange(n)] = -1.0
        stiffness = np.zeros((n + len(scale),) * 2)
        stiffness[:n, :n] = np.linalg.inv(specimen.disk_compliance.matrix) / UM_PER_MM
        stiffness[[n, n + 1], [n, n + 1]] = specimen.bearing.stiffness / UM_PER_MM
        load = np.zeros(len(stiffness))
        load[n + reducer.output_motion] = torque / SPAN
        return cls(specimen.laws, specimen.gap, np.hstack([patches, reducer.contact_jacobian * scale]), stiffness, load)

    def penetration(self, state: Real) -> Real:
        """(n_contacts,) [mm], negative where open."""
        return (self.approach @ state) / UM_PER_MM - self.gap

    def force(self, state: Real) -> Real:
        """Contact forces (n_contacts,) [N]."""
        return self.laws.force(self.penetration(state))

    def value(self, state: Real) -> float:
        """[N um]"""
        depth, force = self.penetration(state), self.force(state)
        springs = UM_PER_MM * np.sum(force * depth - self.laws.energy(force))
        return float(0.5 * state @ self.stiffness @ state + springs - self.load @ state)

    def gradient(self, state: Real) -> Real:
        """(n_state,) [N]"""
        return self.stiffness @ state + self.approach.T @ self.force(state) - self.load

    def curvature(self, state: Real) -> Real:
        """(n_state, n_state) [N/um]"""
        force = self.force(state)
        slope, in_contact = np.zeros(len(force)), force > 0
        slope[in_contact] = 1 / self.laws[in_contact].compliance(force[in_contact]) / UM_PER_MM
        return self.stiffness + self.approach.T @ (slope[:, None] * self.approach)

    def least_energy_state(self) -> Real:
        """State of least energy, from a state with every contact that resists the torque closed.

        Energies tell states apart to the root of the rounding only, so the zero of the gradient is found last.

        Raises
        ------
        ArithmeticError
            If SciPy finds no such state.
        """
        start = np.zeros(len(self.load))
        start[self.load != 0] = np.sign(self.load[self.load != 0]) * UM_PER_MM * np.abs(self.gap).max() * 3
        minimum = minimize(self.value, start, jac=self.gradient, hess=self.curvature, method="trust-exact", tol=1e-6)
        stationary = root(self.gradient, minimum.x, jac=self.curvature, tol=1e-14)
        if np.abs(self.gradient(stationary.x)).max() > 1e-9 * np.abs(self.load).max():
            raise ArithmeticError(f"least energy not found: {minimum.message} {stationary.message}")
        state: Real = stationary.x
        return state


def _against_scipy(specimen: Specimen, states: Equilibria, torque: Real) -> Iterator[Finding]:
    reducer = specimen.reducer
    angle, forces = [], []
    for load in torque:
        energy = PotentialEnergy.from_specimen(specimen, load)
        state = energy.least_energy_state()
        forces.append(energy.force(state))
        angle.append(state[len(specimen.disk_rows) + reducer.output_motion] / (SPAN * UM_PER_MM))
    largest_force = np.max(forces, axis=1, keepdims=True)
    yield largest_difference(
        "contact forces against scipy.optimize, over the largest", forces, states.force[0], LIMIT, largest_force
    )
    yield relative(
        "output angle against scipy.optimize [rad]", angle, states.motion[0, :, reducer.output_motion], LIMIT
    )


def _mirror(specimen: Specimen, torque: Real) -> Iterator[Finding]:
    """The mirrored sample under the opposite torque, on the mean of the compliance and its mirror image."""
    partner = mirror_permutation(specimen.reducer)
    compliance = 0.5 * (specimen.compliance + specimen.compliance[np.ix_(partner, partner)])
    yield largest_difference(
        "compliance against its mirror image (the mesh has none), over the largest",
        specimen.compliance,
        specimen.compliance[np.ix_(partner, partner)],
        5e-3,
        specimen.compliance.max(),
    )
    forward = loaded_equilibria(specimen, torque, compliance).force[0]
    backward = loaded_equilibria(specimen, -torque, compliance, specimen.gap[partner]).force[0]
    yield largest_difference(
        "forces of the mirrored sample, over the largest", forward, backward[:, partner], LIMIT, forward.max()
    )


def _uniqueness(specimen: Specimen, states: Equilibria, torque: Real) -> Iterator[Finding]:
    reducer, random = specimen.reducer, np.random.default_rng(1)
    scatter = START_SCATTER * np.where([name.endswith("_phi") for name in reducer.motions], 0.1, 1.0)
    start = scatter * random.standard_normal((STARTS, len(reducer.motions)))
    gap = np.repeat(specimen.gap[None], STARTS, axis=0)
    clearance = np.full(STARTS, specimen.bearing_clearance)
    for name, bearing in (("linear bearing", specimen.bearing), ("bearing of exponent 1.5", Bearing(4e6, 1.5))):
        known_states = states if bearing == specimen.bearing else None
        forces = []
        for load in torque:  # a single load from each start: no step before it helps
            elastic = ElasticReducer(reducer, bearing, specimen.laws, specimen.compliance)
            solution = solve(elastic, gap, clearance, start, np.array([load]))
            forces.append(np.where(solution.converged, 1.0, np.nan)[..., None] * solution.force)
        every = np.concatenate(forces, axis=1)
        reference = every[:1] if known_states is None else known_states.force
        yield largest_difference(
            f"forces from {STARTS} random starts, {name}, over the largest", reference, every, LIMIT, every.max()
        )


def check_equilibrium(specimen: Specimen) -> Iterator[Finding]:
    """Equilibrium: balance, uniqueness, mirror symmetry, least energy."""
    torque = SHARES * specimen.rated_torque
    states = loaded_equilibria(specimen, torque)
    force, moments = _imbalance(specimen, states, torque)
    yield vanishing("force left over on the disk, over the sum of its terms", force, LIMIT)
    yield vanishing("moment left over on each body, over the sum of its terms", moments, LIMIT)
    yield vanishing("misfit of penetration and deflection, over the largest", _misfit(specimen, states), LIMIT)
    yield at_least("least contact force [N]", 0.0, states.force)
    yield from _uniqueness(specimen, states, torque)
    yield from _mirror(specimen, torque)
    yield from _against_scipy(specimen, states, torque)
