"""The page: one HTML file that needs nothing beside it."""

import base64
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from pipeline.report import inputs
from pipeline.report.cases import ROWS_SHOWN, case_crank_rows, case_rows
from pipeline.report.drivers import constant_metrics, drivers, first_drivers, shares_determined
from pipeline.report.frames import DRAWN_CASES, Frames
from pipeline.report.results import Results
from pipeline.report.validity import beyond_law, overloaded
from pipeline.report.wording import counted, listed, plain

TEMPLATE = "page.html"
NUMBER_AND_UNIT = re.compile(r"(\d) (%|N m\b|mm\b|µm\b|MPa\b|arcmin\b)")
"""What a line must not break between."""


@dataclass(frozen=True)
class Picture:
    """A figure as it stands in the page: its title, caption, and SVG file."""

    title: str
    caption: str
    svg: bytes

    @property
    def source(self) -> str:
        """The file as an address that holds the file itself."""
        return f"data:image/svg+xml;base64,{base64.b64encode(self.svg).decode()}"


@dataclass(frozen=True)
class TableNote:
    """One table of the run: where it lies, what a row is, how many there are, and its columns."""

    path: str
    row_per: str
    rows: int
    columns: tuple[str, ...]


def report_page(
    frames: Frames, pictures: Mapping[str, Picture], tables: Sequence[TableNote], versions: Mapping[str, str]
) -> str:
    """The report as one self-contained HTML document.

    Parameters
    ----------
    frames : the study and its tables.
    pictures : by the name of their drawing; the page leaves out what is not there.
    tables : the tables of the run.
    versions : package -> version.
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"plain": plain, "listed": listed, "counted": counted}
    study, found = frames.study, drivers(frames)
    numbers = inputs.design_numbers(study.design)
    cases = inputs.case_columns(study.cases)
    page = environment.get_template(TEMPLATE).render(
        study=study,
        frames=frames,
        results=Results(frames),
        case_rows=case_rows(frames) if frames.listed else [],
        case_crank_rows=case_crank_rows(frames) if frames.listed else [],
        drivers=found,
        first_drivers=first_drivers(found),
        shares_determined=shares_determined(frames),
        constant_metrics=constant_metrics(frames),
        beyond_law=beyond_law(frames),
        overloaded=overloaded(frames),
        pictures=pictures,
        tables=tables,
        versions=versions,
        numbers=numbers,
        calibrated=inputs.names_by_status(numbers, "calibrated"),
        chosen=inputs.names_by_status(numbers, "chosen"),
        reducer_facts=inputs.reducer_facts(study.design),
        study_facts=inputs.study_facts(frames),
        tolerance_rows=inputs.tolerance_rows(study.tolerances),
        zero_tolerances=inputs.zero_tolerances(study.tolerances),
        varying_errors=inputs.varying_errors(study),
        case_titles=[inputs.PARAMETERS[name] for name in cases],
        case_inputs=[(case.label, inputs.case_cells(case, cases)) for case in study.cases[:ROWS_SHOWN]],
        rows_shown=ROWS_SHOWN,
        drawn_cases=DRAWN_CASES,
        law=inputs.LAWS[study.springs.law],
        stress=inputs.STRESS[study.design.disk.stress],
    )
    return NUMBER_AND_UNIT.sub("\\1\u00a0\\2", page)
