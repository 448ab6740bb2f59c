"""The largest t of several tests of the same normal data: rotations give its distribution for any correlation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # its statistics are slow to import: they are when they are called

from pipeline.arrays import Real

ROTATIONS = 200_000
"""Rotations that are drawn: a p of 2 % is known to 0.03 %."""
SEED = 2005
"""Of the rotations: equal data give an equal answer."""
SMALLEST_SQUARE = 1e-300
"""Sum of squares below which a test has no data."""


@dataclass(frozen=True)
class Family:
    """Tests of the means of the same rows.

    Attributes
    ----------
    shares : (n_tests,) of each test, |contrast| over the root of all of its squares: |t| is sqrt(freedom) times its
        ratio to the root of the rest.
    largest_t : (ROTATIONS,) the largest share of all tests of rows without an effect, ascending.
    freedom : degrees of freedom of the scatter.
    """

    shares: Real
    largest_t: Real
    freedom: int

    @property
    def p(self) -> Real:
        """Two-sided p of no effect (n_tests,), all tests counted: never more than n_tests times that of one."""
        below = np.searchsorted(self.largest_t, self.shares * (1 - 1e-12))
        return (1 + len(self.largest_t) - below) / (1 + len(self.largest_t))

    def level(self, chance: float) -> float:
        """Level of each two-sided test by itself at which any of them errs with ``chance``."""
        share = float(np.quantile(self.largest_t, 1 - chance))
        t = np.sqrt(self.freedom) * share / np.sqrt(max(1 - share**2, SMALLEST_SQUARE))
        return 2 * float(scipy.stats.t.sf(t, self.freedom))


def family(contrast: Real, residuals: Real, freedom: int) -> Family:
    """Tests of contrasts against the scatter of independent normal rows, of any covariance between the tests.

    Parameters
    ----------
    contrast : (n_tests,) of the variance of a row where there is no effect.
    residuals : (n_rows, n_tests) whose squares sum to ``freedom`` times that variance.

    Notes
    -----
    Without an effect, contrast and residuals are ``freedom`` + 1 independent rows of one normal distribution, and any
    rotation of them is as likely: given their sums of squares and products the distribution of the largest t holds no
    unknown (Langsrud, Rotation tests, Statistics and Computing 15 (2005) 53; single step of Westfall and Young,
    Resampling-Based Multiple Testing (1993)). A single test is the t test.
    """
    size = np.sqrt(np.maximum(contrast**2 + np.sum(residuals**2, axis=0), SMALLEST_SQUARE))
    _, values, directions = np.linalg.svd(residuals / size, full_matrices=False)
    rows = np.vstack([contrast / size, (values[:, None] * directions)[:freedom]])
    rng = np.random.default_rng(SEED)
    direction = rng.standard_normal((ROTATIONS, freedom + 1))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    largest_t = np.abs(direction[:, : len(rows)] @ rows).max(axis=1)
    return Family(np.abs(contrast) / size, np.sort(largest_t), freedom)
