"""The load cycle of samples with friction, where a state depends on the load path to it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pipeline.arrays import Real
from pipeline.model.equilibrium.newton import ACCEPTED_RESIDUAL
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.load_history.backbone import NO_LOAD, torque_levels
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.friction.incremental import solve_path
from pipeline.model.load_history.friction.output_path import output_path
from pipeline.model.load_history.load_cycle import LoadCycle

LEVELS = 12
"""Torques of a branch, denser towards zero, that the path goes through at least, whatever the cycle's levels are."""

Nodes = tuple[Real, Real, Real]
"""Torques (n_nodes,) ascending, motions and forces (n_nodes, ...) of a sample's frictionless states."""


class FrictionalPath(NamedTuple):
    """A cycle with friction.

    Attributes
    ----------
    equilibria : (n, n_steps, ...)
    carried_torque : torque in the reducer (n, n_steps) [N mm]: that on the output less the friction of the output.
    """

    equilibria: Equilibria
    carried_torque: Real


def _with_output_friction(drive: Drive, state: int, torque: Real, nodes: Nodes) -> tuple[Real, Real, float, Real]:
    """As ``_with_contact_friction`` where friction acts on the output alone: frictionless states at what it leaves."""
    levels, motions, forces = nodes
    leaning = 1 + drive.lean
    sliders = drive.sliders.of_scaled_load(leaning)
    path = output_path(torque, leaning * levels, motions[:, drive.reducer.output_motion], sliders)
    carried_torque = path.at_turns[1] / leaning
    first_positive = int(np.searchsorted(levels, 0.0))
    end = levels[first_positive]
    in_play = np.abs(carried_torque) < end  # stuck within the play
    motion, force = np.empty((len(torque), motions.shape[1])), np.empty((len(torque), forces.shape[1]))
    largest_residual = 0.0
    for sense, start in ((1.0, first_positive), (-1.0, first_positive - 1)):
        loads, rows = np.unique(carried_torque[~in_play & (sense * carried_torque > 0)], return_inverse=True)
        outwards = slice(None, None, int(sense))
        equilibria = drive.some(slice(state, state + 1)).equilibria(motions[start : start + 1], loads[outwards])
        steps = np.flatnonzero(~in_play & (sense * carried_torque > 0))
        motion[steps], force[steps] = equilibria.motion[0, outwards][rows], equilibria.force[0, outwards][rows]
        largest_residual = max(largest_residual, np.max(equilibria.residual, initial=0.0))
    share = ((carried_torque + end) / (2 * end))[in_play]
    for values, of_nodes in ((motion.T, motions.T), (force.T, forces.T)):
        values[..., in_play] = (1 - share) * of_nodes[..., first_positive - 1, None] + share * of_nodes[
            ..., first_positive, None
        ]
    return motion, force, largest_residual, carried_torque


def _with_contact_friction(drive: Drive, state: int, torque: Real, nodes: Nodes) -> tuple[Real, Real, float, Real]:
    """Motions, forces, worst residual and torque carried along torques (n_steps,) [N mm] of one sample."""
    return *solve_path(drive, state, torque, nodes), torque


def refined_cycle(cycle: LoadCycle) -> LoadCycle:
    """The cycle with at least ``LEVELS`` torques on a branch, among them ``NO_LOAD``."""
    return replace(cycle, fractions=np.union1d(torque_levels(LEVELS, float(cycle.fractions[-1])), cycle.fractions))


def solve_frictional_cycle(drive: Drive, cycle: LoadCycle, frictionless: Equilibria) -> FrictionalPath:
    """The steps of the cycle for every sample; arrays (n, n_steps, ...) in the order of ``cycle.steps``.

    Parameters
    ----------
    frictionless : states of the ``refined_cycle`` cycle without friction.

    Notes
    -----
    The cycle is followed from rest. Rows at zero torque are solved at +-``NO_LOAD`` of the rated torque on the branch's
    side. Residual and convergence are those of the whole path, the same at all its steps.
    """
    fine = refined_cycle(cycle)
    order = np.argsort(fine.state_torque, kind="stable")
    order = order[fine.state_torque[order] != 0]
    _, state = fine.steps
    torque = fine.state_torque[state]
    end = NO_LOAD * cycle.rated_torque
    path = np.where(torque == 0, np.where(state <= len(fine.fractions), end, -end), torque)
    of_cycle = np.isin(torque, cycle.state_torque)
    n, steps = len(drive.gap), int(of_cycle.sum())
    motion = np.empty((n, steps, frictionless.motion.shape[2]))
    force = np.empty((n, steps, frictionless.force.shape[2]))
    largest_residuals, carried_torques = np.empty(n), np.empty((n, steps))
    follow = _with_contact_friction if drive.sliders.at_contacts else _with_output_friction
    for k in range(n):
        nodes = fine.state_torque[order], frictionless.motion[k, order], frictionless.force[k, order]
        *along, largest_residuals[k], carried_torque = follow(drive, k, path, nodes)
        motion[k], force[k], carried_torques[k] = (values[of_cycle] for values in (*along, carried_torque))
    residual = np.repeat(largest_residuals[:, None], steps, axis=1)
    equilibria = Equilibria(motion, force, np.zeros((n, steps), np.int64), residual, residual <= ACCEPTED_RESIDUAL)
    return FrictionalPath(equilibria, carried_torques)
