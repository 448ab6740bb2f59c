"""The metrics over the samples, or of each listed case, with their limits."""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.figures.distributions import crank_figure, distributions_figure
from pipeline.figures.yields import units_figure
from pipeline.report.cases import ROWS_SHOWN, case_crank_rows, case_rows
from pipeline.report.convergence import ConvergenceTable
from pipeline.report.drawing import Drawing
from pipeline.report.explorer.explorer import UNITS_SHOWN, WORST_SHOWN, explored_units
from pipeline.report.frames import HEADLINES, Frames
from pipeline.report.layout.wording import count_text, plain_number
from pipeline.report.results import STATISTICS, Results
from pipeline.report.sections.section import Page, Section


def _values(page: Page) -> Mapping[str, object]:
    frames = page.frames
    return {
        "case_rows": case_rows(frames) if frames.is_listed else [],
        "case_crank_rows": case_crank_rows(frames) if frames.is_listed else [],
        "rows_shown": ROWS_SHOWN,
        "explorer": page.explorer,
        "statistics": list(STATISTICS.values()),
        "convergence": ConvergenceTable(frames, Results(frames)),
    }


def _drawings(frames: Frames) -> Iterator[Drawing]:
    if frames.is_listed or not len(frames.over_turn):
        return
    metrics = [name for name in frames.shown_metrics if frames.over_turn[name].notna().any()]
    yield _distributions(frames, metrics)
    yield from _units(frames)
    headlines = [metric for metric in HEADLINES if metric in metrics]
    if len(frames.study.cycle.crank_deg) > 1 and headlines:
        yield _cranks(frames, headlines)


def _distributions(frames: Frames, metrics: list[str]) -> Drawing:
    worst_rows = frames.distributions[frames.distributions["over"] == frames.turn_statistic]
    level = plain_number(100 * frames.study.metrics.confidence)
    nominal = frames.turn_of(0) if frames.study.samples.nominal_first else {}
    return Drawing(
        "distributions",
        "Distributions of the metrics over the samples",
        f"{frames.turn_statistic.capitalize()} value of each of {count_text(len(frames.over_turn), 'sample')} "
        "over the turn. "
        f"Below each histogram: 5 % quantile, mean and 95 % quantile with their {level} % intervals; an arrowhead "
        "marks an end that the samples do not determine. Beyond the limit the ground is shaded.",
        partial(distributions_figure, frames.over_turn[metrics], worst_rows, frames.limits, nominal),
    )


def _units(frames: Frames) -> Iterator[Drawing]:
    units = explored_units(frames)
    if len(units.columns) < 2:
        return
    pair = list(units.columns[:2])
    curves = frames.at_crank(frames.curves)
    angles = np.stack([curves.loc[curves["sample"] == sample, "angle_arcmin"].to_numpy() for sample in units.index])
    torque = curves["torque_Nm"].to_numpy()[: angles.shape[1]]
    yield Drawing(
        "units",
        "Single units",
        f"{count_text(len(units), 'unit').capitalize()}{_choice(frames, units)}: their values over the turn, and their "
        f"loops at crank angle {plain_number(frames.crank_deg)}°. Point at a unit, or go from unit to unit "
        "with the arrow "
        "keys, to see its loop and the forces on its pins (filled points).",
        partial(units_figure, pair, units[pair].to_numpy(), frames.limits, torque, angles),
    )


def _choice(frames: Frames, units: pd.DataFrame) -> str:
    """How the units of the explorer were chosen."""
    if not frames.limits or len(units) < UNITS_SHOWN:
        return ""
    return f", {WORST_SHOWN} of them the nearest to a limit or farthest beyond one, the others random"


def _cranks(frames: Frames, metrics: list[str]) -> Drawing:
    by_crank = frames.distributions[frames.distributions["over"] == "angle"]
    return Drawing(
        "cranks",
        f"The metrics over the turn of the {frames.study.cycle.turn}",
        "Mean and band of 90 % of the samples at each loaded crank angle, and the nominal reducer. A unit's worst lies "
        "beyond the band of a single angle: it is the worst of them all.",
        partial(crank_figure, by_crank, frames.nominal, metrics, frames.limits),
    )


SECTION = Section(
    name="results",
    title="Results",
    rank=20,
    template=Path(__file__).with_suffix(".html"),
    values=_values,
    drawings=_drawings,
)
