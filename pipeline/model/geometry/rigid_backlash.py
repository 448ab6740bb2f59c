"""Rigid backlash: how far the output turns between its two ends of play, every body rigid.

With a rigid input bearing the chain separates: the play of the disk among its pins and the play of each output
interface add up (``separated_play``). With a clearance of the bearing everything couples, and the play is
a linear program with one second-order cone (``general_play``), which is also the check of the other.

Arrays have the sample axis first; gaps [mm], angles [rad].
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linprog

from pipeline.model.compiled import entry
from pipeline.model.geometry.cycloid_profile import Index, Real
from pipeline.model.geometry.reducer import PIN, Reducer
from pipeline.model.units import UM_PER_MM

CONE_TOLERANCE = 1e-9
"""The bearing's disc is cut until it is met to this share of the clearance."""
PROGRAM_TOLERANCE = 1e-10
"""Feasibility of the linear programs, which are solved in micrometres."""
AMONG_MANY = 20
"""Tangents of the bearing's disc after which its optimum is taken for one of many; a single one needs some 16."""
MOST_CUTS = 200
"""Tangents of the bearing's disc after which a program is given up."""
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


@entry
def _rotation_ends(gap, contact, arm):
    """Ends plus, minus (n,) of the rotation that keeps gap[:, contact] + arm phi >= 0, and whether there is none.

    The contacts stand in the order of their arms.
    """
    n = gap.shape[0]
    ends_plus, ends_minus, tight = np.empty(n), np.empty(n), np.empty(n, np.bool_)
    first, last = np.searchsorted(arm, 0.0), np.searchsorted(arm, 0.0, side="right")
    for s in range(n):
        plus, minus, shut = np.inf, -np.inf, False
        for k in range(first):
            plus = min(plus, -gap[s, contact[k]] / arm[k])
        for k in range(last, len(arm)):
            minus = max(minus, -gap[s, contact[k]] / arm[k])
        for k in range(first, last):
            shut |= gap[s, contact[k]] < 0.0
        ends_plus[s], ends_minus[s], tight[s] = plus, minus, shut or plus < minus
    return ends_plus, ends_minus, tight


def _rotation_play(gap: Real, contact: Index, arm: Real) -> tuple[Real, Real, Real]:
    """Ends (plus, minus) of the rotation that keeps gap[:, contact] + arm phi >= 0, and the overlap where none does."""
    arm = np.where(np.abs(arm) > ARM_FLOOR * np.max(np.abs(arm)), arm, 0.0)
    order = np.argsort(arm)
    contact, arm = contact[order], arm[order]
    plus, minus, tight = _rotation_ends(gap, contact, arm)
    overlap = np.zeros(len(gap))
    if np.any(tight):
        plus[tight], least = _least_penetration(gap[tight][:, contact], arm, plus[tight], minus[tight])
        minus[tight] = plus[tight]
        overlap[tight] = np.where(least > TOUCHING, least, 0.0)
    return plus, minus, overlap


def _least_penetration(gap: Real, arm: Real, one_end: Real, other_end: Real) -> tuple[Real, Real]:
    """Rotation (n,) and value (n,) of the least largest penetration max(-gap - arm phi), convex in phi."""
    low, high = np.minimum(one_end, other_end), np.maximum(one_end, other_end)
    for _ in range(BISECTIONS):
        phi = 0.5 * (low + high)
        worst = np.argmax(-gap - arm * phi[:, None], axis=1)
        low, high = np.where(arm[worst] > 0, phi, low), np.where(arm[worst] > 0, high, phi)
    phi = 0.5 * (low + high)
    return phi, np.max(-gap - arm * phi[:, None], axis=1)


def _floating_play(gap: Real, side: np.ndarray, arm: Real) -> tuple[Real, Real, Real]:
    """As ``_rotation_play`` for bodies that may also shift across the slide: gap + side y + arm phi >= 0.

    A shift y exists exactly if every pair of contacts on opposite faces leaves room between its two limits,
    so the pairs are contacts of a pure rotation; an overlap is shared by the two faces.
    """
    upper, lower = np.flatnonzero(side > 0), np.flatnonzero(side < 0)
    pair_gap = (gap[:, upper, None] + gap[:, None, lower]).reshape(len(gap), -1)
    pairs = np.arange(pair_gap.shape[1])
    plus, minus, overlap = _rotation_play(pair_gap, pairs, np.add.outer(arm[upper], arm[lower]).ravel())
    return plus, minus, 0.5 * overlap


