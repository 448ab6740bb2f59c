"""Manufacturing errors to the raw gaps of every contact at the nominal pose, before any take-up.

Gaps are (n_samples, n_contacts) [mm]; a negative gap is an interference (preload) and legal.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.model.compiled import entry, part
from pipeline.model.profile import Complex, CycloidProfile, Real, disk_rotation
from pipeline.model.reducer import OUTPUT, Reducer

DISK_READINGS = {"radial": 1.0, "radial_on_diameter": 0.5, "normal": 1.0}
"""What a disk profile error of 1 is at the flank: a shift of the pin circle that generates it (radial; half of
it if the error is a size on the diameter), or material taken off along the normal."""
ROLLER_READINGS = {"diameter": 1.0, "half_diameter": 0.5}
"""Gap per missing roller diameter: all of it, or the half on each side of a roller that lies centred."""

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
FOOT_TOLERANCE = 1e-10
"""Turn [rad] left at the foot point, to which the distance is second order: 1e-20 of a length."""
FOOT_ITERATIONS = 30
SMALL_TURN = 0.02
"""Angle [rad] up to which five terms of the series of sine and cosine are exact to the last bit."""


@dataclass(frozen=True)
class Errors:
    """Manufacturing errors of ``n`` samples [mm]; signs as in the study file.

    Attributes
    ----------
    pin_radial, pin_tangential, pin_radius : (n, n_pins); outward, counterclockwise, larger positive.
    lobe : (n, n_lobes) material off each lobe's flank, the uniform part included.
    eccentricity : (n,) larger positive.
    roller_diameter : (n, n_rollers) larger positive, in the order of the output contacts.
    """

    pin_radial: Real
    pin_tangential: Real
    pin_radius: Real
    lobe: Real
    eccentricity: Real
    roller_diameter: Real


def pin_lobes(profile: CycloidProfile, reducer: Reducer) -> tuple[np.ndarray, np.ndarray]:
    """The lobes on the two sides of the valley in which each pin lies, (n_pins,) each.

    The first has phases beta < 0 (counterclockwise of the root), the second beta > 0. Lobes are numbered
    clockwise, lobe 0 from the root at angle 0 of the disk frame.
    """
    valley = np.rint(-(reducer.pins.flank_parameter + reducer.pins.phase / profile.lobes) / profile.lobe_pitch)
    valley = valley.astype(np.int64)
    return (valley - 1) % profile.lobes, valley % profile.lobes


def first_order_gaps(profile: CycloidProfile, reducer: Reducer, errors: Errors, disk_reading: str) -> Real:
    """Gaps of the pins to first order in the errors, (n, n_pins) [mm].

    Notes
    -----
    -n.dA - ds + w + n.u de, with w the material off the flank. Fails at the roots, where the pin centre
    lies close to the evolute of the flank. Where a root separates unequal lobes the nearer flank counts.
    """
    pins = reducer.pins
    radial = pins.centre / np.abs(pins.centre)
    along = np.real(np.conj(pins.normal) * radial)
    across = np.real(np.conj(pins.normal) * 1j * radial)
    eccentric = np.real(np.conj(pins.normal) * np.exp(1j * reducer.crank))
    before, behind = pin_lobes(profile, reducer)
    at_root = np.isclose(pins.phase, 0.0, atol=1e-9)
    own = np.where(pins.phase < 0, before, behind)
    return _first_order_gaps(
        DISK_READINGS[disk_reading],
        errors.lobe,
        np.where(at_root, before, own),
        np.where(at_root, behind, own),
        np.ones(len(along)) if disk_reading == "normal" else -along,
        errors.pin_radial,
        along,
        errors.pin_tangential,
        across,
        errors.pin_radius,
        errors.eccentricity,
        eccentric,
    )


@entry
def _first_order_gaps(reading, lobe, one, other, off, radial, along, tangential, across, radius, eccentricity, eccentric):
    """See ``first_order_gaps``; lobes ``one`` and ``other`` of every pin, by which the nearer flank counts."""
    n, n_pins = radial.shape
    gap = np.empty((n, n_pins))
    for s in range(n):
        for i in range(n_pins):
            shared = reading * min(lobe[s, one[i]], lobe[s, other[i]]) * off[i]
            placed = shared - along[i] * radial[s, i] - across[i] * tangential[s, i]
            gap[s, i] = placed - radius[s, i] + eccentric[i] * eccentricity[s]
    return gap


@part
def _locus(psi, circle, eccentricity, pins):
    """Locus q and its first two derivatives by psi."""
    slow = circle * complex(np.cos(psi), np.sin(psi))
    fast = eccentricity * complex(np.cos(pins * psi), np.sin(pins * psi))
    return slow - fast, 1j * (slow - pins * fast), -(slow - pins * pins * fast)


@part
def _turned(x, y, angle):
    """The vector (x, y) turned by an angle up to ``SMALL_TURN``, to the last bit."""
    square = angle * angle
    cosine = 1.0 - square * (0.5 - square * (1.0 / 24.0))
    sine = angle * (1.0 - square * (1.0 / 6.0) * (1.0 - square * 0.05))
    return x * cosine - y * sine, y * cosine + x * sine


@part
def _distance(psi, centre, circle, offset, eccentricity, pins):
    """Distance of ``centre`` from the flank point at ``psi``."""
    q, dq, _ = _locus(psi, circle, eccentricity, pins)
    return abs(centre - q - offset * 1j * dq / abs(dq))


@part
def _single_distance(slow, fast, centre, offset, pins):
    """Distance of ``centre`` from the flank around a pin whose foot point is unique; negative if it moves too far.

    ``slow`` and ``fast`` are the two terms of the locus at the nominal foot, which Newton leaves by a small turn.
    Real numbers: products of complex ones are compiled with checks for infinities, at three times the cost.
    """
    turn = 0.0
    for _ in range(FOOT_ITERATIONS):
        sx, sy = _turned(slow.real, slow.imag, turn)
        fx, fy = _turned(fast.real, fast.imag, pins * turn)
        x, y = sx - fx - centre.real, sy - fy - centre.imag
        dx, dy = pins * fy - sy, sx - pins * fx
        slope, length = x * dx + y * dy, dx * dx + dy * dy
        bend = length + x * (pins * pins * fx - sx) + y * (pins * pins * fy - sy)
        if abs(slope) <= FOOT_TOLERANCE * length:  # second order in what is left of the turn
            return offset + (y * dx - x * dy) / np.sqrt(length)
        turn -= slope / bend
        if abs(pins * turn) > SMALL_TURN:
            return -1.0
    return -1.0


@part
def _foot(psi, low, high, centre, circle, eccentricity, pins):
    """Foot point of ``centre`` on the locus near ``psi``, held to [low, high]."""
    for _ in range(FOOT_ITERATIONS):
        q, dq, ddq = _locus(psi, circle, eccentricity, pins)
        away = q - centre
        slope = away.real * dq.real + away.imag * dq.imag
        length = dq.real * dq.real + dq.imag * dq.imag
        if abs(slope) <= FOOT_TOLERANCE * length:
            return psi
        bend = length + away.real * ddq.real + away.imag * ddq.imag
        step = -slope / bend if bend > 0 else -np.sign(slope) * 0.01 * (high - low)
        moved = min(max(psi + step, low), high)
        if abs(moved - psi) <= 1e-15:
            return moved
        psi = moved
    return psi


@part
def _nearest(first, last, valley, root, centre, circle, offset, eccentricity, pins):
    """Smallest distance of ``centre`` from a flank, every local minimum over the valley's points refined.

    ``valley`` (``_valley``) has its points ``first`` to ``last`` on this flank.
    """
    psi, fast, radial, normal = valley
    turned = centre * complex(np.cos(root), -np.sin(root))
    best = np.inf
    previous, here = np.inf, np.inf
    for k in range(first, last + 2):
        ahead = np.inf
        if k <= last:
            away = turned - circle * radial[k] - fast[k] - offset * normal[k]
            ahead = away.real * away.real + away.imag * away.imag
        if k > first and here <= previous and here <= ahead:
            near = k - 1
            low, high = psi[max(first, near - 1)], psi[min(last, near + 1)]
            foot = _foot(root + psi[near], root + low, root + high, centre, circle, eccentricity, pins)
            best = min(best, _distance(foot, centre, circle, offset, eccentricity, pins))
            if near in (first, last):
                best = min(best, _distance(root + psi[near], centre, circle, offset, eccentricity, pins))
        previous, here = here, ahead
    return best


@entry
def _exact_gaps(psi, root, valley, single, room, centre, radius, circle, offset, before, behind, eccentricity, pins):
    """Signed distances (n, n_pins); see ``exact_gaps``. circle, offset: (n, n_lobes)."""
    n, n_pins = centre.shape
    slow, fast = np.exp(1j * psi), eccentricity * np.exp(1j * pins * psi)
    last = len(valley[0]) - 1
    gaps = np.empty((n, n_pins))
    for s in range(n):
        for i in range(n_pins):
            own = before[i] if psi[i] > root[i] else behind[i]
            at = circle[s, own] * slow[i]
            nearest = -1.0
            moved = abs(centre[s, i] - at + fast[i])
            step = abs(circle[s, before[i]] - circle[s, behind[i]]) + abs(offset[s, before[i]] - offset[s, behind[i]])
            if moved <= single[i] and 2.0 * moved + step <= room[i]:
                nearest = _single_distance(at, fast[i], centre[s, i], offset[s, own], pins)
            if nearest < 0.0:
                nearest = min(
                    _nearest(
                        last // 2,
                        last,
                        valley,
                        root[i],
                        centre[s, i],
                        circle[s, before[i]],
                        offset[s, before[i]],
                        eccentricity,
                        pins,
                    ),
                    _nearest(
                        0,
                        last // 2,
                        valley,
                        root[i],
                        centre[s, i],
                        circle[s, behind[i]],
                        offset[s, behind[i]],
                        eccentricity,
                        pins,
                    ),
                )
            gaps[s, i] = nearest - radius[s, i]
    return gaps


def _valley(profile: CycloidProfile) -> tuple[Real, Complex, Complex, Complex]:
    """Points of a valley about its root at psi = 0, some way beyond its two tips, over which a pin on a tip may move.

    Returns psi, -fast term, radial direction, normal.
    """
    even = BEYOND_THE_TIP * np.linspace(-1, 1, 2 * VALLEY_SCAN + 1)
    psi = 0.5 * profile.lobe_pitch * even * np.abs(even)
    return psi, -profile.eccentricity * np.exp(1j * profile.pins * psi), np.exp(1j * psi), profile.normal(psi)


def _rooms(profile: CycloidProfile, phase: Real) -> tuple[Real, Real]:
    """How far a pin may move (n_pins,) before its foot is no longer the only one, and until the other flank is nearer.

    The first is the least gap over change of normal among the points of the valley that are no neighbours of the
    foot, and Newton's own limit; the second the least gap of the other side of the root.
    """
    psi, fast, radial, normal = _valley(profile)
    flank = profile.pin_circle_radius * radial + fast + profile.pin_radius * normal
    place = -phase / profile.lobes
    gap = np.abs(profile.locus(place)[:, None] - flank) - profile.pin_radius
    turned = np.abs(profile.normal(place)[:, None] - normal)
    least = np.min(gap / np.maximum(turned, OTHER_NORMAL), axis=1, where=turned > OTHER_NORMAL, initial=np.inf)
    room = np.min(gap, axis=1, where=psi * place[:, None] <= 0, initial=np.inf)
    return np.minimum(least, SINGLE_FOOT * np.abs(profile.locus_radius(phase))), room


def exact_gaps(profile: CycloidProfile, reducer: Reducer, errors: Errors, disk_reading: str) -> Real:
    """Signed distance of each actual pin from the actual flank, (n, n_pins) [mm].

    The foot point is searched over both flanks of the valley in which the pin lies, and over its tips; each lobe
    has the flank of its own error.

    Notes
    -----
    With ``radial`` readings a lobe's flank is generated by a pin circle smaller by its error, with
    ``normal`` it is the parallel of the nominal flank.
    """
    pins = reducer.pins
    radial = pins.centre / np.abs(pins.centre)
    moved = (
        pins.centre
        + radial * (errors.pin_radial + 1j * errors.pin_tangential)
        - (profile.eccentricity + errors.eccentricity[:, None]) * np.exp(1j * reducer.crank)
    )
    centre = moved * np.exp(-1j * disk_rotation(profile, reducer.crank))
    off = DISK_READINGS[disk_reading] * errors.lobe
    nominal = np.zeros_like(off)
    circle = profile.pin_circle_radius - (nominal if disk_reading == "normal" else off)
    offset = profile.pin_radius + (off if disk_reading == "normal" else nominal)
    before, behind = pin_lobes(profile, reducer)
    return _exact_gaps(
        pins.flank_parameter,
        pins.flank_parameter + pins.phase / profile.lobes,
        _valley(profile),
        *_rooms(profile, pins.phase),
        centre,
        profile.pin_radius + errors.pin_radius,
        circle,
        offset,
        before,
        behind,
        profile.eccentricity,
        profile.pins,
    )


def roller_gaps(errors: Errors, roller_reading: str) -> Real:
    """Gaps of the output rollers between their faces, (n, n_rollers) [mm]."""
    return -ROLLER_READINGS[roller_reading] * errors.roller_diameter


def gaps(
    profile: CycloidProfile,
    reducer: Reducer,
    errors: Errors,
    *,
    method: str,
    disk_reading: str,
    roller_reading: str,
) -> Real:
    """Raw gap of every contact, (n, n_contacts) [mm]; ``method`` is ``"exact"`` or ``"first_order"``."""
    of_pins = {"exact": exact_gaps, "first_order": first_order_gaps}[method]
    n_rollers = int(np.count_nonzero(reducer.contacts.kind == OUTPUT))
    if errors.roller_diameter.shape[1] != n_rollers:
        raise ValueError(f"{errors.roller_diameter.shape[1]} roller errors for {n_rollers} rollers")
    return np.hstack([of_pins(profile, reducer, errors, disk_reading), roller_gaps(errors, roller_reading)])
