"""Rigid play of the disk by exact kinematics: the real pins against the real flank, turned by finite angles.

The rest of the model turns bodies by small angles: a contact keeps its point, its normal and its arm. Here the disk
turns about its centre as far as it goes, and every pin's distance from the flank is searched anew. What the two differ
by is the error of small angles (``load_history.validity`` draws the line).
"""

from dataclasses import replace

import numpy as np

from pipeline.model.geometry.clearance import Errors, exact_gaps
from pipeline.model.geometry.cycloid_profile import CycloidProfile, Real
from pipeline.model.geometry.reducer import Reducer

BRACKET_STEPS = 64
"""Angles to a quarter of a lobe's pitch over which the first contact is looked for."""
HALVINGS = 50
"""Halvings of the bracket about the first contact."""


def gaps_after_rotation(
    profile: CycloidProfile, reducer: Reducer, errors: Errors, disk_reading: str, rotation: Real
) -> Real:
    """Distance of every pin from the flank (n, n_pins) [mm] after the disk has turned by ``rotation`` (n,) [rad].

    Notes
    -----
    Seen from the disk its pins turn the other way about its centre: each is displaced, and the distance is that of
    ``clearance.exact_gaps`` from there.
    """
    centre = profile.eccentricity * np.exp(1j * reducer.crank)
    radial = reducer.pins.centre / np.abs(reducer.pins.centre)
    actual = reducer.pins.centre + radial * (errors.pin_radial + 1j * errors.pin_tangential)
    eccentric = centre * (1 + errors.eccentricity[:, None] / profile.eccentricity)
    displaced = (actual - eccentric) * (np.exp(-1j * rotation[:, None]) - 1) * np.conj(radial)
    turned_reducer = replace(
        errors,
        pin_radial=errors.pin_radial + displaced.real,
        pin_tangential=errors.pin_tangential + displaced.imag,
    )
    return exact_gaps(profile, reducer, turned_reducer, disk_reading)


def exact_disk_play(profile: CycloidProfile, reducer: Reducer, errors: Errors, disk_reading: str) -> tuple[Real, Real]:
    """Rotations (plus, minus) (n,) [rad] at which the disk, its centre held by the crank, first touches a pin.

    NaN where pins interfere at the nominal pose, and where a quarter of a lobe's pitch leaves the disk free.
    """
    largest = 0.25 * profile.lobe_pitch
    ends = []
    for sense in (1.0, -1.0):

        def least_gap(angle: Real, sense: float = sense) -> Real:
            return np.min(gaps_after_rotation(profile, reducer, errors, disk_reading, sense * angle), axis=1)

        low, high = np.zeros(len(errors.eccentricity)), np.full(len(errors.eccentricity), np.nan)
        free = least_gap(low) >= 0
        for angle in np.linspace(0, largest, BRACKET_STEPS + 1)[1:]:
            touched = np.isnan(high) & (least_gap(np.full_like(low, angle)) < 0)
            high[touched] = angle
            low[np.isnan(high)] = angle
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            is_free = least_gap(np.nan_to_num(middle)) >= 0
            low, high = np.where(is_free, middle, low), np.where(is_free, high, middle)
        ends.append(np.where(free, sense * 0.5 * (low + high), np.nan))
    return ends[0], ends[1]
