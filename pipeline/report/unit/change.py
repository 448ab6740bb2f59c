"""The page on what changed between two measurements of one drive."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pipeline.engine.store import write_atomic
from pipeline.figures.measured_states import changes_figure, loops_figure
from pipeline.identification.change.results import ChangeAnswer, content
from pipeline.report.layout.rendering import drawn_pictures, render
from pipeline.report.unit.numbers import digits, interval, p_value

TEMPLATE = "unit/change.html"
CAPTIONS = {
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
    verdict, changes, loops = content(change_answer), frames["changes"], frames["loops"]
    clearest = change_answer.comparison.clearest.number.size.label
    figures = {"loops": loops_figure(loops[loops["loops"] == clearest], verdict["before"])}
    if change_answer.comparison.freedom:
        figures["changes"] = changes_figure(changes)
    page = render(
        TEMPLATE,
        verdict=verdict,
        limits=change_answer.limits_sentence,
        unmeasured=change_answer.unmeasured_sentence,
        titles=[state.measurement.unit.settings.title for state in (change_answer.before, change_answer.after)],
        changes=[_change(row) for row in changes.to_dict("records")],
        freedom=change_answer.comparison.freedom,
        faults=[(name, fault) for name, faults in verdict["data_faults"].items() for fault in faults],
        folder=shown_folder,
        tables=list(frames),
        pictures=drawn_pictures(figures, CAPTIONS, folder),
    )
    write_atomic(folder / "report.html", page.encode())


def _change(row: dict) -> dict[str, str | bool]:
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
