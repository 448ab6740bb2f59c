"""Torsion angle against torque."""

from collections.abc import Iterator
from functools import partial

from pipeline import assembly
from pipeline.figures.hysteresis import hysteresis_figure
from pipeline.report.drawing import Drawing, band_sentence, loop_spreads, loop_traces
from pipeline.report.frames import Frames
from pipeline.report.layout.wording import plain_number
from pipeline.report.sections.section import Section


def _drawings(frames: Frames) -> Iterator[Drawing]:
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


SECTION = Section(
    name="curve",
    title="Torsion under load",
    rank=80,
    template='{% from "macros.html" import figure with context %}\n{{ figure("hysteresis") }}\n',
    drawings=_drawings,
)
