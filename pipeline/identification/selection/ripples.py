"""Where the fit of a ripple starts: its number of waves and its phases, found among many.

The phase of a ripple bends with the angle, so that derivatives lead to the nearest period alone. Many numbers of waves
are therefore looked at. A ripple of given waves is linear in its amplitudes: it changes the torque by a sine of the
angle that was measured, and the angle by the slope of the curve times that. The best of the waves are fitted on.
"""

from dataclasses import replace
from functools import partial
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import chdtrc, chdtri

from pipeline.arrays import Real, Truth
from pipeline.constant_kinds import Fineness, Shortcut, ShortcutCount
from pipeline.identification.bench.instrument_effects import InstrumentEffect
from pipeline.identification.fitting.fitter import WELL_FITTED, Fitter
from pipeline.identification.fitting.least_squares import Descent
from pipeline.identification.fitting.parameters import Fit, Vector, values_at_shares
from pipeline.identification.fitting.problem import Candidate, Model
from pipeline.identification.measurement.enough import UNLOADED_SHARE
from pipeline.model.units import ARCMIN

if TYPE_CHECKING:
    from pipeline.identification.selection.screening import Screening

WAVE_STEP: Shortcut = 0.5
"""Periods that are looked at: steps of their number over the range of the angle."""
FINER: ShortcutCount = 11
"""Numbers of waves that are looked at about the best of them, from one neighbour to the other."""
FAINT: Shortcut = 15.0
"""Fall of the sum of squares by the best ripple at one position, in the mean square that it leaves, below which no fit
is made. With noise alone the best of 75 periods exceeds it in a tenth of the units. For several positions, each with
its own phase, the fall that noise exceeds as often is used."""
PERIODS: ShortcutCount = 6
"""The best periods, which are fitted on."""
FOLLOWED: ShortcutCount = 3
"""Of these, the number that is fitted further after one step."""
PHASES: Fineness = 24
"""Phases that are looked at where a position has been left out."""


class OwnPhases:
    """Phases of ripples at positions that were left out of a fit.

    The phase at a position tells nothing about the drive, as the zero of the angle there tells nothing. Like the zero,
    it is fitted to the cells of its own position, of two ripples one after the other.
    """

    def __init__(self, fitter: Fitter, fit: Fit, training: Truth):
        self.fitter, self.fit, self.training = fitter, fit, training
        data = fitter.problem.data
        self.first = len(fit.unknowns.scales)
        self.ripples: list[tuple[slice, Real]] = []  # shares of the parameters, and their bounds
        for effect, shares in fit.model.places:
            if isinstance(effect, InstrumentEffect) and effect.own_phases:
                self.ripples.append((shares, np.array(fitter.problem.bounds(effect))))
        left_out = np.setdiff1d(data.position, data.position[training]).tolist()
        self.places = list(product(self.ripples, left_out))

    def fitted(self) -> Fit:
        """The fit with the best of these phases; the same where there is none."""
        if not self.places:
            return self.fit
        fitter, unknowns, reach = self.fitter, self.fit.unknowns, 2 * np.pi / PHASES
        for ripple, position in self.places:
            misfit = partial(self._misfit, unknowns, ripple, position)
            best = reach * int(np.nanargmin([misfit(reach * number) for number in range(PHASES)]))
            phase = minimize_scalar(misfit, bounds=(best - reach, best + reach), method="bounded").x
            unknowns = _with_phase(unknowns, ripple, position, float(phase))
        angle = fitter.predict(self.fit.model, unknowns).angle
        values = values_at_shares(fitter.bounds(self.fit.model), unknowns.shares)
        predicted_angle = angle + fitter.offsets(angle, self.training, self.fit.sigma)
        return replace(self.fit, unknowns=unknowns, values=values, predicted_angle=predicted_angle)

    def _misfit(self, unknowns: Vector, ripple: tuple[slice, Real], position: int, phase: float) -> float:
        """Sum of squares, in noise, of the cells of a position with some phase of a ripple."""
        data = self.fitter.problem.data
        of_position = data.position == position
        angle = self.fitter.predict(self.fit.model, _with_phase(unknowns, ripple, position, phase), [position]).angle
        angle = angle + self.fitter.offsets(angle, of_position, data.sigma)
        return float(np.sum(((data.angle - angle) / data.sigma)[of_position] ** 2))

    def removed_from(self, jacobian: Real) -> Real:
        """Derivatives (n_cells, n_unknowns) without what a fit of these phases takes up at their positions."""
        if not self.places:
            return jacobian
        data, jacobian = self.fitter.problem.data, jacobian.copy()
        for (place, bounds), position in self.places:
            start, (low, high) = self.first + place.start, bounds[:2].T
            cosine, sine = low + self.fit.unknowns.shares[place][:2] * (high - low)
            by_phase = jacobian[:, start + 2 + position]
            if position == 0:  # its phase is that of the two amplitudes
                by_phase = sine * jacobian[:, start] - cosine * jacobian[:, start + 1]
            in_noise = np.where(data.position == position, by_phase / data.sigma**2, 0.0)
            followed = in_noise @ jacobian / max(float(in_noise @ by_phase), 1e-300)
            jacobian[data.position == position] -= np.outer(by_phase[data.position == position], followed)
        return jacobian


