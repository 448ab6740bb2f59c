"""A rough rank of every pitch of an output turn by each metric, at a microsecond or two a pitch.

The gaps of all pitches are outer sums (``turn_gaps``), on which every contact has a spring of its own
(``turn_springs``); forces of the pins are linear in the gaps (``turn_forces``). Metrics are then taken to be linear in
the results, by least squares on solved pairs of units and pitches.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pipeline.arrays import Index, Real
from pipeline.populations.turn_forces import PinForces, fitted_slopes
from pipeline.populations.turn_gaps import SeparateGaps
from pipeline.populations.turn_residuals import Correlation, fitted_correlation
from pipeline.populations.turn_springs import Springs

WAVES = 4
"""Waves of the direction of the eccentric in the disk: two tell the paper's rigidity to R = 0.97, none to 0.37."""
SAME_METRIC = 1e-9
"""Of a value: metrics that differ by less at all pitches are the same."""
SPRING_FLOOR = 1e-12
"""Least compliance of a spring [mm/N]."""


@dataclass(frozen=True)
class Ranking:
    """What ranks the pitches of an output turn: springs, forces of the pins, and slopes of each metric.

    Attributes
    ----------
    names : metrics that are ranked.
    slopes : (1 + n_features + 2 WAVES, n_names), of 1, features of the springs, peak pressures and the `waves`.
    of_forces : of each sense (n_sources + n_closing, n_names), of what the forces follow from, and of themselves.
    correlations : metric -> correlation of what the ranking misses at two pitches of a unit.
    """

    springs: Springs
    forces: PinForces
    names: tuple[str, ...]
    slopes: Real
    of_forces: tuple[Real, Real]
    correlations: Mapping[str, Correlation]

    @classmethod
    def from_pairs(
        cls,
        springs: Springs,
        forces: PinForces,
        gaps: SeparateGaps,
        pitches: Index,
        metrics: Mapping[str, Real],
        jointly: bool,
    ) -> "Ranking":
        """By least squares on metrics (n, n_pitches) of units at some pitches; those that hardly exist are not ranked.

        Nor are those that are another one's, as the width of the loop is the backlash where nothing rubs.

        Parameters
        ----------
        gaps : of the units.
        jointly : whether the correlation is that of all metrics together.
        """
        n_sides = [len(first) - 1 + first.shape[1] for first in forces.first]
        none = tuple(np.zeros((side, 0)) for side in n_sides)
        turn = waves(pitches, gaps.of_lobes.shape[1])
        parts = [springs.features(gaps)[:, pitches], forces.peaks_and_sums(gaps, none)[0][:, pitches]]
        parts += [np.broadcast_to(turn, (*parts[0].shape[:2], turn.shape[1])), forces.at(gaps, pitches)]
        features = np.concatenate(parts, axis=2)
        is_known = {name: np.isfinite(values) for name, values in metrics.items()}
        names: tuple[str, ...] = ()
        for name, values in metrics.items():
            is_other = any(np.allclose(values, metrics[k], rtol=SAME_METRIC, atol=0, equal_nan=True) for k in names)
            if is_known[name].sum() > 2 * features.shape[2] and np.ptp(values[is_known[name]]) > 0 and not is_other:
                names += (name,)
        known = np.all([is_known[name] for name in names], axis=0) & np.isfinite(features).all(axis=2)
        values = np.stack([metrics[name] for name in names], axis=-1) if names else np.zeros((*known.shape, 0))
        slopes = fitted_slopes(features[known], values[known])
        missed = values - (features @ slopes[1:] + slopes[0])
        lengths = gaps.of_pins.shape[1], gaps.of_lobes.shape[1], pitches
        correlations = {name: fitted_correlation(*lengths, missed[..., k]) for k, name in enumerate(names)}
        if jointly and names:
            scale = np.sqrt([correlations[name].variance for name in names])
            joint = fitted_correlation(*lengths, np.concatenate(np.moveaxis(missed / scale, -1, 0)))
            correlations = {name: replace(joint, variance=one.variance) for name, one in correlations.items()}
        own, of_plus, of_minus = np.split(slopes, [len(slopes) - sum(n_sides), len(slopes) - n_sides[1]])
        return cls(springs, forces, names, own, (of_plus, of_minus), correlations)

    def predict_values(self, gaps: SeparateGaps) -> dict[str, Real]:
        """Metrics (n, n_pitches) of units."""
        features = self.springs.features(gaps)
        peaks, values = self.forces.peaks_and_sums(gaps, self.of_forces)
        turn = waves(np.arange(features.shape[1]), gaps.of_lobes.shape[1])
        split = np.cumsum([1, features.shape[2], peaks.shape[2]])
        constant, of_springs, of_peaks, of_waves = np.split(self.slopes, split)
        values += features @ of_springs + peaks @ of_peaks + (turn @ of_waves + constant)
        return dict(zip(self.names, np.moveaxis(values, -1, 0), strict=True))


def waves(pitches: Index, lobes: int) -> Real:
    """Cosines and sines (n_pitches, 2 WAVES) of the direction of the eccentric in the disk.

    Slides and holes stand otherwise to the eccentric after each pitch, and come back when the disk has gone on by all
    lobes.
    """
    angle = 2 * np.pi / lobes * np.multiply.outer(pitches % lobes, np.arange(1, WAVES + 1))
    return np.hstack([np.cos(angle), np.sin(angle)])


class SpringWork:
    """Springs (n_places,) that take the work of forces over deflections, from some states after others."""

    def __init__(self, n_places: int) -> None:
        self.work, self.square = np.zeros((2, n_places))

    def add(self, deflection: Real, force: Real) -> None:
        """Add states with deflections [mm] under forces [N] (..., n_places); those without a result are left out."""
        finite = np.all(np.isfinite(force) & np.isfinite(deflection), axis=-1)
        self.work += np.sum(force[finite] * deflection[finite], axis=0)
        self.square += np.sum(force[finite] ** 2, axis=0)

    @property
    def compliance(self) -> Real:
        """Compliance (n_places,) [mm/N]; of places that carry nothing in these states, that of all."""
        of_all = np.sum(self.work) / np.sum(self.square)
        compliance = np.divide(self.work, self.square, out=np.full_like(self.work, of_all), where=self.square > 0)
        return np.maximum(compliance, SPRING_FLOOR)
