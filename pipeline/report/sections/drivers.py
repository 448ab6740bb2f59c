"""Which errors drive the metrics."""

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.figures.drivers import sensitivity_figure
from pipeline.figures.labels import METRICS
from pipeline.report import inputs
from pipeline.report.drawing import Drawing
from pipeline.report.drivers import base_samples, constant_metrics, driver_tables, drivers
from pipeline.report.frames import Frames
from pipeline.report.layout.wording import plain_number
from pipeline.report.sections.section import Page, Section


def _values(page: Page) -> Mapping[str, object]:
    frames = page.frames
    return {
        "drivers": drivers(frames),
        "driver_tables": driver_tables(frames),
        "base_samples": base_samples(frames),
        "constant_metrics": constant_metrics(frames),
        "metric_titles": {name: METRICS[name].title for name in frames.shown_metrics},
        "zero_tolerances": inputs.zero_tolerances(frames.study.tolerances),
    }


def _drawings(frames: Frames) -> Iterator[Drawing]:
    table, level = frames.sensitivity, plain_number(100 * frames.study.metrics.confidence)
    for metric in frames.shown_metrics if len(frames.over_turn) else ():
        of_metric = (table["metric"] == metric) & (table["over"] == "worst")
        rows = table[of_metric & np.isfinite(table["index"].to_numpy(float))]
        if len(rows):
            yield Drawing(
                f"drivers_{metric}",
                f"Which tolerance drives the {METRICS[metric].inline}",
                f"Worst over the turn. Lines: {level} % intervals. Empty bars, numbers in brackets: not determined, "
                "the interval is as wide as the index.",
                partial(sensitivity_figure, rows),
            )


SECTION = Section(
    name="drivers",
    title="Which tolerance decides",
    rank=25,
    template=Path(__file__).with_suffix(".html"),
    values=_values,
    applies=lambda frames: not frames.is_listed,
    drawings=_drawings,
)