def _with_phase(unknowns: Vector, ripple: tuple[slice, Real], position: int, phase: float) -> Vector:
    """Unknowns with another phase [rad] at a position, and those of the other positions as they are."""
    place, bounds = ripple
    low, high = bounds.T
    values = low + unknowns.shares[place] * (high - low)
    phases = np.arctan2(values[0], values[1]) + np.append(0.0, values[3:])
    phases[position] = phase
    size = np.hypot(values[0], values[1])
    values[:2] = size * np.sin(phases[0]), size * np.cos(phases[0])
    values[3:] = (phases[1:] - phases[0] - np.pi) % (2 * np.pi) + np.pi
    shares = unknowns.shares.copy()
    shares[place] = (values - low) / (high - low)
    return replace(unknowns, shares=shares)


def ripple_starts(screening: "Screening", effect: Candidate) -> list[tuple[float, Vector]]:
    """Starts of a ripple with their sums of squares."""
    search = _Search(screening, effect)
    ripples = [search.ripple(wave) for wave in search.waves]
    falls = np.array([-np.inf, *(fall for fall, *_ in ripples), -np.inf])
    best = int(np.argmax(falls)) - 1
    starts = [search.start(wave, *of_wave[1:]) for wave, of_wave in zip(search.waves, ripples, strict=True)]
    if search.in_noise(falls[best + 1]) < chdtri(2 * len(screening.positions) + 1, chdtrc(3, FAINT)):
        return [(max(screening.base_misfit - falls[best + 1], 1e-300), starts[best])]
    is_peak = (falls[1:-1] >= falls[:-2]) & (falls[1:-1] > falls[2:])
    peaks = sorted(np.flatnonzero(is_peak).tolist(), key=lambda number: -falls[number + 1])[:PERIODS]
    starts = [search.start_near(search.waves[number]) for number in peaks]
    descents = [Descent(screening.fitter, search.model, screening.cells, start, screening.base) for start in starts]
    descents = [descent for descent in descents if np.isfinite(descent.cost)]
    for steps, count in ((1, PERIODS), (2, FOLLOWED)):
        descents = sorted(descents, key=lambda descent: descent.in_noise)[:count]
        for descent in descents:
            descent.run(steps)
    unknowns = [descent.unknowns for descent in descents if descent.prediction.sound]
    return [(screening.misfit_at(search.model, one), one) for one in unknowns]


