"""How many samples the study has, and what more of them would tell."""

from pathlib import Path

from pipeline.report.samples.section import SamplesSection, sample_drawings
from pipeline.report.sections.section import Section

SECTION = Section(
    name="samples",
    title="How many samples",
    rank=30,
    template=Path(__file__).with_suffix(".html"),
    values=lambda page: {"samples": SamplesSection(page.frames)},
    applies=lambda frames: not frames.is_listed and len(frames.over_turn) > 0,
    drawings=sample_drawings,
)
