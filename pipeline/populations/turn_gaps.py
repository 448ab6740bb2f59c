"""Gaps of units over a whole turn of the output as outer sums.

To first order the gap at a pin is the sum of what the pin does and what the lobe does that it meets, and over the
output turn every pin meets every lobe: the gaps of all pitches are outer sums of those of as many pitches as there are
pins, without errors of the disk, and of as many as there are lobes, without errors of the pins. Contacts with the
output stand about the eccentric as before after as many pitches as there are lobes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Real
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import rigid_play
from pipeline.model.load_history.drive import Drive
from pipeline.mounting import drive_of
from pipeline.populations.turn_drives import HOUSING_ERRORS, TurnDrives, Units

OF_DISK = ("lobe", "lobe_pitch", "bore_runout", "hole_diameter", "pin_off_hole")
"""Errors that turn with a disk."""
NEVER_CLOSED = 1e3
"""Rotation [rad] at which a contact closes that opens instead."""


@dataclass(frozen=True)
class SeparateGaps:
    """Gaps of ``n`` units over the output turn as outer sums.

    Attributes
    ----------
    of_pins : (n, n_pins, n_places) [mm] with errors of the pins alone, after 0, 1, ... pitches.
    of_lobes : (n, n_lobes, n_places) [mm] what the other errors add.
    output : (n, n_lobes, 2, n_disks, n_output) [rad] rotation of the output against each disk in the senses + and - at
        which each contact between them closes, counted in the sense. Where no pins in holes are these contacts, a
        single one of a disk stands for what is behind it.
    """

    of_pins: Real
    of_lobes: Real
    output: Real

    @classmethod
    def from_units(cls, drives: TurnDrives, units: Units) -> "SeparateGaps":
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

    @property
    def n_pitches(self) -> int:
        """Pitches of the output turn."""
        return int(self.of_pins.shape[1] * self.of_lobes.shape[1])

    def some(self, rows: slice) -> "SeparateGaps":
        """The gaps of some units."""
        return SeparateGaps(self.of_pins[rows], self.of_lobes[rows], self.output[rows])


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


def has_pins_in_holes(reducer: Reducer) -> bool:
    """Whether the contacts between disks and output are pins of the output in holes of the disks."""
    holes = reducer.contacts.hole[reducer.n_pins :]
    return reducer.is_centred and len(holes) > 0 and bool(np.all(holes >= 0))


def _output_ends(drive: Drive) -> Real:
    """Rotations (n, 2, n_disks, n_output) [rad] of the output against each disk at which their contacts close."""
    reducer, n = drive.reducer, len(drive.gap)
    if not has_pins_in_holes(reducer):
        return _play_behind(drive)[:, :, None, None] * np.ones((1, 1, reducer.n_disks, 1))
    gap, arm = (values[..., reducer.n_pins :] for values in (drive.gap, reducer.contacts.arm))
    ends = []
    for sign in (1.0, -1.0):
        closes = np.broadcast_to(-sign * arm > 0, gap.shape)
        ends.append(np.divide(gap, np.abs(arm), out=np.full_like(gap, NEVER_CLOSED), where=closes))
    return np.stack(ends, axis=1).reshape(n, 2, reducer.n_disks, -1)


def _play_behind(drive: Drive) -> Real:
    """Play behind the disk in both senses (n, 2) [rad]: that of all less that of the pins; 0 of several."""
    reducer = drive.reducer
    if reducer.n_disks > 1 or not reducer.is_centred:
        return np.zeros((len(drive.gap), 2))
    ends = rigid_play(reducer, drive.gap, np.zeros_like(drive.bearing_clearance)).ends * reducer.flange_ratio
    ends = ends if reducer.flange_ratio > 0 else ends[::-1]
    gap, arm = drive.gap[:, : reducer.n_pins], reducer.contacts.arm[: reducer.n_pins]
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = -gap / arm
    plus = np.min(angle, axis=1, where=arm < 0, initial=np.inf)
    minus = np.max(angle, axis=1, where=arm > 0, initial=-np.inf)
    return np.stack([ends[0] - plus, minus - ends[1]], axis=-1)
