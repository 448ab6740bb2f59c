"""Where the fit of a ripple starts: its number of waves and its phases, found among many.

The phase of a ripple bends with the angle, so that derivatives lead to the nearest period alone. Many numbers of waves
are therefore looked at, at each position with the best of some phases, and the best of them are fitted on.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np
from scipy.special import chdtrc, chdtri

from pipeline.arrays import Real
from pipeline.constant_kinds import Shortcut, ShortcutCount, ShortcutGrid
from pipeline.identification.bench.instrument_effects import InstrumentEffect
from pipeline.identification.fitting.least_squares import Descent
from pipeline.identification.fitting.parameters import Vector, values_at_shares
from pipeline.identification.fitting.problem import Candidate, Model
from pipeline.model.units import ARCMIN

if TYPE_CHECKING:
    from pipeline.identification.selection.screening import Screening

WAVE_STEP: Shortcut = 0.75
"""Periods that are looked at: steps of their number over the range of the angle."""
WAVE_PHASES: ShortcutCount = 5
"""Phases of each."""
SIZES: ShortcutGrid = (0.09, 0.13, 0.18, 0.25, 0.35, 0.5, 0.75, 1.0, 1.3, 1.6, 2.0)
"""Sizes of a ripple that are tried, as multiples of the one that would explain the residual by the slope of the curve.
That one is too large if the model without effects is far off."""
COARSER: ShortcutCount = 5
"""Every fifth period is tried with all sizes; then all periods are tried with the best size and its two neighbours."""
FAINT: Shortcut = 15.0
"""Fall of the sum of squares by the best small ripple at one position below which no full search is made. With noise
alone the best of 75 periods exceeds it in a tenth of the units. For several positions, each with its own phase, the
fall that noise exceeds as often is used."""
PERIODS: ShortcutCount = 6
"""The best periods, which are fitted on."""
FOLLOWED: ShortcutCount = 3
"""Of these, the number that is fitted further after one step."""


def ripple_starts(screening: "Screening", effect: Candidate) -> list[tuple[float, Vector]]:
    """Starts of a ripple with their sums of squares."""
    search = _Search(screening, effect)
    falls = [search.small_ripple(wave)[0] for wave in search.waves]
    n_columns = 2 * len(screening.positions) + 1
    if max(falls) < chdtri(n_columns, chdtrc(3, FAINT)):
        best_wave = int(np.argmax(falls))
        wave = search.waves[best_wave]
        fall, size, phases = search.small_ripple(wave)
        return [(max(screening.base_misfit - fall, 1e-300), search.start(wave, size, phases))]
    return search.fitted_starts()


class _Search:
    """The search for a ripple beside the base of a screening.

    Attributes
    ----------
    waves : (n_waves,) waves per turn of the output that are looked at.
    """

    def __init__(self, screening: "Screening", effect: Candidate):
        self.screening, self.effect = screening, effect
        self.fitter, self.base, self.positions = screening.fitter, screening.base.unknowns, screening.positions
        self.bounds = self.fitter.problem.bounds(effect)
        self.model = Model((*screening.base.model.effects, effect))
        self.slope = self.fitter.slopes(screening.base)
        self.waves = np.arange(*self.bounds[2], WAVE_STEP * 2 * np.pi * ARCMIN / self.fitter.problem.span)

    def small_ripple(self, wave: float) -> tuple[float, float, dict[int, float]]:
        """Fall of the sum of squares by a small ripple of some waves, its size [N m], and its phase [rad] by position.

        To first order a ripple moves the angle by the slope [arcmin/(N m)] of the curve, at each position with its own
        phase; a larger one opens the loop too, as constant friction does.
        """
        screening, data = self.screening, self.fitter.problem.data
        goal = screening.unfollowed_part(screening.residual_left)
        angle = data.angle - screening.base.predicted_angle + screening.base_angle
        phase = wave * angle / ARCMIN
        columns = [
            np.where(data.position == position, self.slope * shape, 0.0)
            for position in self.positions
            for shape in (np.cos(phase), np.sin(phase))
        ]
        scaled_columns = map(screening.scaled_residuals, [*columns, self.slope * data.senses])
        changes = np.column_stack([screening.unfollowed_part(column) for column in scaled_columns])
        amounts = np.asarray(np.linalg.lstsq(changes, goal, rcond=None)[0], float)
        cosine, sine = amounts[:-1].reshape(-1, 2).T
        phases = dict(zip(self.positions, np.arctan2(cosine, sine).tolist(), strict=True))
        return float(goal @ changes @ amounts), float(np.sqrt(np.mean(cosine**2 + sine**2))), phases

    def fitted_starts(self) -> list[tuple[float, Vector]]:
        """The best periods, after a few steps of a fit of each.

        A first size follows from the residual and the slope of the curve. The width of the loop shows the size better,
        whatever the period. The right period is clearly the best only at about the right size.
        """
        screening = self.screening
        probes = self._probes()
        misfit = np.array([np.inf, *(one for one, _ in probes), np.inf])
        is_minimum = (misfit[1:-1] <= misfit[:-2]) & (misfit[1:-1] < misfit[2:])
        minima = [probe for probe, minimum in zip(probes, is_minimum, strict=True) if minimum]
        starts = [start for _, start in sorted(minima, key=lambda probe: probe[0])[:PERIODS]]
        as_fitted = np.array([self.base.scales] * 2)  # with a ripple each derivative by them is many predictions
        starts = [replace(start, reach=as_fitted) for start in starts]
        descents = [Descent(self.fitter, self.model, screening.cells, start, screening.base) for start in starts]
        descents = [descent for descent in descents if np.isfinite(descent.cost)]
        for steps, count in ((1, PERIODS), (2, FOLLOWED)):
            descents = sorted(descents, key=lambda descent: descent.in_noise)[:count]
            for descent in descents:
                descent.run(steps)
        unknowns = [
            replace(descent.unknowns, reach=self.base.reach) for descent in descents if descent.prediction.sound
        ]
        return [(screening.misfit_at(self.model, one), one) for one in unknowns]

    def _probes(self) -> list[tuple[float, Vector]]:
        """Misfit and start of each number of waves, with its best phases, at the size that the first position asks."""
        screening, first = self.screening, self.positions[:1]
        residual = self.fitter.problem.data.angle - screening.base.predicted_angle
        asked_square = np.sum(screening.weight * residual**2) / np.sum(screening.weight * self.slope**2)
        sizes = np.sqrt(2 * asked_square) * np.array(SIZES)
        misfits = {position: self._misfit_of(position) for position in self.positions}

        def probe(size: float, wave: float, count: int, positions: Sequence[int]) -> tuple[float, Vector]:
            best_phases, total = {first[0]: 0.0}, 0.0
            for position in positions:
                misfit, best_phases[position] = min(
                    (misfits[position](self.start(wave, size, {first[0]: 0.0, position: phase})), phase)
                    for phase in 2 * np.pi * np.arange(count) / count
                )
                total += misfit
            return total, self.start(wave, size, best_phases)

        def best_size(sizes: Real, waves: Real, count: int) -> int:
            return int(np.argmin([min(probe(size, wave, count, first)[0] for wave in waves) for size in sizes]))

        near = sizes[max(best_size(sizes, self.waves[::COARSER], 2) - 1, 0) :][:3]
        size = near[best_size(near, self.waves, WAVE_PHASES)]
        return [probe(size, wave, WAVE_PHASES, self.positions) for wave in self.waves]

    def start(self, wave: float, size: float, phases: dict[int, float]) -> Vector:
        """Start with a ripple of some size [N m] and phases [rad] at positions; at others it is as at the first."""
        low, high = np.array(self.bounds).T
        values, first = 0.5 * (low + high), self.positions[0]
        middle = np.append(0.0, values[3:])
        reference = phases[first] - (middle[first] if first < len(middle) else 0.0)
        values[:3] = size * np.sin(reference), size * np.cos(reference), wave
        for position in range(1, len(middle)):
            turned = phases.get(position, phases[first]) - reference - middle[position]
            values[2 + position] += (turned + np.pi) % (2 * np.pi) - np.pi
        shares = np.clip((values - low) / (high - low), 0.0, 1.0)
        return replace(self.base, shares=np.concatenate([self.base.shares, shares]))

    def _misfit_of(self, position: int) -> Callable[[Vector], float]:
        """As ``Screening.misfit_at`` over one position: drive and backbone are made once."""
        fitter, data = self.fitter, self.fitter.problem.data
        of_position = data.position == position
        screening = self.screening.of_cells(of_position)
        drives, instrument = fitter.drives(screening.base.model, self.base, [position])
        forward = fitter.forward(screening.base.model)
        prior_residuals = screening.prior_residuals(self.base.flat)

        def misfit(start: Vector) -> float:
            values = values_at_shares(self.bounds, start.shares[len(self.base.shares) :]).tolist()
            with_ripple = cast(InstrumentEffect, self.effect).apply(instrument, values)
            reading, angle = forward.read(drives[position], position, with_ripple), np.full(len(data), np.nan)
            if not reading.sound or not np.all(np.isfinite(reading.angle)):
                return np.inf
            angle[of_position] = reading.angle
            residuals = screening.scaled_residuals(data.angle - angle) - prior_residuals
            return screening.square(screening.unfollowed_part(residuals))

        return misfit
