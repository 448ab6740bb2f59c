"""The rough model that ranks pitches: every contact a spring of its own, the centres of the disks held.

Each disk turns on the springs of its pins and the output on those between it and the disk; the disks share the torque
on the output as their springs give way. Newton's steps find the rotations: of a disk and of the output the moment
grows in straight lines between the rotations at which springs close.
"""

from dataclasses import dataclass

import numpy as np

from pipeline import assembly
from pipeline.arrays import Index, Real
from pipeline.model.compiled import algebraic_part, entry
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import ARM_FLOOR
from pipeline.model.units import NMM_PER_NM
from pipeline.populations.turn_drives import TurnDrives
from pipeline.populations.turn_gaps import SeparateGaps, has_pins_in_holes

MOST_STEPS = 40
"""Newton steps to the rotations; piecewise linear, so that some five find them."""
SAME_ROTATION = 1e-9
"""Of a rotation: what steps change it by when they have ended."""
STIFF = 1e3
"""Stiffness of what is behind a disk and has no springs, over that of all of its pins."""
OF_SENSE = 5
"""Features of a sense: the first contact, rotations at three torques, largest share of a disk in the highest."""
MOMENTS = 3
"""Waves around a disk of what output pins in its holes carry."""


@algebraic_part
def _ends(of_pins: Real, of_lobes: Real, output: Real, first_place: Index, end: Real, first_end: Real) -> None:
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
def _closed(end: Real, stiffness: Real, start: int, stop: int, angle: float) -> tuple[float, float]:
    """Stiffness of the springs that are closed at a rotation, and their moment at 0.

    The sums take all springs, the open ones with the factor 0: so the compiler adds several at once.
    """
    slope, offset = 0.0, 0.0
    for k in range(start, stop):
        closed_spring = stiffness[k] if end[k] < angle else 0.0
        slope += closed_spring
        offset += closed_spring * end[k]
    return slope, offset


_Springs = tuple[Real, Real]
"""Stiffness of the pins' springs (n_places,), and of those of the output at each lobe (n_lobes, n_disks, n)."""


@algebraic_part
def _balance(
    places: tuple[Real, Real, Index, Real], behind: tuple[Real, Real], torque: float, phi: Real, line: Real
) -> None:
    """Rotations at which the springs carry a torque, by Newton from any: of the disks ``phi[:-1]``, the output's last.

    A disk carries nothing before the output has gone through its play. Beyond it some spring on either side of it is
    closed, and its rotation lies between those at which the first ones close. Where none carries, all springs count.
    """
    (end, stiffness, first_place, first_end), (output, output_stiffness) = places, behind
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
            line[0, d], line[1, d] = h / (k + h), (k0 - h0) / (k + h)
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
def _spring_features(
    of_pins: Real, of_lobes: Real, output: Real, springs: _Springs, first_place: Index, levels: Real, features: Real
) -> None:
    """Fill features (n, n_pins n_lobes, OF_SENSE) of one sense, see ``Springs.features``."""
    n, n_pins, n_places = of_pins.shape
    n_lobes, n_levels, n_disks = of_lobes.shape[1], levels.shape[0], output.shape[2]
    end, phi = np.empty(n_places), np.zeros((n_levels, n_disks + 1))
    first_end, line = np.empty((2, n_disks)), np.empty((2, n_disks))
    places = (end, springs[0], first_place, first_end)
    for s in range(n):
        for pitch in range(n_pins * n_lobes):
            lobe = pitch % n_lobes
            behind, springs_behind = output[s, lobe], springs[1][lobe]
            _ends(of_pins[s, pitch % n_pins], of_lobes[s, lobe], behind, first_place, end, first_end)
            features[s, pitch, 0] = np.min(first_end[0] + first_end[1])
            for k in range(n_levels):  # from the rotations at the pitch before: two or three steps of Newton away
                _balance(places, (behind, springs_behind), levels[k], phi[k], line)
                features[s, pitch, 1 + k] = phi[k, n_disks]
            angle, share = phi[n_levels - 1], 0.0
            for d in range(n_disks):
                slope, offset = _closed(behind[d], springs_behind[d], 0, behind.shape[1], angle[n_disks] - angle[d])
                share = max(share, slope * (angle[n_disks] - angle[d]) - offset)
            features[s, pitch, n_levels + 1] = share / levels[n_levels - 1]


