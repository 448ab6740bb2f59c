"""What the ranking of pitches misses at a pitch, from what it misses at the solved pitches of the same unit.

The miss of a unit varies slowly: after a turn of the crank the same pins stand about the eccentric and meet the next
lobes, and a pitch on they stand one place farther. It is taken for a Gaussian process with a mean of each unit and two
parts: one whose correlation falls with the distance of two pitches around the crank, and with that in turns of the
crank, and one whose correlation falls with the distance of two lobes under the same pins, which comes from the disk.

Source
------
Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), sec. 2.2, 4.2 and 5.4; upper confidence bound:
Srinivas et al., IEEE Trans. Inf. Theory 58 (2012) 3250.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.arrays import Index, Real, Single, Truth
from pipeline.model.compiled import entry

CHOICES = {
    "pitch_length": (0.7, 1.2, 2.0, 3.5, 6.0),
    "turn_length": (0.5, 3.0, 10.0, 30.0, 100.0, 1000.0),
    "of_disk": (0.0, 0.1, 0.3, 0.6),
    "noise": (0.02, 0.1, 0.5, 2.0),
}
"""Of these that of the largest likelihood is taken: distances around the crank [pitches] and in turns of the crank,
the share of the disk, and the part that no other pitch shows over the variance of the rest."""
ASCENTS = 2
"""Times that each of them is chosen, the others as they were."""
WINDINGS = 8
"""Of the crank on both sides: at four pins and the longest length the next one adds 1e-4."""


@dataclass(frozen=True)
class Correlation:
    """Correlation of the misses at two pitches.

    Attributes
    ----------
    around_crank : (n_pins,) by the difference of their places around the crank, of both parts' variance the share.
    along : (n_pitches,) factor of it by the difference of their numbers.
    in_disk : (n_lobes,) by the difference of the directions of the eccentric in the disk, the other share.
    noise : variance of the part that no other pitch shows, over that of the rest.
    variance : of the misses of a unit, in the mean.
    """

    around_crank: Real
    along: Real
    in_disk: Real
    noise: float
    variance: float = 1.0

    @classmethod
    def from_lengths(
        cls, pins: int, lobes: int, pitch_length: float, turn_length: float, of_disk: float, noise: float
    ) -> "Correlation":
        """Matern's of the order 3/2 around the crank and in the disk, exponential along the turns."""
        steps = np.arange(pins * lobes)
        turns = np.minimum(steps, pins * lobes - steps) / pins
        around_crank, in_disk = (_wound(count, pitch_length) for count in (pins, lobes))
        return cls((1 - of_disk) * around_crank, np.exp(-turns / turn_length), of_disk * in_disk, noise)

    def matrix(self, first_pitches: Index, second_pitches: Index) -> Real:
        """Correlations of pitches that broadcast against each other, without the noise."""
        correlation: Real = self.of_distance[np.abs(first_pitches - second_pitches)]
        return correlation

    @cached_property
    def of_distance(self) -> Real:
        """Correlations (n_pitches,) by the difference of the numbers of two pitches."""
        around_crank, in_disk = (np.resize(part, self.along.shape) for part in (self.around_crank, self.in_disk))
        return self.along * around_crank + in_disk


def _wound(count: int, length: float) -> Real:
    """Matern's correlation (count,) of the order 3/2 by the distance on a circle, summed over its windings."""
    windings = count * np.arange(-WINDINGS, WINDINGS + 1)
    distance = np.sqrt(3) * np.abs(np.add.outer(np.arange(count), windings)) / length
    correlation: Real = np.sum((1 + distance) * np.exp(-distance), axis=1)
    return correlation / float(correlation[0])


