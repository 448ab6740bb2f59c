"""Listed cases: their metrics as rows of tables, and which of them fail a limit."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.figures.labels import METRICS
from pipeline.report.frames import OK, Frames, case_label, unsolved_rows
from pipeline.report.layout.wording import number, plain_number

ROWS_SHOWN = 40
"""Cases that the page lists."""


@dataclass(frozen=True)
class CaseRow:
    """One case, its worst metrics over the turn or those at one crank angle; `failing` marks those beyond a limit."""

    label: str
    crank: str
    values: tuple[str, ...]
    failing: tuple[bool, ...]
    note: str


def case_rows(frames: Frames) -> list[CaseRow]:
    """Worst metrics of the first cases over the turn."""
    by_sample = _first_cases(frames).groupby("sample")
    return [_case_row(frames, int(sample), rows, "", frames.turn_of(int(sample))) for sample, rows in by_sample]


def case_crank_rows(frames: Frames) -> list[CaseRow]:
    """Metrics of the first cases at every crank angle."""
    return [
        _case_row(frames, int(sample), rows, plain_number(crank), {name: float(rows[name].iloc[0]) for name in METRICS})
        for (sample, crank), rows in _first_cases(frames).groupby(["sample", "crank_deg"])
    ]


def _first_cases(frames: Frames) -> pd.DataFrame:
    return frames.metrics[frames.metrics["sample"] < ROWS_SHOWN]


def _case_row(frames: Frames, sample: int, rows: pd.DataFrame, crank: str, values: dict[str, float]) -> CaseRow:
    notes = ["no result"] if len(unsolved_rows(rows)) else sorted({str(text) for text in rows["status"] if text != OK})
    notes += ["preloaded"] if rows["preloaded"].any() else []
    metrics_shown = frames.shown_metrics
    return CaseRow(
        case_label(frames.study, sample),
        crank,
        tuple(number(values[name], METRICS[name]) for name in metrics_shown),
        tuple(_fails(frames, name, values[name]) for name in metrics_shown),
        ", ".join(notes),
    )


def _fails(frames: Frames, metric: str, value: float) -> bool:
    limit = frames.limits.get(metric)
    if limit is None or np.isnan(value):
        return False
    return not METRICS[metric].keeps(np.array(value), limit)
