"""A rough rank of every pitch of an output turn by each metric, at a microsecond or two a pitch.

To first order the gap at a pin is the sum of what the pin does and what the lobe does that it meets, and over the
output turn every pin meets every lobe: the gaps of all pitches are outer sums of those of as many pitches as there are
pins, without errors of the disk, and of as many as there are lobes, without errors of the pins. On these gaps each pin
has a spring of its own, and one rotation balances the torque (``load_history.winkler``). Metrics are then taken to be
linear in its results, by least squares on solved pairs of units and pitches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline import assembly
from pipeline.model.compiled import algebraic_part, entry
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.load_history.drive import Drive
from pipeline.model.units import NMM_PER_NM
from pipeline.mounting import drive_of
from pipeline.populations.turn_drives import HOUSING_ERRORS, TurnDrives, Units
from pipeline.populations.turn_residuals import Correlation

Real = NDArray[np.float64]

OF_DISK = ("lobe", "lobe_pitch", "bore_runout", "hole_diameter", "pin_off_hole")
"""Errors that turn with a disk."""
MOST_STEPS = 40
"""Newton steps to the rotation; convex and piecewise linear, so that some five find it."""
WAVES = 4
"""Waves of the direction of the eccentric in the disk: two tell the paper's rigidity to R = 0.97, none to 0.37."""
RIDGE = 1e-3
"""Of the spread of forces: places that hardly ever carry keep the springs' own."""
SPRING_FLOOR = 1e-12
"""Least compliance of a spring [mm/N]."""


@dataclass(frozen=True)
class SeparateGaps:
    """Gaps of ``n`` units over the output turn as outer sums.

    Attributes
    ----------
    of_pins : (n, n_pins, n_places) [mm] with errors of the pins alone, after 0, 1, ... pitches.
    of_lobes : (n, n_lobes, n_places) [mm] what the other errors add.
    output : (n, n_lobes, n_disks, 2) [rad] play behind each disk in the senses + and -, the rotation of the disk.
    """

    of_pins: Real
    of_lobes: Real
    output: Real

    @classmethod
    def from_units(cls, drives: TurnDrives, units: Units) -> SeparateGaps:
        """The gaps of some units."""
        study, n_places = drives.study, drives.study.design.cycloid.pins * drives.study.design.disk.count
        without_disk, without_pins = _without_errors(units, OF_DISK), _without_errors(units, HOUSING_ERRORS)
        neither = _without_errors(without_disk, HOUSING_ERRORS)
        first_gap = _drive(drives, 0, neither).gap[:, :n_places]
        of_pins, of_lobes, output = [], [], []
        for pitch in range(study.design.cycloid.pins):
            gap = _drive(drives, pitch, without_disk).gap
            of_pins.append(_by_place(drives, gap, pitch)[:, :n_places])
        for pitch in range(study.design.cycloid.lobes):
            drive = _drive(drives, pitch, without_pins)
            of_lobes.append(_by_place(drives, drive.gap, pitch)[:, :n_places] - first_gap)
            output.append(_output_ends(drive))
        return cls(*(np.ascontiguousarray(np.stack(parts, axis=1)) for parts in (of_pins, of_lobes, output)))


def _without_errors(units: Units, names: Sequence[str]) -> Units:
    zeros = {name: np.zeros_like(getattr(units.errors, name)) for name in names}
    return replace(units, errors=replace(units.errors, **zeros))


def _drive(drives: TurnDrives, pitch: int, units: Units) -> Drive:
    crank = float(drives.crank_deg(pitch * drives.phases))
    return drive_of(drives.study, crank, None, units.errors, units.clearance, drives.laws[0])


def _by_place(drives: TurnDrives, gap: Real, pitch: int) -> Real:
    by_place = np.empty_like(gap)
    by_place[:, drives.places(pitch)] = gap
    return by_place


def _output_ends(drive: Drive) -> Real:
    """Play behind the disks in both senses (n, n_disks, 2) [rad]: that of all less that of the pins; 0 of several."""
    reducer = drive.reducer
    if reducer.n_disks > 1 or not reducer.is_centred:
        return np.zeros((len(drive.gap), reducer.n_disks, 2))
    ends = rigid_play(reducer, drive.gap, np.zeros_like(drive.bearing_clearance)).ends * reducer.flange_ratio
    ends = ends if reducer.flange_ratio > 0 else ends[::-1]
    gap, arm = drive.gap[:, : reducer.n_pins], reducer.contacts.arm[: reducer.n_pins]
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = -gap / arm
    plus = np.min(angle, axis=1, where=arm < 0, initial=np.inf)
    minus = np.max(angle, axis=1, where=arm > 0, initial=-np.inf)
    return np.stack([ends[0] - plus, ends[1] - minus], axis=-1)[:, None]


@algebraic_part
def _ends(of_pins, of_lobes, end):
    """Fill the rotations ``end`` (n_places,) at which springs close; the least."""
    for k in range(end.shape[0]):
        end[k] = of_pins[k] + of_lobes[k]
    first_end = np.inf
    for k in range(end.shape[0]):
        first_end = end[k] if end[k] < first_end else first_end
    return first_end


