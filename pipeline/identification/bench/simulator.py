"""What the model says that a bench reads: the drive of each position along its load history, through the instrument.

The frictionless backbone of a drive is kept from call to call: friction, torsion and the instrument change what is
made of it, not itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.bench.course import Course, slid_torque
from pipeline.model.elements import Spring, merged_path, polyline, same
from pipeline.model.load_history.backbone import NO_LOAD, Backbone, backbone, torque_levels
from pipeline.model.load_history.cell_means import means, means_along
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.friction.incremental import solve_path
from pipeline.model.load_history.friction.output_path import Ripple, output_path
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.model.units import NMM_PER_NM, SECONDS_AN_HOUR

Real = NDArray[np.float64]
Whole = NDArray[np.int64]

LEVELS = 22
"""Nodes of the backbone in each sense of the torque."""
PATH_LEVELS = 11
"""The same where friction at the contacts is followed step by step, which costs a hundred times as much."""
BEYOND = 1.05
"""Reach of the backbone over the largest torque measured: friction may keep more in the reducer than is read."""
KEPT_CURVES = 130
"""Backbones that are kept for each position: those of a fit on its way."""
REPEATED = 0.01
"""Share of the range of torque within which two turns are the same: friction then repeats its last loop."""
UNSOUND, UNSOUND_SHARE = 1e-3, 0.05
"""Relative residual of an equilibrium that is none, and the share of them that a fit may pass through."""


@dataclass(frozen=True)
class Instrument:
    """The bench as it reads: torque (1 + gain) T + zero, angle with drift and the eccentricity of its encoder.

    Attributes
    ----------
    torque_zero : [N m]
    torque_gain : [-]
    drift : [arcmin/h]
    encoder : amplitudes (cosine, sine) of the encoder's eccentricity [arcmin].
    ripple : torque of the motor, locked to its angle.
    """

    torque_zero: float = 0.0
    torque_gain: float = 0.0
    drift: float = 0.0
    encoder: tuple[float, float] = (0.0, 0.0)
    ripple: Ripple = field(default_factory=Ripple)

    def true_torque(self, read: Real) -> Real:
        """Torque [N mm] that is read as ``read`` [N m]."""
        return NMM_PER_NM * (read - self.torque_zero) / (1 + self.torque_gain)


@dataclass(frozen=True)
class Reading:
    """Prediction at the cells of one position.

    Attributes
    ----------
    angle : (n_cells,) [arcmin]
    slope : (n_cells,) d angle / d torque [arcmin/(N m)].
    carried : (n_cells,) torque in the reducer [N mm].
    sound : whether nearly every equilibrium was found.
    """

    angle: Real
    slope: Real
    carried: Real
    sound: bool


@dataclass(frozen=True)
class LoadPath:
    """What a position went through.

    Attributes
    ----------
    angle : (n_cells,) of the output [rad].
    slope : (n_cells,) d angle / d torque [rad/(N mm)].
    carried : (n_cells,) torque in the reducer [N mm].
    at_turns : (n_turns,) the same at the turns.
    """

    angle: Real
    slope: Real
    carried: Real
    at_turns: Real


class Forward:
    """Predictions of drives on the courses of a unit; keeps the backbones of the drives that it has seen."""

    def __init__(self, courses: list[Course], rated_torque: float, largest: float | None = None):
        """``largest`` torque [N m] that the curves are solved for, in place of that of the courses."""
        self.courses = courses
        top = max(float(np.max(np.abs(course.torque))) for course in courses) if largest is None else largest
        self.shares = torque_levels(LEVELS, BEYOND * top * NMM_PER_NM / rated_torque)
        self._kept: dict[tuple, tuple[Drive, Backbone]] = {}
        self._latest: tuple[Drive | None, Backbone | None] = None, None
        self._preloaded: dict[tuple, Backbone] = {}

    def backbone(self, drive: Drive) -> Backbone:
        """The frictionless curve of a drive, without its torsion.

        A compliance is told by its place in memory, which the drive that is kept holds: its content takes longer to
        look up than many a fit's step.
        """
        latest_drive, latest_curve = self._latest
        if drive is latest_drive and latest_curve is not None:
            return latest_curve
        key = (
            drive.reducer.contact_jacobian.tobytes(),
            drive.gap.tobytes(),
            drive.bearing_clearance.tobytes(),
            drive.laws.content,
            id(drive.compliance),
            drive.bearing,
        )
        if key not in self._kept:
            if len(self._kept) > KEPT_CURVES * len(self.courses):
                self._kept.clear()
            self._kept[key] = drive, self._solved(drive)
        self._latest = drive, self._kept[key][1]
        return self._kept[key][1]

    def _solved(self, drive: Drive) -> Backbone:
        """The curve of a drive that is not kept; preload is sought from the latest at its crank angle."""
        alike = drive.reducer.crank, drive.gap.shape
        curve = backbone(drive.without_elements, self.shares, self._preloaded.get(alike))
        if curve.preloaded:
            self._preloaded[alike] = curve
        return curve

    def read(self, drive: Drive, position: int, instrument: Instrument) -> Reading:
        """Prediction at the cells of a position."""
        course = self.courses[position]
        curve = self.backbone(drive)
        torque, edges = instrument.true_torque(course.torque), instrument.true_torque(course.cell_torques)
        unsound = int(np.count_nonzero(curve.states.residual > UNSOUND))
        sound = unsound <= UNSOUND_SHARE * curve.states.residual.size
        if course.sliding is not None:
            path = _slid(drive, course, curve, torque, edges)
        elif len(drive.sliders.acting) or instrument.ripple.amplitude:
            path, leg_path = self._along(drive, course, curve, instrument.ripple, torque, edges)
            sound = sound and leg_path
        else:
            path = _unhindered(drive, course, curve, torque, edges)
        angle, slope, carried_torque = path.angle, path.slope, path.carried
        if drive.hystereses:
            angle = angle + _remembered(drive, course, curve, path, (torque, edges))
        read = ARCMIN * angle + instrument.drift * course.time / SECONDS_AN_HOUR
        if any(instrument.encoder):
            turns = course.encoder_turns * angle + course.encoder_place
            read += instrument.encoder[0] * np.cos(turns) + instrument.encoder[1] * np.sin(turns)
        return Reading(read, ARCMIN * NMM_PER_NM * slope, carried_torque, sound)

    def _along(
        self, drive: Drive, course: Course, curve: Backbone, ripple: Ripple, torque: Real, edges: Real
    ) -> tuple[LoadPath, bool]:
        """The way with friction through turns (n_turns,) and cells (n_cells, n_edges) [N mm]; whether it is sound."""
        nodes, sound = curve.torque, True
        mean, slope, at_turns = np.empty((2, len(edges))), np.empty((2, len(edges))), torque.copy()
        path = LoadPath(mean[0], slope[0], mean[1], at_turns)
        repeated_torque = np.arange(len(torque) - 1)
        if drive.sliders.at_contacts and drive.lean:
            return path, False  # not solved together
        if drive.sliders.at_contacts:
            repeated_torque = _repeats(torque)
            loads = np.sign(nodes) * np.maximum(np.abs(nodes), NO_LOAD * drive.rated_torque)  # ends of play carry none
            steps, turns = _steps(torque[: repeated_torque.max() + 2], loads[:: LEVELS // PATH_LEVELS])
        for state in course.states:
            stiffer = drive.stiffening(state)
            if drive.sliders.at_contacts:
                seeds = (nodes, curve.states.motion[state], curve.states.force[state])
                motions, _, worst = solve_path(drive.at_drawing_modulus(state), state, steps / stiffer, seeds)
                output_angle = motions[:, drive.reducer.output_motion] + drive.twist(steps)
                corners, sound = np.array([steps, output_angle, steps]), sound and worst <= UNSOUND
            else:
                elastic_angle = curve.angle[state] + drive.twist(stiffer * nodes)
                leaning = 1 + drive.lean
                sliders = drive.sliders.of_scaled_load(leaning)
                corners, turns = output_path(torque, leaning * stiffer * nodes, elastic_angle, sliders, ripple)
                corners[2] /= leaning
            followed = course.state == state
            ends = np.column_stack([turns[repeated_torque], turns[repeated_torque + 1], course.sense])
            at_turns[1:][followed] = corners[2, ends[followed, 1]]
            at_turns[:-1][followed] = corners[2, ends[followed, 0]]
            means_along(edges, course.leg, corners, ends, followed, mean, slope)
        return path, sound

    def influence(self, drive: Drive, position: int, carried_torque: Real, modes: Real) -> Real:
        """d angle / d modes (n_cells, n_modes) [arcmin] of patterns of gaps (n_modes, n_contacts) [mm]."""
        curve = self.backbone(drive)
        return self._at_cells(drive, position, carried_torque, curve.influence @ modes.T)

    def change(self, drive: Drive, neighbour: Drive, position: int, carried_torque: Real) -> Real | None:
        """Change of the angle (n_cells,) [arcmin], to first order, from a drive to one with other gaps and springs.

        None where the two differ in more.
        """
        if not _alike_but_for_springs(drive, neighbour):
            return None
        curve = self.backbone(drive)
        return self._at_cells(drive, position, carried_torque, curve.change(drive, neighbour)[..., None])[:, 0]

    def _at_cells(self, drive: Drive, position: int, carried_torque: Real, values: Real) -> Real:
        """Values (n, n_nodes, k) [rad] of a backbone at ``carried_torque`` (n_cells,): (n_cells, k) [arcmin]."""
        course, nodes = self.courses[position], self.backbone(drive).torque
        state = course.state[course.leg]
        carried_torque = (
            carried_torque / np.array([drive.stiffening(number) for number in range(state.max() + 1)])[state]
        )
        j = np.clip(np.searchsorted(nodes, carried_torque) - 1, 0, len(nodes) - 2)
        x = np.clip((carried_torque - nodes[j]) / (nodes[j + 1] - nodes[j]), 0, 1)[:, None]
        return ARCMIN * ((1 - x) * values[state, j] + x * values[state, j + 1])


def _alike_but_for_springs(drive: Drive, neighbour: Drive) -> bool:
    """Whether two drives have the same contacts and the same elements but for springs without memory."""
    others = (tuple(e for e in d.elements if not isinstance(e, Spring)) for d in (drive, neighbour))
    return same(*others) and np.array_equal(drive.reducer.contact_jacobian, neighbour.reducer.contact_jacobian)


def _remembered(drive: Drive, course: Course, curve: Backbone, path: LoadPath, applied: tuple[Real, Real]) -> Real:
    """Rotation (n_cells,) [rad] of the elements with memory, along cells and the turns between them.

    Each element goes along all of the position; ``applied`` are torques at turns (n_turns,) and cells (n_cells,
    n_edges) [N mm]. Its curve is that of the first state.
    """
    nodes = drive.stiffening(0) * curve.torque
    angles = curve.angle[0] + drive.twist(nodes)
    torque, edges = applied
    along, points = merged_path(
        (path.at_turns, torque),
        (path.carried, _mean_torque(edges)),
        course.leg,
        course.time,
        polyline(nodes, angles),
    )
    return np.asarray(sum(element.twist(along) for element in drive.hystereses))[points]


def _mean_torque(edges: Real) -> Real:
    """Mean (n_cells,) of torques within cells (n_cells, n_edges), as many rows between any two."""
    return np.asarray((0.5 * (edges[:, 1:] + edges[:, :-1])).mean(axis=1))


def _unhindered(drive: Drive, course: Course, curve: Backbone, torque: Real, edges: Real) -> LoadPath:
    """The way without friction: the backbone, wherever it is."""
    angle, slope = np.empty(len(edges)), np.empty(len(edges))
    state_of = course.state[course.leg]
    for state in course.states:
        cells = state_of == state if len(course.states) > 1 else slice(None)
        nodes = drive.stiffening(state) * curve.torque
        elastic_angle = curve.angle[state] + drive.twist(nodes)
        angle[cells], slope[cells] = means(edges[cells], nodes, elastic_angle)
    return LoadPath(angle, slope, _mean_torque(edges), torque)


def _slid(drive: Drive, course: Course, curve: Backbone, torque: Real, edges: Real) -> LoadPath:
    """The way of an output that slides all along in one sense at each cell: see ``slid_torque``."""
    assert course.sliding is not None
    angle, slope, carried_torque = np.empty((3, len(edges)))
    state_of, leaning = course.state[course.leg], 1 + drive.lean
    for state in np.unique(state_of):
        cells = state_of == state
        nodes = leaning * drive.stiffening(state) * curve.torque
        elastic_angle = curve.angle[state] + drive.twist(nodes / leaning)
        edges_carried, share = slid_torque(edges[cells], course.sliding[cells], drive.sliders.of_scaled_load(leaning))
        angle[cells], rise = means(edges_carried, nodes, elastic_angle)
        slope[cells] = rise * share
        carried_torque[cells] = _mean_torque(edges_carried) / leaning
    return LoadPath(angle, slope, carried_torque, torque)


def _steps(torque: Real, nodes: Real) -> tuple[Real, Whole]:
    """Torques from turn to turn over the nodes, and the step at which each turn stands."""
    parts, starts, count = [torque[:1]], [0], 1
    for start, end in zip(torque[:-1], torque[1:], strict=True):
        interval = nodes[(nodes > min(start, end)) & (nodes < max(start, end))]
        parts.append(np.append(interval if end > start else interval[::-1], end))
        count += len(parts[-1])
        starts.append(count - 1)
    return np.concatenate(parts), np.array(starts)


def _repeats(torque: Real) -> Whole:
    """For each leg the earlier one that it repeats, turns before it included, or itself (n_legs,)."""
    close = REPEATED * np.ptp(torque)
    repeated_torque = np.arange(len(torque) - 1)
    for leg in range(3, len(repeated_torque)):
        repeated = np.all(np.abs(torque[leg - 1 : leg + 1] - torque[leg - 3 : leg - 1]) <= close)
        ends = np.sign(torque[leg + 1] - torque[leg]) * (torque[leg + 1] - torque[leg - 1])
        if repeated and ends <= close:
            repeated_torque[leg] = repeated_torque[leg - 2]
        else:
            repeated_torque[: leg + 1] = np.arange(leg + 1)  # its history must be followed
    return repeated_torque
