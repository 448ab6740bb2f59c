"""The load cycle 0 -> +T -> -T -> +T on the output, the states it visits and the numbers read off its curve.

Without friction a state depends on the torque alone: each torque is solved once, from the free play outwards, and
the branches of the cycle visit the states. T = 0 stands as two states, the ends 0+ and 0- of the free play.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its functions are slow to import: they are when they are called

from pipeline.arrays import Index, Real
from pipeline.model.equilibrium.solve import ElasticReducer, Equilibria
from pipeline.model.geometry.rigid_play.rigid_backlash import RigidPlay, rigid_play
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import ARCMIN as ARCMIN

BRANCHES = ("loading+", "unloading+", "loading-", "unloading-", "reloading+")
LIMIT_TORQUE = 1e-8
"""Share of the rated torque that stands for the limit T -> 0 where preload leaves no rigid play: its twist is below
1e-7 arcmin."""
SMALL_TORQUE = 1e-6
"""The same share where that drowns in the rounding of the preload, which grows as the torque falls: 9.7 kN in the
bearings of an RV reducer leave a residual of 4e-11 here, of 9e-10 at 3e-8 and no state at 1e-8."""
TOUCHING = 1e-7
"""Gap [mm] that is left of a contact which limits the play: the accuracy of the linear program."""


@dataclass(frozen=True)
class LoadCycle:
    """Torques of a cycle.

    Attributes
    ----------
    rated_torque : [N mm]
    fractions : (n_levels,) ascending shares of the rated torque, the last one the cycle's top.
    """

    rated_torque: float
    fractions: Real

    @classmethod
    def evenly(cls, rated_torque: float, levels: int, top: float, marks: tuple[float, ...]) -> "LoadCycle":
        """``levels`` equal steps up to the share ``top`` of the rated torque, and exactly the shares ``marks``.

        Raises
        ------
        ValueError
            If a mark lies above the top.
        """
        if max(marks) > top * (1 + 1e-12):
            raise ValueError(f"a metric needs {max(marks):g} of the rated torque, the cycle ends at {top:g}")
        steps = top * np.arange(1, levels + 1) / max(levels, 1)
        even_steps = steps[
            np.min(np.abs(steps[:, None] - np.asarray(marks)), axis=1) > 1e-9 * top
        ]  # none if levels is 0
        return cls(rated_torque, np.unique(np.concatenate([even_steps, marks])))

    @property
    def state_torque(self) -> Real:
        """Torque of every state (n_states,) [N mm]: 0+, the positive levels, 0-, the negative levels."""
        levels = np.concatenate([[0.0], self.rated_torque * self.fractions])
        return np.concatenate([levels, -levels])

    @property
    def steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Branch number and state of every step of the cycle, (n_steps,) each."""
        upward = np.arange(len(self.fractions) + 1)
        downward = upward[-2::-1]
        negative = len(upward)
        visits = [upward, downward, upward + negative, downward + negative, upward]
        branch = np.repeat(np.arange(len(visits)), [len(v) for v in visits])
        return branch, np.concatenate(visits)


def first_poses(drive: Drive, pose: Real, torque: float) -> Real:
    """Poses (n, n_motions) beyond an end of play: each rotation closes a contact that carries ``torque`` [N mm]."""
    reducer = drive.reducer
    if not reducer.is_centred:
        return _loaded_poses(drive.elastic, drive.gap, pose, torque)
    arms = np.abs(reducer.contact_jacobian[:, reducer.output_motion])
    carrier = int(np.argmax(arms))
    force = abs(torque) / arms[carrier]
    depth = drive.laws.deflection(force)[carrier] + drive.compliance[carrier, carrier] * force
    turn = np.sign(torque) * depth / arms[carrier]
    rotations = [i for i, motion in enumerate(reducer.motions) if motion.endswith("_phi")]
    senses = [1 if motion == reducer.output_motion else np.sign(reducer.flange_ratio) for motion in rotations]
    contact_pose = pose.copy()
    bodies_passed = np.maximum(np.arange(len(rotations)) + 2 - reducer.n_disks, 1)  # disks stand side by side
    contact_pose[:, rotations] += turn * np.array(senses) * bodies_passed
    return contact_pose


