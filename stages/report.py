"""Stage 6: the report, one HTML page that needs nothing beside it, and its figures."""

import importlib.metadata
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.config.studies.study import Study
from pipeline.engine.fingerprint import package_versions
from pipeline.engine.parallel import end_idle_workers
from pipeline.engine.stage import Job, Stage, Tables
from pipeline.engine.store import sha256_of
from pipeline.engine.table import Table
from pipeline.figures.labels import METRICS
from pipeline.report.explorer import kept_samples
from pipeline.report.frames import OK, ROWS_SHOWN, Drawing, Frames, drawn_samples, unit_columns, unsolved_rows
from pipeline.report.layout import LinkedPicture, with_pictures
from pipeline.report.sections.section import Page, StageNote, TableNote, drawings, library, report_page
from stages.reduce import MESH_FILE
from stages.tables.curves import CONTACTS
from stages.tables.over_turn import TURN_CONTACTS

SAMPLES_AT_ONCE = 10_000
"""Samples whose metrics are read together at most."""
BAND_SAMPLES = 2000
"""Samples that a band of the figures is drawn from: more change it by less than its line's width."""
ROWS_AT_ONCE = 2_000_000
"""Rows of a table that are read together at most; many crank angles leave fewer samples."""
PRINTED_WITH = ("matplotlib", "jinja2", "joblib", "pydantic")


def _table(job: Job, stage: str, name: str) -> pd.DataFrame:
    return pd.DataFrame(job.read(stage, name))


def _first_rows(job: Job, stage: str, table: str) -> pd.DataFrame:
    """Rows of the first samples, as many as the bands need."""
    return pd.DataFrame(job.read_items(stage, table, 0, _at_once(job, stage, table, BAND_SAMPLES + 1)))


