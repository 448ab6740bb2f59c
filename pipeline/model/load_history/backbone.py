"""The frictionless curve of a drive: what it turns by at torques of both senses, from the ends of its play."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from pipeline.arrays import Real
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import LIMIT_TORQUE, LoadCycle, solve_cycle

NO_LOAD = 1e-5
"""Least share of the rated torque that is solved where there is play. The residual that rounding leaves grows as the
torque falls, wherever a state is come down from: 1e-12 here, at 1e-7 up to 2e-9 on a bearing with 12 um of clearance,
where 3 of 80 states are lost, at 1e-8 3e-8 (12 of 80)."""


@dataclass(frozen=True)
class Backbone:
    """Frictionless curve of a drive in its ``n`` states.

    Attributes
    ----------
    torque : (n_nodes,) ascending [N mm], symmetric; the two next to zero, at ``LIMIT_TORQUE``, are the ends of play.
    angle : (n, n_nodes) rotation of the output [rad], the springs in series included.
    states : equilibria at the nodes (n, n_nodes, ...).
    drive : the drive that the curve was solved for. Another drive may share the curve if only its elements differ.
    """

    torque: Real
    angle: Real
    states: Equilibria
    drive: Drive

    @property
    def limits(self) -> Equilibria:
        """States (n, 2) at the limits of no torque from above and from below."""
        middle = len(self.torque) // 2
        return self.states[:, [middle, middle - 1]]

    @property
    def is_preloaded(self) -> bool:
        """Whether contacts carry forces at the limits of no torque in all states."""
        return bool(np.all(np.any(self.limits.force > 0, axis=2)))

    @cached_property
    def influence(self) -> Real:
        """d angle / d gap (n, n_nodes, n_contacts) [rad/mm].

        Notes
        -----
        The least complementary energy V(T) under the torque T has dV/dT = angle and dV/d gap = force, so
        the influence of a gap on the angle is the slope of its force over the torque (Maxwell's reciprocity). At the
        ends of play it is that up to ``NO_LOAD``, 0.1 % too large.
        """
        return self._over_torque(self.states.force)

    def _over_torque(self, values: Real) -> Real:
        """Derivative of ``values`` (n, n_nodes, k) by the torque [N mm], from either side of the play."""
        return _slopes_from(self.torque.tobytes()) @ values

    def change(self, neighbour: Drive) -> Real:
        """Change of the angle (n, n_nodes) [rad], to first order, from the drive of this curve to a ``neighbour``.

        Gaps, compliance, laws and bearing may differ; springs in series are not part of it.

        Notes
        -----
        By the energy of ``influence``: what each contact and the bearing give way more under the forces that they
        carry, times the slope of these over the torque.
        """
        drive, force = self.drive, self.states.force
        closing: Real = (neighbour.gap - drive.gap)[:, None]
        if neighbour.compliance is not drive.compliance:
            closing = closing + force @ (neighbour.compliance - drive.compliance)
        if neighbour.laws is not drive.laws and neighbour.laws.content != drive.laws.content:
            closing = closing + self._deflections(neighbour.laws) - self._own_deflections
        change: Real = np.sum(self.influence * closing, axis=2)
        depth = neighbour.clearance_of_disks[:, None] - drive.clearance_of_disks[:, None]
        if neighbour.bearing != drive.bearing:
            depth = depth + neighbour.bearing.depth(self._thrust) - drive.bearing.depth(self._thrust)
        if np.any(depth):
            change += np.sum(self._slopes_of_thrust * depth, axis=2)
        return change

    @cached_property
    def _own_deflections(self) -> Real:
        return self._deflections(self.drive.laws)

    @cached_property
    def _thrust(self) -> Real:
        """Force (n, n_nodes, n_disks) on each input bearing [N]."""
        return self.drive.reducer.thrust(self.states.force)

    @cached_property
    def _slopes_of_thrust(self) -> Real:
        """Derivative (n, n_nodes, n_disks) of the force on each input bearing by the torque [N/(N mm)]."""
        return self._over_torque(self._thrust)

    def _deflections(self, laws: ContactLaws) -> Real:
        """Deflection of contacts (n, n_nodes, n_contacts) by laws under the forces of this curve [mm]."""
        force = self.states.force
        is_loaded = np.nonzero(force > 0)
        deflection = np.zeros(force.shape)
        deflection[is_loaded] = laws[is_loaded[-1]].deflection(force[is_loaded])
        return deflection


@lru_cache(maxsize=8)
def _slopes_from(torques: bytes) -> Real:
    """Derivatives (n_nodes, n_nodes) [1/(N mm)] by a curve's torques of what is 1 at a node: a fit has one ladder."""
    torque = np.frombuffer(torques)
    slopes, middle = np.zeros((len(torque), len(torque))), len(torque) // 2
    for side in (slice(None, middle), slice(middle, None)):
        slopes[side, side] = np.gradient(np.eye(middle), torque[side], axis=0)
    return slopes


def torque_levels(levels: int, reach: float) -> Real:
    """Shares of the rated torque up to ``reach`` (levels,), quadratically denser towards zero, from ``NO_LOAD``."""
    steps = np.arange(1, levels) / (levels - 1)
    return np.concatenate([[NO_LOAD], reach * steps**2])


def backbone(drive: Drive, shares: Real, neighbour: Backbone | None = None) -> Backbone:
    """The frictionless curve at +- the ``shares`` (n_levels,) of the rated torque, ascending from ``NO_LOAD``.

    The modulus is the drawing's, as of ``Drive.equilibria``. ``neighbour`` is the curve of a preloaded drive in as many
    states that differs little in gaps and springs.
    """
    cycle = LoadCycle(drive.rated_torque, shares)
    middle = len(shares) + 1
    states = solve_cycle(drive.without_elements, cycle, None if neighbour is None else neighbour.limits)
    levels = drive.rated_torque * np.append(LIMIT_TORQUE, shares)
    torque = np.concatenate([-levels[::-1], levels])
    states = states[:, np.append(np.arange(2 * middle)[: middle - 1 : -1], np.arange(middle))]
    return Backbone(torque, states.motion[..., drive.reducer.output_motion] + drive.twist(torque), states, drive)
