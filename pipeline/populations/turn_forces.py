"""Forces of the pins over the turn, foretold from the gaps of a unit: linear, none pulls, and linear in these again.

Gaps are small against what bodies give way, so that most contacts that can carry do: forces are then nearly linear in
the gaps, and the forces of all pitches are outer sums as the gaps are. Where that foretells a pull there is none, and a
second layer tells what the other contacts carry instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Index, Real, Single
from pipeline.model.compiled import entry
from pipeline.populations.turn_gaps import SeparateGaps
from pipeline.populations.turn_springs import Springs

RIDGE = 1e-6
"""Of the variance of a feature, by which nearly equal ones share a slope."""


def fitted_slopes(features: Real, values: Real) -> Real:
    """Slopes (1 + n_features, n_values) by least squares on rows (n, n_features) and (n, n_values), of 1 first.

    Without rows they are 0.
    """
    if not len(features):
        return np.zeros((1 + features.shape[1], values.shape[1]))
    centre, scale = features.mean(axis=0), features.std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    design, mean = (features - centre) / scale, values.mean(axis=0)
    square = design.T @ design + RIDGE * len(design) * np.eye(len(scale))
    slopes = np.linalg.solve(square, design.T @ (values - mean)) / scale[:, None]
    return np.vstack([mean - centre @ slopes, slopes])


_Sums = tuple[Single, Single]
"""``_Sources.single_sums``."""


@entry
def _second_layer(first: _Sums, second: _Sums, slopes: Single, n_forces: int, peak: Real, sums: Real) -> None:
    """Fill the root of the largest of the first ``n_forces`` sums (n, n_pitches), and add the others to ``sums``.

    Forces of as many pitches as there are lobes are multiplied together: a library's product takes a third of the time.
    """
    (first_pins, first_lobes), (second_pins, second_lobes) = first, second
    n_pins, n_lobes, n_sums, none = first_pins.shape[1], first_lobes.shape[1], slopes.shape[1], np.float32(0.0)
    force, total = np.empty((n_lobes, slopes.shape[0]), np.float32), np.empty((n_lobes, n_sums), np.float32)
    for s in range(peak.shape[0]):
        for first_pitch in range(0, n_pins * n_lobes, n_lobes):
            for lobe in range(n_lobes):
                of_pin, of_lobe = first_pins[s, (first_pitch + lobe) % n_pins], first_lobes[s, lobe]
                for k in range(slopes.shape[0]):
                    linear = of_pin[k] + of_lobe[k]
                    force[lobe, k] = linear if linear > none else none
            np.dot(force, slopes, total)
            for lobe in range(n_lobes):
                pitch, largest, row = first_pitch + lobe, none, total[lobe]
                of_pin, of_lobe = second_pins[s, pitch % n_pins], second_lobes[s, lobe]
                for i in range(n_sums):
                    row[i] += of_pin[i] + of_lobe[i]
                for i in range(n_forces):
                    largest = row[i] if row[i] > largest else largest
                peak[s, pitch] = np.sqrt(largest)
                for i in range(n_forces, n_sums):
                    sums[s, pitch, i - n_forces] += row[i]


@dataclass(frozen=True)
class _Sources:
    """What forces in a sense are linear in: gaps of the pins that close, outer sums, and loads by the output.

    Attributes
    ----------
    of_pins : (n, n_pins, n_closing); of_lobes : (n, n_lobes, n_closing + n_loads).
    """

    of_pins: Real
    of_lobes: Real

    @classmethod
    def from_gaps(cls, springs: Springs, gaps: SeparateGaps, sense: int) -> _Sources:
        places, loads = springs.closing(sense), springs.output_loads(gaps, sense)
        return cls(gaps.of_pins[:, :, places], np.concatenate([gaps.of_lobes[:, :, places], loads], axis=2))

    def at(self, pitches: Index) -> Real:
        """Sources (n, n_pitches, n_sources) at some pitches."""
        values: Real = self.of_lobes[:, pitches % self.of_lobes.shape[1]].copy()
        values[..., : self.of_pins.shape[2]] += self.of_pins[:, pitches % self.of_pins.shape[1]]
        return values

    def single_sums(self, slopes: Real) -> tuple[Single, Single]:
        """Outer sums (n, n_pins, n_values) and (n, n_lobes, n_values) of slopes (1 + n_sources, n_values)."""
        of_pins = self.of_pins @ slopes[1 : 1 + self.of_pins.shape[2]]
        of_lobes = self.of_lobes @ slopes[1:] + slopes[0]
        return of_pins.astype(np.float32), of_lobes.astype(np.float32)


@dataclass(frozen=True)
class PinForces:
    """Forces of the pins that close in the senses + and -, under the highest torque.

    Attributes
    ----------
    springs : that tell which pins close, and what the output does.
    pressure : (n_places,) [MPa/N^0.5]
    first : of each sense (1 + n_sources, n_closing) force over the sources, of 1 first.
    second : of each sense (1 + n_sources + n_closing, n_closing) likewise over these and the forces above 0.
    """

    springs: Springs
    pressure: Real
    first: tuple[Real, ...]
    second: tuple[Real, ...]

    @classmethod
    def from_pairs(cls, springs: Springs, pressure: Real, gaps: SeparateGaps, pitches: Index, force: Real) -> PinForces:
        """By least squares on true forces (n, n_pitches, 2, n_places) [N]."""
        first, second = [], []
        for sense in range(2):
            sources = _Sources.from_gaps(springs, gaps, sense).at(pitches)
            true = force[:, :, sense, springs.closing(sense)]
            finite = np.isfinite(true).all(axis=2)
            sources, true = sources[finite], true[finite]
            first.append(fitted_slopes(sources, true))
            forces = np.maximum(sources @ first[-1][1:] + first[-1][0], 0.0)
            second.append(fitted_slopes(np.hstack([sources, forces]), true))
        return cls(springs, pressure, tuple(first), tuple(second))

    def at(self, gaps: SeparateGaps, pitches: Index) -> Real:
        """Sources and forces above 0 of both senses (n, n_pitches, n_all) at some pitches."""
        parts = []
        for sense, slopes in enumerate(self.first):
            sources = _Sources.from_gaps(self.springs, gaps, sense).at(pitches)
            parts += [sources, np.maximum(sources @ slopes[1:] + slopes[0], 0.0)]
        return np.concatenate(parts, axis=2)

    def peaks_and_sums(self, gaps: SeparateGaps, slopes: Sequence[Real]) -> tuple[Real, Real]:
        """Peak pressure at every pitch (n, n_pitches, 3) [MPa] in both senses and of both; and sums over what `at` has.

        Parameters
        ----------
        slopes : of each sense (n_sources + n_closing, n_values).
        """
        n, n_pitches = len(gaps.of_pins), gaps.of_pins.shape[1] * gaps.of_lobes.shape[1]
        peaks, sums = np.empty((3, n, n_pitches)), np.zeros((n, n_pitches, slopes[0].shape[1]))
        for sense, (first, second, of_values) in enumerate(zip(self.first, self.second, slopes, strict=True)):
            sources = _Sources.from_gaps(self.springs, gaps, sense)
            square = self.pressure[self.springs.closing(sense)] ** 2
            columns = np.hstack([second * square, np.vstack([np.zeros(of_values.shape[1]), of_values])])
            split = len(first)
            linear, of_forces = columns[:split], columns[split:]
            first_sums, second_sums = sources.single_sums(first), sources.single_sums(linear)
            _second_layer(first_sums, second_sums, of_forces.astype(np.float32), len(square), peaks[sense], sums)
        np.maximum(peaks[0], peaks[1], out=peaks[2])
        return np.moveaxis(peaks, 0, -1), sums
