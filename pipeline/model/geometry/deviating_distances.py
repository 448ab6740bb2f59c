"""Distance of actual pins from a flank that is no parallel of a cycloid: turned, or measured.

As ``foot_points``, but the normal of the flank is not that of the locus. Each side of the valley of a pin is scanned
over its tip, the side below the root mirrored; where the flank cannot come nearer than what was found, by the length
between two points, it is left out; every minimum is refined.
"""

from functools import lru_cache

import numpy as np

from pipeline.arrays import Index, Real
from pipeline.model.compiled import entry, part
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.drawn_flank import STEPS
from pipeline.model.geometry.foot_points import Valleys, _rotate

REACH = 800
"""Points of a side, at the ends of the cubics: a quarter of a lobe over its tip."""
COARSE = 16
"""Points of the scan between which the finer ones are left out where they lie too far."""
ARC_OVER_CHORD = 1.2
"""Length of flank between two points of the coarse scan over their distance, at most."""
SECANTS = 12
"""Steps of the regula falsi; what has not settled then has a kink within its bracket, and is bisected."""
BISECTIONS = 45
"""Halvings of an interval of the flank: below the rounding of a parameter."""
SETTLED_STEP = 1e-12
"""Bracket [rad] at which a minimum is found: the distance is second order in it, or first at a kink."""


@lru_cache(maxsize=64)
def _scan_points(profile: CycloidProfile) -> Real:
    """Rows (7, ``REACH`` + 1): psi [rad] from 0 at the root, direction of psi, fast term [mm], normal into the disk."""
    psi = profile.lobe_pitch / STEPS * np.arange(REACH + 1)
    terms = (np.exp(1j * psi), profile.eccentricity * np.exp(1j * profile.pins * psi), profile.normal(psi))
    return np.stack([psi, *(row for term in terms for row in (term.real, term.imag))])


_Side = tuple[tuple[float, float, float], float, Real, float]
"""One side of a lobe: its gear (pins, circle, eccentricity), offset and cubics, and whether these begin at the root (1)
or end there (-1)."""


@part
def _half_slope(psi: float, side: _Side, cx: float, cy: float) -> tuple[float, float]:
    """Half of the derivative of the squared distance of c from the flank by psi, and the distance."""
    (pins, circle, eccentricity), offset, cubics, sense = side
    steps = cubics.shape[0]
    per_psi = sense * (pins - 1) * steps / (2 * np.pi)
    station = per_psi * psi if sense > 0 else steps + per_psi * psi
    step = int(min(max(np.floor(station), 0), steps - 1))
    t = station - step
    b, c, d = cubics[step, 1], cubics[step, 2], cubics[step, 3]
    deviation = offset + cubics[step, 0] + t * (b + t * (c + t * d))
    sx, sy = circle * np.cos(psi), circle * np.sin(psi)
    fx, fy = eccentricity * np.cos(pins * psi), eccentricity * np.sin(pins * psi)
    mx, moment_y = pins * fx - sx, pins * fy - sy
    length = np.sqrt(mx * mx + moment_y * moment_y)
    nx, ny = mx / length, moment_y / length
    # The derivative of m is i (N^2 f - s); its part across m turns the normal.
    turning = (nx * (pins * pins * fx - sx) + ny * (pins * pins * fy - sy)) / length
    tangential_slope, normal_offset = per_psi * (b + t * (2 * c + 3 * t * d)), deviation * turning - length
    x, y = sx - fx + deviation * nx - cx, sy - fy + deviation * ny - cy
    return tangential_slope * (x * nx + y * ny) + normal_offset * (y * nx - x * ny), np.sqrt(x * x + y * y)


@part
def _least_distance(low: float, high: float, side: _Side, cx: float, cy: float) -> float:
    """Least distance of c from the flank between psi = low and high, about a single minimum."""
    falling, near_low = _half_slope(low, side, cx, cy)
    rising, near_high = _half_slope(high, side, cx, cy)
    smallest_distance = min(near_low, near_high)
    if falling >= 0.0 or rising <= 0.0:
        return smallest_distance
    for step in range(SECANTS + BISECTIONS):
        middle = (low * rising - high * falling) / (rising - falling) if step < SECANTS else 0.5 * (low + high)
        slope, distance = _half_slope(middle, side, cx, cy)
        smallest_distance = min(smallest_distance, distance)
        if slope == 0.0 or high - low <= SETTLED_STEP:
            break
        if slope < 0.0:
            low, falling, rising = middle, slope, 0.5 * rising
        else:
            high, rising, falling = middle, slope, 0.5 * falling
    return smallest_distance


@part
def _scan_distances(
    first_point: int, last_point: int, stride: int, points: Real, side: _Side, cx: float, cy: float, distances: Real
) -> float:
    """Fill ``distances`` with the distance of c from points ``first_point`` to ``last_point`` of a scan; the least."""
    (_, circle, _), offset, cubics, sense = side
    steps, smallest_distance = cubics.shape[0], np.inf
    for k in range(first_point, last_point + 1, stride):
        # The deviation at the end of a cubic; that of the lobe's end is its first one's of the next lobe.
        step = k if sense > 0 else steps - k
        if step < steps:
            deviation = offset + cubics[step, 0]
        else:
            deviation = (
                offset + cubics[steps - 1, 0] + cubics[steps - 1, 1] + cubics[steps - 1, 2] + cubics[steps - 1, 3]
            )
        x = circle * points[1, k] - points[3, k] + deviation * points[5, k] - cx
        y = circle * points[2, k] - points[4, k] + deviation * points[6, k] - cy
        distances[k] = np.sqrt(x * x + y * y)
        smallest_distance = min(smallest_distance, distances[k])
    return smallest_distance