def refined_ripple(fitter: Fitter, fit: Fit, cells: Truth) -> Fit:
    """The fit, refined if its model has a ripple and misses more than the noise.

    Plain fits end at kinks, and there a wrong number of waves may fit better than the right one. The fit from each
    start is therefore refined before the best of them is taken.
    """
    has_ripple = any(isinstance(effect, InstrumentEffect) and effect.own_phases for effect in fit.model.effects)
    is_well_fitted = fit.cost < WELL_FITTED * np.count_nonzero(cells)
    return fitter.refine(fit, cells, fit.unknowns) if has_ripple and not is_well_fitted else fit


class _Search:
    """The search for a ripple beside the base of a screening, in the cells where the curve has no play.

    Attributes
    ----------
    waves : (n_waves,) waves per turn of the output that are looked at.
    """

    def __init__(self, screening: "Screening", effect: Candidate):
        problem, base = screening.fitter.problem, screening.base
        torque = np.abs(problem.data.torque)
        is_loaded = torque > UNLOADED_SHARE * np.max(torque[screening.cells])
        self.loaded, self.base, self.data = screening.of_cells(is_loaded), base.unknowns, problem.data
        self.bounds = problem.bounds(effect)
        self.model = Model((*base.model.effects, effect))
        is_of_angle = isinstance(effect, InstrumentEffect) and effect.is_of_angle
        slope = screening.fitter.predict(base.model, base.unknowns).slope
        self.response = np.ones(len(torque)) if is_of_angle else -slope
        self.goal = self.loaded.unfollowed_part(self.loaded.residual_left)
        self.step = WAVE_STEP * 2 * np.pi * ARCMIN / problem.span
        self.waves = np.arange(*self.bounds[2], self.step)

    def ripple(self, wave: float) -> tuple[float, float, dict[int, float]]:
        """Fall of the sum of squares by a ripple of some waves, its size [N m], and its phase [rad] by position."""
        loaded, positions, phase = self.loaded, self.loaded.positions, wave * self.data.angle / ARCMIN
        columns = [
            np.where(self.data.position == position, self.response * shape, 0.0)
            for position in positions
            for shape in (np.cos(phase), np.sin(phase))
        ]
        changes = np.column_stack([loaded.unfollowed_part(loaded.scaled_residuals(column)) for column in columns])
        amounts = np.asarray(np.linalg.lstsq(changes, self.goal, rcond=None)[0], float)
        cosine, sine = amounts.reshape(-1, 2).T
        phases = dict(zip(positions, np.arctan2(cosine, sine).tolist(), strict=True))
        return float(self.goal @ changes @ amounts), float(np.sqrt(np.mean(cosine**2 + sine**2))), phases

    def in_noise(self, fall: float) -> float:
        """A fall of the sum of squares in the mean square that it leaves."""
        left = max(float(self.goal @ self.goal) - fall, 1e-300)
        return fall * len(self.loaded.root) / left

    def start_near(self, wave: float) -> Vector:
        """Start with the best number of waves near one."""
        waves = np.clip(wave + self.step * np.linspace(-1.0, 1.0, FINER), *self.bounds[2])
        falls, sizes, phases = zip(*map(self.ripple, waves), strict=True)
        best = int(np.argmax(falls))
        return self.start(waves[best], sizes[best], phases[best])

    def start(self, wave: float, size: float, phases: dict[int, float]) -> Vector:
        """Start with a ripple of some size [N m] and phases [rad] at positions; at others it is as at the first."""
        low, high = np.array(self.bounds).T
        values, first = 0.5 * (low + high), self.loaded.positions[0]
        middle = np.append(0.0, values[3:])
        reference = phases[first] - (middle[first] if first < len(middle) else 0.0)
        values[:3] = size * np.sin(reference), size * np.cos(reference), wave
        for position in range(1, len(middle)):
            turned = phases.get(position, phases[first]) - reference - middle[position]
            values[2 + position] += (turned + np.pi) % (2 * np.pi) - np.pi
        shares = np.clip((values - low) / (high - low), 0.0, 1.0)
        return self.base.with_shares(shares)
