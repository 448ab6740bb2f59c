"""What pins out of round take of their gaps: waves of a pin's radius, held in the housing as they happen to sit.

Lobes' own errors change the flank under a pin by micrometres, and what that does to the closing by a wave is of second
order in both; the flank as drawn stands for it here. The pins' places count in full.
"""

import numpy as np

from pipeline.arrays import Complex, Real
from pipeline.model.compiled import entry, part
from pipeline.model.geometry.contacts import DiskPose
from pipeline.model.geometry.cycloid_profile import CycloidProfile, disk_rotation
from pipeline.model.geometry.foot_points import valley_points
from pipeline.model.geometry.reducer import Reducer

ORDERS = (2, 3)
"""Waves around a pin that a roundness tolerance has."""
SCAN = 240
"""Points from root to tip: about the smallest gap the parabola through three of them misses it by 1e-4 of a wave."""
STRIDE = 12
"""Of the first pass over these points; the second looks at all within a stride of its smallest one."""


def first_order_closing(pose: DiskPose | Reducer, waves: Complex) -> Real:
    """How far each pin reaches out along its nominal contact normal (n, n_pins) [mm].

    Parameters
    ----------
    waves : ``Errors.pin_roundness`` (n, n_pins, 2) [mm].
    """
    turns = np.stack([pose.pins.normal**order for order in ORDERS], axis=-1)
    closing: Real = np.sum(np.real(waves * turns), axis=-1)
    return closing


def exact_closing(
    profile: CycloidProfile, pose: DiskPose | Reducer, displacements: tuple[Real, Real, Real], waves: Complex
) -> Real:
    """How much nearer the flank comes to a pin out of round than to a round one (n, n_pins) [mm].

    Parameters
    ----------
    displacements : radial and tangential way of the pins (n, n_pins) and error of the eccentricity (n,) [mm].
    waves : ``Errors.pin_roundness`` (n, n_pins, 2) [mm].

    Notes
    -----
    The gap of a pin whose radius is r + rho(theta) is the least of |q - A| - r - rho over the points q of the flank, A
    being the pin's axis and theta the direction from A to q: along that direction, which a wave of amplitude a turns
    against the normal by 2 a/r or 3 a/r.
    """
    pins, turn = pose.pins, np.exp(-1j * disk_rotation(profile, pose.crank))
    radial, tangential, eccentricity = displacements
    outward = pins.centre / np.abs(pins.centre)
    eccentric = np.exp(1j * pose.crank)
    approach = (radial + 1j * tangential) * outward - eccentricity[:, None] * eccentric
    axis = (pins.centre - profile.eccentricity * eccentric + approach) * turn
    valley, root = valley_points(profile, SCAN), pins.flank_parameter + pins.phase / profile.lobes
    flank = profile.generating.flank(root[:, None] + valley)
    in_disk = waves * np.stack([turn**-order for order in ORDERS])
    return _closing(valley, flank.real.copy(), flank.imag.copy(), axis.real.copy(), axis.imag.copy(), in_disk)


@part
def _least_gap(
    psi: Real,
    flank_x: Real,
    flank_y: Real,
    axis_x: float,
    axis_y: float,
    wave_2: complex,
    wave_3: complex,
    values: Real,
) -> float:
    """Least of |q - A| - rho over the points q of a valley (n_points,); ``values`` is room for all of them."""
    last_point = len(psi) - 1
    smallest_gap, best_point = np.inf, 0
    for step in (STRIDE, 1):
        first_point, end = (
            (0, last_point) if step > 1 else (max(0, best_point - STRIDE), min(last_point, best_point + STRIDE))
        )
        for k in range(first_point, end + 1, step):
            x, y = flank_x[k] - axis_x, flank_y[k] - axis_y
            distance = np.sqrt(x * x + y * y)
            x, y = x / distance, y / distance
            cos_2, sin_2 = x * x - y * y, 2.0 * x * y
            cos_3, sin_3 = cos_2 * x - sin_2 * y, cos_2 * y + sin_2 * x
            values[k] = distance - (
                wave_2.real * cos_2 - wave_2.imag * sin_2 + wave_3.real * cos_3 - wave_3.imag * sin_3
            )
            if values[k] < smallest_gap:
                smallest_gap, best_point = values[k], k
    if not 0 < best_point < last_point:
        return smallest_gap
    low, high = psi[best_point] - psi[best_point - 1], psi[best_point + 1] - psi[best_point]
    slope_before, slope_behind = values[best_point - 1] - smallest_gap, values[best_point + 1] - smallest_gap
    bend = slope_before * high + slope_behind * low  # of the parabola through the three points, as the slope in it
    slope = slope_behind * low * low - slope_before * high * high
    return smallest_gap - slope * slope / (4.0 * low * high * (low + high) * bend) if bend > 0.0 else smallest_gap


@entry
def _closing(psi: Real, flank_x: Real, flank_y: Real, axis_x: Real, axis_y: Real, waves: Complex) -> Real:
    """See ``exact_closing``; flank (n_pins, n_points), axis (n, n_pins), waves (n, n_pins, 2) in the disk's frame."""
    n, n_pins = axis_x.shape
    closing, values = np.zeros((n, n_pins)), np.empty(len(psi))
    for s in range(n):
        for i in range(n_pins):
            wave_2, wave_3 = waves[s, i, 0], waves[s, i, 1]
            if wave_2 == 0.0 and wave_3 == 0.0:
                continue
            axis = axis_x[s, i], axis_y[s, i]
            as_round = _least_gap(psi, flank_x[i], flank_y[i], *axis, 0j, 0j, values)
            closing[s, i] = as_round - _least_gap(psi, flank_x[i], flank_y[i], *axis, wave_2, wave_3, values)
    return closing