@part
def _least_of_side(points: Real, chords: Real, side: _Side, cx: float, cy: float, distances: Real) -> float:
    """Least distance of c from one side of a valley."""
    last_point = points.shape[1] - 1
    smallest_distance = _scan_distances(0, last_point, COARSE, points, side, cx, cy, distances=distances)
    for block in range(chords.shape[0]):
        block_start, end = block * COARSE, (block + 1) * COARSE
        if 0.5 * (distances[block_start] + distances[end] - chords[block]) > smallest_distance:
            continue
        from_k, to_k = max(block_start - 1, 0), min(end + 1, last_point)
        finer_distance = _scan_distances(from_k, to_k, 1, points, side, cx, cy, distances=distances)
        smallest_distance = min(smallest_distance, finer_distance)
        for k in range(block_start, end + 1):
            falls = k == 0 or distances[k] <= distances[k - 1]
            if falls and (k == last_point or distances[k] <= distances[k + 1]):
                # On either side of the least point, apart: it may be a kink.
                for chord in range(max(k - 1, 0), min(k, last_point - 1) + 1):
                    low, high = points[0, chord], points[0, chord + 1]
                    smallest_distance = min(smallest_distance, _least_distance(low, high, side, cx, cy))
    return smallest_distance


@entry
def _distances(
    table: Real,
    points: Real,
    chords: Real,
    eccentric: complex,
    gear: tuple[float, float, float],
    radius: float,
    deviation: Real,
    shares: tuple[float, float],
    lobe: Real,
    lobe_before: Index,
    lobe_behind: Index,
    displacements: tuple[Real, Real, Real, Real],
) -> Real:
    pins, circle, nominal = gear
    radial, tangential, eccentricity, rotation = displacements
    n, n_pins = radial.shape
    rows, distances = deviation.shape[0], np.empty(points.shape[1])
    distance = np.empty((n, n_pins))
    for s in range(n):
        for i in range(n_pins):
            cx = (
                table[4, i]
                + table[6, i] * radial[s, i]
                - table[7, i] * tangential[s, i]
                - eccentricity[s] * eccentric.real
            )
            cy = (
                table[5, i]
                + table[7, i] * radial[s, i]
                + table[6, i] * tangential[s, i]
                - eccentricity[s] * eccentric.imag
            )
            x = cx * table[8, i] + cy * table[9, i]
            y = cy * table[8, i] - cx * table[9, i]
            smallest_distance = np.inf
            for neighbour, sense in ((lobe_before[i], -1.0), (lobe_behind[i], 1.0)):
                error = lobe[s, neighbour]
                shifted_gear = (pins, circle - shares[0] * error, nominal)
                parallel, cubics = radius + shares[1] * error, deviation[neighbour % rows]
                px, py = _rotate(x, y, -rotation[s, neighbour])
                side = (shifted_gear, parallel, cubics, sense)
                of_side = _least_of_side(points, chords, side, px, -sense * py, distances)
                smallest_distance = min(smallest_distance, of_side)
            distance[s, i] = smallest_distance
    return distance


def deviating_distances(
    profile: CycloidProfile,
    nominal: Valleys,
    deviation: Real,
    shares: tuple[float, float],
    lobe: Real,
    sides: tuple[Index, Index],
    displacements: tuple[Real, Real, Real, Real],
) -> Real:
    """Distances (n, n_pins) of the pins' centres from the flanks [mm]; see ``clearance.exact_gaps``.

    Parameters
    ----------
    profile : with its modification.
    deviation : its ``deviation_table``.
    shares : what a lobe's error takes off the circle, and adds to the offset of its flank.
    lobe : (n, n_lobes) [mm]
    sides : the lobes before and behind the root of each pin's valley (n_pins,).
    displacements : error of the pins outward and counterclockwise (n, n_pins), of the eccentricity (n,) [mm], and
        rotation of the lobes about the disk's axis (n, n_lobes) [rad].
    """
    flank = profile.generating
    points = _scan_points(flank)
    coarse = flank.flank(points[0, ::COARSE])
    rise = np.ptp(deviation[..., 0])
    chords = ARC_OVER_CHORD * (np.abs(np.diff(coarse)) + rise)
    gear = float(profile.pins), flank.pin_circle_radius, flank.eccentricity
    lobe_before, lobe_behind = sides
    return _distances(
        nominal.pins,
        points,
        chords,
        nominal.eccentric,
        gear,
        flank.pin_radius,
        deviation,
        shares=shares,
        lobe=lobe,
        lobe_before=lobe_before,
        lobe_behind=lobe_behind,
        displacements=displacements,
    )
