"""Modulus of all elastic parts in each state of a drive."""

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from pipeline.arrays import Real
from pipeline.model.elements.element import Element


@dataclass(frozen=True)
class ElasticModulus(Element):
    """Modulus of all elastic parts and contacts over that of the drawing.

    Attributes
    ----------
    factor : (n,) in each state of the drive.
    of_bearing : whether the stiffness of the input bearing has the same factor.
    """

    factor: Real
    of_bearing: bool = False

    def some(self, states: NDArray[Any] | slice) -> "ElasticModulus":
        """The factors of some of the states (n,)."""
        return ElasticModulus(self.factor[states], self.of_bearing)
