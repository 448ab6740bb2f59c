"""A law's term of another form, as a stranger would write it."""

import numpy as np

from pipeline.model.contact.further_term import FurtherTerm


class Asperities(FurtherTerm):
    """Heights of asperities that fall off exponentially: s ln(1 + F/F0) (Greenwood and Williamson 1966)."""

    __slots__ = ()
    COLUMNS = {"height_mm": ("mm", "of the asperities"), "force_N": ("N", "that bends the law")}

    @staticmethod
    def form(numbers, force):
        return numbers[0] * np.log1p(force / numbers[1])

    @staticmethod
    def slope(numbers, force):
        return numbers[0] / (numbers[1] + force)

    @staticmethod
    def energy(numbers, force):
        return numbers[0] * ((numbers[1] + force) * np.log1p(force / numbers[1]) - force)
