"""Whether the positions of a drive kept what is their own between two states: a new assembly shuffles it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from pipeline.constant_kinds import Fineness, Seed
from pipeline.identification.change.loops import Loop
from pipeline.identification.change.table import LoopTable
from pipeline.statistics.resampling import LEVEL

FEWEST_POSITIONS: Fineness = 4
"""Of which one pairing of all, 1 in 24, is rarer than 5 %; of three it is 1 in 6."""
MOST_EXACT: Fineness = 6
"""Positions up to which every pairing is tried."""
PAIRINGS: Fineness = 999
"""Random pairings of the positions in the test: p is no smaller than 1/1000."""
SEED: Seed = 12
"""Of the pairings: equal data give an equal page."""


@dataclass(frozen=True)
class Pattern:
    """The pairing of equal positions among all pairings of the positions of two states.

    Attributes
    ----------
    p : share of pairings that agree at least as well; NaN with fewer than `FEWEST_POSITIONS`.
    pairings : number of pairings that were tried.
    """

    p: float
    pairings: int

    @property
    def persists(self) -> bool:
        """Whether equal positions agree better than 95 % of all pairings."""
        return self.p <= LEVEL + 1e-12


def pattern(table: LoopTable, labels: Sequence[str]) -> Pattern:
    """The pattern over positions that the first two states of a table have, by their largest loops.

    Notes
    -----
    A permutation test: what all positions have in common is in every pairing alike (Good, Permutation, Parametric and
    Bootstrap Tests of Hypotheses (2005)). Of more than six positions a sample of the pairings is taken.
    """
    n, size = len(labels), table.numbers[-1].size
    loops_before, loops_after = (
        [
            table.loops[np.flatnonzero((table.state == state) & (np.array(table.label) == label))[0]][size]
            for label in labels
        ]
        for state in (0, 1)
    )
    if n < FEWEST_POSITIONS:
        return Pattern(float("nan"), 1)
    distance = np.array(  # of the second state at a position (row) from the first at another (column)
        [[_distance(loop_before, loop_after) for loop_before in loops_before] for loop_after in loops_after]
    )
    if n <= MOST_EXACT:
        permutations_tried = np.array(list(permutations(range(n))))
    else:
        rng = np.random.default_rng(SEED)
        permutations_tried = np.array([np.arange(n), *(rng.permutation(n) for _ in range(PAIRINGS))])
    sums = distance[np.arange(n), permutations_tried].sum(axis=1)
    return Pattern(float(np.mean(sums <= np.trace(distance) * (1 + 1e-12))), len(permutations_tried))


def _distance(loop_before: Loop, loop_after: Loop) -> float:
    """Mean square difference [arcmin^2] of two loops, its offset removed."""
    return float(
        np.var(np.concatenate([loop_after.rising - loop_before.rising, loop_after.falling - loop_before.falling]))
    )
