"""Where the numbers of the page lie, and how they came about."""

from collections.abc import Mapping
from pathlib import Path

from pipeline.report.chain.graph import BOX, stage_graph
from pipeline.report.sections.section import Page, Section


def _values(page: Page) -> Mapping[str, object]:
    return {"tables": page.tables, "graph": stage_graph(page.stages), "box": BOX, "versions": page.versions}


SECTION = Section(
    name="data",
    title="Data and versions",
    rank=130,
    collapsed=True,
    template=Path(__file__).with_suffix(".html"),
    values=_values,
)
