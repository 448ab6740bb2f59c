"""The drive of a position, fitted to both of its states together, and the changes that explain their difference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pipeline.identification.change.kinds import Kind
from pipeline.identification.change.pairing import Pair
from pipeline.identification.generic.play_and_friction import TERMS, PlayAndFriction, TorqueCells, fitted

Real = NDArray[np.float64]

REACH = 2.0
"""Largest change that is looked for, in scales of its kind."""


@dataclass(frozen=True)
class JointModel:
    """The drive of one position, fitted to both states together, and the largest torque of both."""

    drive: PlayAndFriction
    pair: Pair
    top: float

    @classmethod
    def of(cls, pair: Pair) -> JointModel:
        """The fit of a position."""
        torque = np.concatenate([pair.before_followed, pair.followed])
        state = np.repeat([0, 1], [len(pair.before_angle), len(pair.angle)])
        angle, sigma = (
            np.concatenate([pair.before_angle, pair.angle]),
            np.concatenate([pair.before_sigma, pair.sigma]),
        )
        top = float(np.max(np.abs(torque)))
        cells = TorqueCells(state, state, torque, angle, sigma, top)
        return cls(fitted(cells, np.ones(len(torque), bool), frozenset(TERMS)), pair, top)

    def scale(self, kind: Kind) -> float:
        """Size of a change of a kind that is large."""
        span = float(np.ptp(self.pair.angle))
        return {"play": span, "friction": 0.5 * self.top, "compliance": 1.0, "torque_zero": 0.5 * self.top}[kind.name]

    def change(self, change: Mapping[Kind, float]) -> Real:
        """Difference (n_cells,) [arcmin] of the second state's curve that changes make."""
        drive = self.drive
        for kind, amount in change.items():
            drive = kind.put(drive, amount)
        no_group = np.zeros(len(self.pair.torque), np.int64)
        return drive.angle(self.pair.followed, no_group, self.top) - self.drive.angle(
            self.pair.followed, no_group, self.top
        )

    def error(self, change: Mapping[Kind, float]) -> float:
        """Rms (in noise) of what changes leave of the measured difference."""
        return float(np.sqrt(np.mean(self.pair.residual(self.change(change)) ** 2)))

    def estimated(self, kinds: Sequence[Kind], fixed_values: Mapping[Kind, float] | None = None) -> dict[Kind, float]:
        """Changes of these kinds that explain the measured difference best, beside ``fixed_values`` ones."""
        scales, fixed = [self.scale(kind) for kind in kinds], fixed_values or {}

        def changes(shares: Sequence[float]) -> dict[Kind, float]:
            return {**fixed, **{kind: x * size for kind, x, size in zip(kinds, shares, scales, strict=True)}}

        optimum = least_squares(
            lambda shares: self.pair.residual(self.change(changes(shares))),
            np.zeros(len(kinds)),
            bounds=(-REACH, REACH),
            diff_step=2e-3,
            x_scale=0.1,
            loss="soft_l1",
            f_scale=max(self.error(fixed), 1.0),
        )
        return changes(optimum.x.tolist())

    def mounted(self, kinds: Sequence[Kind], fixed_values: Mapping[Kind, float]) -> Mapping[Kind, float]:
        """A given change with what mounting changed beside it: these kinds, fitted to the position."""
        return self.estimated(kinds, fixed_values) if kinds else fixed_values