def _centring_shift(gap: Real, side: np.ndarray, arm: Real, phi: Real) -> Real:
    """Shift y across the slide that leaves both faces equal room at the rotation phi."""
    room = gap + arm * phi[:, None]
    above = np.min(room, axis=1, where=side > 0, initial=np.inf)
    below = np.min(room, axis=1, where=side < 0, initial=np.inf)
    return 0.5 * (below - above)


def _of_output(reducer: Reducer, play: RigidPlay) -> RigidPlay:
    """The play of the flange as that of the output, flange or housing."""
    for pose in (play.pose_plus, play.pose_minus):
        pose[:, play.output_motion] /= reducer.flange_ratio
    if reducer.flange_ratio > 0:
        return play
    return replace(play, pose_plus=play.pose_minus, pose_minus=play.pose_plus)


def separated_play(reducer: Reducer, gap: Real) -> RigidPlay:
    """Play (n,) with the disk centre held, part by part; ``gap`` (n, n_contacts) [mm].

    Notes
    -----
    Exact for a rigid bearing without clearance: no part of the chain then moves another's contacts but by
    its rotation, and the two slides of a floating plate are perpendicular.
    """
    contacts, motions = reducer.contacts, reducer.motions
    poses = {end: np.zeros((len(gap), len(motions))) for end in ("plus", "minus")}
    of_pins = np.flatnonzero(contacts.kind == PIN)
    plus, minus, overlap = _rotation_play(gap, of_pins, contacts.arm[of_pins])
    turned = {"plus": plus, "minus": minus}
    for end, pose in poses.items():
        pose[:, motions.index("disk_phi")] = turned[end]
    for interface in range(contacts.interface.max() + 1):
        rows = np.flatnonzero(contacts.interface == interface)
        arm, normal, body = contacts.arm[rows], contacts.normal[rows], contacts.body_b[rows[0]]
        floats = any(f"{b}_x" in motions for b in (body, contacts.body_a[rows[0]]) if b != "disk")
        if floats:
            own, side = gap[:, rows], np.where(np.real(np.conj(normal[0]) * normal) > 0, 1, -1)
            plus, minus, part = _floating_play(own, side, arm)
        else:
            plus, minus, part = _rotation_play(gap, rows, arm)
        overlap = np.maximum(overlap, part)
        for end, phi in (("plus", plus), ("minus", minus)):
            turned[end] = turned[end] + phi
            poses[end][:, motions.index(f"{body}_phi")] = turned[end]
            if floats:
                shift = _centring_shift(own, side, arm, phi) * (1 if f"{body}_x" in motions else -1)
                mover = body if f"{body}_x" in motions else contacts.body_a[rows[0]]
                poses[end][:, motions.index(f"{mover}_x")] += shift * normal[0].real
                poses[end][:, motions.index(f"{mover}_y")] += shift * normal[0].imag
    return _of_output(reducer, RigidPlay(poses["plus"], poses["minus"], overlap, reducer.output_motion))


def _program(objective: Real, rows: Real, limits: Real, radius: float) -> np.ndarray | None:
    """Maximise objective @ x subject to rows @ x <= limits and |x[0]|, |x[1]| <= radius; None where infeasible.

    Raises
    ------
    ArithmeticError
        If the program is unbounded or the solver fails.
    """
    bounds: list[tuple[float | None, float | None]] = [(-radius, radius)] * 2
    bounds += [(None, None)] * (len(objective) - 2)
    options = {
        "primal_feasibility_tolerance": PROGRAM_TOLERANCE,
        "dual_feasibility_tolerance": PROGRAM_TOLERANCE,
    }
    solution = linprog(-objective, A_ub=rows, b_ub=limits, bounds=bounds, method="highs", options=options)
    if solution.status == 2:
        return None
    if solution.status != 0:
        raise ArithmeticError(f"rigid play not solved: {solution.message}")
    return np.asarray(solution.x)


def _overshoot(x: Real, radius: float) -> float:
    """How far [um] x[:2] lies beyond the disc of a radius and its tolerance; negative within."""
    return float(np.hypot(*x[:2])) - radius * (1 + CONE_TOLERANCE) - PROGRAM_TOLERANCE


def _with_tangent(tangents: Real, x: Real) -> Real:
    """The tangents of the disc (n_cuts, n_motions) and the one in the direction of x[:2]."""
    normal = np.zeros((1, tangents.shape[1]))
    normal[0, :2] = x[:2] / np.hypot(*x[:2])
    return np.vstack([tangents, normal])


