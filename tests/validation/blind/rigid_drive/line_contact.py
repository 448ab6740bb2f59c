"""Line contacts of steel cylinders after Palmgren, with a linear spring behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

APPROACH_MM, BY_FORCE, BY_LENGTH = 3.84e-5, 0.9, 0.8
"""Approach [mm] of a roller and a raceway of steel: 3.84e-5 Q^0.9 / L^0.8 with Q in N, L in mm; Palmgren, Ball and
Roller Bearing Engineering (1959)."""
INVERSION_STEPS = 60
"""Newton steps to a force at most; the approach is concave, so that they rise to it from below."""
SETTLED = 1e-14
"""Relative step at which a force is found."""


@dataclass(frozen=True)
class LineContact:
    """Approach ``interfaces`` times Palmgren's and ``compliance`` [mm/N] times the force, over ``length`` [mm].

    ``softness`` multiplies Palmgren's part.
    """

    length: float
    interfaces: int = 1
    compliance: float = 0.0

    @property
    def _scale(self) -> float:
        return self.interfaces * APPROACH_MM / self.length**BY_LENGTH

    def force(self, approach: Real) -> Real:
        """Forces (n,) [N] at approaches [mm]; none where bodies are apart."""
        penetration = np.maximum(approach, 0.0)
        force = (penetration / self._scale) ** (1 / BY_FORCE)
        if self.compliance == 0.0:
            return force
        force = np.minimum(force, penetration / self.compliance)
        for _ in range(INVERSION_STEPS):
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = self.compliance + BY_FORCE * self._scale * force ** (BY_FORCE - 1)
            deviation = penetration - self._scale * force**BY_FORCE - self.compliance * force
            step = np.where(force > 0, deviation / slope, 0.0)
            force = np.maximum(force + step, 0.1 * force)
            if np.all(np.abs(step) <= SETTLED * np.maximum(force, SETTLED)):
                break
        return force

    def stiffness(self, force: Real) -> Real:
        """Slopes (n,) [N/mm] of the force; none where there is no force."""
        with np.errstate(divide="ignore"):
            soft = self.compliance + BY_FORCE * self._scale * force ** (BY_FORCE - 1)
        return np.where(force > 0, 1 / soft, 0.0)

    def energy(self, force: Real) -> Real:
        """Elastic energy (n,) [N mm] under forces."""
        return BY_FORCE / (1 + BY_FORCE) * self._scale * force ** (1 + BY_FORCE) + 0.5 * self.compliance * force**2
