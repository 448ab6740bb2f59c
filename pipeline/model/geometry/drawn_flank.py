"""The flank as drawn and as measured: a parallel of a cycloid, less a deviation along its normal.

Material off, w >= 0, is counted along the normal of the generating profile into the disk. It is kept as cubics of the
phase over every lobe: a rotation has its kinks at root and tip, which are ends of cubics.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Complex, Real
from pipeline.model.geometry.cycloid_profile import CycloidProfile

STEPS = 1024
"""Cubics of a lobe: of the paper's flank turned by 10 um they are within 1e-11 mm."""
TURN = 2 * np.pi
"""Radians of a turn."""
NEIGHBOURS = 4
"""Points of the lobes beside that the interpolation of a measured one sees: a slope depends on two."""


def arm_of_phase(profile: CycloidProfile, beta: ArrayLike) -> Real:
    """Arm |a| of the contact normal about the disk's centre at the phase ``beta`` [rad], in mm."""
    k, angle = profile.shortening, np.asarray(beta, float)
    length = np.sqrt(1 + k * k - 2 * k * np.cos(angle))
    arm: Real = profile.eccentricity * profile.lobes * np.abs(np.sin(angle)) / length
    return arm


def _arm_slope(profile: CycloidProfile, beta: Real, side: int) -> Real:
    """d|a|/d beta [mm] from the side of larger (1) or smaller (-1) phases."""
    k, shifted_angle = profile.shortening, beta + side * 1e-12
    s_squared = 1 + k * k - 2 * k * np.cos(beta)
    slope = np.cos(beta) / s_squared**0.5 - k * np.sin(beta) ** 2 / s_squared**1.5
    return profile.eccentricity * profile.lobes * np.sign(np.sin(shifted_angle)) * slope


@lru_cache(maxsize=16)
def deviation_table(profile: CycloidProfile) -> Real:
    """Cubics of the material off (n_rows, ``STEPS``, 4) [mm], ascending powers of the share of a step.

    Step k begins at the phase 2 pi k / ``STEPS`` of a lobe, clockwise from its first root. One row for all lobes, or
    one a lobe.
    """
    modification, drawn_profile = profile.modification, profile.generating
    grid, width = np.linspace(0, TURN, STEPS + 1), TURN / STEPS
    value = modification.rotation * arm_of_phase(drawn_profile, grid)[None, :]
    slope_after = modification.rotation * _arm_slope(drawn_profile, grid[:-1], 1)[None, :]
    slope_before = modification.rotation * _arm_slope(drawn_profile, grid[1:], -1)[None, :]
    if modification.measured_flank is not None:
        measured_material, slope = _measured_material(
            modification.measured_flank.phase, modification.measured_flank.material, grid
        )
        value = value - measured_material
        slope_after = slope_after - slope[:, :-1]
        slope_before = slope_before - slope[:, 1:]
    rise = np.diff(value, axis=1)
    slope_after, slope_before = width * slope_after, width * slope_before
    second, third = 3 * rise - 2 * slope_after - slope_before, slope_after + slope_before - 2 * rise
    table = np.stack([value[:, :-1], slope_after, second, third], axis=2)
    return np.ascontiguousarray(table)  # in another order it would need a second compiled form


def _measured_material(phase: Real, material: Real, grid: Real) -> tuple[Real, Real]:
    """Measured material (n_rows, n_grid) [mm] and its slope; a lobe goes on in the next, with the last in the first."""
    from scipy.interpolate import Akima1DInterpolator  # slow to import, and few flanks are measured

    lobes = np.stack([np.roll(material, 1, axis=0), material, np.roll(material, -1, axis=0)], axis=1)
    chain = lobes.reshape(len(material), -1)
    places = np.concatenate([phase - TURN, phase, phase + TURN])
    inner = slice(max(len(phase) - NEIGHBOURS, 0), min(2 * len(phase) + NEIGHBOURS, 3 * len(phase)))
    interpolant = Akima1DInterpolator(places[inner], chain[:, inner], axis=1, method="makima")
    return interpolant(grid), interpolant(grid, 1)


def material_off(profile: CycloidProfile, lobe: ArrayLike, beta: ArrayLike) -> Real:
    """Material off the generated flank along its normal [mm] at phases ``beta`` [rad] of lobes, broadcast.

    A lobe has the phases 0 to 2 pi, clockwise; negative ones are counted from its end.
    """
    lobe, beta = np.broadcast_arrays(lobe, np.asarray(beta, float))
    if not profile.modification.deviates:
        return np.zeros(beta.shape)
    table = deviation_table(profile)
    station = np.where(beta < 0, beta + TURN, beta) / TURN * STEPS
    step = np.minimum(station.astype(np.int64), STEPS - 1)
    cubic = table[np.asarray(lobe) % len(table), step]
    material: Real = np.sum(cubic * (station - step)[..., None] ** np.arange(4), axis=-1)
    return material


def drawn_flank(profile: CycloidProfile, lobe: ArrayLike, beta: ArrayLike) -> Complex:
    """Points of the flank in the disk frame [mm] at phases ``beta`` [rad] of lobes, broadcast.

    Lobes are numbered clockwise, lobe 0 from the root at angle 0; a lobe has the phases 0 to 2 pi, clockwise.
    """
    lobe, beta = np.broadcast_arrays(lobe, np.asarray(beta, float))
    drawn_profile = profile.generating
    psi = -(np.asarray(lobe) + beta / TURN) * profile.lobe_pitch
    return drawn_profile.locus(psi) + (
        drawn_profile.pin_radius + material_off(profile, lobe, beta)
    ) * drawn_profile.normal(psi)


def phase_of_arc(profile: CycloidProfile, arc: Real) -> Real:
    """Phase [rad] at the length ``arc`` [mm] along a lobe of the drawn flank, clockwise from its first root."""
    beta = np.linspace(0, TURN, 16 * STEPS + 1)
    return np.interp(arc, _arc(profile, beta), beta)


def lobe_length(profile: CycloidProfile) -> float:
    """Length of a lobe of the drawn flank without measured deviation [mm]."""
    return float(_arc(profile, np.linspace(0, TURN, 16 * STEPS + 1))[-1])


def _arc(profile: CycloidProfile, beta: Real) -> Real:
    """Length of the generated flank from phase 0 (n,) [mm]."""
    flank = profile.generating.flank(-beta / profile.lobes)
    return np.concatenate([[0.0], np.cumsum(np.abs(np.diff(flank)))])
