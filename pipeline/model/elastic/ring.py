"""Bending of a thin ring in its plane under forces at places around it.

Source: Timoshenko, Strength of Materials, part II (third edition), section 12 (rings); Roark's formulas for stress and
strain, table of circular rings, has the same ring under single loads, with factors for thick ones.
"""

import numpy as np

from pipeline.arrays import Complex, Real

THICKEST = 0.25
"""Wall over mean radius: Roark's factors for shear and hoop force make two opposite loads go 10 % farther there."""
ORDERS = np.arange(2, 201)
"""Waves around the ring: its first ones deflect by 1/order^4, and 200 leave 1e-7 of a radial load's deflection."""


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
