"""What the report knows of a figure, and which rows and words figures share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pipeline.config.designs.design import Design
from pipeline.figures.hysteresis import centred_loops, spread_frame
from pipeline.report.frames import Frames
from pipeline.report.layout.wording import count_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Drawing:
    """One figure of the report; `name` is the stem of its files and its place in the page, `figure` draws it."""

    name: str
    title: str
    caption: str
    figure: Callable[[], Figure]


def disk_words(design: Design) -> str:
    """Which disk a figure shows, where there are several."""
    return ", disk 0 of several" if design.disk.count > 1 else ""


def band_sentence(frames: Frames, spread: object) -> str:
    """Which samples the band is of."""
    if spread is None:
        return ""
    subset = frames.curves["sample"].iloc[-1] + 1 < frames.study.samples.rows
    return f" The band is over {'the first ' if subset else ''}{count_text(len(frames.band), 'sample')}."


def loop_traces(frames: Frames) -> dict[str, pd.DataFrame]:
    """Loop of each drawn sample at the crank angle of the figures, by its label."""
    curves = frames.at_crank(frames.curves)
    return {label: curves[curves["sample"] == sample] for label, sample in frames.samples_drawn.items()}


def loop_spreads(frames: Frames, *columns: str) -> Mapping[str, pd.DataFrame] | None:
    """Spread over the samples on the two branches that span all torques, by column; None of a single sample.

    Angles count from the middle of each loop's width at zero torque.
    """
    if len(frames.band) < 2:
        return None
    steps = len(frames.of_band(frames.curves, "torque_Nm")[0])
    branch = np.asarray(frames.curves["branch"].iloc[:steps])
    torque = frames.curves["torque_Nm"].to_numpy()[:steps]
    spanning = (branch == "loading+") | (branch == "loading-")
    spreads = {}
    for name in columns:
        values = frames.of_band(frames.curves, name)
        values = centred_loops(values, branch, torque) if name == "angle_arcmin" else values
        spreads[name] = spread_frame(values[:, spanning], branch=branch[spanning], torque_Nm=torque[spanning])
    return spreads
