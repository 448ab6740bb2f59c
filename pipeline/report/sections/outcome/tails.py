"""Units beyond the limits in parts per million, and far quantiles."""

from pathlib import Path

from pipeline.report.samples.tails import tail_lines
from pipeline.report.sections.section import Section

SECTION = Section(
    name="tails",
    title="Far tails",
    rank=40,
    template=Path(__file__).with_suffix(".html"),
    values=lambda page: {"tail_lines": tail_lines(page.frames)},
    applies=lambda frames: len(frames.tails) > 0,
)