def _play_to_start_from(drive: Drive) -> RigidPlay:
    """Play of rigid bodies; of a preloaded sample whose contacts hold the disks, how far its least penetration lets it.

    Contacts that interfere may leave the output some play, through which Newton would take small steps.
    """
    play = rigid_play(drive.reducer, drive.gap, drive.bearing_clearance)
    tight = np.flatnonzero(play.preloaded)
    if drive.reducer.is_centred or not len(tight):
        return play
    widened_gap = drive.gap[tight] + play.overlap[tight, None]
    relaxed = rigid_play(drive.reducer, widened_gap, drive.bearing_clearance[tight])
    play.pose_plus[tight], play.pose_minus[tight] = relaxed.pose_plus, relaxed.pose_minus
    return play


def solve_cycle(drive: Drive, cycle: LoadCycle, neighbour: Equilibria | None = None) -> Equilibria:
    """The frictionless states of the cycle; arrays (n, n_states, ...) in the order of ``cycle.state_torque``.

    Parameters
    ----------
    neighbour : of a preloaded drive that differs little, the states (n, 2) at the limits from above and from below:
        preload is sought from them.

    Notes
    -----
    The states at zero torque are the ends of the rigid play, free of force. In a preloaded sample forces act at zero
    torque too; its two ends are the equilibria at +-``LIMIT_TORQUE`` of the rated torque.

    Samples are solved from the ends of play upwards, preloaded ones from the limit, but from the largest torque down
    where bearings are loose, since disks lean on these under load. Contacts that interfere are many at no load: a
    start at the largest torque, where few of them carry, takes an interior point for most samples.
    """
    play = _play_to_start_from(drive)
    levels = cycle.rated_torque * cycle.fractions
    downward = drive.reducer.is_centred & np.any(drive.clearance_of_disks, axis=1)
    ways = sorted(set(zip(play.preloaded.tolist(), downward.tolist(), strict=True)))
    if len(ways) == 1:
        return _both_senses(drive, play.pose_plus, play.pose_minus, levels, *ways[0], neighbour)
    rows = [np.flatnonzero((play.preloaded == way[0]) & (downward == way[1])) for way in ways]
    parts = [
        _both_senses(drive.some(samples), play.pose_plus[samples], play.pose_minus[samples], levels, *way)
        for samples, way in zip(rows, ways, strict=True)
    ]
    return Equilibria.concatenate(parts, axis=0)[np.argsort(np.concatenate(rows))]


def _both_senses(
    drive: Drive,
    pose_plus: Real,
    pose_minus: Real,
    levels: Real,
    are_preloaded: bool,
    downward: bool,
    neighbour: Equilibria | None = None,
) -> Equilibria:
    """As ``solve_cycle``, of samples (n,) which all are ``are_preloaded`` or none and start in one direction."""
    states: list[Equilibria] = []
    for number, (torque, pose) in enumerate(((levels, pose_plus), (-levels, pose_minus))):
        limit = None
        if are_preloaded and not downward and (states or neighbour is not None):
            limit = states[0][:, 0] if neighbour is None else neighbour[:, number]
        states.append(_either_way(drive, pose, torque, are_preloaded, downward, limit))
    return Equilibria.concatenate(states, axis=1)


def _either_way(
    drive: Drive, pose: Real, levels: Real, are_preloaded: bool, downward: bool, limit: Equilibria | None
) -> Equilibria:
    """As ``_solve_direction``; samples lost on their way are solved on the other if more of their states are.

    A state that is lost on both is sought by itself from the end of play: on the way it may start at a kink, between
    two sets of contacts (1 of 33,000 load cycles of ``rv_80e``).
    """
    states = _solve_direction(drive, pose, levels, are_preloaded, downward, limit)
    if states.converged.all():
        return states
    lost = np.flatnonzero(~np.all(states.converged, axis=1))
    other_states = _solve_direction(drive.some(lost), pose[lost], levels, are_preloaded, not downward)
    is_better = np.sum(other_states.converged, axis=1) > np.sum(states.converged[lost], axis=1)
    states[lost[is_better]] = other_states[is_better]
    for sample, level in zip(*np.nonzero(~states.converged[:, 1:]), strict=True):
        own = np.array([sample])
        alone = _solve_direction(drive.some(own), pose[own], levels[[level]], are_preloaded, downward=False)
        if alone.converged[0, 1]:
            states[sample, 1 + level] = alone[0, 1]
    return states


