"""Equilibria along a load history, with friction: what a step leaves behind, and steps that are halved.

Every load step is the one equilibrium (``equilibrium``), its sliders held by the anchors of the step before.
"""

from typing import NamedTuple

import numpy as np

from pipeline.arrays import Real
from pipeline.model.compiled import algebraic_part, borrowing_entry
from pipeline.model.equilibrium.blocks import Friction, System, Workspace, with_axis_of_blocks, workspace
from pipeline.model.equilibrium.newton import ACCEPTED_RESIDUAL, activate, converge, reset
from pipeline.model.equilibrium.primal_active_set import solved_afresh
from pipeline.model.equilibrium.return_mapping import follow
from pipeline.model.equilibrium.solve import friction_of, system_of
from pipeline.model.load_history.drive import Drive

HALVINGS = 4
"""A step that does not converge is reached in two, each of them again, up to this depth."""
LOST = 1e-3
"""Relative residual of a step after which the path is not followed: its friction would start from nowhere."""
NO_TORQUE = 1e-7
"""Share of the largest torque that stands for none where there is play."""


class States(NamedTuple):
    """Some states of one sample."""

    torque: Real  # (n_states,) [N mm]
    motion: Real  # (n_states, n_motions) [mm, rad]
    force: Real  # (n_states, n_contacts) [N]
    thrust: Real  # (n_states, n_disks) of the bearings [N]


@algebraic_part
def _restore(system: System, states: States, s: int, work: Workspace) -> None:
    """Make one of the states the start of the next solve."""
    reset(work)
    for k in range(work.thrust.shape[0]):
        work.thrust[k] = states.thrust[s, k]
    for d in range(work.motion.shape[0]):
        work.motion[d] = states.motion[s, d]
    for i in range(work.force.shape[0]):
        work.force[i] = states.force[s, i]
        if work.force[i] > 0.0:
            activate(system, i, work)


@algebraic_part
def _save(work: Workspace, states: States, s: int, torque: float) -> None:
    """Make the solved step one of the states."""
    states.torque[s] = torque
    for k in range(work.thrust.shape[0]):
        states.thrust[s, k] = work.thrust[k]
    for d in range(work.motion.shape[0]):
        states.motion[s, d] = work.motion[d]
    for i in range(work.force.shape[0]):
        states.force[s, i] = work.force[i]


@algebraic_part
def _nearest_state(states: States, torque: float) -> int:
    """The state whose torque is nearest."""
    nearest_index = 0
    for s in range(1, states.torque.shape[0]):
        if abs(states.torque[s] - torque) < abs(states.torque[nearest_index] - torque):
            nearest_index = s
    return nearest_index


@algebraic_part
def _attempt(
    system: System,
    friction: Friction,
    goal: float,
    gap: Real,
    clearance: Real,
    seeds: States,
    solution_reached: States,
    work: Workspace,
) -> float:
    """Residual of the step to a torque, from the state before or from a seed: across the play that leads nowhere."""
    crosses_zero = goal * solution_reached.torque[0] <= 0.0
    residual = np.inf
    for attempt in range(2):
        if crosses_zero == (attempt == 0):
            _restore(system, seeds, _nearest_state(seeds, goal), work)
        elif attempt == 1:
            _restore(system, solution_reached, 0, work)
        _, residual = converge(system, friction, goal, gap, clearance, work)
        if residual <= ACCEPTED_RESIDUAL:
            break
    return residual


class Progress(NamedTuple):
    """How far a path is followed; one number each, in arrays so that it is left where it is."""

    step: np.ndarray  # which is being solved
    halvings: np.ndarray  # of it
    share: Real  # of the way to its torque that is tried
    largest_residual: Real  # residual so far
    afresh: Real  # residual of what is tried, where it was solved from no start; NaN where it was not


