"""The page on what changed between two measurements of one drive."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from pipeline.engine.store import read_json, write_atomic
from pipeline.figures.measured.change import changes_figure, difference_figure
from pipeline.identification.change.results import VERDICT_FILE, ChangeAnswer
from pipeline.report.layout.pictures import drawn_pictures
from pipeline.report.layout.rendering import rendered
from pipeline.report.unit.numbers import digits, interval

TEMPLATE = "unit/change.html"
CAPTIONS = {
    "difference": (
        "Difference of the two measurements",
        "Dots: angle after less angle before, at the same sense, start and torque. Lines: what the change says, "
        "estimated at the other positions, with what mounting may have changed fitted beside it where the verdict says "
        "so. The offset of the angle is removed.",
    ),
    "changes": (
        "Each kind of change",
        "Strokes: estimated at one position. Dot and line: mean and 95 % interval over the positions; blue where the "
        "verdict names it.",
    ),
}


def write_change_page(change_answer: ChangeAnswer, folder: Path, shown_folder: Path) -> None:
    """Write report.html and its figures into ``folder``, whose verdict and tables are there already.

    Parameters
    ----------
    shown_folder : the folder as a user would type it.
    """
    verdict = read_json(folder / VERDICT_FILE)
    changes, positions, cells = (
        pd.read_parquet(folder / f"{name}.parquet") for name in ("changes", "positions", "difference")
    )
    unnamed = change_answer.comparison.best.other_kinds
    shown_tables = [frame[frame["others"] == unnamed] for frame in (changes, positions)]
    figures = {"difference": difference_figure(cells), "changes": changes_figure(*shown_tables)}
    pictures = drawn_pictures(figures, CAPTIONS, folder)
    page = rendered(
        TEMPLATE,
        verdict=verdict,
        limits=change_answer.limits_sentence,
        titles=[state.measurement.unit.settings.title for state in (change_answer.before, change_answer.after)],
        changes=[_change(row) for row in changes.to_dict("records")],
        positions=_errors(change_answer),
        others=unnamed,
        best=change_answer.comparison.best.words,
        faults=[(name, fault) for name, faults in verdict["data_faults"].items() for fault in faults],
        folder=shown_folder,
        pictures=pictures,
    )
    write_atomic(folder / "report.html", page.encode())


def _errors(change_answer: ChangeAnswer) -> list[tuple[str, str, str]]:
    """Crank angle and errors in noise floors at each position, without and with the change that says most."""
    best = change_answer.comparison.best
    rows = zip(change_answer.comparison.models, best.nothing, best.error, strict=True)
    return [
        (digits(model.pair.crank_deg), digits(unchanged), digits(remaining)) for model, unchanged, remaining in rows
    ]


def _change(row: dict) -> dict[str, str | bool]:
    scale, unit = (100.0, "%") if row["unit"] == "1" else (1.0, row["unit"])
    return {
        "title": row["title"].removesuffix(", as a share").capitalize(),
        "unit": unit,
        "value": digits(scale * row["change"]),
        "interval": interval(scale * row["ci_low"], scale * row["ci_high"]),
        "p": digits(row["p"], 2),
        "p_family": digits(row["p_family"], 2),
        "detectable": digits(scale * row["detectable"], 2),
        "share": digits(100 * row["held_out_share"], 2),
        "named": row["named"],
        "others": row["others"],
    }