@algebraic_part
def _rotation(end, stiffness, torque, phi):
    """Rotation at which the springs carry a torque, by Newton from any rotation ``phi``.

    The sums take all springs, the open ones with the factor 0: so the compiler adds several at once.
    """
    angle_before = np.inf
    for _ in range(MOST_STEPS):
        slope, offset = 0.0, 0.0
        for k in range(end.shape[0]):
            spring = stiffness[k]
            closed_spring = spring if end[k] < phi else 0.0
            slope += closed_spring
            offset += closed_spring * end[k]
        if slope == 0.0:
            for k in range(end.shape[0]):
                slope += stiffness[k]
                offset += stiffness[k] * end[k]
        phi = (torque + offset) / slope
        if phi == angle_before:
            break
        angle_before = phi
    return phi


@entry
def _spring_forces(of_pins, of_lobes, stiffness, torque, pitches, force):
    """Fill the moments (n, n_pitches, n_places) [N mm] of the springs under a torque."""
    n_pins, n_lobes = of_pins.shape[1], of_lobes.shape[1]
    end = np.empty(of_pins.shape[2])
    for s in range(force.shape[0]):
        for p in range(pitches.shape[0]):
            _ends(of_pins[s, pitches[p] % n_pins], of_lobes[s, pitches[p] % n_lobes], end)
            phi = _rotation(end, stiffness, torque, 0.0)
            for k in range(end.shape[0]):
                force[s, p, k] = stiffness[k] * (phi - end[k]) if end[k] < phi else 0.0


@entry
def _spring_features(of_pins, of_lobes, stiffness, peak_of_moment, levels, features):
    """Fill features (n, n_pins n_lobes, n_levels + 2) of one sense, see ``Springs.features``."""
    n, n_pins, n_places = of_pins.shape
    n_lobes, n_levels = of_lobes.shape[1], levels.shape[0]
    end, force = np.empty(n_places), np.empty(n_places)
    for s in range(n):
        phi = np.zeros(n_levels)  # at the pitch before: two or three steps of Newton away
        for pitch in range(n_pins * n_lobes):
            features[s, pitch, 0] = _ends(of_pins[s, pitch % n_pins], of_lobes[s, pitch % n_lobes], end)
            for level in range(n_levels):
                phi[level] = _rotation(end, stiffness, levels[level], phi[level])
                features[s, pitch, 1 + level] = phi[level]
            features[s, pitch, n_levels + 1] = _peak(end, phi[-1], stiffness, peak_of_moment, force)


@algebraic_part
def _peak(end, phi, stiffness, peak_of_moment, force):
    """Peak pressure [MPa] under the moments of springs at a rotation, spread over their neighbours."""
    force[:] = 0.0
    for k in range(end.shape[0]):
        if end[k] < phi:
            moment = stiffness[k] * (phi - end[k])
            for i in range(force.shape[0]):
                force[i] += peak_of_moment[k, i] * moment
    peak = 0.0
    for k in range(force.shape[0]):
        peak = force[k] if force[k] > peak else peak
    return np.sqrt(peak)


