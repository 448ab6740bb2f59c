"""The question that the study asks."""

from pathlib import Path

from pipeline.report.sections.section import Section

SECTION = Section(name="question", title="The question", rank=10, template=Path(__file__).with_suffix(".html"))
