"""What of a fitted model's misfit is expected at other cells: the discrepancy in the prediction.

Part of what a model misses is common to all positions of a drive and comes again at one that was not measured; the rest
is each position's own. The prediction adds what of the training residual is expected to come again.

Which share is common, several training positions tell. A single one does not, and nothing else known before the
measurement does: the share is uniform between 0 and 1 (Bayes' and Laplace's prior of an unknown share) and integrated
over, so that half of the smooth residual of a single position is carried over. With a true share c of the variance that
leaves 1.25 - c of it, the model alone 1, a replay of the residual 2 (1 - c): half is never worse than the worse of
these two, and better than both where c is between 0.25 and 0.75. Size and reach are integrated over too, uniform in
their logarithms.

Source: Kennedy and O'Hagan, J. R. Stat. Soc. B 63 (2001) 425, sec. 4; best linear unbiased prediction, Robinson,
Stat. Sci. 6 (1991) 15.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Real, Truth, Whole
from pipeline.constant_kinds import Fineness, Grid, Rounding
from pipeline.identification.selection.statements.discrepancy import REACHES, SIZES, averaged_cells, kernels
from pipeline.statistics.curve_scatter import dummies

Places = tuple[Real, Real, Whole]

SHARES: Grid = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Shares of the variance that all positions have in common: midpoints of five equal parts of their uniform prior."""
REACHES_TRIED: Fineness = 7
"""Steps of the logarithm of the reach: a factor of 1.8 each."""
SIZES_TRIED: Fineness = 25
"""The same of the size."""
NEGLIGIBLE: Rounding = 1e-6
"""Weight of a share and reach below which nothing of them is told at other cells."""


@dataclass(frozen=True)
class Expectation:
    """What is expected to be missed.

    Attributes
    ----------
    mean, deviation : (n_cells,) [arcmin] and its standard deviation, beside noise and the zero of the angle.
    common_share : of the variance of what is missed, common to all positions: mean of its posterior.
    """

    mean: Real
    deviation: Real
    common_share: float


def expected_misfit(
    torque: Real, sense: Real, position: Whole, residual: Real, sigma: Real, training: Truth
) -> Expectation:
    """What a model misses at every cell, by its residual at some.

    Parameters
    ----------
    torque, sense, position : (n_cells,) [N m]; +1 or -1; number.
    residual, sigma : (n_cells,) [arcmin] measured less fitted, and its noise; read at ``training`` cells alone.
    training : (n_cells,)
    """
    places, means, noise, _ = averaged_cells(
        torque[training],
        sense[training],
        position[training],
        residual[training],
        sigma[training],
        np.zeros((int(training.sum()), 0)),
    )
    places = places[0], places[1], np.unique(position[training])[places[2]]
    observations = _Seen(places, means / noise, noise, dummies(places[2]) / noise[:, None])
    cells, top = (torque, np.sign(sense), position), float(np.max(np.abs(torque[training])))
    grid = [(share, reach * top) for share in SHARES for reach in np.geomspace(*REACHES, REACHES_TRIED)]
    likelihood = np.array([observations.process(*numbers).likelihood for numbers in grid])
    weights = np.exp(likelihood - likelihood.max())
    weights /= weights.sum()
    mean, square = np.zeros((2, len(torque)))
    for numbers, weight in zip(grid, weights, strict=True):
        if weight.sum() > NEGLIGIBLE:  # found anew: all of them take the memory of as many matrices
            means_of_sizes, variance = observations.process(*numbers).prediction_at(cells)
            mean += means_of_sizes @ weight
            square += (variance + means_of_sizes**2) @ weight
    common_share = weights.reshape(len(SHARES), -1).sum(axis=1) @ np.array(SHARES)
    return Expectation(mean, np.sqrt(np.maximum(square - mean**2, 0.0)), float(common_share))


@dataclass(frozen=True)
class _Seen:
    """Places; what is missed there (n_places,) and columns of zeros (n_places, n_positions), both over their noise."""

    places: Places
    misfit: Real
    noise: Real
    zeros: Real

    def process(self, share: float, reach: float) -> "_Process":
        """Processes of a share and a reach [N m], of every size."""
        common, by_position = kernels(self.places, self.places, reach)
        correlation = (share * common + (1 - share) * by_position) / np.outer(self.noise, self.noise)
        roots, vectors = np.linalg.eigh(correlation)
        variance = np.median(self.noise) ** 2 * np.geomspace(SIZES[0], SIZES[-1], SIZES_TRIED) ** 2
        gain = 1 / (1 + np.maximum(roots, 0.0)[:, None] * variance)
        misfit, zeros = vectors.T @ self.misfit, vectors.T @ self.zeros
        information = (zeros.T * gain.T[:, None]) @ zeros  # (n_sizes, n_positions, n_positions)
        levels = np.linalg.solve(information, (zeros.T @ (gain * misfit[:, None])).T[:, :, None])[:, :, 0]
        centred_misfit = misfit[:, None] - zeros @ levels.T
        likelihood = 0.5 * (
            np.log(gain).sum(axis=0)
            - np.linalg.slogdet(information)[1]
            - np.sum(gain * misfit[:, None] * centred_misfit, axis=0)
        )
        return _Process(
            observations=self,
            share=share,
            reach=reach,
            vectors=vectors,
            variance=variance,
            gain=gain,
            centred_misfit=centred_misfit,
            likelihood=likelihood,
        )


@dataclass(frozen=True)
class _Process:
    """Processes of one share and reach, each column of another size.

    Attributes
    ----------
    vectors : (n_places, n_places) of the correlation at the places seen, over their noise.
    variance : (n_sizes,) [arcmin^2]
    gain : (n_places, n_sizes) inverse covariance.
    centred_misfit : (n_places, n_sizes) what is missed less the zeros.
    likelihood : (n_sizes,) restricted, its logarithm.
    """

    observations: _Seen
    share: float
    reach: float
    vectors: Real
    variance: Real
    gain: Real
    centred_misfit: Real
    likelihood: Real

    def prediction_at(self, cells: Places) -> tuple[Real, Real]:
        """Mean [arcmin] and variance [arcmin^2] at cells, each (n_cells, n_sizes)."""
        common, by_position = kernels(cells, self.observations.places, self.reach)
        to_cells = (self.share * common + (1 - self.share) * by_position) / self.observations.noise @ self.vectors
        known_variance = to_cells**2 @ (self.gain * self.variance**2)
        return to_cells @ (self.gain * self.centred_misfit * self.variance), np.maximum(
            self.variance - known_variance, 0.0
        )
