"""A drive of play, a spring that softens, constant friction and friction in proportion to the load.

Friction keeps part of the torque: what the spring carries follows the torque T as a play operator of half-width
Tc + mu |T|, cell by cell in time (Visintin, Differential Models of Hysteresis (1994)). The angle is
b/2 sign(Tn) + c Tn + d Tn |Tn| of the carried Tn; b, c and d follow by linear least squares from all others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pipeline.model.compiled import entry

Real = NDArray[np.float64]
Whole = NDArray[np.int64]

CROSSING = 0.02
"""Share of the largest torque over which the play is crossed."""
AT_BOUND = 0.99
"""Share of a bound from which a fit stands there."""
LARGEST_FRICTION, LARGEST_SHARE, LARGEST_ZERO = 0.5, 0.5, 0.2
"""Bounds of the constant friction and of the torque's zero, in largest torques, and of the friction by the load."""
TERMS = ("play", "friction", "load_friction", "softening", "torque_zero")
"""What a drive may have beside its spring."""
WITHOUT_ZERO = frozenset(TERMS[:-1])
STARTS = ((0.02, 0.02), (0.1, 0.1))
"""Starts of the fit, in shares of the largest torque and angle: its misfit has several minima."""


@dataclass(frozen=True)
class TorqueCells:
    """Cells of torque in time order, from rest at each position's start.

    A cell is one torque, or several through which it went in time order, of as many rows each: its angle is their mean.

    Attributes
    ----------
    position : (n_cells,)
    group : (n_cells,) cells that share a zero of the angle.
    torque : (n_cells,) or (n_cells, n_parts) [N m].
    angle, sigma : (n_cells,) [arcmin].
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

    def terms_at_bound(self, top: float) -> frozenset[str]:
        """Terms that end at the largest value that a fit of torques up to ``top`` [N m] allows."""
        shares = {
            "friction": self.friction_Nm / (LARGEST_FRICTION * top),
            "load_friction": self.load_friction / LARGEST_SHARE,
            "torque_zero": abs(self.torque_zero_Nm) / (LARGEST_ZERO * top),
        }
        return frozenset(term for term, share in shares.items() if share >= AT_BOUND)

    def angle(self, torque: Real, position: Whole, top: float) -> Real:
        """Angle (n_cells,) [arcmin] without offsets along torques [N m] in time order, as those of ``TorqueCells``."""
        amounts = self.play_arcmin, self.compliance_arcmin_per_Nm, self.softening_arcmin_per_Nm2
        net_torque = torque - self.torque_zero_Nm
        return spring_columns(net_torque, position, self.friction_Nm, self.load_friction, top) @ np.array(amounts)


@entry
def carried_torque(torque: Real, position: Whole, friction: float, share: float) -> Real:
    """Torque (n_cells,) [N m] that the spring carries behind friction, from no torque at each position's start."""
    net, play_torque = np.empty(len(torque)), 0.0
    for k in range(len(torque)):
        load = torque[k]
        if k == 0 or position[k] != position[k - 1]:
            play_torque = 0.0
        half = max(friction + share * abs(load), 0.0)
        play_torque = min(max(play_torque, load - half), load + half)
        net[k] = play_torque
    return net


def spring_columns(torque: Real, position: Whole, friction: float, share: float, top: float) -> Real:
    """What play, compliance and softening are multiplied by (n_cells, 3), of torques as those of ``TorqueCells``."""
    parts = torque.reshape(len(torque), -1)
    n = parts.shape[1]
    net = carried_torque(np.ravel(parts), np.repeat(position, n), friction, share).reshape(-1, n)
    crossing = 0.5 * np.clip(net / (CROSSING * top), -1, 1)
    return np.stack([crossing, net, net * np.abs(net)], axis=-1).mean(axis=1)


def fit_play_and_friction(
    cells: TorqueCells, training: NDArray[np.bool_], terms: frozenset[str] = WITHOUT_ZERO
) -> PlayAndFriction:
    """Least squares over the ``training`` cells (n_cells,), each group with its own offset.

    Parameters
    ----------
    terms : of ``TERMS`` that are fitted; others are none. The spring always is.
    """
    dummies = (cells.group[:, None] == np.unique(cells.group)).astype(float)
    root = 1 / cells.sigma[training]
    angle = cells.angle[training] * root
    is_free = np.array([name in terms for name in ("friction", "load_friction", "torque_zero")])
    spring_free = np.array(["play" in terms, True, "softening" in terms])

    def physical(unknowns: Real) -> tuple[float, float, float]:
        friction, share, zero = _place_values(unknowns, is_free).tolist()
        return friction * cells.top, share, zero * cells.top

    def spring(unknowns: Real) -> tuple[Real, Real]:
        friction, share, zero = physical(unknowns)
        columns = spring_columns(cells.torque - zero, cells.position, friction, share, cells.top)
        design = np.column_stack([columns[:, spring_free], dummies])[training] * root[:, None]
        amounts, *_ = np.linalg.lstsq(design, angle, rcond=None)
        return np.asarray(amounts, float), np.asarray(design @ amounts - angle, float)

    low, high = np.array([0.0, 0.0, -LARGEST_ZERO]), np.array([LARGEST_FRICTION, LARGEST_SHARE, LARGEST_ZERO])
    best_values = np.empty(0)
    if is_free.any():
        fits = [
            least_squares(
                lambda position: spring(position)[1],
                np.array([*start, 0.0])[is_free],
                bounds=(low[is_free], high[is_free]),
                diff_step=1e-3,
            )
            for start in STARTS
        ]
        best_values = min(fits, key=lambda fit: fit.cost).x
    play, compliance, softening = _place_values(spring(best_values)[0][: spring_free.sum()], spring_free).tolist()
    return PlayAndFriction(play, compliance, softening, *physical(best_values))


def _place_values(values: Real, is_free: NDArray[np.bool_]) -> Real:
    """Values at their places, zeros elsewhere."""
    placed_values = np.zeros(len(is_free))
    placed_values[is_free] = values
    return placed_values
