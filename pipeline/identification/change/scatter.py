"""How far mounting a drive again scatters what is estimated at its positions, and the change that this could hide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called
from numpy.typing import NDArray
from scipy.optimize import brentq

from pipeline.statistics.rotations import Family, family

Real = NDArray[np.float64]

POWER = 0.95
"""Chance with which a change of the detection limit is sure."""
LARGEST = 1e3
"""Non-centrality beyond which no power is sought."""


@dataclass(frozen=True)
class Scatter:
    """Scatter of the mean change over the positions.

    Attributes
    ----------
    error : (n_kinds,) standard error of the mean change.
    freedom : degrees of freedom that it is known with.
    interaction : (n_states n_positions, n_kinds) what mounting adds to each state at each position.
    positions : their number.
    """

    error: Real
    freedom: int
    interaction: Real
    positions: int

    def p(self, mean: Real) -> Real:
        """Two-sided p of no change (n_kinds,)."""
        return 2 * scipy.stats.t.sf(np.abs(mean) / self.error, self.freedom)

    def family(self, mean: Real) -> Family:
        """Tests of mean changes (n_kinds,), which share their positions."""
        return family(np.sqrt(self.positions / 2) * mean, self.interaction, self.freedom)

    def detectable(self, level: float) -> Real:
        """Size (n_kinds,) of a change that a two-sided test at ``level`` shows with the chance ``POWER``.

        By the noncentral t distribution, of the scatter as estimated: Cohen, Statistical Power Analysis (1988), ch. 2.
        """
        critical = float(scipy.stats.t.isf(level / 2, self.freedom))
        shift = brentq(lambda shift: scipy.stats.nct.sf(critical, self.freedom, shift) - POWER, critical / 2, LARGEST)
        return shift * self.error


def scatter(estimates: Real, other_states: Real) -> Scatter:
    """The scatter of changes from a first state.

    Parameters
    ----------
    estimates : (n_positions, n_kinds) change of the second state at each position.
    other_states : (n_others, n_positions, n_kinds) the same of further states of the drive, (0, n_positions, n_kinds)
        without any.

    Notes
    -----
    Every state has a level, every position a number of its own that all states share, and mounting adds to each: the
    interaction of a two-way layout (Scheffe, The Analysis of Variance (1959), ch. 4). The first state is its row of
    zeros, since what is subtracted is each position's own. With two states this is the variance of the differences.
    """
    table = np.concatenate([np.zeros_like(estimates)[None], estimates[None], other_states])
    interaction = table - table.mean(axis=1, keepdims=True)
    interaction = interaction - interaction.mean(axis=0)
    freedom = (table.shape[0] - 1) * (table.shape[1] - 1)
    variance = np.sum(interaction**2, axis=(0, 1)) / freedom
    error = np.maximum(np.sqrt(2 * variance / table.shape[1]), 1e-12)
    return Scatter(error, freedom, interaction.reshape(-1, table.shape[2]), table.shape[1])
