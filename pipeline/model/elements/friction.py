"""Friction of a drive: elastic-slip elements, and how it differs between the two senses of motion."""

from dataclasses import dataclass, replace

from pipeline.model.contact.friction_elements import Sliders
from pipeline.model.elements.element import Element


@dataclass(frozen=True)
class Friction(Element):
    """In parallel with the output or at the contacts.

    Attributes
    ----------
    sliders : elastic-slip elements; their resistance has its limits at T -> 0 in ``Sliders.limit``.
    lean : torque beyond the one carried, over it, that the turning end takes in either sense of motion: half of what
        friction in proportion to the load resists more with the load than against it.
    """

    sliders: Sliders
    lean: float = 0.0

    def at_drawing_modulus(self, factor: float) -> "Friction":
        """Friction that is to the modulus of the drawing as this is to one that is ``factor`` times as large."""
        sliders = self.sliders
        scaled = replace(sliders, limit=sliders.limit / factor, stiffness=sliders.stiffness / factor)
        return replace(self, sliders=scaled)