@entry
def _features_of_single(of_pins: Real, of_lobes: Real, stiffness: Real, levels: Real, features: Real) -> None:
    """Likewise of a single disk with rigid parts behind it, whose play ``of_lobes`` holds too."""
    n, n_pins, n_places = of_pins.shape
    n_lobes, n_levels = of_lobes.shape[1], levels.shape[0]
    end, phi = np.empty(n_places), np.zeros(n_levels)
    for s in range(n):
        for pitch in range(n_pins * n_lobes):
            of_pin, of_lobe, first_end = of_pins[s, pitch % n_pins], of_lobes[s, pitch % n_lobes], np.inf
            for k in range(n_places):
                end[k] = of_pin[k] + of_lobe[k]
            for k in range(n_places):
                first_end = min(first_end, end[k])
            features[s, pitch, 0] = first_end
            for level in range(n_levels):
                angle = phi[level]
                for _ in range(MOST_STEPS):
                    slope, offset = _closed(end, stiffness, 0, n_places, angle)
                    if slope == 0.0:
                        slope, offset = _closed(end, stiffness, 0, n_places, np.inf)
                    angle, angle_before = (levels[level] + offset) / slope, angle
                    if abs(angle - angle_before) <= SAME_ROTATION * abs(angle):
                        break
                phi[level] = features[s, pitch, 1 + level] = angle
            features[s, pitch, n_levels + 1] = 1.0