def _cut_program(objective: Real, rows: Real, limits: Real, radius: float) -> np.ndarray | None:
    """Maximise objective @ x subject to rows @ x <= limits and |x[:2]| <= radius; None where infeasible.

    Notes
    -----
    The disc is replaced by its tangents at the optima so far (Kelley, J. SIAM 8 (1960) 703). Each quarters the
    overshoot, unless the optimum is one of many: where the disk's centre decides nothing, every tangent only moves it
    on to the next corner of the polygon. After ``AMONG_MANY`` tangents the optimum nearest to the centre is asked for.

    Raises
    ------
    ArithmeticError
        If the program is unbounded, the solver fails or ``MOST_CUTS`` tangents are not enough.
    """
    tangents = np.zeros((0, len(objective)))
    while len(tangents) < MOST_CUTS:
        bounded = np.append(limits, np.full(len(tangents), radius))
        optimum = _program(objective, np.vstack([rows, tangents]), bounded, radius)
        if optimum is None or _overshoot(optimum, radius) <= 0:
            return optimum
        tangents = _with_tangent(tangents, optimum)
        if len(tangents) > AMONG_MANY:
            optimal = np.vstack([rows, -objective]), np.append(limits, PROGRAM_TOLERANCE - objective @ optimum)
            nearest, tangents = _nearest_to_the_centre(*optimal, tangents, radius)
            if nearest is not None:
                return nearest
    raise ArithmeticError(f"rigid play not solved: {MOST_CUTS} tangents do not replace the bearing's clearance")


def _nearest_to_the_centre(rows: Real, limits: Real, tangents: Real, radius: float) -> tuple[Real | None, Real]:
    """Point of rows @ x <= limits whose x[:2] lies within the disc, None where there is none; and all tangents used.

    The largest of x[:2] along the tangents' normals is minimised: from below it tends to the least distance.
    """
    n = rows.shape[1]
    distance = np.append(np.zeros(n), -1.0)
    fixed = np.hstack([rows, np.zeros((len(rows), 1))])
    while len(tangents) < MOST_CUTS:
        measured = np.hstack([tangents, np.full((len(tangents), 1), -1.0)])
        point = _program(distance, np.vstack([fixed, measured]), np.append(limits, np.zeros(len(tangents))), radius)
        if point is None or point[n] > radius * (1 + CONE_TOLERANCE) + PROGRAM_TOLERANCE:
            break
        if _overshoot(point, radius) <= 0:
            return point[:n], tangents
        tangents = _with_tangent(tangents, point)
    return None, tangents


def _general_ends(jacobian: Real, gap: Real, radius: float, output: int) -> tuple[Real, Real, float]:
    """Poses at the two ends [um, urad] and overlap [um] of one sample, by the general program."""
    n = jacobian.shape[1]
    ends = []
    for sense in (1.0, -1.0):
        objective = np.zeros(n)
        objective[output] = sense
        ends.append(_cut_program(objective, jacobian, gap, radius))
    if ends[0] is not None and ends[1] is not None:
        return ends[0], ends[1], 0.0
    lifted = np.hstack([jacobian, -np.ones((len(gap), 1))])
    pose = _cut_program(np.append(np.zeros(n), -1.0), lifted, gap, radius)
    if pose is None:
        raise ArithmeticError("no pose of least penetration found")
    least = float(pose[n])
    return pose[:n], pose[:n], least if least > UM_PER_MM * TOUCHING else 0.0


def general_play(reducer: Reducer, gap: Real, bearing_clearance: Real) -> RigidPlay:
    """Play (n,) of the whole chain at once, the disk centre free within the bearing's clearance (n,) [mm].

    Notes
    -----
    The bearing's clearance is a disc: tangent cuts are added until it is met to 1e-9 of its radius. A sample that
    interferes anywhere has no play here; ``separated_play`` keeps the play of its other parts.
    """
    plus, minus, overlap = zip(
        *(
            _general_ends(reducer.contact_jacobian, UM_PER_MM * one, UM_PER_MM * clearance, reducer.output_motion)
            for one, clearance in zip(gap, bearing_clearance, strict=True)
        ),
        strict=True,
    )
    return RigidPlay(
        np.array(plus) / UM_PER_MM,
        np.array(minus) / UM_PER_MM,
        np.array(overlap) / UM_PER_MM,
        reducer.output_motion,
    )


def rigid_play(reducer: Reducer, gap: Real, bearing_clearance: Real) -> RigidPlay:
    """Play (n,) by the separated form where the bearing is tight, by the general program where it is not."""
    loose = bearing_clearance > 0
    play = separated_play(reducer, gap)
    if not np.any(loose):
        return play
    coupled = general_play(reducer, gap[loose], bearing_clearance[loose])
    for whole, part in (
        (play.pose_plus, coupled.pose_plus),
        (play.pose_minus, coupled.pose_minus),
        (play.overlap, coupled.overlap),
    ):
        whole[loose] = part
    return play
