"""Distance of actual pins from the actual flank, by the foot points on both flanks of the valley of each pin.

Most pins lie where only one foot is near: Newton from the nominal one finds it, on all pins of a sample at once. Near
the roots the flank's centre of curvature is a few micrometres away from the pin's and feet may be many: the distance
is scanned over the whole valley and every minimum refined.

Compiled code works on real numbers: products of complex ones are checked for infinities, at three times the cost.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pipeline.arrays import Index, Real
from pipeline.model.compiled import entry, part
from pipeline.model.geometry.cycloid_profile import KEPT_ANGLES, CycloidProfile, disk_rotation, pin_contacts

BEYOND_THE_TIP = 1.25
"""Reach of a valley's points, squared in units of half a lobe: well over the tips, and within the lobes."""
VALLEY_SCAN = 40
"""Points from root to tip at which the distance is scanned before refinement where feet may be many, the denser the
nearer to the root."""
SINGLE_FOOT = 0.05
"""Newton finds the foot point from the nominal one while the pin's displacement stays below this share of the nominal
locus' radius of curvature."""
OTHER_NORMAL = 0.1
"""Flank points whose normals differ by more than this [rad] are no neighbours of the foot: one may come nearer."""
FOOT_TOLERANCE = 1e-9
"""Turn [rad] left at the foot point, to which the distance is second order: below 1e-15 mm."""
SINGLE_STEPS = 3
"""Newton steps to a single foot; what has not met ``FOOT_TOLERANCE`` then is scanned for."""
SAME_PHASE = 12
"""Digits of a crank angle [rad] that a phase of a pitch is told from others by."""
FOOT_STEPS = 100
"""Newton steps or bisections within a bracket."""
SMALL_TURN = 0.1
"""Angle [rad] up to which nine terms of the series of sine and cosine are exact to the last bit."""


@dataclass(frozen=True)
class Valleys:
    """The nominal pins in the valleys of the flank without rotation and measured deviation, in the disk frame.

    Attributes
    ----------
    pins : (12, n_pins), rows: unit vector of the locus' slow term, its fast term [mm], pin centre [mm], radial
        direction, direction of the root (two rows each), how far the pin may move before its foot is no longer the
        only one, and until the other flank is nearer [mm].
    points : (7, n_points) of a valley about its root, rows: psi [rad], the locus' fast term [mm], radial direction,
        normal (two rows each).
    eccentric : direction of the eccentric.
    """

    pins: Real
    points: Real
    eccentric: complex


@lru_cache(maxsize=KEPT_ANGLES)
def valleys(profile: CycloidProfile, crank: float) -> Valleys:
    """What ``_distances`` needs of the nominal reducer at the crank angle ``crank`` [rad]; kept from call to call."""
    pins, flank = pin_contacts(profile, crank), profile.generating
    turn = np.exp(-1j * disk_rotation(profile, crank))
    radial = pins.centre / np.abs(pins.centre)
    root = pins.flank_parameter + pins.phase / profile.lobes
    directions = (
        np.exp(1j * pins.flank_parameter),
        profile.eccentricity * np.exp(1j * profile.pins * pins.flank_parameter),
        (pins.centre - profile.eccentricity * np.exp(1j * crank)) * turn,
        radial * turn,
        np.exp(1j * root),
    )
    n_pitches = int(crank // (2 * np.pi / profile.pins))
    rooms = np.roll(_rooms(flank, round(crank - 2 * np.pi / profile.pins * n_pitches, SAME_PHASE)), -n_pitches, axis=1)
    rows = [*(row for direction in directions for row in (direction.real, direction.imag)), *rooms]
    return Valleys(np.array(rows), _points_of_valley(profile), complex(np.exp(1j * crank) * turn))


@lru_cache
def _points_of_valley(profile: CycloidProfile) -> Real:
    """``Valleys.points``."""
    psi = valley_points(profile, VALLEY_SCAN)
    eccentric = profile.eccentricity * np.exp(1j * profile.pins * psi)
    curve_points = (eccentric, np.exp(1j * psi), profile.generating.normal(psi))
    return np.vstack([psi, *(row for direction in curve_points for row in (direction.real, direction.imag))])


def valley_points(profile: CycloidProfile, scan: int) -> Real:
    """Parameters psi of a valley (2 scan + 1,) about its root at 0, ascending, some way beyond its tips."""
    even_grid = BEYOND_THE_TIP * np.linspace(-1, 1, 2 * scan + 1)
    return 0.5 * profile.lobe_pitch * even_grid * np.abs(even_grid)


@lru_cache(maxsize=KEPT_ANGLES)
def _rooms(profile: CycloidProfile, crank: float) -> Real:
    """How far pins may move (2, n_pins) before their foot is no longer the only one, and until another flank is nearer.

    A pitch on the next pin has them: they are kept by the crank angle [rad] within it.
    The first is the least gap over change of normal among the points of the valley that are no neighbours of the
    foot, and Newton's own limit; the second the least gap of the other side of the root.
    """
    phase, psi = pin_contacts(profile, crank).phase, valley_points(profile, VALLEY_SCAN)
    flank, normal = profile.flank(psi), profile.normal(psi)
    lobe_position = -phase / profile.lobes
    gap = np.abs(profile.locus(lobe_position)[:, None] - flank) - profile.pin_radius
    rotated_normal = np.abs(profile.normal(lobe_position)[:, None] - normal)
    smallest_room = np.min(
        gap / np.maximum(rotated_normal, OTHER_NORMAL), axis=1, where=rotated_normal > OTHER_NORMAL, initial=np.inf
    )
    room = np.min(gap, axis=1, where=psi * lobe_position[:, None] <= 0, initial=np.inf)
    return np.stack([np.minimum(smallest_room, SINGLE_FOOT * np.abs(profile.locus_radius(phase))), room])


@part
def _rotate(x: float, y: float, angle: float) -> tuple[float, float]:
    """The vector (x, y) turned by an angle up to ``SMALL_TURN``, to the last bit."""
    square = angle * angle
    cosine = 1.0 - square * (0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0 - square * (1.0 / 40320.0))))
    sine = 1.0 - square * (1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square * (1.0 / 362880.0))))
    sine *= angle
    return x * cosine - y * sine, y * cosine + x * sine


