"""Stage 2: errors to the gap of every contact at every crank angle, and the rigid backlash."""

from dataclasses import dataclass

import numpy as np

from pipeline import assembly
from pipeline.config.study import Study
from pipeline.engine.stage import Chunk, Job, Stage, Tables
from pipeline.engine.table import Column, Table
from pipeline.model.contact.laws import ContactLaws
from pipeline.model.geometry.clearance import Errors
from pipeline.model.geometry.reducer import Bearing, Reducer
from pipeline.model.geometry.rigid_backlash import rigid_play
from pipeline.model.load_history.drive import Drive, GapReading
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.mounting import with_effects
from stages.keys import CONTACT, CRANK, SAMPLE, repeated
from stages.sample import errors_of_columns

UM_PER_MM = 1e3

CONTACTS = Table(
    "contacts",
    "contact, crank (the nominal reducer)",
    (
        CONTACT,
        CRANK,
        Column("kind", "label", "", "pin or output"),
        Column("body_a", "label", "", "body that the contact pushes against the normal"),
        Column("body_b", "label", "", "body that the contact pushes along the normal"),
        Column("disk", "int32", "1", "disk that the contact belongs to, -1 if none"),
        Column("interface", "int32", "1", "0: disk and plate (or output), 1: plate and output, -1: pins"),
        Column("face", "int32", "1", "face of the tongue, 0 in a hole, -1: pins"),
        Column("end", "int32", "1", "end of the slide, 0 in a hole, -1: pins"),
        Column("station", "int32", "1", "roller from outside to inside, or output pin; -1: pins"),
        Column("label", "label", "", "name of the contact"),
        Column("x_mm", "float64", "mm", "contact point, housing frame"),
        Column("y_mm", "float64", "mm", "contact point, housing frame"),
        Column("arm_mm", "float64", "mm", "moment of the unit normal force on body b about its centre"),
        Column("normal_x", "float64", "1", "unit normal from body a into body b"),
        Column("normal_y", "float64", "1", "unit normal from body a into body b"),
        Column(
            "curvature_per_mm", "float64", "1/mm", "of the disk at a pin or in a hole (convex positive), 0 on flats"
        ),
    ),
)
GAPS = Table(
    "gaps",
    "sample, crank, contact",
    (
        SAMPLE,
        CRANK,
        CONTACT,
        Column("clearance_um", "float64", "um", "gap at the nominal pose, negative: interference"),
    ),
)
KINEMATIC = Table(
    "kinematic",
    "sample, crank",
    (
        SAMPLE,
        CRANK,
        Column("backlash_arcmin", "float64", "arcmin", "rigid backlash; interfering parts contribute 0"),
        Column("overlap_um", "float64", "um", "least possible largest penetration, 0 if the gaps leave room"),
        Column("preloaded", "bool", "", "whether the gaps of some part interfere"),
    ),
)


@dataclass(frozen=True)
class _Shared:
    study: Study
    reducers: tuple[Reducer, ...]


def contact_columns(at: Reducer, crank_deg: float) -> dict[str, np.ndarray]:
    """Columns of the dimension table at one crank angle."""
    contacts = at.contacts
    on_disk = (contacts.body_a == "disk") | (contacts.body_b == "disk")
    return {
        "contact": np.arange(len(contacts)),
        "crank_deg": np.full(len(contacts), crank_deg),
        "kind": contacts.kind.astype(object),
        "body_a": contacts.body_a.astype(object),
        "body_b": contacts.body_b.astype(object),
        "disk": np.where(on_disk, 0, -1),
        "interface": contacts.interface,
        "face": contacts.face,
        "end": contacts.end,
        "station": contacts.station,
        "label": contacts.label.astype(object),
        "x_mm": contacts.point.real.copy(),
        "y_mm": contacts.point.imag.copy(),
        "arm_mm": contacts.arm,
        "normal_x": contacts.normal.real.copy(),
        "normal_y": contacts.normal.imag.copy(),
        "curvature_per_mm": contacts.curvature,
    }


def _prepare(job: Job) -> _Shared:
    study = job.study
    return _Shared(study, tuple(assembly.reducer(study.design, crank) for crank in study.cycle.crank_deg))


def _unloaded(study: Study, at: Reducer, errors: Errors, loose: np.ndarray) -> Drive:
    """Drive with the design's effects whose gaps and clearances count: its springs, all of unit stiffness, do not."""
    n = len(at.contacts)
    unit, none = np.ones(n), np.zeros(n)
    drive = Drive(
        profile=assembly.profile(study.design),
        reducer=at,
        bearing=Bearing(1.0, 1.0),
        laws=ContactLaws(unit, none, none, unit, np.full(n, np.inf), none),
        compliance=np.zeros((n, n)),
        rated_torque=assembly.NMM_PER_NM * study.design.cycloid.rated_torque_Nm,
        errors=errors,
        reading=GapReading(**dict(study.clearance)),
        shift=np.zeros((len(loose), n)),
        bearing_clearance=loose,
    )
    return with_effects(drive, study.design.effects)


def _solve(shared: _Shared, chunk: Chunk) -> Tables:
    study = shared.study
    sampled = errors_of_columns(
        {name: chunk.tables[f"sample/{name}"] for name in ("reducer", "pins", "lobes", "rollers")}
    )
    errors = assembly.errors(sampled)
    loose = assembly.bearing_clearance(study.design, sampled.bearing_clearance)
    drives = [_unloaded(study, at, errors, loose) for at in shared.reducers]
    gap = np.stack([drive.gap for drive in drives], axis=1)
    plays = [rigid_play(drive.reducer, drive.gap, drive.bearing_clearance) for drive in drives]
    number, cranks = np.arange(chunk.start, chunk.stop), np.array(study.cycle.crank_deg)
    sample, crank, contact = repeated(number, cranks, np.arange(gap.shape[2]))
    rows_sample, rows_crank = repeated(number, cranks)
    first = [contact_columns(at, c) for at, c in zip(shared.reducers, cranks, strict=True)]
    return {
        "contacts": {name: np.concatenate([one[name] for one in first]) for name in first[0]}
        if chunk.start == 0
        else CONTACTS.empty(),
        "gaps": {"sample": sample, "crank_deg": crank, "contact": contact, "clearance_um": UM_PER_MM * gap.ravel()},
        "kinematic": {
            "sample": rows_sample,
            "crank_deg": rows_crank,
            "backlash_arcmin": ARCMIN * np.stack([play.backlash for play in plays], axis=1).ravel(),
            "overlap_um": UM_PER_MM * np.stack([play.overlap for play in plays], axis=1).ravel(),
            "preloaded": np.stack([play.preloaded for play in plays], axis=1).ravel(),
        },
    }


CLEARANCE = Stage(
    name="clearance",
    reads=("sample",),
    sections=(
        "samples",
        "design.cycloid",
        "design.output",
        "design.bearing.clearance_um",
        "design.effects",
        "clearance",
        "cycle.crank_deg",
    ),
    tables=(CONTACTS, GAPS, KINEMATIC),
    module="stages.clearance",
    unit="samples",
    items=lambda job: job.study.samples.rows,
    prepare=_prepare,
    solve=_solve,
    chunk_reads=("sample/reducer", "sample/pins", "sample/lobes", "sample/rollers"),
)
