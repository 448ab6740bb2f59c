"""What the page on a unit whose crank turned shows: its record."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.engine.store import write_atomic
from pipeline.figures import measured_states
from pipeline.identification.fitting.data import TurningData
from pipeline.identification.identify import Identification
from pipeline.identification.record.answer import RecordAnswer, Value, effect_values
from pipeline.identification.record.results import content
from pipeline.identification.results.turn_signatures import mean_turns
from pipeline.model.turn import orders
from pipeline.report.layout import drawn_pictures, render
from pipeline.report.unit.rows import digits, interval

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
        "record": measured_states.record_figure(frames["points"]),
        "levels": measured_states.torque_levels_figure(frames["levels"]),
        "orders": measured_states.record_orders_figure(frames["orders"].assign(of=frames["orders"]["of"].astype(str))),
    }
    page = render(
        "unit/record.html",
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
        tried=_tried_rows(answer),
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


def _tried_rows(answer: RecordAnswer) -> list[tuple[str, str, str, str]]:
    """Titles, odds, discrepancy [arcsec] and what speaks against the models that were tried, most probable first."""
    judgement = answer.judgement
    names = sorted(judgement.odds, key=lambda name: -judgement.odds[name])
    return [
        (
            " and ".join(answer.titles[part] for part in name.split("+")),
            digits(judgement.odds[name]),
            digits(60 * judgement.trials[name].structure.size * answer.noise),
            judgement.reasons.get(name, ""),
        )
        for name in names[:10]
    ]


def _row(value: Value) -> dict[str, str]:
    scale, unit = (60.0, "arcsec") if value.unit == "arcmin" else (1.0, value.unit)
    title = value.title[:1].upper() + value.title[1:]
    ends = interval(scale * value.ci_low, scale * value.ci_high)
    return {"title": title, "value": digits(scale * value.value), "unit": unit, "interval": ends}


TURNING_CAPTIONS = {
    "loops": (
        "Turns",
        "Dots: cells, averages over an interval of the crank that spans whole pitches of the pins, and over the turns "
        "of one sense at one held torque. Lines: the models, each by a fit that has not seen the held-out turns.",
    ),
    "torque": (
        "Residual over the crank angle",
        "A distance between the senses shows friction, waves eccentricity, ovality or an encoder.",
    ),
    "time": (
        "Orders of the crank",
        "Harmonics over a turn of the crank, means over the held-out turns: measured, and of the models before and "
        "after. Orders above half of the intervals, and what repeats with the pins' pitch, are averaged out.",
    ),
}
SHOWN_ORDERS = 8
"""Orders that are drawn."""


def turning_figures(
    identification: Identification, cells: pd.DataFrame, models: Mapping[str, tuple[str, str, str]]
) -> dict[str, Figure]:
    """Figures by the place that those of loops have on the page; ``cells`` is the table ``residual``."""
    data = identification.problem.data
    assert isinstance(data, TurningData)
    cells = cells.assign(level=data.level)
    curves = {"measured": data.angle} | identification.curves
    turns = mean_turns(data, curves, identification.folds.cells)
    amplitudes = {
        name: np.mean([orders(turn[name][None]).amplitude[0][:SHOWN_ORDERS] for turn in turns], axis=0)
        for name in curves
        if turns
    }
    in_turn = len(turns[0]["measured"]) if turns else 1
    floor = data.noise * float(np.sqrt(2 / in_turn))
    return {
        "loops": measured_states.turns_figure(cells, models),
        "torque": measured_states.turn_residual_figure(cells),
        "time": measured_states.orders_figure(amplitudes, floor),
    }
