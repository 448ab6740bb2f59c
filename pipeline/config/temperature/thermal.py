"""What parts do whose temperatures differ from unit to unit: growth beyond the mean, and modulus."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from pipeline.arrays import Real
from pipeline.config.files.section import Section

Number = TypeVar("Number", float, Real)
CHANGED_BY = {"pin_radial": "housing", "pin_radius": "pins", "eccentricity": "crank"}
"""Deviation of a unit and the part whose growth beyond the disk's changes it."""


class ThermalPart(Section):
    """A part at its mean temperature.

    Attributes
    ----------
    follows : the part whose temperature it has: its own name, or that of another whose draw it shares.
    size_um : length by whose growth a draw is told [um].
    expansion_per_K, slope_per_K : of its size and of its modulus, relative to those of the drawing.
    rise_K : its mean temperature less that of the drawing.
    """

    follows: str
    size_um: float
    expansion_per_K: float
    slope_per_K: float
    rise_K: float

    def growth_um(self, warmer: Number) -> Number:
        """Growth of the size [um] by a temperature above the mean [K]."""
        return self.size_um * self.expansion_per_K * warmer

    def factor(self, warmer: Number) -> Number:
        """Size over that on the drawing."""
        return 1 + self.expansion_per_K * (self.rise_K + warmer)

    def softening(self, warmer: Number) -> Number:
        """Modulus over that at the mean temperature."""
        return 1 + self.slope_per_K * warmer / (1 + self.slope_per_K * self.rise_K)


class Thermal(Section):
    """The four parts `disk`, `pins`, `housing` and `crank` of a design at mean temperatures.

    Attributes
    ----------
    drawn_parts : parts whose temperature is drawn.
    """

    drawn_parts: tuple[str, ...]
    parts: dict[str, ThermalPart]

    def warmer(self, growth_um: Mapping[str, Real]) -> dict[str, Real]:
        """Temperature of each part above its mean (n,) [K], by the growths (n,) [um] of those that are drawn."""
        zeros = np.zeros_like(next(iter(growth_um.values())))
        rises = {part: growth / self.parts[part].growth_um(1.0) for part, growth in growth_um.items()}
        return {name: rises.get(part.follows, zeros) for name, part in self.parts.items()}

    def shifts_um(self, growth_um: Mapping[str, Real]) -> dict[str, Real]:
        """What units (n,) deviate more from the reducer that has grown as their disk has [um], by deviation.

        Notes
        -----
        A reducer that grows by one factor in all lengths keeps its angles. So the disk's size is the unit of length,
        and the others grow by their factor over the disk's. That the tolerances themselves grow is left out: it is
        their size times the expansion.
        """
        warmer = self.warmer(growth_um)
        disk = self.parts["disk"]
        shifts = {}
        for deviation, name in CHANGED_BY.items():
            part = self.parts[name]
            ratio = part.factor(warmer[name]) / disk.factor(warmer["disk"])
            shifts[deviation] = part.size_um * (ratio - part.factor(0.0) / disk.factor(0.0))
        return shifts

    def modulus(self, growth_um: Mapping[str, Real]) -> Real:
        """Torque (n,) that turns the reducer as far as a torque of 1 does at mean temperatures.

        Notes
        -----
        By similarity: in the disk's unit of length forces grow with the modulus and the square of its factor of
        growth, and their arms with the factor itself. All elastic parts soften as the disk does.
        """
        disk, warmer = self.parts["disk"], self.warmer(growth_um)["disk"]
        return np.asarray(disk.softening(warmer) * (disk.factor(warmer) / disk.factor(0.0)) ** 3)
