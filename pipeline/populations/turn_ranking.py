"""A rough rank of every pitch of an output turn by each metric, at a microsecond or two a pitch.

The gaps of all pitches are outer sums (``turn_gaps``), on which every contact has a spring of its own
(``turn_springs``). Metrics are then taken to be linear in the results, by least squares on solved pairs of units and
pitches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.populations.turn_gaps import SeparateGaps
from pipeline.populations.turn_residuals import Correlation
from pipeline.populations.turn_springs import Springs

Real = NDArray[np.float64]

WAVES = 4
"""Waves of the direction of the eccentric in the disk: two tell the paper's rigidity to R = 0.97, none to 0.37."""
SPRING_FLOOR = 1e-12
"""Least compliance of a spring [mm/N]."""


@dataclass(frozen=True)
class Ranking:
    """What ranks the pitches of an output turn: springs at the places of the pins, and slopes of each metric.

    Attributes
    ----------
    slopes : metric -> (1 + n_features + 2 WAVES,), of 1, the features and the `waves`.
    correlations : metric -> correlation of what the ranking misses at two pitches of a unit.
    """

    springs: Springs
    slopes: Mapping[str, Real]
    correlations: Mapping[str, Correlation]

    def predict_metrics(self, gaps: SeparateGaps) -> dict[str, Real]:
        """Metrics (n, n_pitches) of units."""
        features = self.springs.features(gaps)
        turn = waves(np.arange(features.shape[1]), gaps.of_lobes.shape[1])
        split = 1 + features.shape[2]
        return {
            name: features @ slope[1:split] + (slope[0] + turn @ slope[split:]) for name, slope in self.slopes.items()
        }


def waves(pitches: NDArray[np.intp], lobes: int) -> Real:
    """Cosines and sines (n_pitches, 2 WAVES) of the direction of the eccentric in the disk.

    Slides and holes stand otherwise to the eccentric after each pitch, and come back when the disk has gone on by all
    lobes.
    """
    angle = 2 * np.pi / lobes * np.multiply.outer(pitches % lobes, np.arange(1, WAVES + 1))
    return np.hstack([np.cos(angle), np.sin(angle)])


def place_compliance(deflection: Real, force: Real) -> Real:
    """Compliance (n_places,) [mm/N] of springs that take the work of forces (n_states, n_places) [N] over deflections.

    Of places that carry nothing in these states, that of all.
    """
    finite = np.all(np.isfinite(force) & np.isfinite(deflection), axis=1)
    force, deflection = force[finite], deflection[finite]
    work: Real = np.sum(force * deflection, axis=0)
    square: Real = np.sum(force**2, axis=0)
    of_all = np.sum(work) / np.sum(square)
    compliance = np.divide(work, square, out=np.full_like(work, of_all), where=square > 0)
    return np.maximum(compliance, SPRING_FLOOR)


def fitted_slopes(features: Real, metrics: Mapping[str, Real]) -> dict[str, Real]:
    """Slopes (1 + n_features,) of each metric by least squares on pairs (n, n_features); none of a constant metric."""
    slopes = {}
    for name, values in metrics.items():
        finite = np.isfinite(values) & np.all(np.isfinite(features), axis=1)
        if np.count_nonzero(finite) <= 2 * features.shape[1] or np.ptp(values[finite]) == 0:
            continue
        centre, scale = features[finite].mean(axis=0), features[finite].std(axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        design = np.column_stack([np.ones(np.count_nonzero(finite)), (features[finite] - centre) / scale])
        slope = np.linalg.lstsq(design, values[finite], rcond=1e-10)[0]
        slopes[name] = np.append(slope[0] - np.sum(slope[1:] * centre / scale), slope[1:] / scale)
    return slopes
