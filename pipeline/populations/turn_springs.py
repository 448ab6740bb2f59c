"""The rough model that ranks pitches: every contact a spring of its own, the centres of the disks held.

Each disk turns on the springs of its pins and the output on those between it and the disk; the disks share the torque
on the output as their springs give way. Newton's steps find the rotations: of a disk and of the output the moment
grows in straight lines between the rotations at which springs close.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline import assembly
from pipeline.model.compiled import algebraic_part, entry
from pipeline.model.units import NMM_PER_NM
from pipeline.populations.turn_drives import TurnDrives
from pipeline.populations.turn_gaps import SeparateGaps, has_pins_in_holes

Real = NDArray[np.float64]
Index = NDArray[np.intp]

MOST_STEPS = 40
"""Newton steps to the rotations; piecewise linear, so that some five find them."""
SAME_ROTATION = 1e-13
"""Of a rotation: what steps change it by when they have ended."""
RIDGE = 1e-3
"""Of the spread of forces: places that hardly ever carry keep the springs' own."""
STIFF = 1e3
"""Stiffness of what is behind a disk and has no springs, over that of all of its pins."""
OF_SENSE = 7
"""Features of a sense: the first contact, rotations at three torques, pressures of pins and of the output, share."""
FIRST_END, FIRST_ROTATION, PEAK, OUTPUT_PEAK, SHARE = 0, 1, 4, 5, 6
"""Places of these features."""


@algebraic_part
def _ends(of_pins, of_lobes, output, first_place, end, first_end):
    """Fill the rotations ``end`` (n_places,) at which springs close, and ``first_end`` (2, n_disks): pins, output."""
    for k in range(end.shape[0]):
        end[k] = of_pins[k] + of_lobes[k]
    for d in range(first_end.shape[1]):
        first_end[:, d] = np.inf
        for k in range(first_place[d], first_place[d + 1]):
            first_end[0, d] = end[k] if end[k] < first_end[0, d] else first_end[0, d]
        for j in range(output.shape[1]):
            first_end[1, d] = output[d, j] if output[d, j] < first_end[1, d] else first_end[1, d]


@algebraic_part
def _closed(end, stiffness, start, stop, angle):
    """Stiffness of the springs that are closed at a rotation, and their moment at 0.

    The sums take all springs, the open ones with the factor 0: so the compiler adds several at once.
    """
    slope, offset = 0.0, 0.0
    for k in range(start, stop):
        closed_spring = stiffness[k] if end[k] < angle else 0.0
        slope += closed_spring
        offset += closed_spring * end[k]
    return slope, offset


@algebraic_part
def _balance(end, stiffness, first_place, first_end, output, output_stiffness, torque, phi, line):
    """Rotations at which the springs carry a torque, by Newton from any: of the disks ``phi[:-1]``, the output's last.

    A disk carries nothing before the output has gone through its play. Beyond it some spring on either side of it is
    closed, and its rotation lies between those at which the first ones close. Where none carries, all springs count.
    """
    n_disks, none_carries = phi.shape[0] - 1, False
    for _ in range(MOST_STEPS):
        theta, slope, offset = phi[n_disks], 0.0, 0.0
        for d in range(n_disks):
            low, high = first_end[0, d], theta - first_end[1, d]
            line[0, d] = 0.0
            if low >= high and not none_carries:
                phi[d] = low
                continue
            if not low < phi[d] < high:
                phi[d] = 0.5 * (low + high)
            of_pins, of_output = (np.inf, np.inf) if none_carries else (phi[d], theta - phi[d])
            k, k0 = _closed(end, stiffness, first_place[d], first_place[d + 1], of_pins)
            h, h0 = _closed(output[d], output_stiffness[d], 0, output.shape[1], of_output)
            line[0, d], line[1, d], line[2, d] = h / (k + h), (k0 - h0) / (k + h), k
            slope += k * h / (k + h)
            offset += (k0 * h + h0 * k) / (k + h)
        none_carries = slope == 0.0
        if none_carries:
            continue
        phi[n_disks] = (torque + offset) / slope
        for d in range(n_disks):
            if line[0, d] > 0.0:
                phi[d] = line[0, d] * phi[n_disks] + line[1, d]
        if abs(phi[n_disks] - theta) <= SAME_ROTATION * abs(theta):
            break


