"""What a reader looks up: definitions, limits of the model, numbers of the design, tables and versions."""

from collections.abc import Mapping
from pathlib import Path

from pipeline import assembly
from pipeline.figures.labels import METRICS
from pipeline.report import inputs
from pipeline.report.sections.section import Page, Section
from pipeline.report.stage_graph import BOX, stage_graph
from pipeline.report.validity import beyond_law, overload_phrases
from pipeline.statistics.resampling import FEWEST_BEYOND

FOLDER = Path(__file__).parent


def _data_values(page: Page) -> Mapping[str, object]:
    return {"tables": page.tables, "graph": stage_graph(page.stages), "box": BOX, "versions": page.versions}


def _definition_values(page: Page) -> Mapping[str, object]:
    torques = vars(assembly.definitions(page.frames.study))
    return {
        "definitions": [(metric, metric.definition.format(**torques)) for metric in METRICS.values()],
        "fewest_beyond": FEWEST_BEYOND,
    }


def _limit_values(page: Page) -> Mapping[str, object]:
    frames, design = page.frames, page.frames.study.design
    numbers = inputs.design_numbers(design)
    return {
        "beyond_law": beyond_law(frames),
        "overloaded": overload_phrases(frames),
        "law": inputs.law_fact(frames.study),
        "stress": inputs.STRESS[design.disk.stress],
        "calibrated": inputs.names_by_status(numbers, "calibrated"),
        "chosen": inputs.names_by_status(numbers, "chosen"),
    }


SECTIONS = (
    # What each number of the page means.
    Section(
        name="definitions",
        title="Definitions",
        rank=100,
        template=FOLDER / "definitions.html",
        values=_definition_values,
    ),
    # What the model leaves out, and how far the run stays within what it holds for.
    Section(name="model", title="Limits of the model", rank=110, template=FOLDER / "model.html", values=_limit_values),
    # Every number of the design, and where it comes from.
    Section(
        name="numbers",
        title="Every number of the design",
        rank=120,
        is_collapsed=True,
        template=FOLDER / "numbers.html",
        values=lambda page: {"numbers": inputs.design_numbers(page.frames.study.design)},
    ),
    # Where the numbers of the page lie, and how they came about.
    Section(
        name="data",
        title="Data and versions",
        rank=130,
        is_collapsed=True,
        template=FOLDER / "data.html",
        values=_data_values,
    ),
)
