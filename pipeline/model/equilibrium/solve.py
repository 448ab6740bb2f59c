"""The one nonlinear solve: contact forces and rigid motions of a reducer under output torques, batched over samples.

Unknowns of a load step are the contact forces F >= 0 [N] and the rigid motions q [mm, rad]:

    law(F) + C F + gap - B q = 0   where F > 0,   B q <= C F + gap elsewhere,
    B^T F + bearing(q) + friction(q, F) = load,

with B the contact Jacobian. Without friction they are the stationarity of a convex potential, so F is unique. The
active contacts are found by a primal-dual active set: Newton on the closed contacts, then contacts are dropped where
the local deflection has become negative and added where an open contact is penetrated. Each step eliminates the forces
(inverse of law' + C on the active contacts) and then solves the few rigid motions, which the bearing and sticking
sliders (``return_mapping``) hold too; contacts between rigid bodies are uncoupled and need no inverse. It is kept from
load step to load step: the laws are nearly linear, a contact that closes or opens is an update of it, and only slow
convergence asks for another (``newton``, ``inverse_update``). A load step starts from the extrapolated forces of the
steps before; a start that leads nowhere is replaced by an interior-point iteration (``interior_point``), which a
primal active set finishes (``primal_active_set``), one contact at a time. Without friction a linear bearing without
clearance is a compliance like the bodies' and leaves two motions fewer.

Array order: (n_samples, n_torques, n_contacts or n_motions).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pipeline.arrays import Index, Real, Whole
from pipeline.model.compiled import algebraic_part, borrowing_entry, compile_for, compiled_before
from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.equilibrium.blocks import (
    Friction,
    System,
    Workspace,
    count,
    coupled_blocks,
    kept_workspace,
    part_of,
    with_axis_of_blocks,
    workspace,
)
from pipeline.model.equilibrium.newton import ACCEPTED_RESIDUAL, activate, converge, reset
from pipeline.model.equilibrium.primal_active_set import solved_afresh
from pipeline.model.geometry.reducer import Bearing, Reducer, of_each_disk

ROUNDING = 1e-15
"""Share of the force that carries the torque at the longest arm below which a force is rounding: a disk that carries
nothing touches with 1e-20 of it."""


@dataclass(frozen=True)
class ElasticReducer:
    """A reducer on its springs: all that its equilibria depend on but gaps and torque.

    Attributes
    ----------
    compliance : (n_contacts, n_contacts) [mm/N] condensed of the elastic bodies; symmetric, positive semidefinite.
    """

    reducer: Reducer
    bearing: Bearing
    laws: ContactLaws
    compliance: Real

    @cached_property
    def full_system(self) -> tuple[System, Index]:
        """``system_of`` the reducer with all its motions, and the order (n_contacts,) of the contacts."""
        return system_of(self)

    @cached_property
    def reduced_system(self) -> tuple[System, Index]:
        """The same (n_contacts,) without the disks' translations, of linear bearings without clearance."""
        return system_of(self, linear=True)


@dataclass(frozen=True)
class Equilibria:
    """Solutions of ``n`` samples at ``n_torques`` output torques.

    Attributes
    ----------
    motion : (n, n_torques, n_motions) [mm, rad]
    force : (n, n_torques, n_contacts) [N]
    iterations : (n, n_torques) Newton steps
    residual : (n, n_torques) the larger of the two relative residuals
    converged : (n, n_torques) whether it met ``ACCEPTED_RESIDUAL``
    """

    motion: Real
    force: Real
    iterations: np.ndarray
    residual: Real
    converged: np.ndarray

    @classmethod
    def concatenate(cls, parts: Sequence["Equilibria"], axis: int) -> "Equilibria":
        """Samples (axis 0) or torques (axis 1) of all parts, one part after the other."""
        return cls(**{name: np.concatenate([vars(part)[name] for part in parts], axis) for name in vars(parts[0])})

    def __getitem__(self, index: Any) -> "Equilibria":
        """Some samples, and torques, as of an array (n, n_torques)."""
        return Equilibria(**{name: values[index] for name, values in vars(self).items()})

    def __setitem__(self, index: Any, solutions: "Equilibria") -> None:
        for name, values in vars(self).items():
            values[index] = vars(solutions)[name]


@algebraic_part
def _extrapolate(torques: Real, t: int, motions: Real, forces: Real, work: Workspace) -> None:
    """Start of step t: the two or three steps before with the same contacts, continued to its torque.

    ``motions``, ``forces`` hold the solved steps; ``counts[0]`` of them, up to the last, have the contacts of that one.
    """
    points = min(work.counts[0], 3, t)
    if points < 2:
        return
    weight = work.column
    for p in range(points):
        weight[p] = 1.0
        for point in range(points):
            if point != p:
                weight[p] *= (torques[t] - torques[t - 1 - point]) / (torques[t - 1 - p] - torques[t - 1 - point])
    for d in range(work.motion.shape[0]):
        total = 0.0
        for p in range(points):
            total += weight[p] * motions[t - 1 - p, d]
        work.motion[d] = total
    for b in range(count(work.active)):
        part = part_of(work.active, work, b)
        for j in range(work.sizes[b, 0]):
            i = part.active[j]
            total = 0.0
            for p in range(points):
                total += weight[p] * forces[t - 1 - p, i]
            if total > 0.0:
                work.force[i] = total


