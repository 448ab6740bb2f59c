"""A loop under load and a whole turn: transmission error, forces on bearings and pins."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from pipeline import assembly
from pipeline.figures.hysteresis import hysteresis_figure
from pipeline.report.drawing import Drawing, band_sentence, loop_spreads, loop_traces
from pipeline.report.frames import Frames
from pipeline.report.layout.wording import plain_number
from pipeline.report.results import STATISTICS
from pipeline.report.sections.section import Section
from pipeline.report.turn import TurnSection, turn_drawings


def _curve_drawings(frames: Frames) -> Iterator[Drawing]:
    spreads = loop_spreads(frames, "angle_arcmin")
    centre = " Each loop is drawn about the middle of its width at zero torque." if spreads else ""
    yield Drawing(
        "hysteresis",
        "Torsion angle against torque",
        f"At crank angle {plain_number(frames.crank_deg)}°, input held; marked are the definitions of the "
        "metrics. Without "
        "friction loading and unloading coincide outside the free play."
        f"{centre}{band_sentence(frames, spreads)}",
        partial(
            hysteresis_figure,
            loop_traces(frames),
            spreads["angle_arcmin"] if spreads else None,
            assembly.definitions(frames.study),
        ),
    )


CURVE = Section(
    name="curve",
    title="Torsion under load",
    rank=80,
    template='{% from "macros.html" import figure with context %}\n{{ figure("hysteresis") }}\n',
    drawings=_curve_drawings,
)


TURN = Section(
    name="turn",
    title="Over a turn",
    rank=90,
    template=Path(__file__).with_suffix(".html"),
    values=lambda page: {"turn": TurnSection(page.frames), "statistics": list(STATISTICS.values())},
    drawings=turn_drawings,
)

SECTIONS = (CURVE, TURN)
