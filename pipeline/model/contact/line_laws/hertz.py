"""Hertz' line contact: every body's half space, cut off at the length that its part of the field ends at."""

import numpy as np

from pipeline.arrays import Real
from pipeline.model.contact.laws import (
    SHARE_OF_LIMIT,
    ContactLaws,
    LineContact,
    cylinder_share,
    flat_share,
    meshed_share,
)
from pipeline.model.contact.line_laws.contact_law import ContactLaw

HALF_WIDTH_LIMIT = 0.5
"""Largest half width over cylinder radius: 30 degrees of arc, where Hertz' parabola leaves the circle
by 7 % (Johnson 1985, 5.3)."""


def hertz_laws(contact: LineContact, shares: list[tuple[Real, Real]], smallest_radius: float) -> ContactLaws:
    """Laws of contacts in series whose deflections are ``shares``, bounded where Hertz ends.

    Parameters
    ----------
    smallest_radius : float
        Radius of the smaller cylinder [mm]; bounds the half width.
    """
    linear = np.sum([a for a, _ in shares], axis=0)
    logarithmic = np.sum([c for _, c in shares], axis=0)
    flat = np.exp(linear / logarithmic - 1)
    widest = (HALF_WIDTH_LIMIT * smallest_radius / np.exp(contact.log_half_width)) ** 2
    zeros = np.zeros_like(linear)
    return ContactLaws(
        linear=linear,
        logarithmic=logarithmic,
        power=zeros,
        exponent=np.ones_like(linear),
        force_limit=np.minimum(SHARE_OF_LIMIT * flat, widest),
        pressure=contact.pressure_factor,
    )


def _on_mesh(contact: LineContact, radius: float, patch_half_width: float) -> ContactLaws:
    shares = [
        cylinder_share(contact, contact.first_material, radius),
        meshed_share(contact, contact.second_material, patch_half_width),
    ]
    return hertz_laws(contact, shares, radius)


def _on_solid(contact: LineContact, radius: float) -> ContactLaws:
    shares = [
        cylinder_share(contact, contact.first_material, radius),
        flat_share(contact, contact.second_material, radius),
    ]
    return hertz_laws(contact, shares, radius)


def _between_flats(sides: tuple[LineContact, LineContact], radius: float, depth: float) -> ContactLaws:
    shares = []
    for side in sides:
        shares.append(cylinder_share(side, side.first_material, radius))
        shares.append(flat_share(side, side.second_material, depth))
    return hertz_laws(sides[0], shares, radius)


LAW = ContactLaw(
    name="hertz",
    title="line contact after Hertz",
    source="Johnson, Contact Mechanics, 1985",
    on_mesh=_on_mesh,
    on_solid=_on_solid,
    between_flats=_between_flats,
)
