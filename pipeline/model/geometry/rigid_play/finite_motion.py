"""Rigid play by exact kinematics: the real pins against the real flank and holes, moved by finite motions.

The rest of the model moves bodies by small motions: a contact keeps its point, its normal and its arm. Here every pin's
distance from the flank is searched anew where the disk has turned, and output pins move in round holes. Flats keep
their direction: their error is half of the rotation, below 0.5 % within ``validity.LARGEST_ROTATION``.

Where bearings hold the disks' centres, each disk turns until a pin touches, and its output until a contact does: roots
of the least gap. Where disks can shift, what the pose at an end leaves out of the gaps is added to them, and the end is
sought again until it stays.
"""

from collections.abc import Callable

import numpy as np

from pipeline.arrays import Complex, Index, Real
from pipeline.model.geometry.clearance import Errors, pin_gaps
from pipeline.model.geometry.contacts import DiskPose
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.reducer import Reducer, of_each_disk
from pipeline.model.geometry.rigid_play.rigid_backlash import TOUCHING, RigidPlay, rigid_play, rotation_play

STEPS = 60
"""Steps in which an end of play is found, by bracketing or from pose to pose; most take less than ten."""
WIDENING = 1.5
"""Growth of a rotation until some contact is closed by it."""
SETTLED = 1e-5
"""Change of an end of play in the last step, over the play."""


def _motion(reducer: Reducer, body: str, pose: Real) -> tuple[Complex, Real]:
    """Translation (n,) complex [mm] and rotation (n,) [rad] of a body at poses (n, n_motions)."""
    parts = []
    for component in ("x", "y", "phi"):
        name = f"{body}_{component}"
        column = reducer.motions.index(name) if name in reducer.motions else None
        ratio = reducer.flange_ratio if column == reducer.output_motion else 1.0
        parts.append(np.zeros(len(pose)) if column is None else ratio * pose[:, column])
    return parts[0] + 1j * parts[1], parts[2]


def _round_holes(reducer: Reducer, disk: int) -> Index:
    """Numbers of the contacts of output pins in round holes of a disk."""
    rows: Index = reducer.output_rows[disk]
    contacts = reducer.contacts.some(rows)
    round_holes: Index = rows[(contacts.hole >= 0) & (contacts.per_eccentricity != 0)]
    return round_holes


def _hole_changes(
    reducer: Reducer, disk: DiskPose, rows: Index, errors: Errors, motion: tuple[Complex, Real], output: Real
) -> Real:
    """What finite motions of a disk and rotations ``output`` (n,) change its output pins' gaps by, (n, n_rows) [mm].

    Notes
    -----
    The axes of hole and pin stand e n - v apart, see ``clearance.hole_gaps``; the gap is what is left of the radii.
    """
    contacts, (shift, turn) = reducer.contacts.some(rows), motion
    centre = contacts.point - contacts.normal / contacts.curvature - disk.eccentric  # of the pin, about the axis
    eccentricity = disk.eccentricity + errors.eccentricity[:, None]
    apart = eccentricity * contacts.normal - errors.pin_off_hole[:, contacts.hole] * np.exp(1j * disk.rotation)
    moved = apart + shift[:, None] + centre * (np.exp(1j * turn) - np.exp(1j * output))[:, None]
    changes: Real = np.abs(apart) - np.abs(moved)
    return changes


def _gaps_of_pins(
    profile: CycloidProfile, reducer: Reducer, errors: Errors, disk_reading: str, pose: Real | None
) -> Real:
    """Gaps (n, n_disks n_pins) of the pins after finite motions ``pose`` (n, n_motions) [mm]; None for none."""
    gap = []
    for number, disk in enumerate(reducer.disks):
        motion = None if pose is None else _motion(reducer, disk.body, pose)
        of_disk = errors.of_disk(number)
        gap.append(pin_gaps(profile, disk, of_disk, method="exact", disk_reading=disk_reading, motion=motion))
    return np.hstack(gap)


def _gap_changes(
    profile: CycloidProfile, reducer: Reducer, errors: Errors, disk_reading: str, pose: Real, before: Real
) -> Real:
    """What finite motions ``pose`` (n, n_motions) change the gap of every contact by, (n, n_contacts) [mm].

    ``before`` (n, n_disks n_pins) are the gaps of the pins [mm] without any.
    """
    change = -pose @ reducer.contact_jacobian.T
    change[:, : reducer.n_pins] = _gaps_of_pins(profile, reducer, errors, disk_reading, pose) - before
    for number, disk in enumerate(reducer.disks):
        holes = _round_holes(reducer, number)
        if len(holes):
            motion, (_, output) = _motion(reducer, disk.body, pose), _motion(reducer, "output", pose)
            change[:, holes] = _hole_changes(reducer, disk, holes, errors.of_disk(number), motion, output)
    return change


