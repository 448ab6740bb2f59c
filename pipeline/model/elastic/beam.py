"""Deflection of a straight round pin or shaft that bends and shears between its supports, and of a thin ring.

Source: Timoshenko, Gere, Mechanics of Materials (unit loads: section 9.10 of the third edition); shear coefficient of
the round section by Cowper, J. Appl. Mech. 33 (1966) 335.
"""

import numpy as np

from pipeline.arrays import Complex, Real
from pipeline.model.contact.laws import Material

SHORTEST, LONGEST = 1.0, 10.0
"""Free length over diameter: below, the pin's root deforms more than the beam does (a cantilever's shear is 36 % of its
deflection there); above, its slope at the disk is no longer small against the disk's width."""
THICKEST = 0.25
"""Wall over mean radius: Roark's factors for shear and hoop force make two opposite loads go 10 % farther there."""
ORDERS = np.arange(2, 201)
"""Waves around the ring: its first ones deflect by 1/order^4, and 200 leave 1e-7 of a radial load's deflection."""


def _flexibility(length: float, bending: float, shear: float) -> Real:
    """Deflection and slope (2,) of a cantilever's end by a unit force and moment (2,) there."""
    flexibility = length**3 / (3 * bending) + length / shear
    return np.array([[flexibility, length**2 / (2 * bending)], [length**2 / (2 * bending), length / bending]])


def _cantilever_flexibility(load_distance: float, observed_distance: float, bending: float, shear: float) -> Real:
    """Deflection, slope (2,) of a cantilever at ``observed`` by a unit force and moment (2,) at ``load_distance``."""
    near_part: Real = _flexibility(min(load_distance, observed_distance), bending, shear)
    if observed_distance <= load_distance:  # the load beyond is its force and its moment here
        flexibility: Real = near_part @ np.array([[1.0, 0.0], [load_distance - observed_distance, 1.0]])
        return flexibility
    return np.array([[1.0, observed_distance - load_distance], [0.0, 1.0]]) @ near_part


def _section_stiffness(diameter: float, material: Material) -> tuple[float, float]:
    """Stiffness of a round section against bending [N mm2] and against shear [N]."""
    nu = material.poisson_ratio
    shear = material.youngs_modulus / (2 * (1 + nu)) * np.pi * diameter**2 / 4 * 6 * (1 + nu) / (7 + 6 * nu)
    return material.youngs_modulus * np.pi * diameter**4 / 64, shear


def pin_flexibility(planes: Real, diameter: float, material: Material, span: float | None) -> Real:
    """Deflection (n, n) [mm/N] at each of the ``planes`` by a unit force at each, alike in all directions.

    Parameters
    ----------
    planes : (n,) distances [mm] from the flange in which the pin is clamped.
    diameter : [mm]
    span : distance [mm] to a second flange that clamps its other end; None for a cantilever.
    """
    bending, shear = _section_stiffness(diameter, material)
    plane_positions = np.asarray(planes, float)
    free_flexibility = np.array(
        [[_cantilever_flexibility(b, a, bending, shear)[0, 0] for b in plane_positions] for a in plane_positions]
    )
    if span is None:
        return free_flexibility
    end: Real = np.array(
        [_cantilever_flexibility(b, span, bending, shear)[:, 0] for b in plane_positions]
    )  # what the clamp at the end takes back
    return free_flexibility - end @ np.linalg.solve(_flexibility(span, bending, shear), end.T)


def support_shares(planes: Real, span: float) -> Real:
    """Share (n, 2) of each of two supports in a force at each of the ``planes`` (n,) [mm] from the first of them."""
    second = np.asarray(planes, float) / span
    return np.stack([1 - second, second], axis=1)


def shaft_flexibility(planes: Real, span: float, diameter: float, material: Material) -> Real:
    """Deflection (n, n) [mm/N] at each of the ``planes`` of a shaft by a unit force at each, alike in all directions.

    Parameters
    ----------
    planes : (n,) distances [mm] from the first support; planes below 0 or beyond the span overhang.
    span : distance [mm] of the second support. Both hold the shaft's deflection and leave its slope free.
    diameter : [mm]

    Notes
    -----
    By unit loads: the integral of M M / bending stiffness + V V / shear stiffness over the moments M and shear forces V
    of two unit forces. Between supports and forces M is linear and V constant, so that Simpson's rule is exact.
    """
    bending, shear = _section_stiffness(diameter, material)
    position, shares = np.asarray(planes, float), support_shares(planes, span)
    joints = np.unique(np.concatenate([position, [0.0, span]]))
    start, end = joints[:-1], joints[1:]

    def moment(x: Real) -> Real:
        forces = ((0.0, shares[:, :1]), (span, shares[:, 1:]), (position[:, None], -1.0))
        return np.asarray(sum(size * np.maximum(x - place, 0.0) for place, size in forces))

    corners = [moment(start), moment(0.5 * (start + end)), moment(end)]
    bent = sum(weight * (values * (end - start)) @ values.T for weight, values in zip((1, 4, 1), corners, strict=True))
    slope = (corners[2] - corners[0]) / (end - start)
    return np.asarray(bent / (6 * bending) + (slope * (end - start)) @ slope.T / shear)


def ring_flexibility(
    place: Complex, direction: Complex, radii: tuple[float, float], width: float, modulus: float
) -> Real:
    """Displacement (n, n) [mm/N] of each loaded place along its direction by a unit force at each along its own.

    Parameters
    ----------
    place : (n,) complex [mm], of which the angle counts: the forces act on the inner radius.
    direction : (n,) complex unit vectors.
    radii : inner and outer one [mm].
    width : along the axis [mm].
    modulus : Young's modulus [MPa].

    Notes
    -----
    Timoshenko, Strength of Materials, part II (third edition), section 12; Roark's formulas for stress and strain has
    the same ring under single loads in its table of circular rings, with factors for thick ones.

    A wave V sin(n t) of the tangential displacement of the centre line, R from the axis, goes with n V cos(n t) inwards
    where the line keeps its length, and bends it by the energy pi E I n^2 (n^2 - 1)^2 V^2 / (2 R^3). A place z within
    the line moves around by 1 + (n^2 - 1) z/R times as much, since the section turns. Without waves a radial force
    widens the ring by R/(2 pi E A). Order 1 and a turn are motions of the ring as a whole, which are held.
    """
    inner, outer = radii
    centre, wall = 0.5 * (inner + outer), outer - inner
    outwards = place / np.abs(place)
    along = np.conj(outwards) * direction
    lever = 1 + (ORDERS**2 - 1) * 0.5 * wall / centre
    wave = outwards[:, None] ** ORDERS
    load = (along.imag[:, None] * lever - 1j * along.real[:, None] * ORDERS) * wave  # its parts: of cosine and sine
    energy = np.pi * modulus * width * wall**3 / 12 * (ORDERS * (ORDERS**2 - 1)) ** 2 / centre**3
    bent = np.real((load / energy) @ np.conj(load.T))
    hoop = np.multiply.outer(along.real, along.real) * centre / (2 * np.pi * modulus * width * wall)
    return np.asarray(bent + hoop)
