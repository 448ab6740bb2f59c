"""What a calibrated number of a design may plausibly be: its stated range, or that of its kind."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.config.designs.design import Design
from pipeline.config.files.section import number_at

DIMENSION = 1.05
"""Factor within which a length lies: also where it stands for a part that is not drawn, nobody builds it 5 % off."""
STIFFNESS = 3.0
"""Factor of a stiffness that was not measured: preload, fit and seat make as much of a bearing's catalogue value."""
METAL_MODULUS, OTHER_MODULUS = 1.1, 1.6
"""Factor of Young's modulus: alloys of a metal differ by some per cent (steel 190 to 215 GPa), polymers by fillers,
moisture and printing."""
METAL_MPA = 40e3
"""Young's modulus above which a material is a metal: magnesium has 45 GPa, filled polymers less than 30."""
FORCE_LAW = 1.65
"""Factor of the deflection of a contact: Hertz' and Palmgren's laws differ by up to a third on the flank."""


@dataclass(frozen=True)
class PlausibleRange:
    """Factors of the declared number between which it is plausible, and why."""

    low: float
    high: float
    reason: str

    @property
    def log(self) -> tuple[float, float]:
        """Logarithms of the factors."""
        return float(np.log(self.low)), float(np.log(self.high))


LAWS = PlausibleRange(1 / FORCE_LAW, FORCE_LAW, "contact laws differ by as much")


def plausible_range(design: Design, key: str) -> PlausibleRange:
    """Range of the number at a dotted key of the design."""
    value, provenance = number_at(design, key), design.provenance.get(key)
    if provenance is not None and provenance.plausible is not None:
        low, high = provenance.plausible
        return PlausibleRange(low / value, high / value, "stated with the number")
    if key.endswith("youngs_modulus_MPa"):
        metal = value >= METAL_MPA
        factor, reason = (METAL_MODULUS, "metals") if metal else (OTHER_MODULUS, "polymers")
        return PlausibleRange(1 / factor, factor, f"modulus of {reason}")
    factor, reason = (DIMENSION, "dimension") if key.endswith("_mm") else (STIFFNESS, "stiffness that was not measured")
    return PlausibleRange(1 / factor, factor, reason)