@entry
def _spring_forces(of_pins, of_lobes, output, stiffness, output_stiffness, first_place, torque, pitches, force):
    """Fill the moments (n, n_pitches, n_places) [N mm] of the springs of the pins under a torque."""
    n_pins, n_lobes, n_disks = of_pins.shape[1], of_lobes.shape[1], output.shape[2]
    end, phi = np.empty(of_pins.shape[2]), np.zeros(n_disks + 1)
    first_end, line = np.empty((2, n_disks)), np.empty((3, n_disks))
    for s in range(force.shape[0]):
        for p in range(pitches.shape[0]):
            lobe = pitches[p] % n_lobes
            behind, springs_behind = output[s, lobe], output_stiffness[lobe]
            _ends(of_pins[s, pitches[p] % n_pins], of_lobes[s, lobe], behind, first_place, end, first_end)
            _balance(end, stiffness, first_place, first_end, behind, springs_behind, torque, phi, line)
            for d in range(n_disks):
                for k in range(first_place[d], first_place[d + 1]):
                    force[s, p, k] = stiffness[k] * (phi[d] - end[k]) if end[k] < phi[d] else 0.0


@entry
def _spring_features(
    of_pins, of_lobes, output, stiffness, output_stiffness, first_place, peak_of_moment, output_peak, levels, features
):
    """Fill features (n, n_pins n_lobes, OF_SENSE) of one sense, see ``Springs.features``."""
    n, n_pins, n_places = of_pins.shape
    n_lobes, n_levels, n_disks = of_lobes.shape[1], levels.shape[0], output.shape[2]
    end, force, phi = np.empty(n_places), np.empty(n_places), np.zeros((n_levels, n_disks + 1))
    first_end, line = np.empty((2, n_disks)), np.empty((3, n_disks))
    for s in range(n):
        for pitch in range(n_pins * n_lobes):
            lobe = pitch % n_lobes
            behind, springs_behind = output[s, lobe], output_stiffness[lobe]
            _ends(of_pins[s, pitch % n_pins], of_lobes[s, lobe], behind, first_place, end, first_end)
            features[s, pitch, FIRST_END] = np.min(first_end[0] + first_end[1])
            for level in range(n_levels):  # from those at the pitch before: two or three steps of Newton away
                _balance(
                    end, stiffness, first_place, first_end, behind, springs_behind, levels[level], phi[level], line
                )
                features[s, pitch, FIRST_ROTATION + level] = phi[level, n_disks]
            angle = phi[n_levels - 1]
            features[s, pitch, PEAK] = _peak(end, angle, stiffness, first_place, peak_of_moment, force)
            peak, share = 0.0, 0.0
            for d in range(n_disks):
                moment = 0.0
                for j in range(behind.shape[1]):
                    of_spring = springs_behind[d, j] * max(0.0, angle[n_disks] - angle[d] - behind[d, j])
                    moment += of_spring
                    peak = max(peak, output_peak[lobe, d, j] * of_spring)
                share = max(share, moment)
            features[s, pitch, OUTPUT_PEAK] = np.sqrt(peak)
            features[s, pitch, SHARE] = share / levels[n_levels - 1]


@algebraic_part
def _peak(end, phi, stiffness, first_place, peak_of_moment, force):
    """Peak pressure [MPa] under the moments of springs at rotations of disks, spread over their neighbours."""
    force[:] = 0.0
    for d in range(first_place.shape[0] - 1):
        for k in range(first_place[d], first_place[d + 1]):
            if end[k] < phi[d]:
                moment = stiffness[k] * (phi[d] - end[k])
                for i in range(force.shape[0]):
                    force[i] += peak_of_moment[k, i] * moment
    peak = 0.0
    for k in range(force.shape[0]):
        peak = force[k] if force[k] > peak else peak
    return np.sqrt(peak)


