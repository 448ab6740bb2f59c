"""The load cycle of samples with friction, where a state depends on the way to it."""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.equilibrium.solve import ACCEPTED, Equilibria
from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.geometry.reducer import Bearing, Reducer
from pipeline.model.load_history.drive import NO_LOAD, ladder
from pipeline.model.load_history.incremental import solve_path
from pipeline.model.load_history.load_cycle import LoadCycle
from pipeline.model.load_history.output_path import Ripple, condensed_path

LEVELS = 12
"""Torques of a branch, denser towards zero, that the way goes through at least, whatever the cycle's levels are."""


@dataclass(frozen=True)
class _Sample:
    """One sample; ``nodes`` are torques, motions and forces of its frictionless states, torque ascending."""

    reducer: Reducer
    bearing: Bearing
    laws: ContactLaws
    compliance: Real
    gap: Real
    bearing_clearance: float
    nodes: tuple[Real, Real, Real]

    def along(self, torque: Real, sliders: Sliders) -> tuple[Real, Real, float]:
        """Motions, forces and largest residual along a history of torques (n_steps,) [N mm]."""
        return solve_path(
            self.reducer,
            self.bearing,
            self.laws,
            self.compliance,
            self.gap,
            self.bearing_clearance,
            sliders,
            torque,
            self.nodes,
        )

    def with_output_friction(self, torque: Real, sliders: Sliders) -> tuple[Real, Real, float]:
        """The same where friction acts on the output alone: frictionless states at the torque that it leaves."""
        nodes, motions, forces = self.nodes
        _, carried = condensed_path(torque, nodes, motions[:, self.reducer.output_motion], sliders, Ripple())
        above = int(np.searchsorted(nodes, 0.0))
        end = nodes[above]
        within = np.abs(carried) < end  # stuck within the play
        motion, force, worst = self.along(
            np.where(within, np.copysign(end, carried), carried), Sliders.none(motions.shape[1])
        )
        share = ((carried + end) / (2 * end))[within, None]
        for values, of_nodes in ((motion, motions), (force, forces)):
            values[within] = (1 - share) * of_nodes[above - 1] + share * of_nodes[above]
        return motion, force, worst


def refined(cycle: LoadCycle) -> LoadCycle:
    """The cycle with at least ``LEVELS`` torques on a branch, among them ``NO_LOAD``."""
    return replace(cycle, fractions=np.union1d(ladder(LEVELS, float(cycle.fractions[-1])), cycle.fractions))


def solve_frictional_cycle(
    reducer: Reducer,
    bearing: Bearing,
    laws: ContactLaws,
    compliance: Real,
    gap: Real,
    bearing_clearance: Real,
    cycle: LoadCycle,
    sliders: Sliders,
    frictionless: Equilibria,
) -> Equilibria:
    """The steps of the cycle for every sample; arrays (n, n_steps, ...) in the order of ``cycle.steps``.

    Parameters
    ----------
    compliance : (n_contacts, n_contacts) [mm/N]
    gap : (n, n_contacts) [mm]
    bearing_clearance : (n,) [mm]
    frictionless : states of the ``refined`` cycle without friction.

    Notes
    -----
    The cycle is followed from rest. Rows at zero torque are solved at +-``NO_LOAD`` of the rated torque on the branch's
    side. Residual and convergence are those of the whole way, the same at all its steps.
    """
    fine, states = refined(cycle), frictionless
    order = np.argsort(fine.state_torque, kind="stable")
    order = order[fine.state_torque[order] != 0]
    _, state = fine.steps
    torque = fine.state_torque[state]
    end = NO_LOAD * cycle.rated_torque
    path = np.where(torque == 0, np.where(state <= len(fine.fractions), end, -end), torque)
    wanted = np.isin(torque, cycle.state_torque)
    n, steps = len(gap), int(wanted.sum())
    motion, force = np.empty((n, steps, states.motion.shape[2])), np.empty((n, steps, states.force.shape[2]))
    worst = np.empty(n)
    for k in range(n):
        nodes = fine.state_torque[order], states.motion[k, order], states.force[k, order]
        sample = _Sample(reducer, bearing, laws, compliance, gap[k], float(bearing_clearance[k]), nodes)
        follow = sample.along if sliders.at_contacts else sample.with_output_friction
        motions, forces, worst[k] = follow(path, sliders)
        motion[k], force[k] = motions[wanted], forces[wanted]
    residual = np.repeat(worst[:, None], steps, axis=1)
    return Equilibria(motion, force, np.zeros((n, steps), np.int64), residual, residual <= ACCEPTED)
