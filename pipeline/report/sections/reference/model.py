"""What the model leaves out, and how far the run stays within what it holds for."""

from collections.abc import Mapping
from pathlib import Path

from pipeline.report import inputs
from pipeline.report.sections.section import Page, Section
from pipeline.report.validity import beyond_law, overloaded


def _values(page: Page) -> Mapping[str, object]:
    frames, design = page.frames, page.frames.study.design
    numbers = inputs.design_numbers(design)
    return {
        "beyond_law": beyond_law(frames),
        "overloaded": overloaded(frames),
        "law": inputs.law_fact(frames.study),
        "stress": inputs.STRESS[design.disk.stress],
        "calibrated": inputs.names_by_status(numbers, "calibrated"),
        "chosen": inputs.names_by_status(numbers, "chosen"),
    }


SECTION = Section(
    name="model", title="Limits of the model", rank=110, template=Path(__file__).with_suffix(".html"), values=_values
)
