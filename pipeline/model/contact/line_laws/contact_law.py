"""What a law of the line contacts declares, and the library of all."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

from pipeline.model.contact.laws import ContactLaws, LineContact
from pipeline.model.registry import declarations

ENTRY_POINTS = "cycloid_contact_laws"
"""Group in which an installed package registers laws of its own."""


@dataclass(frozen=True, kw_only=True)
class ContactLaw:
    """A law delta(F) = a F - c F ln F + k F^m of the contacts of pins, output pins and rollers.

    Attributes
    ----------
    name : as the study file has it.
    title, source : as the report tells them.
    on_mesh : contacts, radius of their cylinders [mm] and half width of the loaded patch [mm] to laws: cylinders of
        the first material, whole, on a meshed body of the second, less what the mesh deflects under the patch.
    between_flats : the two contacts of each roller, radius [mm] of the rollers and depth [mm] of the flats to laws: a
        roller of the first materials between flats of the second ones, both deflections in series.
    """

    name: str
    title: str
    source: str
    on_mesh: Callable[[LineContact, float, float], ContactLaws]
    between_flats: Callable[[tuple[LineContact, LineContact], float, float], ContactLaws]


@cache
def library() -> Mapping[str, ContactLaw]:
    """All laws by name: the files beside this one and what packages register as ``ENTRY_POINTS``."""
    return declarations("pipeline.model.contact.line_laws", "LAW", ENTRY_POINTS)
