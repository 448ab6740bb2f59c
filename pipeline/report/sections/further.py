"""Other forms of the model, the number of samples, and units in the far tails."""

from pathlib import Path

from pipeline.figures.labels import METRICS
from pipeline.report.model_forms import FORM_TABLES, FormResults
from pipeline.report.samples import SamplesSection, sample_drawings, tail_lines
from pipeline.report.sections.section import Section

FORMS = Section(
    name="forms",
    title="Other forms of the model",
    rank=23,
    template=Path(__file__).with_name("forms.html"),
    values=lambda page: {"forms": FormResults(page.frames, page.results), "metric_labels": METRICS},
    applies=lambda frames: len(frames.tables.get(FORM_TABLES[0], ())) > 0,
    tables=FORM_TABLES,
)


SAMPLES = Section(
    name="samples",
    title="How many samples",
    rank=30,
    template=Path(__file__).with_name("samples.html"),
    values=lambda page: {"samples": SamplesSection(page.frames)},
    applies=lambda frames: not frames.is_listed and len(frames.over_turn) > 0,
    drawings=sample_drawings,
)


TAILS = Section(
    name="tails",
    title="Far tails",
    rank=40,
    template=Path(__file__).with_name("tails.html"),
    values=lambda page: {"tail_lines": tail_lines(page.frames)},
    applies=lambda frames: len(frames.tails) > 0,
)

SECTIONS = (FORMS, SAMPLES, TAILS)
