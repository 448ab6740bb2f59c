"""What a reader looks up: definitions, limits of the model, numbers of the design, tables and versions."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline import assembly
from pipeline.figures.labels import METRICS
from pipeline.report import inputs
from pipeline.report.frames import Frames
from pipeline.report.layout import DASH, count_text, listed_text, percent
from pipeline.report.sections.section import Page, Section, StageNote
from pipeline.statistics.resampling import FEWEST_BEYOND

BOX = 124, 62
"""Width and height of a stage's box [pixels of the drawing]."""
GAP = 40, 18
"""Between boxes, across and down, likewise."""


@dataclass(frozen=True)
class StageBox:
    """A stage with the corner of its box in the drawing, and the share of the run's time that it took."""

    note: StageNote
    x: float
    y: float
    share: float


@dataclass(frozen=True)
class StageGraph:
    """Boxes of stages and the lines (x0, y0, x1, y1) from what is read to what reads it; all in pixels."""

    boxes: tuple[StageBox, ...]
    lines: tuple[tuple[float, float, float, float], ...]
    width: float
    height: float
    description: str


def stage_graph(notes: Sequence[StageNote]) -> StageGraph:
    """The graph of stages, upstream ones first: each stands right of all that it reads.

    A line is drawn to the stages that read another's tables directly; one that a longer path implies is left out.
    """
    notes_by_name = {note.name: note for note in notes}
    reads = {note.name: [name for name in note.reads if name in notes_by_name] for note in notes}
    upstream: dict[str, set[str]] = {}
    column: dict[str, int] = {}
    for name, sources in reads.items():
        upstream[name] = set(sources).union(*(upstream[source] for source in sources))
        column[name] = max((column[source] + 1 for source in sources), default=0)
    total = sum(note.seconds for note in notes) or 1.0
    places: dict[str, tuple[float, float]] = {}
    for name in notes_by_name:
        row = sum(column[neighbour] == column[name] for neighbour in places)
        places[name] = column[name] * (BOX[0] + GAP[0]), row * (BOX[1] + GAP[1])
    lines = []
    for name, sources in reads.items():
        implied_sources = set().union(*(upstream[source] for source in sources))
        for source in sources:
            if source not in implied_sources:
                (x0, y0), (x1, y1) = places[source], places[name]
                lines.append((x0 + BOX[0], y0 + BOX[1] / 2, x1, y1 + BOX[1] / 2))
    return StageGraph(
        tuple(StageBox(note, *places[note.name], note.seconds / total) for note in notes),
        tuple(lines),
        max(x for x, _ in places.values()) + BOX[0],
        max(y for _, y in places.values()) + BOX[1],
        "; ".join(_stage_text(note, reads[note.name]) for note in notes),
    )


def _stage_text(note: StageNote, sources: Sequence[str]) -> str:
    """A stage in words, for those who do not see the drawing."""
    origin = f" reads {', '.join(sources)}" if sources else ""
    failed_text = f", {count_text(note.failed_items, 'item')} failed" if note.failed_items else ""
    return f"{note.name}{origin}: {note.seconds:.1f} s{failed_text}"


def beyond_law(frames: Frames) -> str:
    """Share of the pins' moment on contacts beyond the range of their law, at the largest torque of the cycle."""
    curves = frames.curves
    torque = np.abs(curves["torque_Nm"].to_numpy())
    has_failed = curves["sample"].isin(frames.failed_rows["sample"]).to_numpy()
    shares = curves["beyond_limit_share"].to_numpy()[(torque >= (1 - 1e-9) * torque.max()) & ~has_failed]
    if not shares.size:
        return DASH
    return f"{percent(float(shares.mean()))} on average and {percent(float(shares.max()))} at most"


def overload_phrases(frames: Frames) -> list[str]:
    """Contacts of the drawn samples beyond the pressure limit, one phrase a sample; none without a limit."""
    limit = frames.limits.get("peak_pressure_MPa")
    return [] if limit is None else list(_overload_phrases(frames, limit))


def _overload_phrases(frames: Frames, limit: float) -> Iterator[str]:
    loads = frames.at_crank(frames.loads)
    for label, sample in frames.samples_drawn.items():
        rows = loads[loads["sample"] == sample]
        if not len(rows):
            continue
        contacts_beyond = rows.loc[rows["pressure_MPa"] > limit, "contact"].unique()
        pins = sorted(int(contact) for contact in contacts_beyond if contact < frames.study.design.cycloid.pins)
        rollers = len(contacts_beyond) - len(pins)
        parts = [f"{count_text(len(pins), 'pin')} ({ranges(pins)})"] if pins else []
        parts += [count_text(rollers, frames.study.design.output.words.contact)] if rollers else []
        yield f"{listed_text(parts) if parts else 'none'} of {frames.owner(label)}"


def ranges(numbers: list[int]) -> str:
    """Ascending numbers with their runs joined: ``3, 70–75``."""
    runs: list[list[int]] = []
    for item in numbers:
        if runs and item == runs[-1][1] + 1:
            runs[-1][1] = item
        else:
            runs.append([item, item])
    return ", ".join(
        f"{run_start}" if run_start == run_end else f"{run_start}\u2013{run_end}" for run_start, run_end in runs
    )


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
