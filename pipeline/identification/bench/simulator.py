"""What the model says that a bench reads: the drive of each position along its load history, through the instrument.

The frictionless backbone of a drive is kept from call to call: friction, torsion and the instrument change what is
made of it, not itself.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import is_
from typing import Any

import numpy as np
from scipy.sparse import csr_array, hstack

from pipeline.arrays import Real
from pipeline.constant_kinds import Fineness, Shortcut
from pipeline.identification.bench.course import Course
from pipeline.identification.bench.load_path import (
    LARGEST_RESIDUAL,
    Elastic,
    Instrument,
    LoadPath,
    load_path,
    read_with_ripple,
    with_springs,
)
from pipeline.identification.bench.locked_output import ElasticOverCrank, locked_path
from pipeline.model.elements import Spring, same
from pipeline.model.load_history.backbone import Backbone, backbone, torque_levels
from pipeline.model.load_history.cell_means import mean_torque
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.model.load_history.turning_crank import CurvesOverCrank
from pipeline.model.units import NMM_PER_NM

LEVELS: Fineness = 44
"""Nodes of the backbone in each sense of the torque. The lines between them are off by 0.01 to 0.04 of the noise of a
cell (rms, four benches); with 22 nodes by 0.04 to 0.14, and contacts close at kinks over which fits end."""
BEYOND: Shortcut = 1.05
"""Reach of the backbone over the largest torque measured: friction may keep more in the reducer than is read."""
BEYOND_TURNING: Shortcut = 1.3
"""The same where the crank turns: the work on what varies over its angle changes the torque by a tenth or two."""
KEPT_CURVES: Fineness = 40
"""Curves that are kept for each crank angle, those of all states of a drive counted: those of a fit on its way. A curve
of 64 contacts takes a quarter of a megabyte."""
UNSOUND_SHARE = 0.05
"""Share of equilibria that were not found which a fit may pass through."""
RIPPLES = ("ripple", "ripple_phases", "interpolation", "interpolation_phases")
"""Fields of an instrument whose change has a derivative by the angle measured."""
Drives = tuple[Drive, ...]
"""A drive at the crank angles of a position's stations."""
Way = Callable[[Real], tuple[LoadPath, Real, float, bool]]
"""The way, the angle (n_cells,) [rad] with what elements with memory add, the place of the encoder [rad] and whether
every equilibrium was found, by the torques within the cells (n_cells, n_edges) [N mm]."""


@dataclass(frozen=True)
class Reading:
    """Prediction at the cells of one position.

    Attributes
    ----------
    angle : (n_cells,) [arcmin]
    slope : (n_cells,) d angle / d torque [arcmin/(N m)].
    carried_torque : (n_cells,) torque in the reducer [N mm].
    response : (n_cells,) change of the angle for a change of the drive's own angle: 1 but where a ripple answers it.
    balances : (n_cells,) angles of balance at one torque in the mean over the phases of a ripple: 1 without one.
    sound : whether nearly every equilibrium was found.
    is_in_range : whether a crank that turns stays between the angles at which drives were made.
    """

    angle: Real
    slope: Real
    carried_torque: Real
    response: Real
    balances: Real
    sound: bool
    is_in_range: bool