@algebraic_part
def _begin(system: System, start: Real, force: Real, work: Workspace) -> None:
    """A sample's motions and forces to start from."""
    for d in range(start.shape[0]):
        work.motion[d] = start[d]
    work.thrust[:] = 0.0
    reset(work)
    for i in range(work.force.shape[0]):
        work.force[i] = force[i]
        if force[i] > 0.0:
            activate(system, i, work)


@algebraic_part
def _keep(work: Workspace, t: int, rounding: float, motion: Real, force: Real) -> None:
    """Keep the solved step of a sample, forces of ``rounding`` as zero; count the steps that have had its contacts."""
    for d in range(motion.shape[1]):
        motion[t, d] = work.motion[d]
    n_changed = 0 if t > 0 else 1
    for i in range(force.shape[1]):
        force[t, i] = work.force[i] if work.force[i] > rounding else 0.0
        if t > 0:
            n_changed += (force[t, i] > 0.0) != (force[t - 1, i] > 0.0)
    work.counts[0] = work.counts[0] + 1 if n_changed == 0 else 1


_Inputs = tuple[Real, Real, Real, tuple[Real, Real]]
"""Torques, gaps, clearances, and motions and forces to start from."""
_Rows = tuple[Real, Real, Whole, Real]
"""Motions, forces, iterations and residuals, see ``Equilibria``."""


@borrowing_entry
def _solve_batch(system: System, work: Workspace, inputs: _Inputs, progress: Whole, rows: _Rows) -> bool:
    """Samples through their torques in order; ``rows`` are filled.

    It continues from ``progress`` (the sample, its step, and whether that was solved otherwise), up to a step that
    Newton does not solve; True if there is one.
    """
    (torques, gap, clearance, start), (motion, force, iterations, residual) = inputs, rows
    while progress[0] < gap.shape[0]:
        s, t = progress[0], progress[1]
        if t == torques.shape[0]:
            progress[0], progress[1] = s + 1, 0
            continue
        if not progress[2]:
            if t == 0:
                _begin(system, start[0][s], start[1][s], work)
            _extrapolate(torques, t, motion[s], force[s], work)
            iterations[s, t], residual[s, t] = converge(system, None, torques[t], gap[s], clearance[s], work)
            if not residual[s, t] <= ACCEPTED_RESIDUAL:
                progress[2] = 1
                return True
        _keep(work, t, ROUNDING * abs(torques[t]) / system.arm[system.output], motion[s], force[s])
        progress[1], progress[2] = t + 1, 0
    return False


def solver_is_compiled() -> bool:
    """Whether some process has compiled the solver from these sources."""
    return compiled_before(_solve_batch) and compiled_before(solved_afresh)


def compile_solver() -> None:
    """Compile the solver for a reducer whose contacts are one block, or find it compiled; it solves no sample.

    The start from an interior point too: else the first step that needs it would wait for it amid a study.
    """
    row, square, index = np.zeros(1), np.zeros((1, 1)), np.zeros(1, np.int64)
    system = System(
        *(square, square, row, np.zeros((1, 2), np.int64), index, np.zeros((1, 1), np.bool_)),
        *(row, row, row, row, row, row),
        output=0,
        planar=False,
        bearings=1,
        stiffness=1.0,
        bearing_exponent=1.0,
    )
    samples, states = np.zeros((0, 1)), np.zeros((0, 1, 1))
    progress, rows = np.zeros(3, np.int64), (states, states, np.zeros((0, 1), np.int64), samples)
    work = workspace(system)
    _solve_batch(system, work, (row, samples, samples, (samples, samples)), progress, rows)
    friction = friction_of(Sliders.none(1), index)
    compile_for(solved_afresh, system, friction, 1.0, row, row, with_axis_of_blocks(work))


def system_of(elastic: ElasticReducer, linear: bool = False) -> tuple[System, Index]:
    """The equations' numbers, and the order (n_contacts,) in which the contacts stand in them.

    Of ``linear`` bearings without clearance the disks' translations are eliminated.

    Their give is then a compliance like the bodies'. Friction resists the translations, so that it leaves them in.
    """
    reducer, bearing, compliance = elastic.reducer, elastic.bearing, elastic.compliance
    planar, n_eliminated = reducer.planar, 2 * reducer.n_disks if linear else 0
    blocks = coupled_blocks(compliance + planar @ planar.T / bearing.stiffness if linear else compliance)
    jacobian = np.ascontiguousarray(reducer.contact_jacobian[blocks.order, n_eliminated:].T)
    ordered_laws = elastic.laws[blocks.order]
    system = System(
        contact_jacobian=jacobian,
        compliance=blocks.compliance,
        self_compliance=blocks.self_compliance,
        blocks=blocks.ranges,
        block=np.repeat(np.arange(len(blocks.ranges)), np.diff(blocks.ranges)[:, 0]),
        moving=np.array([np.any(jacobian[:, block_start:end], axis=1) for block_start, end in blocks.ranges]),
        linear=ordered_laws.linear,
        logarithmic=ordered_laws.logarithmic,
        power=ordered_laws.power,
        exponent=ordered_laws.exponent,
        limit=ordered_laws.force_limit,
        arm=np.max(np.abs(jacobian), axis=1),
        output=reducer.output_motion - n_eliminated,
        planar=reducer.is_centred and not linear,
        bearings=reducer.n_disks,
        stiffness=float(bearing.stiffness),
        bearing_exponent=float(bearing.exponent),
    )
    return system, blocks.order


