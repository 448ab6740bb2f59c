"""The page: one HTML file that needs nothing beside it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline import assembly
from pipeline.config.studies.study import Study
from pipeline.figures.labels import METRICS
from pipeline.model.metrics import Metric
from pipeline.report import inputs
from pipeline.report.cases import ROWS_SHOWN, case_crank_rows, case_rows
from pipeline.report.chain.graph import BOX, StageNote, stage_graph
from pipeline.report.drivers import base_samples, constant_metrics, driver_tables, drivers, first_drivers
from pipeline.report.explorer.explorer import explored
from pipeline.report.frames import DRAWN_CASES, Frames
from pipeline.report.layout.pictures import Picture
from pipeline.report.layout.rendering import rendered
from pipeline.report.results import Results
from pipeline.report.samples.section import SamplesSection
from pipeline.report.samples.tails import tail_lines
from pipeline.report.turn.section import TurnSection
from pipeline.report.validity import beyond_law, overloaded
from pipeline.statistics.replicated import FEWEST_BEYOND

TEMPLATE = "page.html"


@dataclass(frozen=True)
class TableNote:
    """One table of the run: where it lies, what a row is, how many there are, and its columns."""

    path: str
    row_per: str
    rows: int
    columns: tuple[str, ...]


def definitions(study: Study) -> list[tuple[Metric, str]]:
    """Every metric with its definition at the torques of the study."""
    torques = vars(assembly.definitions(study))
    return [(metric, metric.definition.format(**torques)) for metric in METRICS.values()]


def report_page(
    frames: Frames,
    pictures: Mapping[str, Picture],
    tables: Sequence[TableNote],
    stages: Sequence[StageNote],
    versions: Mapping[str, str],
) -> str:
    """The report as one self-contained HTML document.

    Parameters
    ----------
    frames : the study and its tables.
    pictures : by the name of their drawing; the page leaves out what is not there.
    tables : the tables of the run.
    stages : the stages that it rests on, upstream ones first.
    versions : package -> version.
    """
    study, driver_statements = frames.study, drivers(frames)
    numbers = inputs.design_numbers(study.design)
    cases = inputs.case_columns(study.cases)
    return rendered(
        TEMPLATE,
        study=study,
        frames=frames,
        results=Results(frames),
        turn=TurnSection(frames),
        samples=SamplesSection(frames),
        tail_lines=tail_lines(frames),
        case_rows=case_rows(frames) if frames.listed else [],
        case_crank_rows=case_crank_rows(frames) if frames.listed else [],
        drivers=driver_statements,
        first_drivers=first_drivers(driver_statements),
        base_samples=base_samples(frames),
        constant_metrics=constant_metrics(frames),
        beyond_law=beyond_law(frames),
        overloaded=overloaded(frames),
        definitions=definitions(study),
        metric_titles={name: METRICS[name].title for name in frames.shown_metrics},
        explorer=explored(frames) if "units" in pictures else {},
        driver_tables=driver_tables(frames),
        pictures=pictures,
        tables=tables,
        graph=stage_graph(stages),
        box=BOX,
        versions=versions,
        numbers=numbers,
        calibrated=inputs.names_by_status(numbers, "calibrated"),
        chosen=inputs.names_by_status(numbers, "chosen"),
        reducer_facts=inputs.reducer_facts(study.design),
        study_facts=inputs.study_facts(frames),
        tolerance_rows=inputs.tolerance_rows(study.tolerances),
        zero_tolerances=inputs.zero_tolerances(study.tolerances),
        case_titles=[inputs.PARAMETERS[name] for name in cases],
        case_inputs=[(case.label, inputs.case_cells(case, cases)) for case in study.cases[:ROWS_SHOWN]],
        rows_shown=ROWS_SHOWN,
        drawn_cases=DRAWN_CASES,
        fewest_beyond=FEWEST_BEYOND,
        law=inputs.law_fact(study),
        stress=inputs.STRESS[study.design.disk.stress],
    )
