"""What a law of the line contacts declares, and the library of all."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

from pipeline.model.contact.laws import ContactLaws, LineContact
from pipeline.registry import CONTACT_LAWS


@dataclass(frozen=True, kw_only=True)
class ContactLaw:
    """A law delta(F) = a F - c F ln F + k F^m of the contacts of pins, output pins and rollers.

    Attributes
    ----------
    name : as the study file has it.
    title, source : as the report tells them.
    on_mesh : contacts, radius of their cylinders [mm] and half width of the loaded patch [mm] to laws: cylinders of
        the first material, whole, on a meshed body of the second, less what the mesh deflects under the patch.
    on_solid : contacts and radius [mm] to laws: the same cylinders on a body of the second material that is rigid
        elsewhere, its own deflection counted down to the depth of a radius.
    between_flats : the two contacts of each roller, radius [mm] of the rollers and depth [mm] of the flats to laws: a
        roller of the first materials between flats of the second ones, both deflections in series.
    of_stiffness : stiffness [N/mm] to the law, of one that is stated in a study and not derived; else None.
    steel_alone : whether the law was fitted to steel bodies and holds for no other material.
    """

    name: str
    title: str
    source: str
    on_mesh: Callable[[LineContact, float, float], ContactLaws]
    on_solid: Callable[[LineContact, float], ContactLaws]
    between_flats: Callable[[tuple[LineContact, LineContact], float, float], ContactLaws]
    of_stiffness: Callable[[float], "ContactLaw"] | None = None
    steel_alone: bool = False


def law_of(name: str, stiffness: float | None) -> ContactLaw:
    """The law of a name, of a stated stiffness [N/mm] where it asks for one."""
    law = library()[name]
    return law if law.of_stiffness is None or stiffness is None else law.of_stiffness(stiffness)


@cache
def library() -> Mapping[str, ContactLaw]:
    """All laws by name: the files beside this one and what packages register."""
    return CONTACT_LAWS.declarations()
