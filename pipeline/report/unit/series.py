"""Pages on several states of one drive: a series, and what changed between two."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.engine.store import write_atomic
from pipeline.figures.measured_states import angle_figure, changes_figure, loops_figure, states_figure
from pipeline.identification.change.results import ChangeAnswer
from pipeline.identification.change.results import content as change_content
from pipeline.identification.series.answer import SeriesAnswer, effect_sizes, number_text, state_errors
from pipeline.identification.series.folds import StateFolds
from pipeline.identification.series.results import content as series_content
from pipeline.identification.series.shared_effects import TriedEffect
from pipeline.report.layout import drawn_pictures, render
from pipeline.report.unit.rows import digits, interval, p_value

SERIES_CAPTIONS = {
    "states": (
        "Numbers of the loops in each state",
        "Dots: mean over the positions, with the 95 % interval of the scatter of mounting. Line: trend, blue where it "
        "is shown beyond that scatter.",
    ),
    "angle": (
        "Residual over the crank angle",
        "Each dot is a cell of a position that the fit has not seen, darker by position (of several states the first).",
    ),
}


def write_series_page(answer: SeriesAnswer, frames: dict[str, pd.DataFrame], folder: Path, shown_folder: Path) -> None:
    """Write report.html and its figures into ``folder``.

    Parameters
    ----------
    frames : tables that were written there.
    shown_folder : the folder as a user would type it.
    """
    states, trends, verdict = frames["states"], frames["trends"], series_content(answer)
    figures = {"angle": angle_figure(frames["cells"])}
    if len(trends):
        figures["states"] = states_figure(states[states["source"] == "loops"], trends, verdict["variable"])
    page = render(
        "unit/series.html",
        verdict=verdict,
        classes=[
            [(effect.title, [number_text(*size) for size in effect_sizes(effect).values()]) for effect in members]
            for members in answer.effects.classes
        ],
        tried=[_effect_row(effect) for effect in answer.effects.tried_effects],
        trends=[_trend(row) for row in trends.to_dict("records")],
        numbers=_numbers(states),
        by_others=_by_others(answer),
        errors=[(name, *(_error(*error) for error in errors.values())) for name, errors in state_errors(answer)],
        faults=[(name, fault) for name, faults in verdict["data_faults"].items() for fault in faults],
        folder=shown_folder,
        tables=list(frames),
        pictures=drawn_pictures(figures, SERIES_CAPTIONS, folder),
    )
    write_atomic(folder / "report.html", page.encode())


def _by_others(answer: SeriesAnswer) -> list[tuple[str, list[str]]]:
    """Errors of each state, and of all, by the other states: without, with and with the reversed best effect."""
    folds_without = answer.effects.folds_without
    trials = [effect.folds for effect in answer.effects.tried_effects if isinstance(effect.folds, StateFolds)]
    if folds_without is None or not trials:
        return []
    best_folds = min(trials, key=StateFolds.rms)
    losses = folds_without.loss, best_folds.loss, best_folds.reversed_loss
    rows = [
        (name, [digits(float(np.sqrt(np.nanmean(loss[k])))) for loss in losses])
        for k, name in enumerate(answer.series.names)
        if np.any(np.isfinite(folds_without.loss[k]))
    ]
    return [*rows, ("all", [digits(float(np.sqrt(np.nanmean(loss)))) for loss in losses])]


def _effect_row(effect: TriedEffect) -> dict[str, str | bool]:
    return {
        "title": effect.title,
        "beside": ", ".join(effect.companions).replace("_", " "),
        "rms": digits(effect.folds.rms()),
        "p": digits(effect.p, 2),
        "left_out": effect.left_out,
        "reversed": digits(effect.control) if np.isfinite(effect.control) else "",
        "p_left_out": digits(effect.p_left_out, 2),
        "claimed": effect.is_claimed,
        "note": effect.note,
    }


def _trend(row: dict[str, Any]) -> dict[str, str | bool]:
    scale, unit = (100.0, "%") if row["slope_unit"] == "1" else (1.0, row["slope_unit"])
    return {
        "number": row["number"].replace("_", " "),
        "loops": row["loops"],
        "unit": unit,
        "slope": digits(scale * row["slope"]),
        "interval": interval(scale * row["ci_low"], scale * row["ci_high"]),
        **{name: digits(row[name], 2) for name in ("p", "p_family", "p_differ", "p_bent")},
        "shown": row["shown"],
    }


def _numbers(states: pd.DataFrame) -> tuple[list[str], list[tuple[str, list[str]]]]:
    """Heading of each number, and for each state its values with intervals."""
    keys = states.drop_duplicates(["source", "number", "loops"])
    headings = [
        f"{row['number'].split('_')[0] if row['source'] == 'fit' else row['number'].replace('_', ' ')} ({row['unit']}; "
        f"{'loops to ' + row['loops'] if row['loops'] else 'fit'})"
        for row in keys.to_dict("records")
    ]
    rows = []
    for state, of_state in states.groupby("state", sort=False, observed=True):
        cells = [_error(row["value"], row["ci_low"], row["ci_high"]) for row in of_state.to_dict("records")]
        rows.append((str(state), cells))
    return headings, rows


def _error(value: float, low: float, high: float) -> str:
    return f"{digits(value)} ({interval(low, high)})" if low == low else digits(value)


CHANGE_CAPTIONS = {
    "loops": (
        "Loops of both states",
        "Mean loop at each crank position, less its mean angle. Dashed: before. Full: after.",
    ),
    "changes": (
        "Change of each number",
        "Dot and line: change and its 95 % interval over the positions; blue where the verdict names it. "
        "Red strokes: changes that are detected with 80 % power.",
    ),
}


def write_change_page(
    change_answer: ChangeAnswer, frames: dict[str, pd.DataFrame], folder: Path, shown_folder: Path
) -> None:
    """Write report.html and its figures into ``folder``.

    Parameters
    ----------
    frames : tables that were written there.
    shown_folder : the folder as a user would type it.
    """
    verdict, changes, loops = change_content(change_answer), frames["changes"], frames["loops"]
    clearest = change_answer.comparison.clearest.number.size.label
    figures = {"loops": loops_figure(loops[loops["loops"] == clearest], verdict["before"])}
    if change_answer.comparison.freedom:
        figures["changes"] = changes_figure(changes)
    page = render(
        "unit/change.html",
        verdict=verdict,
        limits=change_answer.limits_sentence,
        unmeasured=change_answer.unmeasured_sentence,
        titles=[state.measurement.unit.settings.title for state in (change_answer.before, change_answer.after)],
        changes=[_change(row) for row in changes.to_dict("records")],
        freedom=change_answer.comparison.freedom,
        faults=[(name, fault) for name, faults in verdict["data_faults"].items() for fault in faults],
        folder=shown_folder,
        tables=list(frames),
        pictures=drawn_pictures(figures, CHANGE_CAPTIONS, folder),
    )
    write_atomic(folder / "report.html", page.encode())


def _change(row: dict[str, Any]) -> dict[str, str | bool]:
    scale, unit = (100.0, "%") if row["change_unit"] == "1" else (1.0, row["unit"])
    return {
        "title": row["title"].capitalize(),
        "loops": row["loops"],
        "before": digits(row["before"]),
        "after": digits(row["after"]),
        "unit": row["unit"],
        "change_unit": unit,
        "change": digits(scale * row["change"]),
        "interval": interval(scale * row["ci_low"], scale * row["ci_high"]),
        "p": p_value(row["p"]),
        "p_family": p_value(row["p_family"]),
        "detectable": f"{digits(scale * row['detectable'])} {unit}",
        "scatter": f"{digits(scale * row['scatter'])} {unit}",
        "named": row["named"],
    }
