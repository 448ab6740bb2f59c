"""What a series leaves behind: verdict.json and tables."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.engine.store import write_json, write_tables
from pipeline.engine.table import Column, Columns, Table, interval_columns
from pipeline.identification.generic.drive_terms import BASIC
from pipeline.identification.results.write import finite
from pipeline.identification.selection.statements.verdict import VERDICT_FILE
from pipeline.identification.series.answer import SeriesAnswer, effect_sizes
from pipeline.identification.series.shared_effects import TriedEffect, fold_groups
from pipeline.statistics.resampling import jackknife_interval

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
        *interval_columns("see unit", "95 % interval; null: not known, or at a bound"),
    ),
)
P_VALUES = ("p", "p_family", "p_states", "p_differ", "p_bent")
TRENDS = Table(
    "trends",
    "number of the loops over the states",
    (
        Column("number", "label", "", "name"),
        Column("loops", "label", "", "largest torque of the loops"),
        Column("slope_unit", "label", "", "of the slope: 1 where it is a share of a positive number"),
        Column("slope", "float64", "see slope_unit", "change with one of the variable; null without a variable"),
        *interval_columns("see slope_unit", "95 % interval"),
        Column("p", "float64", "1", "of no trend, by the scatter over the positions"),
        Column("p_family", "float64", "1", "the same, all numbers counted"),
        Column("p_states", "float64", "1", "of no trend, by the scatter of the states about their line"),
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
    write_json(folder / VERDICT_FILE, content(answer))
    return frames


def content(answer: SeriesAnswer) -> dict[str, Any]:
    """Content of verdict.json."""
    verdict: dict[str, Any] = finite(
        {
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
    )
    return verdict


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
        for number, described_number in BASIC.items():
            value = after.final.values[k][number]
            at_bound = number in after.final.at_bound
            left_out = [] if at_bound else [fit.values[k][number] for fit in after.fits]
            low, high = jackknife_interval(value, left_out)
            row = {"number": number, "loops": "", "unit": described_number.unit}
            records.append({**state, "source": "fit", **row, "value": value, "ci_low": low, "ci_high": high})
    return STATES.columns_of_rows(records)


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
        **{name: np.array([getattr(trend, name) for trend in trends]) for name in P_VALUES},
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
