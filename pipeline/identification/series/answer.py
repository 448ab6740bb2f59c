"""What is said of a series, or of one state of a drive, from what its states share: verdict, sentence, advice."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.arrays import Real
from pipeline.identification.generic.drive_terms import CRANK_EFFECTS, TERMS
from pipeline.identification.measurement.enough import FEWEST_OF_A_WAVE
from pipeline.identification.measurement.faults.branch_faults import FEWEST_BLOCKS
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.selection.statements.verdict import EQUIVALENT, IDENTIFIED, UNEXPLAINED
from pipeline.identification.series.shared_effects import SharedEffects, TriedEffect, share_effects
from pipeline.identification.series.states import Series, Trend, series_of, trends_of
from pipeline.statistics.resampling import LEVEL, jackknife_interval

NOT_SHARED = "no shared effect shown"


@dataclass(frozen=True)
class SeriesAnswer:
    """A series, or one state of a drive, and what is said of it."""

    series: Series
    effects: SharedEffects
    trends: tuple[Trend, ...]

    @property
    def is_single(self) -> bool:
        """Whether there is one state."""
        return len(self.series.states) == 1

    @property
    def verdict(self) -> str:
        """Of all states together: identified, equivalent, or that no shared effect is shown."""
        classes = self.effects.classes
        if not classes:
            return UNEXPLAINED if self.is_single else NOT_SHARED
        return IDENTIFIED if all(len(members) == 1 for members in classes) else EQUIVALENT

    @cached_property
    def errors(self) -> Mapping[str, Real]:
        """Mean square errors (n_states, n_positions) [arcmin^2] before, refitted and after."""
        return {
            "before": self.effects.loss_before,
            "refitted": self.effects.recalibrated_folds.loss,
            "after": self.effects.final_folds.loss,
        }

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        if self.is_single:
            return self._single_sentence
        in_sample = len(self.series.positions) < 2
        basis = "in sample (a single position)" if in_sample else "at positions that were left out in all states"
        error_before, refit_error, error_after = (float(np.sqrt(np.nanmean(loss))) for loss in self.errors.values())
        errors = (
            f"Root mean square error {basis}: {error_before:.3g} arcmin with the numbers of {self.series.names[0]} in "
            f"every state, {refit_error:.3g} arcmin with each state's own friction, play and compliance"
        )
        if not self.effects.classes:
            return f"No effect that all states share is shown. {errors}.{self._leading_words}"
        claims = "; ".join(class_words(members, self.effects) for members in self.effects.classes)
        after_text = f"{error_after:.3g} arcmin with the shared effects"
        return f"All states share: {claims}. {errors}, {after_text}.{self._leading_words}"

    @property
    def _single_sentence(self) -> str:
        """The verdict on one state in words."""
        data, losses = self.series.states[0].data, self.errors
        noise = float(np.sqrt(np.average(data.sigma**2, weights=data.count)))
        refit_error, after = (float(np.sqrt(np.nanmean(losses[stage]))) for stage in ("refitted", "after"))
        error = (
            f"Root mean square error at positions that were left out: {refit_error:.3g} arcmin with friction, play and "
            "compliance, the crank turning"
        )
        if not self.effects.classes:
            return f"No effect of the crank angle or of a soft material is shown. {error}."
        claims = "; ".join(class_words(members, self.effects) for members in self.effects.classes)
        return (
            f"The unit shows {claims}. {error}, and {after:.3g} arcmin with what is named. That is "
            f"{after / noise:.3g} times the measurement noise: what is left is not traced."
        )

    @property
    def _leading_words(self) -> str:
        """The class that predicts best from the other states without being claimed; empty without one."""
        members = self.effects.leading
        if not members:
            return ""
        p = min(effect.p for effect in members)
        return (
            f" Not shown, but the best that other states offer: {class_words(members, self.effects)} (p of the first "
            f"{members[0].p:.2g}, smallest {p:.2g}, all effects counted; {len(self.series.states)} states)."
        )

    @property
    def trend_sentence(self) -> str:
        """Trends that are claimed, in words."""
        return "" if self.is_single else trend_sentence(self.series.variable, self.trends)

    @property
    def advice(self) -> str:
        """The measurement that separates the members of a class."""
        classes = (*self.effects.classes, self.effects.leading)
        names = [effect.name for members in classes if len(members) > 1 for effect in members]
        separating = dict.fromkeys(CRANK_EFFECTS[name].told_apart_by for name in names if name in CRANK_EFFECTS)
        if separating:
            return f"To separate them: {'; '.join(separating)}."
        if self.is_single and len(self.series.positions) < FEWEST_BLOCKS:
            return f"Measure {FEWEST_BLOCKS} or more positions, or other states: effects can then be named."
        if len(self.series.positions) < 3:
            return "Measure 3 or more positions in each state: shared effects can then be judged."
        return ""


def turns_within_its_loops(measurement: Measurement) -> bool:
    """Whether effects of the crank angle can be judged from this unit alone, each position by the others."""
    unit = measurement.unit.settings
    return (
        unit.crank.moves != "fixed"
        and not unit.held_out.train
        and len(np.unique(measurement.cells.position)) >= FEWEST_OF_A_WAVE
        and bool(measurement.known_cranks)
    )


def identify_measurements(measurements: Sequence[Measurement], over: str = "") -> SeriesAnswer:
    """What several states of one drive share, and how each differs; of one state which effects it shows.

    Parameters
    ----------
    over : variable that orders them, as of ``series_of``.

    Raises
    ------
    InputError : as ``series_of`` and ``trends_of``.
    """
    series = series_of(measurements, over)
    return SeriesAnswer(series, share_effects(series), trends_of(series)[0] if len(measurements) > 1 else ())


def class_words(members: Sequence[TriedEffect], effects: SharedEffects) -> str:
    """A class of effects with their sizes."""
    texts = []
    for effect in members:
        sizes = effect_sizes(effect)
        size = ", ".join(f"{name} {number_text(*values)}" for name, values in sizes.items())
        texts.append(f"{effect.title.split(':')[0]} ({size})")
    text = " or ".join(texts)
    if effects.folds_without and members[0].left_out == "states":
        return (
            f"{text}, which predicts unused positions of a state from the other states to {members[0].folds.rms():.3g} "
            f"arcmin, {effects.folds_without.rms():.3g} without it and {members[0].control:.3g} with its sign reversed"
        )
    best = members[0]
    companions = next((folds for folds in effects.bases if folds.terms == best.companions), effects.recalibrated_folds)
    control = f" and {best.control:.3g} with its sign reversed" if math.isfinite(best.control) else ""
    return (
        f"{text}, which predicts positions that were left out to {best.folds.rms():.3g} arcmin, {companions.rms():.3g} "
        f"without it{control}"
    )


def effect_sizes(effect: TriedEffect) -> dict[str, tuple[float, float, float, str]]:
    """Value, 95 % interval over positions and unit of each size of an effect: its amplitude, or its number."""
    numbers = TERMS[effect.name]
    final, folds = effect.folds.final.values[0], [fit.values[0] for fit in effect.folds.fits]
    if effect.name in CRANK_EFFECTS:
        value, *left_out = (math.hypot(*(values[name] for name in numbers)) for values in (final, *folds))
        return {"amplitude": (value, *jackknife_interval(value, left_out), next(iter(numbers.values())).unit)}
    return {
        name.replace("_", " "): (
            final[name],
            *jackknife_interval(final[name], [values[name] for values in folds]),
            number.unit,
        )
        for name, number in numbers.items()
    }


def trend_sentence(variable: str | None, trends: Sequence[Trend]) -> str:
    """Trends over a variable in words, or which numbers differ between the states."""
    differing = ", ".join(trend.number.title for trend in trends if trend.p_differ < LEVEL)
    shown = [trend_words(trend, variable) for trend in trends if trend.is_shown] if variable else []
    if not variable:
        return (
            "No variable orders the states. "
            f"Numbers in which they differ (p < {LEVEL:.2g} each): {differing or 'none'}."
        )
    if shown:
        return f"Over {variable}: {'; '.join(shown)}."
    none = f"No trend over {variable} is shown beyond the scatter of mounting and the distance of the measured torques."
    coarse = (
        f" Beyond the scatter of mounting alone the states differ in: {differing}. Few torques can make such a "
        "difference; to test it, measure at more torques about zero."
    )
    return f"{none}{coarse}" if differing else none


def trend_words(trend: Trend, variable: str) -> str:
    """A trend in words."""
    scale, unit = (100, "%") if trend.number.kind.positive else (1, trend.number.kind.unit)
    direction = trend.number.kind.grows if trend.slope > 0 else trend.number.kind.falls
    low, high = scale * trend.slope_low, scale * trend.slope_high
    bent = "" if trend.straight else ", not in a straight line"
    if not trend.p_states < LEVEL:
        bent += ", and not beyond the scatter of the states about a line: states mounted anew may differ as much"
    return (
        f"{direction} by {scale * trend.slope:+.3g} {unit} for each 1 of {variable} ({low:+.3g} to {high:+.3g}; "
        f"p = {trend.p:.2g}; loops to {trend.number.size.label}{bent})"
    )


def number_text(value: float, low: float, high: float, unit: str) -> str:
    """A number with its interval."""
    suffix = "" if unit == "1" else f" {unit}"
    reach = f", 95 % interval {low:.3g} to {high:.3g}" if math.isfinite(low) else ""
    return f"{value:.3g}{suffix}{reach}"


def state_errors(answer: SeriesAnswer) -> list[tuple[str, dict[str, tuple[float, float, float]]]]:
    """For each state its errors [arcmin] before, refitted and after, with the 95 % interval over positions."""
    rows = []
    for k, name in enumerate(answer.series.names):
        errors = {}
        for stage, loss in answer.errors.items():
            known_losses = loss[k][np.isfinite(loss[k])]
            value = float(np.sqrt(known_losses.mean())) if known_losses.size else float("nan")
            left_out = [
                float(np.sqrt(np.delete(known_losses, p).mean()))
                for p in range(len(known_losses))
                if len(known_losses) > 2
            ]
            errors[stage] = (value, *jackknife_interval(value, left_out))
        rows.append((name, errors))
    return rows