def _at_once(job: Job, stage: str, table: str, most: int) -> int:
    """Samples, at most so many, whose rows of a table are read together."""
    rows: int = max(1, job.inputs[stage].record["tables"][table]["rows"])
    return int(min(most, max(1, ROWS_AT_ONCE * job.study.samples.rows // rows)))


def _kept_contacts(job: Job, table: Table, samples: list[int]) -> pd.DataFrame:
    """Contacts of the drawn samples and of the page's single units, as far as the study keeps them."""
    keep = job.study.cycle.keep_contacts
    drawn_set = {sample for sample in samples if keep == "all" or sample in keep}
    kept_list = sorted(drawn_set | set(kept_samples(job.study)))
    parts = [pd.DataFrame(job.read_items("hysteresis", table.name, sample, sample + 1)) for sample in kept_list]
    return pd.concat(parts) if parts else pd.DataFrame(table.empty())


def _named_metrics(job: Job) -> pd.DataFrame:
    """Rows of the metrics that the page names: of the first samples, without a result or with one that is missing.

    One row with a hysteresis loss, if there is any, says that there is friction.
    """
    parts = []
    at_once = _at_once(job, "aggregate", "metrics", SAMPLES_AT_ONCE)
    for start in range(0, job.study.samples.rows, at_once):
        part = pd.DataFrame(job.read_items("aggregate", "metrics", start, start + at_once))
        is_first, is_faulty = part["sample"] < ROWS_SHOWN, part["status"] != OK
        is_named = np.array(is_first | is_faulty | part[list(METRICS)].isna().all(axis=1))
        is_named[np.flatnonzero(part["hysteresis_loss_arcmin"] > 0)[:1]] = True
        parts.append(part[is_named])
    return pd.concat(parts, ignore_index=True)


def _frames(job: Job) -> Frames:
    study: Study = job.study
    metrics = _named_metrics(job)
    drawn_set, size = list(drawn_samples(study, unsolved_rows(metrics)).values()), None
    if study.reduce.disk == "elastic":
        with np.load(job.input_path("reduce", MESH_FILE)) as mesh:
            size = len(mesh["triangles"]), len(mesh["nodes"])
    return Frames(
        study=study,
        metrics=metrics,
        units=pd.DataFrame(job.read("aggregate", "units", unit_columns(study.limits.over)), copy=False),
        distributions=_table(job, "aggregate", "distributions"),
        convergence=_table(job, "aggregate", "convergence"),
        sample_convergence=_table(job, "aggregate", "sample_convergence"),
        sensitivity=_table(job, "aggregate", "sensitivity"),
        tails=_table(job, "tails", "tails"),
        n_loops=job.inputs["hysteresis"].record["tables"]["status"]["rows"],
        contacts=_table(job, "clearance", "contacts"),
        gaps=_first_rows(job, "clearance", "gaps"),
        curves=_first_rows(job, "hysteresis", "curves"),
        loads=_kept_contacts(job, CONTACTS, drawn_set),
        transmission=_first_rows(job, "aggregate", "transmission"),
        orders=_first_rows(job, "aggregate", "orders"),
        turn_contacts=_kept_contacts(job, TURN_CONTACTS, drawn_set),
        laws=_table(job, "springs", "laws"),
        mesh=size,
        tables={name: _table(job, *name.split("/")) for section in library().values() for name in section.tables},
    )


def _save(drawing: Drawing, stem: Path) -> None:
    from pipeline.figures.style import save  # a plotting library, which commands of other stages do not wait for

    save(drawing.figure(), stem)


def _draw_mesh(job: Job, folder: Path) -> None:
    from pipeline.figures.mesh import mesh_figure
    from pipeline.figures.style import save

    with np.load(job.input_path("reduce", MESH_FILE)) as mesh:
        save(mesh_figure(**mesh), folder / "mesh")


def _mesh_picture(job: Job) -> dict[str, LinkedPicture]:
    """That of the meshed disk, drawn once for equal meshes; none of a rigid one."""
    if job.study.reduce.disk == "rigid":
        return {}
    key = f"picture of mesh {sha256_of(job.input_path('reduce', MESH_FILE))}"
    for file in job.memo(key, partial(_draw_mesh, job)).glob("mesh.*"):
        job.path(f"figures/{file.name}").write_bytes(file.read_bytes())
    output = job.study.design.output
    in_holes = f"; and a hole, with the patch on which it presses on its {output.words.contact}"
    mesh = LinkedPicture(
        "Mesh of the disk and its deflection",
        "Left: size of the deflection by 1 N on the pin of the longest arm, the bore held. Right: the mesh at that "
        "pin, with the patches that carry the pressure of the pins"
        f"{in_holes if output.holes(job.study.design.cycloid) else ''}.",
        "figures/mesh.svg",
    )
    return {"mesh": mesh}


def _notes(job: Job, upstream: tuple[Stage, ...]) -> list[TableNote]:
    """What the page says of every table of the run."""
    notes = []
    for stage in upstream:
        for table in stage.tables:
            entry = job.inputs[stage.name].record["tables"][table.name]
            file_name, _, _ = entry["files"][0]["name"].partition("/")  # one file, or a folder of parts
            columns = tuple(column.name for column in table.columns)
            notes.append(TableNote(f"{stage.name}/{file_name}", table.row_per, entry["rows"], columns))
    return notes


def _stages(job: Job, upstream: tuple[Stage, ...]) -> list[StageNote]:
    """What the page says of every stage before it."""
    return [StageNote.from_record(stage.name, stage.reads, job.inputs[stage.name].record) for stage in upstream]


def _run(upstream: tuple[Stage, ...], job: Job) -> Tables:
    end_idle_workers()
    frames = _frames(job)
    versions = package_versions() | {name: importlib.metadata.version(name) for name in PRINTED_WITH}
    figures = list(drawings(frames))
    pictures = _mesh_picture(job)
    pictures |= {
        drawing.name: LinkedPicture(drawing.title, drawing.caption, f"figures/{drawing.name}.svg")
        for drawing in figures
    }
    for drawing in figures:
        _save(drawing, job.path(f"figures/{drawing.name}"))
    page = report_page(Page(frames, pictures, _notes(job, upstream), _stages(job, upstream), versions))
    job.path("report.html").write_text(with_pictures(page, pictures.values(), job.folder), encoding="utf-8")
    return {}


NO_TABLES: tuple[Table, ...] = ()


def report_of(upstream: tuple[Stage, ...]) -> Stage:
    """The stage that tells of all ``upstream`` ones, in their order."""
    return Stage(
        name="report",
        reads=tuple(stage.name for stage in upstream),
        sections=(
            "name",
            "title",
            "costs",
            "description",
            "design",
            "samples",
            "cases",
            "tolerances",
            "clearance",
            "springs",
            "reduce",
            "cycle",
            "metrics",
            "limits",
            "published",
            "drivers",
            "model_forms",
        ),
        tables=NO_TABLES,
        module="stages.chain",  # every stage is a source of what the page says of it
        run=partial(_run, upstream),
    )
