"""What a series leaves behind: its sentence, verdict.json and tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.engine.frames import write_tables
from pipeline.engine.store import write_json
from pipeline.engine.table import Column, Columns, Table
from pipeline.identification.generic.drive_terms import CRANK_EFFECTS, numbers_of
from pipeline.identification.measurement.measurement import Measurement
from pipeline.identification.results.write import finite
from pipeline.identification.selection.criteria import FEWEST_BLOCKS
from pipeline.identification.selection.statements.verdict import EQUIVALENT, IDENTIFIED, UNEXPLAINED
from pipeline.identification.series.shared_effects import (
    FEWEST_OF_A_WAVE,
    SharedEffects,
    TriedEffect,
    fold_groups,
    share_effects,
)
from pipeline.identification.series.states import Series, series_of
from pipeline.identification.series.trends import Trend, trends_of
from pipeline.statistics.jackknife import jackknife_interval

Real = NDArray[np.float64]

VERDICT_FILE = "verdict.json"
NOT_SHARED = "no shared effect shown"
DIFFERS = 0.05
"""p of a number by itself below which the states are said to differ in it."""
UNIT_OF = {name: number.unit for name, number in numbers_of(frozenset()).items()}
STATES = Table(
    "states",
    "number of a state",
    (
        Column("state", "label", "", "unit"),
        Column("variable", "float64", "see verdict.json", "value of the variable that orders the states"),
        Column("source", "label", "", "loops: read off the measured loops; fit: of the model of all states"),
        Column("number", "label", "", "name"),
        Column("loops", "label", "", "largest torque of the loops; empty of the fit"),
        Column("unit", "label", "", "of value and interval"),
        Column("value", "float64", "see unit", "of the state"),
        Column("ci_low", "float64", "see unit", "lower end of the 95 % interval; null: not known, or at a bound"),
        Column("ci_high", "float64", "see unit", "upper end"),
    ),
)
TRENDS = Table(
    "trends",
    "number of the loops over the states",
    (
        Column("number", "label", "", "name"),
        Column("loops", "label", "", "largest torque of the loops"),
        Column("slope_unit", "label", "", "of the slope: 1 where it is a share of a positive number"),
        Column("slope", "float64", "see slope_unit", "change with one of the variable; null without a variable"),
        Column("ci_low", "float64", "see slope_unit", "lower end of the 95 % interval"),
        Column("ci_high", "float64", "see slope_unit", "upper end"),
        Column("p", "float64", "1", "of no trend"),
        Column("p_family", "float64", "1", "of no trend, all numbers counted"),
        Column("p_differ", "float64", "1", "of no difference between the states"),
        Column("p_bent", "float64", "1", "of no departure of the states from a straight line"),
        Column("shown", "bool", "", "whether the trend is claimed"),
    ),
)
ERRORS = Table(
    "errors",
    "state at a position that no state was fitted to",
    (
        Column("state", "label", "", "unit"),
        Column("position", "label", "", "name of the position, or its crank angle"),
        Column("before_arcmin", "float64", "arcmin", "rms error with the numbers of the first state"),
        Column("refitted_arcmin", "float64", "arcmin", "rms error with the state's own numbers"),
        Column("after_arcmin", "float64", "arcmin", "rms error with the shared effects that are claimed"),
    ),
)
CELLS = Table(
    "cells",
    "cell: measured rows averaged over neighbouring torques of one branch",
    (
        Column("state", "label", "", "unit"),
        Column("position", "label", "", "name of the position, or its crank angle"),
        Column("crank_deg", "float64", "deg", "crank angle at the cell, as measured"),
        Column("torque_Nm", "float64", "N m", "torque at the cell"),
        Column("angle_arcmin", "float64", "arcmin", "measured angle"),
        Column("residual_refitted_arcmin", "float64", "arcmin", "measured less the model with the state's own numbers"),
        Column("residual_after_arcmin", "float64", "arcmin", "the same with the effects that are claimed"),
    ),
)
"""Residuals of fits that have not seen the cell's position in any state."""
EFFECTS = Table(
    "effects",
    "effect that was tried in all states",
    (
        Column("effect", "label", "", "name"),
        Column("title", "label", "", "in words"),
        Column("beside", "label", "", "effects that were shared already"),
        Column("rms_arcmin", "float64", "arcmin", "error at positions that the state was not fitted to"),
        Column("left_out", "label", "", "positions of all states, or states; errors of the two differ in their cells"),
        Column("reversed_arcmin", "float64", "arcmin", "the same with the sign turned round; null over positions"),
        Column("p", "float64", "1", "of no gain there, all effects counted; null: not testable"),
        Column("p_left_out", "float64", "1", "of no gain by the scatter over what was left out alone"),
        Column("claimed", "bool", "", "whether it is claimed"),
        Column("note", "label", "", "why it is not"),
    ),
)


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
    numbers = numbers_of(frozenset([effect.name]))
    own_numbers = [name for name in numbers if name not in UNIT_OF]
    final, folds = effect.folds.final.values[0], [fit.values[0] for fit in effect.folds.fits]
    if len(own_numbers) == 2:
        value, *left_out = (
            float(np.hypot(values[own_numbers[0]], values[own_numbers[1]])) for values in (final, *folds)
        )
        return {"amplitude": (value, *jackknife_interval(value, left_out), numbers[own_numbers[0]].unit)}
    return {
        name.replace("_", " "): (
            final[name],
            *jackknife_interval(final[name], [values[name] for values in folds]),
            numbers[name].unit,
        )
        for name in own_numbers
    }


