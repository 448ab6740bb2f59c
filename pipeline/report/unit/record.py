"""The page on the record of a turning drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.engine.store import write_atomic
from pipeline.figures.measured_turn import record_figure, record_orders_figure, torque_levels_figure
from pipeline.identification.record.answer import RecordAnswer, Value, effect_values
from pipeline.identification.record.results import content
from pipeline.report.layout.rendering import drawn_pictures, render
from pipeline.report.unit.numbers import digits, interval

TEMPLATE = "unit/record.html"
CAPTIONS = {
    "record": (
        "Error over the output angle",
        "Dots: means over the repeats of one held torque and sense, at the lowest temperature. Lines: the zeros of all "
        "places with the terms of every drive and the named effects.",
    ),
    "levels": (
        "Both senses over the torque",
        "Left: mean of both senses, whose slope is the compliance. Right: their difference, the lost motion.",
    ),
    "orders": (
        "Orders of the error",
        "Bars: amplitude of what all passes share. Circles: of what is proportional to the torque, at the largest one. "
        "Crosses: of half the difference of the senses. Numbers: orders of the shafts.",
    ),
}


def write_record_page(answer: RecordAnswer, frames: dict[str, pd.DataFrame], folder: Path, shown_folder: Path) -> None:
    """Write report.html and its figures into ``folder``; ``frames`` are the tables that were written there."""
    figures = {
        "record": record_figure(frames["points"]),
        "levels": torque_levels_figure(frames["levels"]),
        "orders": record_orders_figure(frames["orders"].assign(of=frames["orders"]["of"].astype(str))),
    }
    trials = answer.judgement.trials
    names = sorted(answer.judgement.odds, key=lambda name: -answer.judgement.odds[name])
    page = render(
        TEMPLATE,
        verdict=content(answer),
        numbers=[_row(value) for value in answer.values],
        effects=[_row(value) for value in effect_values(answer)],
        described=not answer.judgement.members and bool(answer.judgement.best_model),
        held_out=[
            (
                row.part,
                digits(60 * row.base_rms),
                digits(60 * row.rms),
                digits(60 * row.repeat_rms),
                digits(row.to_noise),
            )
            for row in answer.held_out
        ],
        tried=[
            (
                " and ".join(answer.titles[part] for part in name.split("+")),
                digits(answer.judgement.odds[name]),
                digits(60 * trials[name].structure.size * answer.noise),
                answer.judgement.reasons.get(name, ""),
            )
            for name in names[:10]
        ],
        why_not=[(name.replace("_", " "), reason) for name, reason in answer.why_not.items()],
        orders=[
            (
                f"{row.order:.4g}",
                row.of,
                digits(row.amplitude),
                interval(row.ci_low, row.ci_high),
                digits(row.per_torque),
                digits(row.senses),
                row.significant,
            )
            for row in answer.orders
        ],
        levels=[
            (f"{row.torque:.4g}", digits(row.mean), digits(60 * row.difference), digits(60 * row.difference_error))
            for row in answer.levels
        ],
        conditions=[
            (*(digits(value) if np.isfinite(value) else "–" for value in (row.temperature, row.speed)), row.numbers)
            for row in answer.conditions
        ],
        condition_row=_row,
        span=f"{answer.record.span_deg:.4g}",
        folder=shown_folder,
        pictures=drawn_pictures(figures, CAPTIONS, folder),
    )
    write_atomic(folder / "report.html", page.encode())


def _row(value: Value) -> dict[str, str]:
    scale, unit = (60.0, "arcsec") if value.unit == "arcmin" else (1.0, value.unit)
    title = value.title[:1].upper() + value.title[1:]
    ends = interval(scale * value.ci_low, scale * value.ci_high)
    return {"title": title, "value": digits(scale * value.value), "unit": unit, "interval": ends}