@dataclass(frozen=True)
class Springs:
    """The springs of the rough model at the places of the pins about the eccentric, and at the output.

    Attributes
    ----------
    arm : (n_places,) [mm]; disk : (n_places,) of each place.
    stiffness : (n_places,) [N mm] moment over rotation.
    pressure : (n_places,) [MPa/N^0.5]
    output_stiffness : (n_lobes, n_disks, n_output) [N mm], likewise between disks and output.
    output_peak : (n_lobes, n_disks, n_output) [MPa^2/(N mm)] squared pressure there over the moment.
    levels : (3,) ascending torques [N mm].
    spread : (n_places, n_places) forces of the model of all bodies by those of the springs, under the highest torque.
    """

    arm: Real
    disk: Index
    stiffness: Real
    pressure: Real
    output_stiffness: Real
    output_peak: Real
    levels: Real
    spread: Real

    @classmethod
    def from_compliance(cls, drives: TurnDrives, compliance: Real) -> Springs:
        """Springs of a compliance (n_contacts,) [mm/N] by places, their forces taken for the true ones."""
        study, definitions = drives.study, assembly.definitions(drives.study)
        reducer, pressure = assembly.reducer(study.design, 0.0), drives.laws[0].pressure
        torques = NMM_PER_NM * np.array([definitions.lost_motion, definitions.rigidity_low, definitions.rigidity_high])
        n, lobes, shape = reducer.n_pins, study.design.cycloid.lobes, (reducer.n_disks, -1)
        arm = reducer.contacts.arm[:n]
        stiffness, disk = arm**2 / compliance[:n], np.ascontiguousarray(reducer.disk_of_contact[:n])
        output_stiffness = np.full((lobes, reducer.n_disks, 1), STIFF * np.sum(stiffness))
        output_peak = np.zeros_like(output_stiffness)
        if has_pins_in_holes(reducer):
            turned = [assembly.reducer(study.design, float(drives.crank_deg(k * drives.phases))) for k in range(lobes)]
            arms = np.stack([np.abs(other.contacts.arm[n:]) for other in turned])
            output_stiffness = (arms**2 / compliance[n:]).reshape(lobes, *shape)
            peaks = np.divide(pressure[n:] ** 2, arms, out=np.zeros_like(arms), where=arms > 0)
            output_peak = peaks.reshape(lobes, *shape)
        levels = np.sort(torques) * abs(reducer.flange_ratio)
        return cls(arm, disk, stiffness, pressure[:n], output_stiffness, output_peak, levels, np.eye(n))

    def _closing(self, gaps: SeparateGaps, sense: int) -> tuple[Index, list[Real | Index]]:
        """Places that close in a sense (n_closing,), and the springs of the sense as the kernels take them.

        Of these the first two are rotations by pins and by lobes [rad], whose sum closes, (n, n_pins, n_closing) and
        (n, n_lobes, n_closing).
        """
        rows = np.flatnonzero((2.0 * sense - 1.0) * self.arm > 0)
        size, counts = np.abs(self.arm[rows]), np.bincount(self.disk[rows], minlength=self.output_stiffness.shape[1])
        ends = [gaps.of_pins[:, :, rows] / size, gaps.of_lobes[:, :, rows] / size, gaps.output[:, :, sense]]
        springs = [self.stiffness[rows], self.output_stiffness, np.append(0, np.cumsum(counts))]
        return rows, [np.ascontiguousarray(values) for values in (*ends, *springs)]

    def with_fitted_spread(self, gaps: SeparateGaps, pitches: Index, force: Real) -> Springs:
        """With the spread by least squares on true forces (n, n_pitches, 2, n_places) [N] under the highest torque."""
        forces = np.zeros(force.shape)
        for sense in range(2):
            rows, springs = self._closing(gaps, sense)
            moments = np.empty((*force.shape[:2], len(rows)))
            _spring_forces(*springs, self.levels[-1], pitches, moments)
            forces[:, :, sense, rows] = moments / np.abs(self.arm[rows])
        finite = np.isfinite(force).all(axis=3)
        rough, true = forces[finite], force[finite]
        square = rough.T @ rough
        ridge = RIDGE * np.trace(square) / len(square) * np.eye(len(square))
        return replace(self, spread=np.linalg.solve(square + ridge, rough.T @ true + ridge))

    def features(self, gaps: SeparateGaps) -> Real:
        """Features (n, n_pitches, n_features) of units at every pitch.

        In each sense the rotation of the output at which the first disk carries and that at each torque, the peak
        pressures of pins and of the output, and the largest share of a disk in the torque; and of the last three the
        larger one of both senses.
        """
        n, n_pins = gaps.of_pins.shape[:2]
        features = np.empty((n, n_pins * gaps.of_lobes.shape[1], 2 * OF_SENSE + OF_SENSE - PEAK))
        for sense in range(2):
            rows, springs = self._closing(gaps, sense)
            peak = self.spread[np.ix_(rows, rows)] * self.pressure[rows] ** 2 / np.abs(self.arm[rows, None])
            columns = features[:, :, sense * OF_SENSE : (sense + 1) * OF_SENSE]
            _spring_features(*springs, peak, self.output_peak, self.levels, columns)
        of_plus, of_minus = features[:, :, PEAK:OF_SENSE], features[:, :, OF_SENSE + PEAK : 2 * OF_SENSE]
        np.maximum(of_plus, of_minus, out=features[:, :, 2 * OF_SENSE :])
        return features
