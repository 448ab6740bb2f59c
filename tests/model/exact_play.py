"""Ends of the disk's play by brute force: turned in small steps until a pin touches, then halved."""

import numpy as np

from pipeline.model.geometry.clearance import pin_gaps

BRACKET_STEPS = 64
HALVINGS = 50


def gaps_after_rotation(profile, reducer, errors, disk_reading, rotation):
    """Distance of every pin from the flank (n, n_pins) [mm] after the disk has turned by ``rotation`` (n,) [rad]."""
    motion = np.zeros(len(rotation), complex), rotation
    return pin_gaps(profile, reducer.disks[0], errors, method="exact", disk_reading=disk_reading, motion=motion)


def exact_disk_play(profile, reducer, errors, disk_reading):
    """Rotations (plus, minus) (n,) [rad] at which the disk, its centre held by the crank, first touches a pin.

    NaN where pins interfere at the nominal pose, and where a quarter of a lobe's pitch leaves the disk free.
    """
    ends = []
    for sense in (1.0, -1.0):

        def least_gap(angle, sense=sense):
            return np.min(gaps_after_rotation(profile, reducer, errors, disk_reading, sense * angle), axis=1)

        low, high = np.zeros(len(errors.eccentricity)), np.full(len(errors.eccentricity), np.nan)
        free = least_gap(low) >= 0
        for angle in np.linspace(0, 0.25 * profile.lobe_pitch, BRACKET_STEPS + 1)[1:]:
            touched = np.isnan(high) & (least_gap(np.full_like(low, angle)) < 0)
            high[touched] = angle
            low[np.isnan(high)] = angle
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            is_free = least_gap(np.nan_to_num(middle)) >= 0
            low, high = np.where(is_free, middle, low), np.where(is_free, high, middle)
        ends.append(np.where(free, sense * 0.5 * (low + high), np.nan))
    return ends[0], ends[1]