LeastGap = Callable[[Real, Index], Real]
"""Rotations (n_rows,) [rad] of the units of those numbers to their least gaps [mm]."""


def _first_contact(least_gap: LeastGap, middle: Real, start: Real) -> Real:
    """Rotation (n,) [rad] beyond ``middle``, near ``start``, at which the least gap is 0; missing where none is found.

    Notes
    -----
    Regula falsi by the Illinois rule: Dowell and Jarratt, BIT 11 (1971) 168.
    """
    low, high, every = middle.copy(), start.copy(), np.arange(len(start))
    gap_low, gap_high = least_gap(low, every), least_gap(high, every)
    found = np.where(np.abs(gap_low) <= TOUCHING, low, np.where(np.abs(gap_high) <= TOUCHING, high, np.nan))
    for _ in range(STEPS):
        rows = np.flatnonzero(np.isnan(found) & (gap_low > 0) & (gap_high > 0))
        if not len(rows):
            break
        low[rows], gap_low[rows] = high[rows], gap_high[rows]
        high[rows] = middle[rows] + WIDENING * (high[rows] - middle[rows])
        gap_high[rows] = least_gap(high[rows], rows)
    rows = np.flatnonzero(np.isnan(found) & (gap_low > 0) & (gap_high < 0))
    for _ in range(STEPS):
        if not len(rows):
            break
        trial = high[rows] - gap_high[rows] * (high[rows] - low[rows]) / (gap_high[rows] - gap_low[rows])
        gap = least_gap(trial, rows)
        crosses = (gap > 0) == (gap_high[rows] < 0)  # then the root lies between the last two
        low[rows[crosses]], gap_low[rows[crosses]] = high[rows[crosses]], gap_high[rows[crosses]]
        gap_low[rows[~crosses]] *= 0.5
        high[rows], gap_high[rows] = trial, gap
        settled = np.abs(gap) <= TOUCHING
        found[rows[settled]] = trial[settled]
        rows = rows[~settled]
    return found


def _centred_ends(
    profile: CycloidProfile, reducer: Reducer, errors: Errors, disk_reading: str, gap: Real, small: RigidPlay
) -> Real:
    """Ends +, - (2, n) [rad] of the output's play with the disks' centres held; missing where one is not found."""
    ratio, arm, of_disks = reducer.flange_ratio, reducer.contacts.arm, []
    for number, disk in enumerate(reducer.disks):
        of_disk, holes = errors.of_disk(number), _round_holes(reducer, number)
        pins = np.arange(number * profile.pins, (number + 1) * profile.pins)
        least_of_pins = _least_gap_of_pins(profile, disk, of_disk, disk_reading, gap[:, pins])
        turns = _both_ends(least_of_pins, *rotation_play(gap, pins, arm[pins])[:2])
        if len(holes):
            ways = rotation_play(gap, holes, arm[holes])[:2]
            flange = [
                turn + _both_ends(_least_gap_of_holes(reducer, disk, holes, of_disk, gap[:, holes], turn), *ways)[end]
                for end, turn in enumerate(turns)
            ]
        else:
            poses = small.pose_plus, small.pose_minus
            rest = [ratio * pose[:, reducer.output_motion] - _motion(reducer, disk.body, pose)[1] for pose in poses]
            flange = [turn + way for turn, way in zip(turns, rest if ratio > 0 else rest[::-1], strict=True)]
        of_disks.append(flange)
    ends = np.array(of_disks)
    plus, minus = ends[:, 0].min(axis=0) / ratio, ends[:, 1].max(axis=0) / ratio
    return np.stack([plus, minus] if ratio > 0 else [minus, plus])


def _least_gap_of_pins(
    profile: CycloidProfile, disk: DiskPose, errors: Errors, disk_reading: str, gap: Real
) -> LeastGap:
    """Least gap of the pins of a disk after it has turned; ``gap`` (n, n_pins) before."""
    before = pin_gaps(profile, disk, errors, method="exact", disk_reading=disk_reading)

    def least_gap(turn: Real, rows: Index) -> Real:
        some = Errors(**{name: values[rows] for name, values in vars(errors).items()})
        motion = np.zeros(len(rows), complex), turn
        after = pin_gaps(profile, disk, some, method="exact", disk_reading=disk_reading, motion=motion)
        least: Real = np.min(gap[rows] + after - before[rows], axis=1)
        return least

    return least_gap