def _solve_direction(
    drive: Drive, pose: Real, levels: Real, are_preloaded: bool, downward: bool, limit: Equilibria | None = None
) -> Equilibria:
    """Ends of play and equilibria (n, 1 + n_levels) in one direction, all samples preloaded or none.

    The first of them is sought from the ``limit`` (n,) of neighbours.
    """
    torque = levels
    if are_preloaded:
        torque = np.append(np.sign(levels[0]) * drive.rated_torque * np.array([LIMIT_TORQUE, SMALL_TORQUE]), levels)
    if downward:
        torque = torque[::-1]
    states = drive.softened_equilibria(first_poses(drive, pose, torque[0]), torque, limit)
    if downward:
        states = states[:, ::-1]
    if are_preloaded:
        return _from_limit(states)
    n = len(pose)
    end = Equilibria(
        motion=pose[:, None],
        force=np.zeros((n, 1, len(drive.laws))),
        iterations=np.zeros((n, 1), np.int64),
        residual=np.zeros((n, 1)),
        converged=np.ones((n, 1), bool),
    )
    return Equilibria.concatenate((end, states), axis=1)


def _from_limit(states: Equilibria) -> Equilibria:
    """The states but one of the first two, at the limit and at a small torque: the second where the first is lost."""
    ends = states[:, :1]
    lost = ~ends.converged[:, 0]
    ends[lost] = states[lost, 1:2]
    return Equilibria.concatenate((ends, states[:, 2:]), axis=1)


def _loaded_poses(elastic: ElasticReducer, gap: Real, pose: Real, torque: float) -> Real:
    """Poses (n, n_motions) near equilibrium under a small ``torque`` [N mm], from ends of play (n, n_motions).

    Notes
    -----
    At an end of play the contacts that stop it balance the torque by forces >= 0 (the duals of its program); each of
    them is then as deep as it deflects under its force. Where as many touch as there are motions they are the basis of
    that program, and have one balance; of others, as of preloaded units, one is sought.
    """
    reducer = elastic.reducer
    jacobian, start = reducer.contact_jacobian, pose.copy()
    rotates = [motion.endswith(("_phi", "_psi")) for motion in reducer.motions]
    scale = np.where(rotates, 1 / np.abs(jacobian).max(), 1.0)
    load = np.zeros(len(scale))
    load[reducer.output_motion] = torque
    slack = gap - pose @ jacobian.T
    stops = slack < TOUCHING
    is_basis = (np.sum(stops, axis=1) == len(scale)) & np.all(slack > -TOUCHING, axis=1)
    units, rows = np.flatnonzero(is_basis), np.nonzero(stops[is_basis])[1].reshape(-1, len(scale))
    of_basis = (jacobian * scale)[rows]
    loads = np.broadcast_to((load * scale)[:, None], (*rows.shape, 1))
    force = np.maximum(np.linalg.solve(of_basis.swapaxes(1, 2), loads)[..., 0], 0.0)
    depth = _depth(elastic, rows, force)
    start[units] += scale * np.linalg.solve(of_basis, depth[..., None])[..., 0]
    for k in np.flatnonzero(~is_basis & np.any(stops, axis=1)):
        stopping = np.flatnonzero(stops[k])
        force, _ = scipy.optimize.nnls((jacobian[stopping] * scale).T, load * scale)
        rows, force = stopping[force > 0], force[force > 0]
        start[k] += np.linalg.lstsq(jacobian[rows], _depth(elastic, rows, force), rcond=None)[0]
    return start


def _depth(elastic: ElasticReducer, rows: Index, force: Real) -> Real:
    """How deep contacts (..., n_rows) are that alone carry forces (..., n_rows) [N]; 0 without one [mm]."""
    give = np.einsum("...ij,...j->...i", elastic.compliance[rows[..., :, None], rows[..., None, :]], force)
    return np.where(force > 0, elastic.laws[rows].deflection(force) + give, 0.0)