@part
def _foot_terms(
    sx: float, sy: float, fx: float, fy: float, cx: float, cy: float, pins: int
) -> tuple[float, float, float, float, float, float, float]:
    """Slope and bend of half the squared distance of c from a point of the locus with slow term s and fast term f.

    Also the derivative of the locus with its square; x, y from the centre to the point.
    """
    x, y = sx - fx - cx, sy - fy - cy
    dx, dy = pins * fy - sy, sx - pins * fx
    slope, length = x * dx + y * dy, dx * dx + dy * dy
    bend = length + x * (pins * pins * fx - sx) + y * (pins * pins * fy - sy)
    return slope, bend, length, x, y, dx, dy


@part
def _single_distances(
    sx: Real,
    sy: Real,
    fx: Real,
    fy: Real,
    cx: Real,
    cy: Real,
    offset: Real,
    limit: Real,
    pins: int,
    turn: Real,
    distance: Real,
) -> None:
    """Distances from the flank of the pins that moved no farther than ``limit``; -1 for the others.

    A loop writes one array and reads few: only then does the compiler prove that none overlaps, and solves several
    pins at once.
    """
    for i in range(turn.shape[0]):
        x, y = sx[i] - fx[i] - cx[i], sy[i] - fy[i] - cy[i]
        turn[i] = 0.0 if np.sqrt(x * x + y * y) <= limit[i] else np.inf
    for _ in range(SINGLE_STEPS):
        for i in range(turn.shape[0]):
            tx, ty = _rotate(sx[i], sy[i], turn[i])
            ux, uy = _rotate(fx[i], fy[i], pins * turn[i])
            slope, bend, _, _, _, _, _ = _foot_terms(tx, ty, ux, uy, cx[i], cy[i], pins)
            turn[i] -= slope / bend
    for i in range(turn.shape[0]):
        tx, ty = _rotate(sx[i], sy[i], turn[i])
        ux, uy = _rotate(fx[i], fy[i], pins * turn[i])
        slope, _, length, x, y, dx, dy = _foot_terms(tx, ty, ux, uy, cx[i], cy[i], pins)
        is_converged = (abs(pins * turn[i]) <= SMALL_TURN) & (abs(slope) <= FOOT_TOLERANCE * length)
        distance[i] = offset[i] + (y * dx - x * dy) / np.sqrt(length) if is_converged else -1.0


_Valley = tuple[Real, float, float, int]
"""Points of a valley (``Valleys.points``), radius of its pin circle, offset of its flank, and pins."""


@part
def _refined_distance(
    k: int, first_point: int, last_point: int, valley: _Valley, cx: float, cy: float, squares: Real
) -> float:
    """Distance of c from the flank at the minimum next to point ``k``, which lies nearer than its neighbours."""
    points, circle, offset, pins = valley
    base = points[0, k]
    low = points[0, max(first_point, k - 1)] - base
    high = points[0, min(last_point, k + 1)] - base
    turn = 0.0
    if first_point < k < last_point:  # the vertex of the parabola through the three points
        slope_before, slope_behind = (squares[k - 1] - squares[k]) / low, (squares[k + 1] - squares[k]) / high
        turn = 0.5 * (low + high) - 0.5 * (high - low) * (slope_before + slope_behind) / (slope_behind - slope_before)
        turn = turn if low < turn < high else 0.0
    slow_x, slow_y = circle * points[3, k], circle * points[4, k]
    for _ in range(FOOT_STEPS):
        if abs(pins * turn) <= SMALL_TURN:
            sx, sy = _rotate(slow_x, slow_y, turn)
            fx, fy = _rotate(points[1, k], points[2, k], pins * turn)
        else:
            c, s = np.cos(turn), np.sin(turn)
            sx, sy = slow_x * c - slow_y * s, slow_y * c + slow_x * s
            c, s = np.cos(pins * turn), np.sin(pins * turn)
            fx, fy = points[1, k] * c - points[2, k] * s, points[2, k] * c + points[1, k] * s
        slope, bend, length, x, y, dx, dy = _foot_terms(sx, sy, fx, fy, cx, cy, pins)
        if slope > 0.0:
            high = turn
        else:
            low = turn
        if abs(slope) <= FOOT_TOLERANCE * length or high - low <= FOOT_TOLERANCE:
            break
        turn -= slope / bend
        if not (bend > 0.0 and low < turn < high):
            turn = 0.5 * (low + high)
    root: float = np.sqrt(length)
    x, y = x - offset * dy / root, y + offset * dx / root
    distance: float = np.sqrt(x * x + y * y)
    return distance


