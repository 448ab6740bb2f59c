"""A drive of play, a spring that softens, constant friction and friction in proportion to the load.

Friction keeps part of the torque: what the spring carries follows the torque T as a play operator of half-width
Tc + mu |T|, cell by cell in time (Visintin, Differential Models of Hysteresis (1994)). The angle is
b/2 sign(Tn) + c Tn + d Tn |Tn| of the carried Tn; b, c and d follow by linear least squares from all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pipeline.model.compiled import entry

Real = NDArray[np.float64]
Whole = NDArray[np.int64]

CROSSING = 0.02
"""Share of the largest torque over which the play is crossed."""
LARGEST_FRICTION, LARGEST_SHARE, LARGEST_ZERO = 0.5, 0.5, 0.2
"""Bounds of the constant friction and of the torque's zero, in largest torques, and of the friction by the load."""
STARTS = ((0.02, 0.02), (0.1, 0.1))
"""Starts of the fit, in shares of the largest torque and angle: its misfit has several minima."""


@dataclass(frozen=True)
class Cells:
    """Cells of torque in time order, from rest at each position's start.

    Attributes
    ----------
    position : (n_cells,)
    group : (n_cells,) cells that share a zero of the angle.
    torque, angle, sigma : (n_cells,) [N m], [arcmin], [arcmin].
    top : [N m] torque that play and bounds are scaled by.
    """

    position: Whole
    group: Whole
    torque: Real
    angle: Real
    sigma: Real
    top: float


@dataclass(frozen=True)
class PlayAndFriction:
    """Parameters of a drive.

    Attributes
    ----------
    play_arcmin : b, angle between the two senses without torque.
    compliance_arcmin_per_Nm, softening_arcmin_per_Nm2 : c and d.
    friction_Nm, load_friction : Tc and mu, referred to the output.
    torque_zero_Nm : reading without torque.
    """

    play_arcmin: float
    compliance_arcmin_per_Nm: float
    softening_arcmin_per_Nm2: float
    friction_Nm: float
    load_friction: float
    torque_zero_Nm: float = 0.0

    def angle(self, torque: Real, position: Whole, top: float) -> Real:
        """Angle (n_cells,) [arcmin] without offsets along torques (n_cells,) [N m] in time order."""
        net = carried(torque - self.torque_zero_Nm, position, self.friction_Nm, self.load_friction)
        amounts = self.play_arcmin, self.compliance_arcmin_per_Nm, self.softening_arcmin_per_Nm2
        return spring_columns(net, top) @ np.array(amounts)


@entry
def carried(torque: Real, position: Whole, friction: float, share: float) -> Real:
    """Torque (n_cells,) [N m] that the spring carries behind friction, from no torque at each position's start."""
    net, inside = np.empty(len(torque)), 0.0
    for k in range(len(torque)):
        load = torque[k]
        if k == 0 or position[k] != position[k - 1]:
            inside = 0.0
        half = max(friction + share * abs(load), 0.0)
        inside = min(max(inside, load - half), load + half)
        net[k] = inside
    return net


def spring_columns(net: Real, top: float) -> Real:
    """What play, compliance and softening are multiplied by (n_cells, 3)."""
    crossing = 0.5 * np.clip(net / (CROSSING * top), -1, 1)
    return np.column_stack([crossing, net, net * np.abs(net)])


def fitted(cells: Cells, training: NDArray[np.bool_], with_zero: bool = False) -> PlayAndFriction:
    """Least squares over the ``training`` cells (n_cells,), each group with its own offset.

    Parameters
    ----------
    with_zero : fit the zero of the torque too; else it is 0.
    """
    dummies = (cells.group[:, None] == np.unique(cells.group)).astype(float)
    root = 1 / cells.sigma[training]
    angle = cells.angle[training] * root

    def spring(unknowns: Sequence[float]) -> tuple[Real, Real]:
        friction, share, zero = _physical(unknowns, cells.top)
        columns = spring_columns(carried(cells.torque - zero, cells.position, friction, share), cells.top)
        design = np.column_stack([columns, dummies])[training] * root[:, None]
        amounts, *_ = np.linalg.lstsq(design, angle, rcond=None)
        return np.asarray(amounts, float), np.asarray(design @ amounts - angle, float)

    zero = ([-LARGEST_ZERO], [0.0], [LARGEST_ZERO]) if with_zero else ([], [], [])
    low, high = [0.0, 0.0, *zero[0]], [LARGEST_FRICTION, LARGEST_SHARE, *zero[2]]
    fits = [
        least_squares(lambda at: spring(at)[1], [*start, *zero[1]], bounds=(low, high), diff_step=1e-3)
        for start in STARTS
    ]
    best = min(fits, key=lambda fit: fit.cost).x.tolist()
    friction, share, torque_zero = _physical(best, cells.top)
    play, compliance, softening = spring(best)[0][:3].tolist()
    return PlayAndFriction(play, compliance, softening, friction, share, torque_zero)


def _physical(unknowns: Sequence[float], top: float) -> tuple[float, float, float]:
    """Constant friction [N m], friction by the load, zero of the torque [N m]."""
    friction, share, *zero = unknowns
    return friction * top, share, zero[0] * top if zero else 0.0
