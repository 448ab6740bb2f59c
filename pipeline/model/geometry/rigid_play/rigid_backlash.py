"""Rigid backlash: how far the output turns between its two ends of play, every body rigid.

With a rigid input bearing the chain separates: the play of the disk among its pins and the play of each output
interface add up (``separated_play``); of several disks, each with a chain of its own to one output, the shortest play
to either side counts. With a clearance of a bearing everything couples, and the play is
a linear program with one second-order cone a disk (``coupled_play``). Where no input bearing holds the disks nothing is
a disc, and the program is linear. The same program by HiGHS (``general_play``) is the check of the others.

Arrays have the sample axis first; gaps [mm], angles [rad].
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Index, Real, Truth, Whole
from pipeline.model.compiled import entry, part
from pipeline.model.geometry.contacts import PIN
from pipeline.model.geometry.reducer import Reducer, of_each_disk
from pipeline.model.geometry.rigid_play.disc_program import cut_program
from pipeline.model.geometry.rigid_play.vertex_program import optimal_points
from pipeline.model.units import UM_PER_MM

ARM_FLOOR = 1e-9
"""Arms below this share of the largest one carry no moment; such contacts limit no rotation."""
TOUCHING = 1e-10
"""Overlap [mm] below which contacts touch: rounding of gaps, which are differences of lengths near 1e2 mm."""
BISECTIONS = 60
"""Halvings of the bracket of the least penetration: down to the last bit."""


@dataclass(frozen=True)
class RigidPlay:
    """Play of ``n`` samples between its two ends.

    Attributes
    ----------
    pose_plus, pose_minus : (n, n_motions) rigid motions at the two ends; of a part whose gaps interfere both are
        its pose of least penetration.
    overlap : (n,) [mm] least possible largest penetration, 0 where the gaps leave room.
    output_motion : column of the output's rotation.
    """

    pose_plus: Real
    pose_minus: Real
    overlap: Real
    output_motion: int

    @property
    def ends(self) -> Real:
        """(2, n) [rad] angle of the output from its nominal position at the two ends, + and -."""
        return np.stack([self.pose_plus[:, self.output_motion], self.pose_minus[:, self.output_motion]])

    @property
    def backlash(self) -> Real:
        """(n,) [rad] angle of the output between the two ends; interfering parts contribute nothing."""
        return self.pose_plus[:, self.output_motion] - self.pose_minus[:, self.output_motion]

    @property
    def preloaded(self) -> np.ndarray:
        """(n,) whether the gaps of some part interfere."""
        return self.overlap > 0


@part
def _ends_of_sample(
    gap: Real, widening: float, contact: Index, arm: Real, arms_below: int, arms_up_to: int
) -> tuple[float, float, bool]:
    """As ``_rotation_ends``, of one sample with gaps (n_contacts,) that are all widened alike."""
    plus, minus, interferes = np.inf, -np.inf, False
    for k in range(arms_below):
        plus = min(plus, -(gap[contact[k]] + widening) / arm[k])
    for k in range(arms_up_to, len(arm)):
        minus = max(minus, -(gap[contact[k]] + widening) / arm[k])
    for k in range(arms_below, arms_up_to):
        interferes |= gap[contact[k]] + widening < 0.0
    return plus, minus, interferes or plus < minus


@entry
def _rotation_ends(gap: Real, contact: Index, arm: Real, arms_below: int, arms_up_to: int) -> tuple[Real, Real, Truth]:
    """Ends plus, minus (n,) of the rotation that keeps gap[:, contact] + arm phi >= 0, and whether there is none.

    The contacts stand in the order of their arms, of which so many are below zero, and up to it.
    """
    n = gap.shape[0]
    ends_plus, ends_minus, tight = np.empty(n), np.empty(n), np.empty(n, np.bool_)
    for s in range(n):
        ends_plus[s], ends_minus[s], tight[s] = _ends_of_sample(gap[s], 0.0, contact, arm, arms_below, arms_up_to)
    return ends_plus, ends_minus, tight


def _by_arm(contact: Index, arm: Real) -> tuple[Index, Real, int, int]:
    """Contacts and arms in the order of the arms, of which those that carry no moment are 0; how many are < 0, <= 0."""
    size = np.abs(arm)
    arm = np.where(size > ARM_FLOOR * size.max(), arm, 0.0)
    order = arm.argsort()
    ascending = arm[order]
    return contact[order], ascending, int(ascending.searchsorted(0.0)), int(ascending.searchsorted(0.0, "right"))


def rotation_play(gap: Real, contact: Index, arm: Real) -> tuple[Real, Real, Real]:
    """Ends (plus, minus) of the rotation that keeps gap[:, contact] + arm phi >= 0, and the overlap where none does."""
    gap, (contact, arm, arms_below, arms_up_to) = np.ascontiguousarray(gap), _by_arm(contact, arm)
    plus, minus, tight = _rotation_ends(gap, contact, arm, arms_below, arms_up_to)
    overlap = np.zeros(len(gap))
    if np.any(tight):
        tight_gap = np.ascontiguousarray(gap[tight][:, contact])
        plus[tight], least_penetration = _least_penetration(tight_gap, arm, plus[tight], minus[tight])
        minus[tight] = plus[tight]
        overlap[tight] = np.where(least_penetration > TOUCHING, least_penetration, 0.0)
    return plus, minus, overlap


@entry
def _least_penetration(gap: Real, arm: Real, one_end: Real, other_end: Real) -> tuple[Real, Real]:
    """Rotation (n,) and value (n,) of the least largest penetration max(-gap - arm phi), convex in phi.

    The gaps (n, n_contacts) stand in the order of the arms.
    """
    n = gap.shape[0]
    rotation, penetration = np.empty(n), np.empty(n)
    for s in range(n):
        low, high = min(one_end[s], other_end[s]), max(one_end[s], other_end[s])
        for step in range(BISECTIONS + 1):
            phi, deepest, worst = 0.5 * (low + high), -np.inf, 0
            for k in range(len(arm)):
                depth = -gap[s, k] - arm[k] * phi
                if depth > deepest:
                    deepest, worst = depth, k
            if step < BISECTIONS and arm[worst] > 0:
                low = phi
            elif step < BISECTIONS:
                high = phi
        rotation[s], penetration[s] = phi, deepest
    return rotation, penetration


def _floating_play(gap: Real, side: np.ndarray, arm: Real) -> tuple[Real, Real, Real]:
    """As ``rotation_play`` for bodies that may also shift across the slide: gap + side y + arm phi >= 0.

    A shift y exists exactly if every pair of contacts on opposite faces leaves room between its two limits,
    so the pairs are contacts of a pure rotation; an overlap is shared by the two faces.
    """
    upper, lower = np.flatnonzero(side > 0), np.flatnonzero(side < 0)
    pair_gap = (gap[:, upper, None] + gap[:, None, lower]).reshape(len(gap), -1)
    pairs = np.arange(pair_gap.shape[1])
    plus, minus, overlap = rotation_play(pair_gap, pairs, np.add.outer(arm[upper], arm[lower]).ravel())
    return plus, minus, 0.5 * overlap


def _centring_shift(gap: Real, side: np.ndarray, arm: Real, phi: Real) -> Real:
    """Shift y across the slide that leaves both faces equal room at the rotation phi."""
    room = gap + arm * phi[:, None]
    room_above: Real = np.min(room, axis=1, where=side > 0, initial=np.inf)
    room_below = np.min(room, axis=1, where=side < 0, initial=np.inf)
    shift: Real = 0.5 * (room_below - room_above)
    return shift


def _of_output(reducer: Reducer, play: RigidPlay) -> RigidPlay:
    """The play of the flange as that of the output, flange or housing."""
    for pose in (play.pose_plus, play.pose_minus):
        pose[:, play.output_motion] /= reducer.flange_ratio
    if reducer.flange_ratio > 0:
        return play
    return replace(play, pose_plus=play.pose_minus, pose_minus=play.pose_plus)


def _disk_contacts(reducer: Reducer) -> list[tuple[Index, Index]]:
    """Contacts of each disk with the pins, and with the output."""
    contacts = reducer.contacts
    disks = (reducer.disk_of_contact == disk for disk in range(reducer.n_disks))
    return [
        (np.flatnonzero(of_disk & (contacts.kind == PIN)), np.flatnonzero(of_disk & (contacts.kind != PIN)))
        for of_disk in disks
    ]


def _parallel_play(reducer: Reducer, gap: Real) -> RigidPlay:
    """Play (n,) of several disks, each between its pins and one output; every body only rotates.

    Notes
    -----
    Each disk leaves the output an interval, the sum of those of its pins and of its output contacts; the output has
    what they share. Where they share nothing the disks work against each other and stand where the largest penetration
    is least.
    """
    pins, output = _parts(reducer, gap)
    plus, minus = np.min(pins[0] + output[0], axis=1), np.max(pins[1] + output[1], axis=1)
    overlap = np.maximum(pins[2], output[2]).max(axis=1)
    is_blocked = plus < minus
    if np.any(is_blocked):
        plus[is_blocked], least_penetration = _meeting(reducer, gap[is_blocked])
        minus[is_blocked] = plus[is_blocked]
        overlap[is_blocked] = np.where(least_penetration > TOUCHING, least_penetration, 0.0)
        pins[:, is_blocked], output[:, is_blocked] = _parts(reducer, gap[is_blocked] + least_penetration[:, None])
    motions = reducer.motions
    turning = [motions.index(f"{disk.body}_phi") for disk in reducer.disks]
    poses = []
    for end, play_behind in ((plus, output[0]), (minus, output[1])):
        pose = np.zeros((len(gap), len(motions)))
        pose[:, reducer.output_motion] = end
        pose[:, turning] = np.clip(end[:, None] - play_behind, pins[1], pins[0])
        poses.append(pose)
    return _of_output(reducer, RigidPlay(poses[0], poses[1], overlap, reducer.output_motion))


def _parts(reducer: Reducer, gap: Real) -> Real:
    """Ends plus, minus and overlap of each disk among its pins, and of the output in it, (2, 3, n, n_disks)."""
    arm = reducer.contacts.arm
    parts = [[rotation_play(gap, rows, arm[rows]) for rows in pair] for pair in _disk_contacts(reducer)]
    return np.moveaxis(np.array(parts), 0, -1)


def _meeting(reducer: Reducer, gap: Real) -> tuple[Real, Real]:
    """Rotation (n,) of the output by several disks that share none, and the least largest penetration.

    All gaps are widened alike until the disks share one rotation, by bisection: their intervals grow with it.
    """
    arm = reducer.contacts.arm
    groups = [_by_arm(rows, arm[rows]) for pair in _disk_contacts(reducer) for rows in pair]
    contacts, arms = (np.concatenate([group[k] for group in groups]) for k in (0, 1))
    lasts = np.cumsum([len(group[0]) for group in groups])
    ranges = np.array([(last - len(group[0]), last, *group[2:]) for last, group in zip(lasts, groups, strict=True)])
    return _bisected_meeting(np.ascontiguousarray(gap), contacts, arms, ranges)


@entry
def _bisected_meeting(gap: Real, contacts: Index, arms: Real, ranges: Whole) -> tuple[Real, Real]:
    """See ``_meeting``.

    Of the contacts of each disk with the pins, then of those with the output, ``ranges`` (2 n_disks, 4) has where they
    begin and end in ``contacts``, and how many of their arms are below zero, and up to it.
    """
    n = gap.shape[0]
    rotation, penetration = np.empty(n), np.empty(n)
    for s in range(n):
        low, high, widening = 0.0, np.max(np.abs(gap[s])), 0.0
        for step in range(BISECTIONS + 1):
            widening = 0.5 * (low + high) if step < BISECTIONS else high
            plus, minus = np.inf, -np.inf
            for disk in range(len(ranges) // 2):
                plus_of_disk, minus_of_disk, is_tight = 0.0, 0.0, False
                for k in range(2 * disk, 2 * disk + 2):
                    first, last, arms_below, arms_up_to = ranges[k, 0], ranges[k, 1], ranges[k, 2], ranges[k, 3]
                    contact, arm = contacts[first:last], arms[first:last]
                    end_plus, end_minus, tight = _ends_of_sample(gap[s], widening, contact, arm, arms_below, arms_up_to)
                    plus_of_disk += end_plus
                    minus_of_disk += end_minus
                    is_tight |= tight
                if is_tight:
                    plus_of_disk = -np.inf
                plus, minus = min(plus, plus_of_disk), max(minus, minus_of_disk)
            if step < BISECTIONS and plus < minus:
                low = widening
            elif step < BISECTIONS:
                high = widening
        rotation[s], penetration[s] = 0.5 * (plus + minus), widening
    return rotation, penetration


def separated_play(reducer: Reducer, gap: Real) -> RigidPlay:
    """Play (n,) with the disks' centres held, part by part; ``gap`` (n, n_contacts) [mm].

    Notes
    -----
    Exact for rigid bearings without clearance: no part of a chain then moves another's contacts but by
    its rotation, and the two slides of a floating plate are perpendicular.
    """
    if reducer.n_disks > 1:
        return _parallel_play(reducer, gap)
    contacts, motions = reducer.contacts, reducer.motions
    poses = {end: np.zeros((len(gap), len(motions))) for end in ("plus", "minus")}
    of_pins = np.flatnonzero(contacts.kind == PIN)
    plus, minus, overlap = rotation_play(gap, of_pins, contacts.arm[of_pins])
    ends = {"plus": plus, "minus": minus}
    for end, pose in poses.items():
        pose[:, motions.index("disk_phi")] = ends[end]
    for interface in range(contacts.interface.max() + 1):
        rows = np.flatnonzero(contacts.interface == interface)
        arm, normal, body = contacts.arm[rows], contacts.normal[rows], contacts.body_b[rows[0]]
        floats = any(f"{b}_x" in motions for b in (body, contacts.body_a[rows[0]]) if b != "disk")
        if floats:
            gaps_of_disk, side = gap[:, rows], np.where(np.real(np.conj(normal[0]) * normal) > 0, 1, -1)
            plus, minus, part_overlap = _floating_play(gaps_of_disk, side, arm)
        else:
            plus, minus, part_overlap = rotation_play(gap, rows, arm)
        overlap = np.maximum(overlap, part_overlap)
        for end, phi in (("plus", plus), ("minus", minus)):
            ends[end] = ends[end] + phi
            poses[end][:, motions.index(f"{body}_phi")] = ends[end]
            if floats:
                shift = _centring_shift(gaps_of_disk, side, arm, phi) * (1 if f"{body}_x" in motions else -1)
                mover = body if f"{body}_x" in motions else contacts.body_a[rows[0]]
                poses[end][:, motions.index(f"{mover}_x")] += shift * normal[0].real
                poses[end][:, motions.index(f"{mover}_y")] += shift * normal[0].imag
    return _of_output(reducer, RigidPlay(poses["plus"], poses["minus"], overlap, reducer.output_motion))


def _general_ends(jacobian: Real, gap: Real, radii: Real, output: int) -> tuple[Real, Real, float]:
    """Poses at the two ends [um, urad] and overlap [um] of one sample, by the general program."""
    n = jacobian.shape[1]
    ends = []
    for sense in (1.0, -1.0):
        objective = np.zeros(n)
        objective[output] = sense
        ends.append(cut_program(objective, jacobian, gap, radii))
    if ends[0] is not None and ends[1] is not None:
        return ends[0], ends[1], 0.0
    lifted = np.hstack([jacobian, -np.ones((len(gap), 1))])
    pose = cut_program(np.append(np.zeros(n), -1.0), lifted, gap, radii)
    if pose is None:
        raise ArithmeticError("no pose of least penetration found")
    clearance = float(pose[n])
    return pose[:n], pose[:n], clearance if clearance > UM_PER_MM * TOUCHING else 0.0


def general_play(reducer: Reducer, gap: Real, bearing_clearance: Real) -> RigidPlay:
    """Play (n,) of the whole chain at once, disk centres free within their bearings' clearance [mm].

    Parameters
    ----------
    bearing_clearance : (n,) of all bearings alike, or (n, n_disks).

    Notes
    -----
    A bearing's clearance is a disc: tangent cuts are added until it is met to 1e-9 of its radius. A sample that
    interferes anywhere has no play here; ``separated_play`` keeps the play of its other parts.
    """
    ends = [
        _general_ends(reducer.contact_jacobian, UM_PER_MM * of_sample, UM_PER_MM * radii, reducer.output_motion)
        for of_sample, radii in zip(gap, of_each_disk(bearing_clearance, reducer.n_disks), strict=True)
    ]
    plus, minus, overlap = zip(*ends, strict=True)
    return RigidPlay(
        np.array(plus) / UM_PER_MM, np.array(minus) / UM_PER_MM, np.array(overlap) / UM_PER_MM, reducer.output_motion
    )


def coupled_play(reducer: Reducer, gap: Real, bearing_clearance: Real) -> RigidPlay:
    """Play (n,) of the whole chain at once, as ``general_play``, by compiled programs that share their first basis.

    ``bearing_clearance`` (n, n_disks) [mm] within which input bearings hold the disks; (n, 0) where contacts alone do.
    """
    jacobian, limits, radii = reducer.contact_jacobian, UM_PER_MM * gap, UM_PER_MM * bearing_clearance
    objective = np.eye(len(reducer.motions))[reducer.output_motion]
    (plus, free), (minus, also_free) = (
        optimal_points(sense * objective, jacobian, limits, radii) for sense in (1.0, -1.0)
    )
    overlap, tight = np.zeros(len(gap)), ~(free & also_free)
    if np.any(tight):
        lifted = np.hstack([jacobian, -np.ones((len(jacobian), 1))])
        poses, _ = optimal_points(np.append(np.zeros(len(objective)), -1.0), lifted, limits[tight], radii[tight])
        plus[tight] = minus[tight] = poses[:, :-1]
        overlap[tight] = np.where(poses[:, -1] > UM_PER_MM * TOUCHING, poses[:, -1], 0.0)
    return RigidPlay(plus / UM_PER_MM, minus / UM_PER_MM, overlap / UM_PER_MM, reducer.output_motion)


def rigid_play(reducer: Reducer, gap: Real, bearing_clearance: Real) -> RigidPlay:
    """Play (n,) by the separated form where every bearing is tight, by the program of the whole where one is not.

    ``bearing_clearance`` [mm] as ``general_play``; of reducers without input bearings it is not asked for.
    """
    if not reducer.is_centred:
        return coupled_play(reducer, gap, np.zeros((len(gap), 0)))
    bearing_clearance = of_each_disk(bearing_clearance, reducer.n_disks)
    loose = np.any(bearing_clearance > 0, axis=1)
    if np.all(loose):
        return coupled_play(reducer, gap, bearing_clearance)
    play = separated_play(reducer, gap)
    if not np.any(loose):
        return play
    coupled = coupled_play(reducer, gap[loose], bearing_clearance[loose])
    for values, of_loose in (
        (play.pose_plus, coupled.pose_plus),
        (play.pose_minus, coupled.pose_minus),
        (play.overlap, coupled.overlap),
    ):
        values[loose] = of_loose
    return play