@part
def _nearest_distance(first_point: int, last_point: int, valley: _Valley, cx: float, cy: float, squares: Real) -> float:
    """Smallest distance of c from a flank, points ``first_point`` to ``last_point``; every minimum refined."""
    points, circle, offset, _ = valley
    for k in range(first_point, last_point + 1):
        x = cx - circle * points[3, k] + points[1, k] - offset * points[5, k]
        y = cy - circle * points[4, k] + points[2, k] - offset * points[6, k]
        squares[k] = x * x + y * y
    smallest_distance: float = np.sqrt(min(squares[first_point], squares[last_point]))
    for k in range(first_point, last_point + 1):
        if (k == first_point or squares[k] <= squares[k - 1]) and (k == last_point or squares[k] <= squares[k + 1]):
            refined_distance = _refined_distance(k, first_point, last_point, valley, cx, cy, squares)
            smallest_distance = min(smallest_distance, refined_distance)
    return smallest_distance


@entry
def pin_distances(
    table: Real,
    points: Real,
    eccentric: complex,
    profile: tuple[int, float, float],
    shares: tuple[float, float],
    lobe: Real,
    lobe_numbers: tuple[Index, Index, Index],
    radial: Real,
    tangential: Real,
    eccentricity: Real,
    rotation: Real,
) -> Real:
    """Distances (n, n_pins) of the pins' centres from the flanks [mm]; see ``clearance.exact_gaps``.

    ``profile``: pins, radius of their circle, radius of a pin; ``shares``: what a lobe's error takes off the circle and
    adds to the offset of its flank; ``rotation``: of each lobe about the disk's axis [rad], which is the pin about it
    the other way; ``lobe_numbers``: of the lobe of each pin, and of the two beside its root.
    """
    pins, pin_circle, pin_radius = profile
    met_lobe, lobe_before, lobe_behind = lobe_numbers
    n, n_pins = radial.shape
    last_point = points.shape[1] - 1
    sx, sy, cx, cy = np.empty(n_pins), np.empty(n_pins), np.empty(n_pins), np.empty(n_pins)
    ox, oy, offset = np.empty(n_pins), np.empty(n_pins), np.empty(n_pins)
    limit, turn = np.empty(n_pins), np.empty(n_pins)
    squares = np.empty(last_point + 1)
    distance = np.empty((n, n_pins))
    for s in range(n):
        for i in range(n_pins):
            circle = pin_circle - shares[0] * lobe[s, met_lobe[i]]
            sx[i], sy[i] = circle * table[0, i], circle * table[1, i]
            offset[i] = pin_radius + shares[1] * lobe[s, met_lobe[i]]
            step = (shares[0] + shares[1]) * abs(lobe[s, lobe_before[i]] - lobe[s, lobe_behind[i]])
            step += pin_circle * abs(rotation[s, lobe_before[i]] - rotation[s, lobe_behind[i]])
            limit[i] = min(table[10, i], 0.5 * (table[11, i] - step))
            shift, lateral = radial[s, i], tangential[s, i]
            cx[i] = table[4, i] + table[6, i] * shift - table[7, i] * lateral - eccentricity[s] * eccentric.real
            cy[i] = table[5, i] + table[7, i] * shift + table[6, i] * lateral - eccentricity[s] * eccentric.imag
            ox[i], oy[i] = _rotate(cx[i], cy[i], -rotation[s, met_lobe[i]])
        _single_distances(
            sx, sy, table[2], table[3], ox, oy, offset, limit=limit, pins=pins, turn=turn, distance=distance[s]
        )
        for i in range(n_pins):
            if distance[s, i] >= 0.0:
                continue
            x = cx[i] * table[8, i] + cy[i] * table[9, i]
            y = cy[i] * table[8, i] - cx[i] * table[9, i]
            distance[s, i] = np.inf
            for neighbour, start, end in (
                (lobe_before[i], last_point // 2, last_point),
                (lobe_behind[i], 0, last_point // 2),
            ):
                error = lobe[s, neighbour]
                valley = (points, pin_circle - shares[0] * error, pin_radius + shares[1] * error, pins)
                px, py = _rotate(x, y, -rotation[s, neighbour])
                distance[s, i] = min(distance[s, i], _nearest_distance(start, end, valley, px, py, squares))
    return distance
