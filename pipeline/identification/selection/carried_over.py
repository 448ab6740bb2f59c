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

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.selection.statements.discrepancy import REACHES, SIZES, averaged, kernels, offset_columns

Real = NDArray[np.float64]
Whole = NDArray[np.int64]
Truth = NDArray[np.bool_]
Places = tuple[Real, Real, Whole]

SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Shares of the variance that all positions have in common: midpoints of five equal parts of their uniform prior."""
REACHES_TRIED, SIZES_TRIED = 7, 25
"""Steps of the logarithms of reach and size: a factor of 1.8 each."""


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
    places, means, noise, _ = averaged(
        torque[training],
        sense[training],
        position[training],
        residual[training],
        sigma[training],
        np.zeros((int(training.sum()), 0)),
    )
    places = places[0], places[1], np.unique(position[training])[places[2]]
    seen = _Seen(places, means / noise, noise, offset_columns(places[2]) / noise[:, None])
    cells, top = (torque, np.sign(sense), position), float(np.max(np.abs(torque[training])))
    grid = [part for share in SHARES for part in seen.parts(share, top, cells)]
    likelihood = np.concatenate([part.likelihood for part in grid])
    weights = np.exp(likelihood - likelihood.max()).reshape(len(grid), -1)
    weights /= weights.sum()
    mean = sum(part.mean @ weight for part, weight in zip(grid, weights, strict=True))
    square = sum((part.variance + part.mean**2) @ weight for part, weight in zip(grid, weights, strict=True))
    common_share = weights.reshape(len(SHARES), -1).sum(axis=1) @ np.array(SHARES)
    return Expectation(mean, np.sqrt(np.maximum(square - mean**2, 0.0)), float(common_share))


@dataclass(frozen=True)
class _Part:
    """Processes of one share and reach, each column of another size.

    Attributes
    ----------
    likelihood : (n_sizes,) restricted, its logarithm.
    mean, variance : (n_cells, n_sizes) [arcmin], [arcmin^2]
    """

    likelihood: Real
    mean: Real
    variance: Real


@dataclass(frozen=True)
class _Seen:
    """Places; what is missed there (n_places,) and columns of zeros (n_places, n_positions), both over their noise."""

    places: Places
    missed: Real
    noise: Real
    zeros: Real

    def parts(self, share: float, top: float, cells: Places) -> Iterator[_Part]:
        """Processes of a share, for every reach and size; ``top``: largest torque [N m]."""
        variance = np.median(self.noise) ** 2 * np.geomspace(*SIZES, SIZES_TRIED) ** 2
        for reach in np.geomspace(*REACHES, REACHES_TRIED) * top:
            common, by_position = kernels(self.places, self.places, reach)
            correlation = (share * common + (1 - share) * by_position) / np.outer(self.noise, self.noise)
            roots, vectors = np.linalg.eigh(correlation)
            gain = 1 / (1 + np.maximum(roots, 0.0)[:, None] * variance)  # (n_places, n_sizes) inverse covariance
            missed, zeros = vectors.T @ self.missed, vectors.T @ self.zeros
            information = np.einsum("ip,is,iq->spq", zeros, gain, zeros)
            levels = np.linalg.solve(information, (zeros.T @ (gain * missed[:, None])).T[:, :, None])[:, :, 0]
            centred = missed[:, None] - zeros @ levels.T
            likelihood = 0.5 * (
                np.log(gain).sum(axis=0)
                - np.linalg.slogdet(information)[1]
                - np.sum(gain * missed[:, None] * centred, axis=0)
            )
            common, by_position = kernels(cells, self.places, reach)
            to_cells = (share * common + (1 - share) * by_position) / self.noise @ vectors
            known = to_cells**2 @ (gain * variance**2)
            yield _Part(likelihood, to_cells @ (gain * centred * variance), np.maximum(variance - known, 0.0))