@dataclass(frozen=True)
class Springs:
    """The springs of the rough model at the places of the pins about the eccentric, and at the output.

    Attributes
    ----------
    arm : (n_places,) [mm]; disk : (n_places,) of each place.
    stiffness : (n_places,) [N mm] moment over rotation.
    output_stiffness : (n_lobes, n_disks, n_output) [N mm], likewise between disks and output after 0, 1, ... pitches.
    output_waves : (n_lobes, n_disks, n_output, 2 MOMENTS + 1) [1/mm] waves around the disk over the arm; none where the
        output has no pins in holes.
    levels : (3,) ascending torques [N mm].
    """

    arm: Real
    disk: Index
    stiffness: Real
    output_stiffness: Real
    output_waves: Real
    levels: Real

    @classmethod
    def from_compliance(cls, drives: TurnDrives, compliance: Real) -> "Springs":
        """Springs of a compliance (n_contacts,) [mm/N] by places."""
        study, definitions = drives.study, assembly.definitions(drives.study)
        lobes, reducer = study.design.cycloid.lobes, assembly.reducer(study.design, 0.0)
        torques = NMM_PER_NM * np.array([definitions.lost_motion, definitions.rigidity_low, definitions.rigidity_high])
        n, arm = reducer.n_pins, reducer.contacts.arm[: reducer.n_pins]
        stiffness, disk = arm**2 / compliance[:n], np.ascontiguousarray(reducer.disk_of_contact[:n])
        output_stiffness = np.full((lobes, reducer.n_disks, 1), STIFF * np.sum(stiffness))
        output_waves = np.zeros((*output_stiffness.shape, 0))
        if has_pins_in_holes(reducer):
            turned = [assembly.reducer(study.design, float(drives.crank_deg(k * drives.phases))) for k in range(lobes)]
            shape = lobes, reducer.n_disks, -1
            output_stiffness = (np.stack([one.contacts.arm[n:] for one in turned]) ** 2 / compliance[n:]).reshape(shape)
            output_waves = np.stack([_waves_over_arm(one) for one in turned]).reshape(*output_stiffness.shape, -1)
        levels = np.sort(torques) * abs(reducer.flange_ratio)
        return cls(arm, disk, stiffness, output_stiffness, output_waves, levels)

    def closing(self, sense: int) -> Index:
        """Places (n_closing,) that close in a sense."""
        return np.flatnonzero((2.0 * sense - 1.0) * self.arm > ARM_FLOOR * np.max(np.abs(self.arm)))

    def output_loads(self, gaps: SeparateGaps, sense: int) -> Real:
        """What output pins in holes do to the disks (n, n_lobes, n_loads), each disk under its part of the torque.

        Of each disk the rotation of the output against it, and the waves of the forces around it.
        """
        ends, stiffness, n_disks = gaps.output[:, :, sense], self.output_stiffness, self.output_stiffness.shape[1]
        order = np.argsort(ends, axis=-1)
        ascending = np.take_along_axis(ends, order, axis=-1)
        springs = np.take_along_axis(np.broadcast_to(stiffness, ends.shape), order, axis=-1)
        slope, offset = np.cumsum(springs, axis=-1), np.cumsum(springs * ascending, axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            angles = (self.levels[-1] / n_disks + offset) / slope  # with the first one, two, ... closed
        angle = np.nanmin(np.where(slope > 0, angles, np.inf), axis=-1, keepdims=True)
        moments = stiffness * np.maximum(angle - ends, 0.0)
        waves = np.einsum("nldk,ldkm->nldm", moments, self.output_waves)
        loads = np.concatenate([angle, waves], axis=-1) if waves.shape[-1] else waves
        return np.asarray(loads.reshape(*loads.shape[:2], -1))

    def features(self, gaps: SeparateGaps) -> Real:
        """Features (n, n_pitches, 2 OF_SENSE) of units at every pitch.

        In each sense the rotation of the output at which the first disk carries, that at each torque, and the largest
        share of a disk in the highest.
        """
        n, n_pins = gaps.of_pins.shape[:2]
        features = np.empty((n, n_pins * gaps.of_lobes.shape[1], 2 * OF_SENSE))
        for sense in range(2):
            rows = self.closing(sense)
            size = np.abs(self.arm[rows])
            counts = np.bincount(self.disk[rows], minlength=self.output_stiffness.shape[1])
            of_pins = np.ascontiguousarray(gaps.of_pins[:, :, rows] / size)
            of_lobes = np.ascontiguousarray(gaps.of_lobes[:, :, rows] / size)
            stiffness, behind = np.ascontiguousarray(self.stiffness[rows]), gaps.output[:, :, sense]
            of_sense = features[:, :, sense * OF_SENSE : (sense + 1) * OF_SENSE]
            if behind.shape[2:] == (1, 1):
                of_lobes += behind[..., 0]
                _features_of_single(of_pins, of_lobes, stiffness, self.levels, of_sense)
                continue
            springs, behind = (stiffness, np.ascontiguousarray(self.output_stiffness)), np.ascontiguousarray(behind)
            first_place = np.append(0, np.cumsum(counts))
            _spring_features(of_pins, of_lobes, behind, springs, first_place, self.levels, of_sense)
        return features


def _waves_over_arm(reducer: Reducer) -> Real:
    """Waves (n_contacts, 2 MOMENTS + 1) [1/mm] around the disks at output contacts, over the arms; 0 without an arm."""
    contacts, rows = reducer.contacts, np.arange(reducer.n_pins, len(reducer.contacts))
    eccentric = np.array([pose.eccentric for pose in reducer.disks])[reducer.disk_of_contact[rows]]
    direction = (contacts.point[rows] - eccentric) / eccentric
    angle = np.angle(direction)[:, None] * np.arange(1, MOMENTS + 1)
    waves: Real = np.hstack([np.ones((len(rows), 1)), np.cos(angle), np.sin(angle)])
    arm = np.abs(contacts.arm[rows])
    has_arm = (arm > ARM_FLOOR * np.max(arm))[:, None]
    return np.divide(waves, arm[:, None], out=np.zeros_like(waves), where=has_arm)