def _least_gap_of_holes(
    reducer: Reducer, disk: DiskPose, holes: Index, errors: Errors, gap: Real, turn: Real
) -> LeastGap:
    """Least gap of output pins in the holes of a disk that has turned by ``turn`` (n,), after the output goes on."""

    def least_gap(way: Real, rows: Index) -> Real:
        some = Errors(**{name: values[rows] for name, values in vars(errors).items()})
        motion = np.zeros(len(rows), complex), turn[rows]
        least: Real = np.min(gap[rows] + _hole_changes(reducer, disk, holes, some, motion, turn[rows] + way), axis=1)
        return least

    return least_gap


def _both_ends(least_gap: LeastGap, plus: Real, minus: Real) -> tuple[Real, Real]:
    """Ends of a rotation between contacts, from estimates of them, at once; missing where they are not found."""
    n, middle = len(plus), 0.5 * (plus + minus)
    ends = _first_contact(
        lambda turn, rows: least_gap(turn, rows % n), np.tile(middle, 2), np.concatenate([plus, minus])
    )
    return ends[:n], ends[n:]


def _shifting_ends(
    profile: CycloidProfile,
    reducer: Reducer,
    errors: Errors,
    disk_reading: str,
    gap: Real,
    bearing_clearance: Real,
    small: RigidPlay,
) -> Real:
    """As `_centred_ends`, of disks whose centres can shift."""
    ends, before = [], _gaps_of_pins(profile, reducer, errors, disk_reading, None)
    for name in ("pose_plus", "pose_minus"):
        pose, rows, found = getattr(small, name).copy(), np.arange(len(gap)), np.full(len(gap), np.nan)
        for _ in range(STEPS):
            if not len(rows):
                break
            some = Errors(**{error: values[rows] for error, values in vars(errors).items()})
            left_out = _gap_changes(profile, reducer, some, disk_reading, pose[rows], before[rows])
            left_out += pose[rows] @ reducer.contact_jacobian.T
            play = rigid_play(reducer, gap[rows] + left_out, bearing_clearance[rows])
            last_end, end = (poses[:, reducer.output_motion] for poses in (pose[rows], getattr(play, name)))
            settled = ~play.preloaded & (np.abs(end - last_end) <= SETTLED * small.backlash[rows])
            found[rows[settled]] = end[settled]
            pose[rows] = getattr(play, name)
            rows = rows[~settled & ~play.preloaded]
        ends.append(found)
    return np.array(ends)


def finite_ends(
    profile: CycloidProfile,
    reducer: Reducer,
    errors: Errors,
    disk_reading: str,
    gap: Real,
    bearing_clearance: Real,
    small: RigidPlay,
) -> Real:
    """Ends +, - (2, n) [rad] of the output's play under finite motions, from its nominal position.

    Parameters
    ----------
    gap : (n, n_contacts) [mm] at the nominal pose; what the errors do not describe stays as it is.
    bearing_clearance : (n,) or (n, n_disks) [mm] as ``rigid_play``.
    small : play under small motions with the same gaps.

    Notes
    -----
    A unit whose gaps interfere has those of small motions. Missing where an end is not found.
    """
    ends, free = small.ends.copy(), np.flatnonzero(~small.preloaded)
    if not len(free):
        return ends
    some = Errors(**{name: values[free] for name, values in vars(errors).items()})
    poses = (small.pose_plus[free], small.pose_minus[free], small.overlap[free], small.output_motion)
    parts = (profile, reducer, some, disk_reading, gap[free])
    clearance = of_each_disk(bearing_clearance, reducer.n_disks)[free]
    if reducer.is_centred and not np.any(clearance):
        ends[:, free] = _centred_ends(*parts, RigidPlay(*poses))
    else:
        ends[:, free] = _shifting_ends(*parts, clearance, RigidPlay(*poses))
    return ends


def backlash_change(
    profile: CycloidProfile, reducer: Reducer, errors: Errors, disk_reading: str, gap: Real, bearing_clearance: Real
) -> Real:
    """What finite motions add to the backlash of small ones (n,) [rad]; missing where it is not found.

    Parameters
    ----------
    gap, bearing_clearance : as `finite_ends`.
    """
    small = rigid_play(reducer, gap, bearing_clearance)
    plus, minus = finite_ends(profile, reducer, errors, disk_reading, gap, bearing_clearance, small)
    change: Real = plus - minus - small.backlash
    return change