def trend_sentence(variable: str | None, trends: Sequence[Trend]) -> str:
    """Trends over a variable in words, or which numbers differ between the states."""
    differing = ", ".join(trend.number.title for trend in trends if trend.p_differ < DIFFERS)
    shown = [trend_words(trend, variable) for trend in trends if trend.is_shown] if variable else []
    if not variable:
        return (
            f"No variable orders the states. Numbers in which they differ (p < {DIFFERS} each): {differing or 'none'}."
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
    return (
        f"{direction} by {scale * trend.slope:+.3g} {unit} for each 1 of {variable} ({low:+.3g} to {high:+.3g}; "
        f"p = {trend.p:.2g}; loops to {trend.number.size.label}{bent})"
    )


def number_text(value: float, low: float, high: float, unit: str) -> str:
    """A number with its interval."""
    suffix = "" if unit == "1" else f" {unit}"
    reach = f", 95 % interval {low:.3g} to {high:.3g}" if math.isfinite(low) else ""
    return f"{value:.3g}{suffix}{reach}"


def write(answer: SeriesAnswer, folder: Path) -> dict[str, pd.DataFrame]:
    """Write tables and, last, the verdict into ``folder``; the frames by name."""
    tables = {
        STATES: state_rows(answer),
        TRENDS: trend_rows(answer),
        ERRORS: error_rows(answer),
        CELLS: cell_rows(answer),
        EFFECTS: effect_rows(answer),
    }
    frames = write_tables(tables, folder)
    write_json(folder / VERDICT_FILE, finite(_verdict(answer)))
    return frames


def _verdict(answer: SeriesAnswer) -> dict[str, Any]:
    return {
        "states": list(answer.series.names),
        "single": answer.is_single,
        "variable": answer.series.variable,
        "values": answer.series.values.tolist() if answer.series.variable else [],
        "verdict": answer.verdict,
        "sentence": answer.sentence,
        "trends": answer.trend_sentence,
        "advice": answer.advice,
        "shared": [[_effect(effect) for effect in members] for members in answer.effects.classes],
        "leading": [_effect(effect) for effect in answer.effects.leading],
        "untestable": dict(answer.effects.untestable),
        "errors_arcmin": {name: float(np.sqrt(np.nanmean(loss))) for name, loss in answer.errors.items()},
        "data_faults": {
            state.name: [asdict(fault) for fault in state.measurement.faults] for state in answer.series.states
        },
    }


def _effect(effect: TriedEffect) -> dict[str, Any]:
    sizes = {
        name: {"value": value, "ci_low": low, "ci_high": high, "unit": unit}
        for name, (value, low, high, unit) in effect_sizes(effect).items()
    }
    return {"effect": effect.name, "title": effect.title, "sizes": sizes, "p": effect.p}


def state_rows(answer: SeriesAnswer) -> Columns:
    """Columns of `STATES`: numbers of the loops, and numbers of the fit with all that is claimed."""
    records = []
    after = answer.effects.final_folds
    for k, name in enumerate(answer.series.names):
        state = {"state": name, "variable": float(answer.series.values[k]) if answer.series.variable else np.nan}
        for trend in answer.trends:
            row = {"number": trend.number.kind.name, "loops": trend.number.size.label, "unit": trend.number.kind.unit}
            ends = {"value": trend.levels[k], "ci_low": trend.low[k], "ci_high": trend.high[k]}
            records.append({**state, "source": "loops", **row, **ends})
        for number, unit in UNIT_OF.items():
            value = after.final.values[k][number]
            at_bound = number in after.final.at_bound
            left_out = [] if at_bound else [fit.values[k][number] for fit in after.fits]
            low, high = jackknife_interval(value, left_out)
            row = {"number": number, "loops": "", "unit": unit}
            records.append({**state, "source": "fit", **row, "value": value, "ci_low": low, "ci_high": high})
    return {column.name: [record[column.name] for record in records] for column in STATES.columns}


def trend_rows(answer: SeriesAnswer) -> Columns:
    """Columns of `TRENDS`."""
    trends = answer.trends
    return {
        "number": [trend.number.kind.name for trend in trends],
        "loops": [trend.number.size.label for trend in trends],
        "slope_unit": ["1" if trend.number.kind.positive else trend.number.kind.unit for trend in trends],
        "slope": np.array([trend.slope for trend in trends]),
        "ci_low": np.array([trend.slope_low for trend in trends]),
        "ci_high": np.array([trend.slope_high for trend in trends]),
        **{name: np.array([getattr(trend, name) for trend in trends]) for name in ("p", "p_family", "p_differ")},
        "p_bent": np.array([trend.p_bent for trend in trends]),
        "shown": np.array([trend.is_shown for trend in trends], bool),
    }


def error_rows(answer: SeriesAnswer) -> Columns:
    """Columns of `ERRORS`."""
    known_places = np.argwhere(np.isfinite(answer.errors["refitted"]))
    return {
        "state": [answer.series.names[k] for k, _ in known_places],
        "position": [answer.series.positions[p] for _, p in known_places],
        **{f"{name}_arcmin": np.sqrt(loss[tuple(known_places.T)]) for name, loss in answer.errors.items()},
    }


def cell_rows(answer: SeriesAnswer) -> Columns:
    """Columns of `CELLS`."""
    series, parts = answer.series, []
    stages = {"refitted": answer.effects.recalibrated_folds, "after": answer.effects.final_folds}
    for k, (state, loops) in enumerate(zip(series.states, series.loops, strict=True)):
        residuals = {stage: np.full(len(loops.angle), np.nan) for stage in stages}
        for number, group in enumerate(fold_groups(series)):
            cells = np.any([series.cells_of(name)[k] for name in group or series.positions], axis=0)
            for stage, folds in stages.items():
                residuals[stage][cells] = (loops.angle - folds.fits[number].predicted_angles[k])[cells]
        parts.append(
            pd.DataFrame(
                {
                    "state": state.name,
                    "position": np.array(state.labels)[loops.position],
                    "crank_deg": np.degrees(loops.crank + loops.crank_per_output * (loops.angle - loops.start)),
                    "torque_Nm": loops.torque[:, -1],
                    "angle_arcmin": loops.angle,
                    **{f"residual_{stage}_arcmin": residual for stage, residual in residuals.items()},
                }
            )
        )
    frame = pd.concat(parts, ignore_index=True)
    return {column.name: frame[column.name].to_numpy() for column in CELLS.columns}


def effect_rows(answer: SeriesAnswer) -> Columns:
    """Columns of `EFFECTS`."""
    tried_effects = answer.effects.tried_effects
    return {
        "effect": [effect.name for effect in tried_effects],
        "title": [effect.title for effect in tried_effects],
        "beside": [" + ".join(effect.companions) for effect in tried_effects],
        "rms_arcmin": np.array([effect.folds.rms() for effect in tried_effects]),
        "left_out": [effect.left_out for effect in tried_effects],
        "reversed_arcmin": np.array([effect.control for effect in tried_effects]),
        "p": np.array([effect.p for effect in tried_effects]),
        "p_left_out": np.array([effect.p_left_out for effect in tried_effects]),
        "claimed": np.array([effect.is_claimed for effect in tried_effects]),
        "note": [effect.note for effect in tried_effects],
    }


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
