"""What a bench reads at the motor of a drive whose output is locked: its crank turns within the loop.

Everything that depends on the crank angle is that of the angle reached (``load_history.turning_crank``), and a torque
read at the motor does the work on it. Elements with memory add their twist m, by which the crank turns on: the curve
then is that which starts at phi_0 - ratio m. Where phi_0 lies follows from the crank angles measured at the cells.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.arrays import Real
from pipeline.constant_kinds import Fineness, Rounding
from pipeline.identification.bench.course import Course
from pipeline.identification.bench.load_path import Elastic, ElasticCurve, LoadPath, Torques, load_path, memory_twist
from pipeline.model.load_history.backbone import Backbone
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.turning_crank import CurvesOverCrank
from pipeline.model.units import NMM_PER_NM

ROUNDS: Fineness = 12
"""Rounds to the crank angle at which the output is locked at most."""
PLACE_TOLERANCE: Rounding = 1e-6
"""Change of that angle [rad] that ends them. The output is off by less than this over the ratio: 3e-4 arcmin at 11."""


class ElasticOverCrank(Elastic):
    """Elastic curves of a drive with its output locked, the crank at ``start`` [rad] without any twist."""

    def __init__(self, drives: Sequence[Drive], course: Course, curves: Sequence[Backbone]):
        super().__init__(drives[0], curves[0])
        assert course.crank is not None
        self.course, self.motion = course, course.crank
        self.mean_crank = float(np.mean(self.motion.cells))
        self._known_curves: dict[tuple[int, float], ElasticCurve] = {}
        self.by_state = {
            state: CurvesOverCrank.from_drives(drives, curves, self.motion.stations, state, extended=True)
            for state in {0, *course.states}
        }
        self.start = self.first_start = self.start_of(self._held_angle())

    def start_of(self, angle: Real) -> float:
        """Crank angle without twist [rad] from which angles of the output (n_cells,) [rad] lead to the mean crank."""
        return self.mean_crank + self.motion.ratio * float(np.mean(angle))

    def _held_angle(self) -> Real:
        """Angle of the output (n_cells,) [rad] with the crank held at its mean angle, run-out included."""
        curves = self.by_state[0]
        held_curve = curves.spline(curves.crank_in_range(np.array([self.mean_crank])))[0]
        angle: Real = np.interp(NMM_PER_NM * self.course.cell_torques.mean(axis=1), curves.torque, held_curve)
        return angle

    def curve_of_state(self, state: int) -> ElasticCurve:
        """The curve of a state."""
        return self.from_start(state, self.start)

    def from_start(self, state: int, start: float) -> ElasticCurve:
        """The curve of a state from another crank angle without twist [rad]."""
        if (state, start) not in self._known_curves:
            locked_curve = self.by_state[state].locked_curve(start, self.motion.ratio)
            torque = locked_curve.torque if self.motion.at_input else locked_curve.carried_torque
            self._known_curves[state, start] = ElasticCurve(torque, locked_curve.angle, locked_curve.carried_torque)
        return self._known_curves[state, start]

    def turned_by_memory(self, torque: Real, twist: Real) -> Real:
        """What the angle (n_cells,) [rad] changes by, at torques behind friction, as a twist turns the crank on.

        By the curves from three starts over the range of the twist, and a parabola between them.
        """
        reach = np.array([0.0, 0.5, 1.0]) * np.ptp(twist) + np.min(twist)
        share = (twist - reach[1]) / (reach[2] - reach[1]) if np.ptp(twist) > 0 else np.zeros(len(twist))
        change = np.zeros(len(torque))
        for number in self.course.states:
            weight = self.course.share_of(number)
            cells = weight > 0
            low, middle, high, held = (
                np.interp(torque[cells], curve.torque, curve.angle)
                for curve in (
                    *(self.from_start(number, self.start - self.motion.ratio * m) for m in reach),
                    self.curve_of_state(number),
                )
            )
            x = share[cells]
            turned = middle + 0.5 * (high - low) * x + 0.5 * (high - 2 * middle + low) * x**2 - held
            change[cells] += weight[cells] * turned
        return change


def locked_path(elastic: ElasticOverCrank, torques: Torques) -> tuple[LoadPath, Real, float, bool]:
    """The way with the output locked.

    The search for the crank angle without twist begins at ``elastic.start``, where the angle found is stored. The first
    start takes the angles of the output with the crank held at its mean: a run-out may exceed the twist by the torque.

    Returns
    -------
    The way, its ``carried_torque`` that in the reducer; the angle (n_cells,) with what elements with memory add [rad];
    the crank angle without twist [rad]; and whether all is sound: equilibria found, and no jump. Where the crank leaves
    the stations, the curves are extended by straight lines, and the way is not in range.
    """
    drive, course, motion = elastic.drive, elastic.course, elastic.motion
    missing = np.full(len(course.leg), np.nan)
    missing_path = LoadPath(missing, missing, missing, np.full(len(course.torque), np.nan))
    try:
        for _ in range(ROUNDS):
            path_at, sound = load_path(drive, course, elastic.curve, elastic, torques[0])
            path = path_at(torques[1])
            angle, former_start = path.angle, elastic.start
            if drive.hystereses and sound:
                carried = elastic.curve_of_state(0).torque_carried
                twist = memory_twist(drive, course, (carried(path.at_turns), carried(path.carried_torque)))
                angle = angle + twist + elastic.turned_by_memory(path.carried_torque, twist)
            carried_torque = elastic.curve_of_state(0).torque_carried(path.carried_torque)
            elastic.start = elastic.start_of(angle)
            if not abs(elastic.start - former_start) > PLACE_TOLERANCE:
                break
    except ValueError:
        elastic.start = elastic.first_start
        return missing_path, missing_path.angle, 0.0, False
    crank = elastic.start - motion.ratio * angle
    is_in_range = bool(motion.stations[0] <= np.min(crank) and np.max(crank) <= motion.stations[-1])
    way = LoadPath(path.angle, path.slope, carried_torque, path.at_turns, is_in_range)
    return way, angle, elastic.start, sound
