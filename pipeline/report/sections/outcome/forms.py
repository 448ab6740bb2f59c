"""How the results move under other forms of the model."""

from pathlib import Path

from pipeline.figures.style import METRICS
from pipeline.report.samples.model_forms import FORM_TABLES, FormResults
from pipeline.report.sections.section import Section

SECTION = Section(
    name="forms",
    title="Other forms of the model",
    rank=23,
    template=Path(__file__).with_suffix(".html"),
    values=lambda page: {"forms": FormResults(page.frames, page.results), "metric_labels": METRICS},
    applies=lambda frames: len(frames.tables.get(FORM_TABLES[0], ())) > 0,
    tables=FORM_TABLES,
)
