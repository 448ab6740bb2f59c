"""What each number of the page means."""

from collections.abc import Mapping
from pathlib import Path

from pipeline import assembly
from pipeline.figures.labels import METRICS
from pipeline.report.sections.section import Page, Section
from pipeline.statistics.replicated import FEWEST_BEYOND


def _values(page: Page) -> Mapping[str, object]:
    """Every metric with its definition at the torques of the study."""
    torques = vars(assembly.definitions(page.frames.study))
    return {
        "definitions": [(metric, metric.definition.format(**torques)) for metric in METRICS.values()],
        "fewest_beyond": FEWEST_BEYOND,
    }


SECTION = Section(
    name="definitions", title="Definitions", rank=100, template=Path(__file__).with_suffix(".html"), values=_values
)
