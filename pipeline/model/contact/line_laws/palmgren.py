"""Palmgren's line contact of steel bodies, fitted to measured roller bearings."""

import numpy as np

from pipeline.errors import ModelError
from pipeline.model.contact.laws import SHARE_OF_LIMIT, ContactLaws, LineContact, mesh_compliance
from pipeline.model.contact.line_laws.contact_law import ContactLaw

PALMGREN_MM = 3.84e-5
"""Palmgren's line contact of steel bodies: approach [mm] = 3.84e-5 Q^0.9 / L^0.8, Q in N, L in mm."""
PALMGREN_FORCE_EXPONENT = 0.9
"""Of the force in Palmgren's approach of a line contact (Ball and Roller Bearing Engineering, 1959)."""
PALMGREN_LENGTH_EXPONENT = 0.8
"""Of the length in the same formula."""


def palmgren_laws(contact: LineContact, interfaces: int, held_by_mesh: float) -> ContactLaws:
    """Palmgren's laws of ``interfaces`` line contacts in series, less what the mesh holds already.

    Parameters
    ----------
    held_by_mesh : float
        Compliance [mm/N] of the meshed body between patch and the depth of the law (``mesh_compliance``);
        0 without a meshed body.

    Raises
    ------
    ValueError
        If the law would decrease below 1 N, so that nothing of it is left.
    """
    shape = contact.radius.shape
    power = interfaces * PALMGREN_MM / contact.length**PALMGREN_LENGTH_EXPONENT
    if held_by_mesh > 0:
        limit = (power * PALMGREN_FORCE_EXPONENT / held_by_mesh) ** (1 / (1 - PALMGREN_FORCE_EXPONENT))
        if limit < 1:
            raise ModelError(
                f"Palmgren's law decreases beyond {limit:.3g} N; the mesh holds more than the law's whole approach"
            )
    else:
        limit = np.inf
    return ContactLaws(
        linear=np.full(shape, -held_by_mesh),
        logarithmic=np.zeros(shape),
        power=np.full(shape, power),
        exponent=np.full(shape, PALMGREN_FORCE_EXPONENT),
        force_limit=np.full(shape, SHARE_OF_LIMIT * limit),
        pressure=contact.pressure_factor,
    )


def _on_mesh(contact: LineContact, radius: float, patch_half_width: float) -> ContactLaws:
    return palmgren_laws(contact, 1, mesh_compliance(contact.second_material, contact.length, radius, patch_half_width))


LAW = ContactLaw(
    name="palmgren",
    title="line contact after Palmgren",
    source="Ball and Roller Bearing Engineering, 1959",
    steel_alone=True,
    on_mesh=_on_mesh,
    on_solid=lambda contact, radius: palmgren_laws(contact, 1, 0.0),
    between_flats=lambda sides, radius, depth: palmgren_laws(sides[0], 2, 0.0),
)
