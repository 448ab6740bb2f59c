"""What a whole turn does: transmission error, forces on bearings and pins."""

from pathlib import Path

from pipeline.report.results import STATISTICS
from pipeline.report.sections.section import Section
from pipeline.report.turn.drawings import turn_drawings
from pipeline.report.turn.section import TurnSection

SECTION = Section(
    name="turn",
    title="Over a turn",
    rank=90,
    template=Path(__file__).with_suffix(".html"),
    values=lambda page: {"turn": TurnSection(page.frames), "statistics": list(STATISTICS.values())},
    drawings=turn_drawings,
)
