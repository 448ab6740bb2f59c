"""The frictionless curve of a drive: what it turns by at torques of both senses, from the ends of its play."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.model.equilibrium.loaded_start import loaded_poses
from pipeline.model.equilibrium.solve import Equilibria
from pipeline.model.geometry.cycloid_profile import Real
from pipeline.model.geometry.reducer import Reducer, of_each_disk
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play, separated_play
from pipeline.model.load_history.drive import Drive

NO_LOAD = 1e-5
"""Share of the rated torque that stands for the limit of no torque on either side of the play: its twist is below 1e-4
arcmin. The residual that rounding leaves grows as the torque falls, wherever a state is come down from: 1e-12 here, at
1e-7 up to 2e-9 on a bearing with 12 um of clearance, where 3 of 80 states are lost, at 1e-8 3e-8 (12 of 80)."""


@dataclass(frozen=True)
class Backbone:
    """Frictionless curve of a drive in its ``n`` states.

    Attributes
    ----------
    torque : (n_nodes,) ascending [N mm], symmetric; the two next to zero stand for the ends of the play.
    angle : (n, n_nodes) rotation of the output [rad], the torsion included.
    states : equilibria at the nodes (n, n_nodes, ...).
    """

    torque: Real
    angle: Real
    states: Equilibria

    @cached_property
    def influence(self) -> Real:
        """d angle / d gap (n, n_nodes, n_contacts) [rad/mm].

        Notes
        -----
        The least complementary energy V(T) under the torque T has dV/dT = angle and dV/d gap = force, so
        the influence of a gap on the angle is the slope of its force over the torque (Maxwell's reciprocity).
        """
        return self._over_torque(self.states.force)

    def _over_torque(self, values: Real) -> Real:
        """Derivative of ``values`` (n, n_nodes, ...) by the torque [N mm], from either side of the play."""
        middle = len(self.torque) // 2
        sides = (slice(None, middle), slice(middle, None))
        return np.concatenate([np.gradient(values[:, side], self.torque[side], axis=1) for side in sides], axis=1)

    def change(self, drive: Drive, neighbour: Drive) -> Real:
        """Change of the angle (n, n_nodes) [rad], to first order, from the ``drive`` of this curve to a ``neighbour``.

        Gaps, compliance, laws, bearing and twist may differ.

        Notes
        -----
        By the energy of ``influence``: what each contact and the bearing give way more under the forces that they
        carry, times the slope of these over the torque.
        """
        force = self.states.force
        loaded = np.nonzero(force > 0)
        closings = [of_drive.gap[:, None] + force @ of_drive.compliance for of_drive in (neighbour, drive)]
        for of_drive, closing in zip((neighbour, drive), closings, strict=True):
            closing[loaded] += of_drive.laws[loaded[-1]].deflection(force[loaded])
        change = np.sum(self.influence * (closings[0] - closings[1]), axis=2)
        thrust = drive.reducer.thrust(force)
        bearing_depths = [
            of_drive.bearing.depth(thrust) + of_drive.clearance_of_disks[:, None] for of_drive in (neighbour, drive)
        ]
        twisted = neighbour.twist(self.torque) - drive.twist(self.torque)
        return change + np.sum(self._over_torque(thrust) * (bearing_depths[0] - bearing_depths[1]), axis=2) + twisted


def torque_levels(levels: int, reach: float) -> Real:
    """Shares of the rated torque up to ``reach`` (levels + 1,), quadratically denser towards zero, from ``NO_LOAD``."""
    steps = np.arange(1, levels) / (levels - 1)
    return np.concatenate([[NO_LOAD, 2 * NO_LOAD], reach * steps**2])


def first_poses(drive: Drive, pose: Real, torque: float) -> Real:
    """Poses (n, n_motions) beyond an end of play: each rotation closes a contact that carries ``torque`` [N mm]."""
    reducer = drive.reducer
    if not reducer.centred:
        return loaded_poses(drive.elastic, drive.gap, pose, torque)
    arms = np.abs(reducer.contact_jacobian[:, reducer.output_motion])
    carrier = int(np.argmax(arms))
    force = abs(torque) / arms[carrier]
    depth = drive.laws[carrier].deflection(force)[0] + drive.compliance[carrier, carrier] * force
    turn = np.sign(torque) * depth / arms[carrier]
    rotations = [i for i, motion in enumerate(reducer.motions) if motion.endswith("_phi")]
    senses = [1 if motion == reducer.output_motion else np.sign(reducer.flange_ratio) for motion in rotations]
    contact_pose = pose.copy()
    bodies_passed = np.maximum(np.arange(len(rotations)) + 2 - reducer.n_disks, 1)  # disks stand side by side
    contact_pose[:, rotations] += turn * np.array(senses) * bodies_passed
    return contact_pose


def _one_sense(drive: Drive, pose: Real, levels: Real, preloaded: bool) -> Equilibria:
    """Equilibria at torques [N mm] of one sense, the least first, from poses at an end of the play.

    Notes
    -----
    Contacts that interfere (``preloaded``) are many at no load and few at the last torque, and a loose disk is easily
    found under load, from where one without clearance stands: both are solved from the last torque down.
    """
    clearance, loose = drive.clearance_of_disks, bool(np.any(drive.clearance_of_disks))
    start = first_poses(drive, pose, levels[-1 if preloaded else 0])
    if loose and drive.reducer.centred:
        one_sided = replace(drive, known=drive.gap_of_errors, bearing_clearance=np.zeros_like(clearance))
        without_clearance = _one_sense(one_sided, pose, levels, preloaded)
        start = _loosened(drive.reducer, without_clearance.motion[:, -1], without_clearance.force[:, -1], clearance)
    downward = preloaded or loose
    states = drive.equilibria(start, levels[::-1] if downward else levels)
    return states[:, ::-1] if downward else states


def _loosened(reducer: Reducer, motion: Real, force: Real, clearance: Real) -> Real:
    """Poses (n, n_motions) once bearings without clearance get one [mm]: each disk falls on by its own.

    The rotations follow so that the contacts, weighted by their forces (n, n_contacts), stay as deep as they can.
    """
    translations = 2 * reducer.n_disks
    planar, rotations = reducer.planar, reducer.contact_jacobian[:, translations:]
    poses = motion.copy()
    shift = motion[:, :translations].reshape(len(motion), -1, 2)
    eccentricity = np.maximum(np.hypot(shift[..., 0], shift[..., 1]), 1e-300)
    fall = (shift * (of_each_disk(clearance, reducer.n_disks) / eccentricity)[..., None]).reshape(len(motion), -1)
    poses[:, :translations] += fall
    for k, weight in enumerate(np.sqrt(np.maximum(force, 0.0))):
        poses[k, translations:] -= np.linalg.lstsq(
            weight[:, None] * rotations, weight * (planar @ fall[k]), rcond=None
        )[0]
    return poses


def backbone(drive: Drive, shares: Real) -> Backbone:
    """The frictionless curve at +- the ``shares`` (n_levels,) of the rated torque, ascending from ``NO_LOAD``.

    Notes
    -----
    The play with the disk's centre held is near enough to start from; the program that knows the bearing's clearance
    takes 15 ms a state and is left to the states that find no equilibrium from there.
    """
    separated = separated_play(drive.reducer, drive.gap)
    torque = drive.rated_torque * shares
    preloaded = bool(np.any(separated.preloaded))
    senses = [
        _one_sense(drive, pose, sense * torque, preloaded)
        for sense, pose in ((-1.0, separated.pose_minus), (1.0, separated.pose_plus))
    ]
    hard = np.any(drive.clearance_of_disks > 0, axis=1) & ~np.all(
        [np.all(branch.converged, axis=1) for branch in senses], axis=0
    )
    if np.any(hard):
        remaining = drive.some(hard)
        coupled = rigid_play(drive.reducer, remaining.gap, remaining.bearing_clearance)
        for branch, sense, pose in zip(senses, (-1.0, 1.0), (coupled.pose_minus, coupled.pose_plus), strict=True):
            start = first_poses(remaining, pose, sense * torque[0])
            branch[hard] = remaining.equilibria(start, sense * torque)
    falling, rising = senses
    states = Equilibria.joined((falling[:, ::-1], rising), axis=1)
    torques = np.concatenate([-torque[::-1], torque])
    return Backbone(torques, states.motion[..., drive.reducer.output_motion] + drive.twist(torques), states)