def fitted_correlation(pins: int, lobes: int, pitches: Index, residuals: Real) -> Correlation:
    """The correlation of the largest likelihood.

    Parameters
    ----------
    residuals : (n_units, n_pitches) true metric less the ranking's at ``pitches``; units with missing ones are omitted.
    """
    rows = residuals[np.isfinite(residuals).all(axis=1)]
    rows = rows - rows.mean(axis=1, keepdims=True) if len(rows) else np.zeros((1, len(pitches)))
    spread = max(float(rows.std()), np.finfo(float).tiny)
    rows = rows / spread
    found = {name: values[len(values) // 2] for name, values in CHOICES.items()}
    for name, values in ASCENTS * list(CHOICES.items()):
        choices = [found | {name: value} for value in values]
        found = max(
            choices, key=lambda choice: _log_likelihood(Correlation.from_lengths(pins, lobes, **choice), pitches, rows)
        )
    return replace(Correlation.from_lengths(pins, lobes, **found), variance=spread**2)


def _log_likelihood(choice: Correlation, pitches: Index, rows: Real) -> float:
    """Of rows (n_units, n_pitches), their variance at its best; but for a constant."""
    matrix = choice.matrix(pitches[:, None], pitches) + choice.noise * np.eye(len(pitches))
    factor = np.linalg.cholesky(matrix)
    half = np.linalg.solve(factor, rows.T)
    variance = max(float(np.mean(half**2)), np.finfo(float).tiny)
    return float(-rows.size * np.log(variance) / 2 - len(rows) * np.sum(np.log(np.diag(factor))))


def upper_bounds(
    correlations: Sequence[Correlation],
    solved_pitches: Index,
    residuals: Real | Single,
    other_pitches: Index,
    predicted_values: Real | Single,
    spreads: float,
) -> Real:
    """Upper confidence bounds (n_metrics, n_units, n_others) of metrics at other pitches, larger ones being worse.

    Parameters
    ----------
    correlations : of each metric, which but for their variances are the first one's.
    solved_pitches : (n_units, n_solved) solved pitches of each unit; negative ones fill up a row.
    residuals : (n_metrics, n_units, n_solved) true metric less the ranking's there; where one is missing the pitch
        counts for nothing.
    other_pitches : (n_units, n_others)
    predicted_values : (n_metrics, n_units, n_others) the ranking's metrics there.
    spreads : standard deviations above what is expected, of this unit's misses or of those in training, the larger.

    Notes
    -----
    The mean's correlation is that with the nearest solved pitch alone, which is no smaller than the process' own and
    needs no further system.
    """
    bounds, others = np.array(predicted_values, float), np.ascontiguousarray(other_pitches, np.intp)
    is_known = np.ascontiguousarray((solved_pitches >= 0) & np.isfinite(residuals).all(axis=0))
    solved = np.ascontiguousarray(np.where(is_known, solved_pitches, 0), np.intp)
    known, number = is_known[..., None], np.maximum(is_known.sum(axis=1), 1)[:, None]
    missed = np.ascontiguousarray(np.where(known, np.moveaxis(residuals, 0, -1), 0.0), float)
    mean = missed.sum(axis=1) / number
    missed = np.where(known, missed - mean[:, None], 0.0)
    least_variances = np.array([correlation.variance for correlation in correlations])
    variance = known.any(axis=1) * np.maximum((missed**2).sum(axis=1) / number, least_variances)
    of_distance, noise = correlations[0].of_distance, correlations[0].noise
    matrix = np.where(known & is_known[:, None], correlations[0].matrix(solved[:, :, None], solved[:, None]), 0.0)
    matrix += np.where(is_known, noise, 1.0)[:, None] * np.eye(solved.shape[1])  # 1 for pitches without a result
    weights = np.linalg.solve(matrix, missed)
    _add_bounds((of_distance, noise), mean, spreads * np.sqrt(variance), weights, (is_known, solved), others, bounds)
    return bounds


@entry
def _add_bounds(
    correlation: tuple[Real, float],
    mean: Real,
    spread: Real,
    weights: Real,
    known_pitches: tuple[Truth, Index],
    other_pitches: Index,
    bounds: Real,
) -> None:
    """Add what the ranking misses at most to its metrics ``bounds`` at other pitches, see ``upper_bounds``."""
    (of_distance, noise), (is_known, solved_pitches) = correlation, known_pitches
    n_metrics = len(bounds)
    missed = np.empty(n_metrics)
    for s in range(solved_pitches.shape[0]):
        for i in range(bounds.shape[2]):
            nearest = 0.0
            for k in range(n_metrics):
                missed[k] = mean[s, k]
            for j in range(solved_pitches.shape[1]):
                if not is_known[s, j]:
                    continue
                along = of_distance[abs(other_pitches[s, i] - solved_pitches[s, j])]
                nearest = max(nearest, along)
                for k in range(n_metrics):
                    missed[k] += along * weights[s, j, k]
            share = np.sqrt(1.0 - nearest**2 / (1.0 + noise))
            for k in range(n_metrics):
                bounds[k, s, i] += missed[k] + share * spread[s, k]