@borrowing_entry
def _follow(
    system: System,
    friction: Friction,
    work: Workspace,
    torques: Real,
    gap: Real,
    clearance: Real,
    seeds: States,
    solution_reached: States,
    path: States,
    progress: Progress,
) -> float | None:
    """States of one sample along its history into ``path``.

    It goes on from ``progress`` up to a step that Newton does not solve, at the last halving: returns the torque of
    that, None at the end.
    """
    if progress.step[0] == 0 and progress.halvings[0] == 0:
        _restore(system, solution_reached, 0, work)
    while progress.step[0] < torques.shape[0]:
        t = progress.step[0]
        goal: float = solution_reached.torque[0] + progress.share[0] * (torques[t] - solution_reached.torque[0])
        residual = progress.afresh[0]
        if np.isnan(residual):
            residual = _attempt(system, friction, goal, gap, clearance, seeds, solution_reached, work=work)
            if not residual <= ACCEPTED_RESIDUAL:
                if progress.halvings[0] == HALVINGS:
                    return goal
                progress.share[0] *= 0.5
                progress.halvings[0] += 1
                _restore(system, solution_reached, 0, work)
                continue
        progress.afresh[0] = np.nan
        if not residual <= LOST:
            path.motion[t:], path.force[t:], progress.largest_residual[0] = np.nan, np.nan, np.inf
            return None
        follow(system, friction, work)
        _save(work, solution_reached, 0, goal)
        progress.largest_residual[0] = max(progress.largest_residual[0], residual)
        if progress.share[0] < 1.0:
            progress.share[0] = min(1.0, 2.0 * progress.share[0])
            continue
        _save(work, path, t, goal)
        progress.step[0], progress.halvings[0] = t + 1, 0
    return None


def _off_zero(torques: Real, smallest_torque: float) -> Real:
    """The torques, those of less than ``smallest_torque`` after a larger one at ``smallest_torque`` on its side."""
    latest = np.maximum.accumulate(np.where(np.abs(torques) >= smallest_torque, np.arange(len(torques)), -1))
    small = (np.abs(torques) < smallest_torque) & (latest >= 0)
    return np.where(small, np.copysign(smallest_torque, torques[np.maximum(latest, 0)]), torques)


def _states(torque: Real, motion: Real, force: Real, thrust: Real) -> States:
    return States(*(np.ascontiguousarray(values, dtype=float) for values in (torque, motion, force, thrust)))


def solve_path(drive: Drive, state: int, torques: Real, seeds: tuple[Real, Real, Real]) -> tuple[Real, Real, float]:
    """Motions (n_steps, n_motions), forces (n_steps, n_contacts) and largest relative residual along a history.

    Parameters
    ----------
    state : of the drive, which is followed.
    torques : (n_steps,) [N mm] in time order, from rest without force; zero after a load stands for the limit from its
        side, since in the play no force holds the pose.
    seeds : torques (n_nodes,), motions (n_nodes, n_motions), forces (n_nodes, n_contacts) of frictionless states, from
        which a step starts where the one before leads nowhere: across the play.

    Raises
    ------
    ValueError
        If the drive leans.

    Notes
    -----
    A step that does not converge is halved. A residual above ``ACCEPTED_RESIDUAL`` says that some step did not; beyond
    ``LOST`` it is infinite, and what follows NaN.
    """
    if drive.lean:
        raise ValueError("friction that differs between drive and backdrive is not followed with friction at contacts")
    n_motions, n_contacts = drive.reducer.contact_jacobian.shape[::-1]
    n_disks = drive.reducer.n_disks
    steps = _off_zero(np.asarray(torques, float), NO_TORQUE * float(np.max(np.abs(seeds[0]))))
    system, order = system_of(drive.elastic)
    position_of_contact = np.argsort(order)  # of each contact in the system
    friction = friction_of(drive.sliders.acting, position_of_contact)
    torque_of_seeds, motion_of_seeds, force_of_seeds = seeds
    path = _states(
        steps, np.empty((len(steps), n_motions)), np.empty((len(steps), n_contacts)), np.empty((len(steps), n_disks))
    )
    unloaded_states = _states(np.zeros(1), np.zeros((1, n_motions)), np.zeros((1, n_contacts)), np.zeros((1, n_disks)))
    work, gap = workspace(system), np.ascontiguousarray(drive.gap[state, order])
    clearance = np.ascontiguousarray(drive.clearance_of_disks[state], dtype=float)
    nodes = _states(
        torque_of_seeds, motion_of_seeds, force_of_seeds[:, order], np.zeros((len(torque_of_seeds), n_disks))
    )
    progress = Progress(np.zeros(1, np.int64), np.zeros(1, np.int64), np.ones(1), np.zeros(1), np.full(1, np.nan))
    while (
        n_unsolved := _follow(
            system,
            friction,
            work,
            steps,
            gap,
            clearance,
            nodes,
            solution_reached=unloaded_states,
            path=path,
            progress=progress,
        )
    ) is not None:
        _, progress.afresh[0] = solved_afresh(system, friction, n_unsolved, gap, clearance, with_axis_of_blocks(work))
    return path.motion, path.force[:, position_of_contact], float(progress.largest_residual[0])
