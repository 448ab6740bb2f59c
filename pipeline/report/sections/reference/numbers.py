"""Every number of the design, and where it comes from."""

from pathlib import Path

from pipeline.report import inputs
from pipeline.report.sections.section import Section

SECTION = Section(
    name="numbers",
    title="Every number of the design",
    rank=120,
    collapsed=True,
    template=Path(__file__).with_suffix(".html"),
    values=lambda page: {"numbers": inputs.design_numbers(page.frames.study.design)},
)