def friction_of(sliders: Sliders, place_of_motion: Index) -> Friction:
    """The sliders' numbers, and room for their states; ``place_of_motion`` (n_contacts,) of a contact in the system."""
    direction, stiffness, limit, coefficient = (
        np.ascontiguousarray(values, dtype=float)
        for values in (sliders.direction, sliders.stiffness, sliders.limit, sliders.coefficient)
    )
    contact = np.asarray(sliders.contact)
    n_sliders, n_motions = direction.shape
    of_sliders = ("anchor", "resistance", "stick", "grip", "trial", "pressing_force", "slip_step", "press_step")
    return Friction(
        *(direction, stiffness, limit, coefficient),
        contact=np.where(contact >= 0, place_of_motion[contact], contact),
        **{name: np.zeros(n_sliders) for name in of_sliders},
        resisting=np.zeros(n_sliders, np.int64),
        position=np.zeros(len(place_of_motion), np.int64),
        row=np.zeros(n_motions),
    )


def solve(
    elastic: ElasticReducer,
    gap: Real,
    bearing_clearance: Real,
    start: Real,
    torque: Real,
    neighbours: Equilibria | None = None,
) -> Equilibria:
    """Equilibria of every sample at every output torque, in the order of ``torque``.

    Parameters
    ----------
    gap : (n, n_contacts) [mm]
    bearing_clearance : (n,) of all bearings alike, or (n, n_disks) [mm]
    start : (n, n_motions) [mm, rad]
        Motions to start from; any will do, near ones save iterations.
    torque : (n_torques,) [N mm]
        None of them zero: with play the zero-torque pose is not unique (``rigid_backlash.rigid_play`` has its ends).
    neighbours : (n,)
        Equilibria of nearly the same reducers at the first torque: motions and forces that are tried before ``start``.

    Notes
    -----
    A step that misses ``ACCEPTED_RESIDUAL`` is reported by ``converged``; the following steps still start from it.
    """
    reducer, bearing = elastic.reducer, elastic.bearing
    clearance = of_each_disk(bearing_clearance, reducer.n_disks)
    linear = reducer.is_centred and bearing.exponent == 1 and not np.any(clearance)
    n_eliminated = 2 * reducer.n_disks if linear else 0
    n, n_contacts = gap.shape
    shape, n_motions = (n, len(torque)), len(reducer.motions) - n_eliminated
    system, order = elastic.reduced_system if linear else elastic.full_system
    motion, force = np.empty((*shape, n_motions)), np.empty((*shape, n_contacts))
    iterations, residual = np.empty(shape, np.int64), np.empty(shape)
    work, steps = kept_workspace(system), np.ascontiguousarray(torque, dtype=float)
    ordered_gap = np.ascontiguousarray(gap if len(system.blocks) == 1 else gap[:, order])
    clearance, start = np.ascontiguousarray(clearance, dtype=float), np.ascontiguousarray(start[:, n_eliminated:])
    neighbour_states = (start.copy(), np.zeros(gap.shape))
    if neighbours is not None:
        neighbour_states = neighbours.motion[:, n_eliminated:].copy(), np.ascontiguousarray(neighbours.force[:, order])
    progress = np.zeros(3, np.int64)
    inputs, rows = (steps, ordered_gap, clearance, neighbour_states), (motion, force, iterations, residual)
    while _solve_batch(system, work, inputs, progress, rows):
        s, t, _ = progress
        if t == 0 and np.any(neighbour_states[1][s]):
            neighbour_states[0][s], neighbour_states[1][s], progress[2] = start[s], 0.0, 0
            continue
        friction, room = friction_of(Sliders.none(n_motions), order), with_axis_of_blocks(work)
        n_updates, residual[s, t] = solved_afresh(system, friction, steps[t], ordered_gap[s], clearance[s], room)
        iterations[s, t] += n_updates
    if len(system.blocks) > 1:
        force = np.take(force, np.argsort(order), axis=2)  # in C order, which an index with ... does not leave
    if linear:
        motion = np.concatenate([-force @ reducer.planar / bearing.stiffness, motion], axis=2)
    residual[~np.all(np.isfinite(gap), axis=1)] = np.inf
    return Equilibria(motion, force, iterations, residual, residual <= ACCEPTED_RESIDUAL)