@dataclass(frozen=True)
class Springs:
    """The springs of the rough model at the places of the pins about the eccentric.

    Attributes
    ----------
    arm : (n_places,) [mm]; disk : (n_places,) of each place.
    stiffness : (n_places,) [N mm] moment over rotation.
    pressure : (n_places,) [MPa/N^0.5]
    levels : (3,) ascending torques [N mm].
    spread : (n_places, n_places) forces of the model of all bodies by those of the springs, under the highest torque.
    """

    arm: Real
    disk: NDArray[np.intp]
    stiffness: Real
    pressure: Real
    levels: Real
    spread: Real

    @classmethod
    def from_compliance(cls, drives: TurnDrives, compliance: Real) -> Springs:
        """Springs of a compliance (n_places,) [mm/N], their forces taken for the true ones."""
        reducer, n = assembly.reducer(drives.study.design, 0.0), len(compliance)
        definitions = assembly.definitions(drives.study)
        torques = NMM_PER_NM * np.array([definitions.lost_motion, definitions.rigidity_low, definitions.rigidity_high])
        contacts = reducer.contacts
        arm = contacts.arm[:n]
        levels, disk = np.sort(torques) * abs(reducer.flange_ratio), np.ascontiguousarray(reducer.disk_of_contact[:n])
        return cls(arm, disk, arm**2 / compliance, drives.laws[0].pressure[:n], levels, np.eye(n))

    def _closing(self, gaps: SeparateGaps, sense: int) -> tuple[NDArray[np.intp], Real, Real]:
        """Places that close in a sense (n_closing,), and their rotations by pins and by lobes [rad], whose sum closes.

        (n, n_pins, n_closing) and (n, n_lobes, n_closing).
        """
        sign = 1.0 - 2.0 * sense
        rows = np.flatnonzero(-sign * self.arm > 0)
        size, behind = np.abs(self.arm[rows]), gaps.output[..., sense][:, :, self.disk[rows]]
        of_pins, of_lobes = gaps.of_pins[:, :, rows] / size, gaps.of_lobes[:, :, rows] / size + sign * behind
        return rows, np.ascontiguousarray(of_pins), np.ascontiguousarray(of_lobes)

    def with_fitted_spread(self, gaps: SeparateGaps, pitches: NDArray[np.intp], force: Real) -> Springs:
        """With the spread by least squares on true forces (n, n_pitches, 2, n_places) [N] under the highest torque."""
        forces = np.zeros(force.shape)
        for sense in range(2):
            rows, of_pins, of_lobes = self._closing(gaps, sense)
            moments = np.empty((*force.shape[:2], len(rows)))
            _spring_forces(of_pins, of_lobes, self.stiffness[rows], self.levels[-1], pitches, moments)
            forces[:, :, sense, rows] = moments / np.abs(self.arm[rows])
        finite = np.isfinite(force).all(axis=3)
        rough, true = forces[finite], force[finite]
        square = rough.T @ rough
        ridge = RIDGE * np.trace(square) / len(square) * np.eye(len(square))
        return replace(self, spread=np.linalg.solve(square + ridge, rough.T @ true + ridge))

    def features(self, gaps: SeparateGaps) -> Real:
        """Features (n, n_pitches, n_features) of units at every pitch.

        In each sense where the first spring closes, the rotation at each torque and the peak pressure; and the larger
        of both pressures.
        """
        n, n_pins = gaps.of_pins.shape[:2]
        of_sense = len(self.levels) + 2
        features = np.empty((n, n_pins * gaps.of_lobes.shape[1], 2 * of_sense + 1))
        for sense in range(2):
            rows, of_pins, of_lobes = self._closing(gaps, sense)
            peak = self.spread[np.ix_(rows, rows)] * self.pressure[rows] ** 2 / np.abs(self.arm[rows, None])
            columns = features[:, :, sense * of_sense : (sense + 1) * of_sense]
            _spring_features(of_pins, of_lobes, self.stiffness[rows], peak, self.levels, columns)
        np.maximum(features[:, :, of_sense - 1], features[:, :, 2 * of_sense - 1], out=features[:, :, -1])
        return features


@dataclass(frozen=True)
class Ranking:
    """What ranks the pitches of an output turn: springs at the places of the pins, and slopes of each metric.

    Attributes
    ----------
    slopes : metric -> (1 + n_features + 2 WAVES,), of 1, the features and the `waves`.
    correlations : metric -> correlation of what the ranking misses at two pitches of a unit.
    """

    springs: Springs
    slopes: Mapping[str, Real]
    correlations: Mapping[str, Correlation]

    def predict_metrics(self, gaps: SeparateGaps) -> dict[str, Real]:
        """Metrics (n, n_pitches) of units."""
        features = self.springs.features(gaps)
        turn = waves(np.arange(features.shape[1]), gaps.of_lobes.shape[1])
        split = 1 + features.shape[2]
        return {
            name: features @ slope[1:split] + (slope[0] + turn @ slope[split:]) for name, slope in self.slopes.items()
        }


def waves(pitches: NDArray[np.intp], lobes: int) -> Real:
    """Cosines and sines (n_pitches, 2 WAVES) of the direction of the eccentric in the disk.

    Slides and holes stand otherwise to the eccentric after each pitch, and come back when the disk has gone on by all
    lobes.
    """
    angle = 2 * np.pi / lobes * np.multiply.outer(pitches % lobes, np.arange(1, WAVES + 1))
    return np.hstack([np.cos(angle), np.sin(angle)])


def place_compliance(deflection: Real, force: Real) -> Real:
    """Compliance (n_places,) [mm/N] of springs that take the work of forces (n_states, n_places) [N] over deflections.

    Of places that carry nothing in these states, that of all.
    """
    finite = np.all(np.isfinite(force) & np.isfinite(deflection), axis=1)
    force, deflection = force[finite], deflection[finite]
    work: Real = np.sum(force * deflection, axis=0)
    square: Real = np.sum(force**2, axis=0)
    of_all = np.sum(work) / np.sum(square)
    compliance = np.divide(work, square, out=np.full_like(work, of_all), where=square > 0)
    return np.maximum(compliance, SPRING_FLOOR)


def fitted_slopes(features: Real, metrics: Mapping[str, Real]) -> dict[str, Real]:
    """Slopes (1 + n_features,) of each metric by least squares on pairs (n, n_features); none of a constant metric."""
    slopes = {}
    for name, values in metrics.items():
        finite = np.isfinite(values) & np.all(np.isfinite(features), axis=1)
        if np.count_nonzero(finite) <= 2 * features.shape[1] or np.ptp(values[finite]) == 0:
            continue
        centre, scale = features[finite].mean(axis=0), features[finite].std(axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        design = np.column_stack([np.ones(np.count_nonzero(finite)), (features[finite] - centre) / scale])
        slope = np.linalg.lstsq(design, values[finite], rcond=1e-10)[0]
        slopes[name] = np.append(slope[0] - np.sum(slope[1:] * centre / scale), slope[1:] / scale)
    return slopes