class Forward:
    """Predictions of drives on the courses of a unit; keeps the backbones of the drives that it has seen."""

    def __init__(self, courses: list[Course], rated_torque: float, largest_torque: float | None = None):
        """``largest_torque`` torque [N m] that the curves are solved for, in place of that of the courses."""
        self.courses = courses
        top = (
            max(float(np.max(np.abs(course.torque))) for course in courses)
            if largest_torque is None
            else largest_torque
        )
        beyond = BEYOND_TURNING if any(course.crank for course in courses) else BEYOND
        self.shares = torque_levels(LEVELS, beyond * top * NMM_PER_NM / rated_torque)
        stations = sum(len(course.crank.stations) if course.crank else 1 for course in courses)
        self._most_kept = KEPT_CURVES * stations
        self._kept_drives: dict[tuple[Any, ...], tuple[Drive, Backbone]] = {}
        self._latest: tuple[Drive | None, Backbone | None] = None, None
        self._preloaded_backbones: dict[tuple[Any, ...], Backbone] = {}
        self._latest_weights: dict[int, tuple[Drives, Real, csr_array]] = {}

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
        if key not in self._kept_drives:
            if len(self._kept_drives) * len(drive.gap) > self._most_kept:
                self._kept_drives.clear()
            self._kept_drives[key] = drive, self._solve_backbone(drive)
        self._latest = drive, self._kept_drives[key][1]
        return self._kept_drives[key][1]

    def _solve_backbone(self, drive: Drive) -> Backbone:
        """The curve of a drive that is not kept; preload is sought from the latest at its crank angle."""
        kind = drive.reducer.crank, drive.gap.shape
        curve = backbone(drive.without_elements, self.shares, self._preloaded_backbones.get(kind))
        if curve.is_preloaded:
            self._preloaded_backbones[kind] = curve
        return curve

    def read(self, stations: Drives, position: int, instrument: Instrument) -> Reading:
        """Prediction at the cells of a position, by its drives at all stations: one where the crank is held."""
        ripple = instrument.ripple_at(position)
        course = self.courses[position].in_order if ripple.amplitude else self.courses[position]
        curves = [self.backbone(drive) for drive in stations]
        sound = all(
            np.count_nonzero(curve.states.residual > LARGEST_RESIDUAL) <= UNSOUND_SHARE * curve.states.residual.size
            for curve in curves
        )
        turns, edges = instrument.torques(course)
        if ripple.amplitude and course.rows is not None:
            turns = turns - ripple.value(course.rows[1] / ARCMIN)[course.edges_beside_turns]
        along = self._along_crank if course.crank is not None else self._at_held_crank
        angle_at = along(stations, course, curves, turns)
        interpolation = instrument.interpolation_error(course, position)

        def read_at(edges: Real) -> tuple[Real, LoadPath, bool]:
            path, angle, encoder_place, is_followed = angle_at(edges)
            return instrument.angle_read(course, angle, encoder_place) + interpolation, path, is_followed

        if ripple.amplitude:
            read, path, is_followed, response = read_with_ripple(ripple, course, edges, read_at)
            # a ripple that is steeper than the drive at most cells has a balance beside any angle that was measured
            is_told_apart = bool(np.median(np.abs(1 / response - 1)) <= 1)
            return _reading(read, path, sound and is_followed and is_told_apart, response, ripple.balances(path.slope))
        read, path, is_followed = read_at(edges)
        return _reading(read, path, sound and is_followed, *np.ones((2, len(read))))

    @staticmethod
    def _along_crank(stations: Drives, course: Course, curves: Sequence[Backbone], turns: Real) -> Way:
        """The way of a crank that turns, as a function of the torques within the cells."""
        elastic = ElasticOverCrank(stations, course, curves)
        return lambda edges: locked_path(elastic, (turns, edges))

    @staticmethod
    def _at_held_crank(stations: Drives, course: Course, curves: Sequence[Backbone], turns: Real) -> Way:
        """The way at a crank that is held, as a function of the torques within the cells."""
        (drive, *_), elastic = stations, Elastic(stations[0], curves[0])
        path_at, is_followed = load_path(drive, course, curves[0], elastic, turns)

        def way(edges: Real) -> tuple[LoadPath, Real, float, bool]:
            path = with_springs(drive, course, curves[0], path_at(edges), (turns, edges))
            return path, path.angle, course.encoder_place, is_followed

        return way

    def interpolation_error(self, drives: Drives, position: int, cranks: Real) -> float:
        """Error [arcmin] of the angle where every second of the drives of a position is left out, in any state.

        Parameters
        ----------
        drives : at crank angles ``cranks`` (n_cranks,) [rad], ``turning_crank.FEWEST_CRANKS`` or more.
        """
        curves = [self.backbone(drive) for drive in drives]
        states = {0, *self.courses[position].states}
        return ARCMIN * max(CurvesOverCrank.from_drives(drives, curves, cranks, state).error for state in states)

    def influence(self, stations: Drives, position: int, carried_torque: Real, modes: Sequence[Real]) -> Real:
        """d angle / d modes (n_cells, n_modes) [arcmin] of gaps of each drive (n_modes, n_contacts) [mm]."""
        values = [self.backbone(drive).influence @ gaps.T for drive, gaps in zip(stations, modes, strict=True)]
        return self._at_cells(stations, position, carried_torque, values)

    def mean_of_draws(
        self, drives: Drives, position: int, carried_torque: Real, gaps: Sequence[Real], modes: Sequence[Real]
    ) -> tuple[Real, Real]:
        """Change of the angle (n_cells,) and influence of the modes (n_cells, n_modes), means over draws of the gaps.

        The frictionless curves are solved for each draw; what friction and the instrument make of them is taken to
        first order. Draws without an equilibrium do not count.

        Parameters
        ----------
        carried_torque : (n_cells,) of the drives as they are [N mm].
        gaps : by station (n_draws, n_contacts), added to the drive's [mm].
        modes : by station (n_modes, n_contacts) [mm].

        Returns
        -------
        Both [arcmin]; NaN where no draw is left.
        """
        values = []
        for drive, added_gap, patterns in zip(drives, gaps, modes, strict=True):
            n_draws, n_states = len(added_gap), len(drive.gap)
            states = drive.without_elements.some(np.tile(np.arange(n_states), n_draws))
            curve = self._solve_backbone(states.with_added_gap(np.repeat(added_gap, n_states, axis=0)))
            is_lost = np.any(curve.states.residual > LARGEST_RESIDUAL, axis=1).reshape(n_draws, n_states)
            counts = ~np.any(is_lost, axis=1)
            angle, influence = (
                np.mean(of_states.reshape(n_draws, n_states, *of_states.shape[1:])[counts], axis=0)
                if np.any(counts)
                else np.full((n_states, *of_states.shape[1:]), np.nan)
                for of_states in (curve.angle, curve.influence)
            )
            change = angle - self.backbone(drive).angle
            values.append(np.concatenate([change[..., None], influence @ patterns.T], axis=2))
        at_cells = self._at_cells(drives, position, carried_torque, values)
        return at_cells[:, 0], at_cells[:, 1:]

    def change(self, stations: Drives, neighbours: Drives, position: int, carried_torque: Real) -> Real | None:
        """Change of the angle (n_cells,) [arcmin], to first order, from drives to some with other gaps and springs.

        None where the two differ in more.
        """
        pairs = list(zip(stations, neighbours, strict=True))
        if not all(_alike_but_for_springs(*pair) for pair in pairs):
            return None
        course, curves = self.courses[position], [self.backbone(drive) for drive in stations]
        values = [curve.change(neighbour) for curve, neighbour in zip(curves, neighbours, strict=True)]
        nodes = curves[0].torque
        twists = [neighbour.twist(nodes) - drive.twist(nodes) for drive, neighbour in pairs]
        if course.crank is not None:
            values = [value + twist for value, twist in zip(values, twists, strict=True)]
        change = self._at_cells(stations, position, carried_torque, [value[..., None] for value in values])[:, 0]
        if course.crank is None and np.any(twists[0]):
            edges = carried_torque[:, None] if course.is_output_locked else NMM_PER_NM * course.cell_torques
            change += ARCMIN * np.interp(edges, nodes, twists[0]).mean(axis=1)
        return change

    def change_by_ripple(
        self, position: int, before: Instrument, after: Instrument, slope: Real
    ) -> Real | float | None:
        """Change of the curve (n_cells,) [arcmin], to first order, by the ripples of an instrument.

        None where more of it changes. ``slope`` (n_cells,) is that of the curve over the torque [arcmin/(N m)].
        """
        if before == after:
            return 0.0
        course = self.courses[position]
        kept = {name: vars(before)[name] for name in RIPPLES}
        if course.rows is None or before != replace(after, **kept):
            return None
        ripples = (instrument.ripple_at(position).value(course.rows[1] / ARCMIN) for instrument in (before, after))
        less, more = (mean_torque(ripple) / NMM_PER_NM for ripple in ripples)
        readings = (instrument.interpolation_error(course, position) for instrument in (after, before))
        return np.asarray(slope * (less - more)) + next(readings) - next(readings)

    def _at_cells(self, stations: Drives, position: int, carried_torque: Real, values: Sequence[Real]) -> Real:
        """Values of each station's backbone (n, n_nodes, k) [rad] at ``carried_torque`` (n_cells,), as the angle reads.

        Where the crank turns they lie on a cubic between four stations, and the locked output lets the crank follow.

        Returns
        -------
        (n_cells, k) [arcmin].
        """
        at_cells = np.concatenate([of_station.reshape(-1, of_station.shape[2]) for of_station in values])
        return np.asarray(self._weights(stations, position, carried_torque) @ at_cells)

    def _weights(self, stations: Drives, position: int, carried_torque: Real) -> csr_array:
        """Weights (n_cells, n_stations n n_nodes) [arcmin/rad] of ``_at_cells``.

        The latest of each position are kept: the derivatives of a fit ask for them once for each unknown.
        """
        known = self._latest_weights.get(position)
        if known and all(map(is_, known[0], stations)) and np.array_equal(known[1], carried_torque):
            return known[2]
        motion, curves = self.courses[position].crank, [self.backbone(drive) for drive in stations]
        at_torques = self._weights_at_torques(stations[0], position, carried_torque)  # the same at all stations
        weights = ARCMIN * at_torques
        if motion is not None:
            held = np.column_stack([at_torques @ curve.angle.ravel() for curve in curves])
            slope = np.sum(motion.shares * np.gradient(held, motion.stations, axis=1), axis=1)
            shares = ARCMIN * motion.shares.T / (1 + motion.ratio * slope)
            weights = hstack([share[:, None] * at_torques for share in shares], format="csr")
        self._latest_weights[position] = stations, carried_torque, weights
        return weights

    def _weights_at_torques(self, drive: Drive, position: int, carried_torque: Real) -> csr_array:
        """Weights (n_cells, n n_nodes) of lines between a backbone's nodes at the ``carried_torque`` (n_cells,)."""
        course, nodes = self.courses[position], self.backbone(drive).torque
        entries = []
        for state in course.states:
            share = course.share_of(state)
            cells = np.flatnonzero(share > 0)
            torque = carried_torque[cells] / drive.stiffening(state)
            j = np.clip(np.searchsorted(nodes, torque) - 1, 0, len(nodes) - 2)
            x = np.clip((torque - nodes[j]) / (nodes[j + 1] - nodes[j]), 0, 1)
            node = state * len(nodes) + j
            entries += [(share[cells] * (1 - x), cells, node), (share[cells] * x, cells, node + 1)]
        weight, cell, node = (np.concatenate(parts) for parts in zip(*entries, strict=True))
        shape = len(carried_torque), len(drive.gap) * len(nodes)
        return csr_array((weight, (cell, node)), shape=shape)


def _reading(read: Real, path: LoadPath, is_sound: bool, response: Real, balances: Real) -> Reading:
    slope = ARCMIN * NMM_PER_NM * path.slope * response
    return Reading(read, slope, path.carried_torque, response, balances, is_sound, path.is_in_range)


def _alike_but_for_springs(drive: Drive, neighbour: Drive) -> bool:
    """Whether two drives have the same contacts and the same elements but for springs without memory."""
    other_elements = (tuple(e for e in d.elements if not isinstance(e, Spring)) for d in (drive, neighbour))
    return same(*other_elements) and np.array_equal(drive.reducer.contact_jacobian, neighbour.reducer.contact_jacobian)
