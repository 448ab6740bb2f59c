"""Stage 2: errors to the gap of every contact at every crank angle, and the rigid backlash."""

from collections.abc import Iterator, Sequence

import numpy as np

from pipeline import assembly
from pipeline.arrays import joined_columns
from pipeline.config.studies.study import Study
from pipeline.engine.stage import Chunk, Stage, Tables
from pipeline.engine.table import Column, Table
from pipeline.model.geometry.reducer import Reducer
from pipeline.model.geometry.rigid_play.rigid_backlash import RigidPlay, rigid_play
from pipeline.model.load_history.drive import Drive
from pipeline.model.load_history.load_cycle import ARCMIN
from pipeline.model.units import UM_PER_MM
from pipeline.mounting import drive_of
from pipeline.populations.turn_drives import Units
from pipeline.sampling.errors import Errors
from stages.sample import SAMPLED_TABLES, errors_of_columns
from stages.tables.keys import CONTACT, CRANK, SAMPLE, repeated_axes

LARGEST = 3
"""Crank angles of a unit, those of its largest backlash, at which finite motions are computed first. More follow until
the largest backlash is one with finite motions."""
CONTACTS = Table(
    "contacts",
    "contact, loaded crank (the nominal reducer)",
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
        Column("arm_mm", "float64", "mm", "moment of the unit normal force on body b about the axis of its motion"),
        Column("normal_x", "float64", "1", "unit normal from body a into body b"),
        Column("normal_y", "float64", "1", "unit normal from body a into body b"),
        Column(
            "curvature_per_mm", "float64", "1/mm", "of the disk at a pin or in a hole (convex positive), 0 on flats"
        ),
    ),
)
GAPS = Table(
    "gaps",
    "sample, crank of a kept curve, contact",
    (
        SAMPLE,
        CRANK,
        CONTACT,
        Column("clearance_um", "float64", "um", "gap at the nominal pose along the normal, negative: interference"),
    ),
)
KINEMATIC = Table(
    "kinematic",
    "sample, crank of the whole turn",
    (
        SAMPLE,
        CRANK,
        Column("backlash_arcmin", "float64", "arcmin", "rigid backlash; interfering parts contribute 0"),
        Column(
            "angle_minus_arcmin", "float64", "arcmin", "output at the negative end of play, from its nominal position"
        ),
        Column(
            "angle_plus_arcmin", "float64", "arcmin", "output from its nominal position, at the positive end of play"
        ),
        Column(
            "finite_motion_arcmin",
            "float64",
            "arcmin",
            "what finite motions add to the backlash at the angles of the largest, 0 elsewhere; null: not found",
        ),
        Column("overlap_um", "float64", "um", "least possible largest penetration, 0 if the gaps leave room"),
        Column("preloaded", "bool", "", "whether the gaps of some part interfere"),
    ),
)


def contact_columns(reducer: Reducer, crank_deg: float) -> dict[str, np.ndarray]:
    """Columns of the dimension table at one crank angle."""
    contacts = reducer.contacts
    return {
        "contact": np.arange(len(contacts)),
        "crank_deg": np.full(len(contacts), crank_deg),
        "kind": contacts.kind.astype(object),
        "body_a": contacts.body_a.astype(object),
        "body_b": contacts.body_b.astype(object),
        "disk": reducer.disk_of_contact,
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


def rigid_angles(study: Study) -> np.ndarray:
    """Crank angles [deg] at which rigid bodies are looked at, ascending: evenly over the turn, and the loaded ones."""
    return np.union1d(study.cycle.rigid_crank_deg, study.cycle.crank_deg)


def rigid_plays(study: Study, sampled_errors: Errors) -> Iterator[tuple[float, Drive, RigidPlay]]:
    """The drive of ``n`` units and its play with rigid bodies, at each crank angle of `rigid_angles`."""
    errors = assembly.errors(sampled_errors)
    clearance = assembly.bearing_clearance(study.design, sampled_errors.bearing_clearance)
    cranks = rigid_angles(study)
    laws = assembly.contact_laws(study, assembly.reducer(study.design, float(cranks[0])))  # rigid bodies know none
    for crank in cranks:
        drive = drive_of(study, crank, None, errors, clearance, laws)
        yield crank, drive, rigid_play(drive.reducer, drive.gap, drive.bearing_clearance)


def rigid_turn(study: Study, sampled_errors: Errors) -> tuple[np.ndarray, np.ndarray]:
    """The play of rigid bodies over the turn, as the table of this stage has it.

    Returns
    -------
    ends : (+, -) of the play (n, 2, n_rigid_angles) [arcmin]; missing where contacts interfere.
    finite_motion : what finite motions add to the backlash (n, n_rigid_angles) [arcmin].
    """
    plays = [play for _, _, play in rigid_plays(study, sampled_errors)]
    return _ends(plays), ARCMIN * _finite_motion(study, sampled_errors, plays)


def rigid_ends(study: Study, sampled_errors: Errors) -> np.ndarray:
    """Ends of the play alone, as `rigid_turn` has them: finite motions take longer than these."""
    return _ends([play for _, _, play in rigid_plays(study, sampled_errors)])


def _ends(plays: Sequence[RigidPlay]) -> np.ndarray:
    ends = [np.where(play.preloaded, np.nan, play.ends) for play in plays]
    return ARCMIN * np.stack(ends, axis=2).swapaxes(0, 1)


def _finite_motion(study: Study, sampled: Errors, plays: Sequence[RigidPlay]) -> np.ndarray:
    """What finite motions add to the backlash (n, n_rigid_angles) [rad] at the largest ones of each unit; else 0.

    They may make the largest smaller than others: further angles are looked at until the largest is one with them.
    """
    backlash = np.stack([play.backlash for play in plays], axis=1)
    change, units = np.zeros(backlash.shape), Units.from_errors(study, sampled)
    preloaded = np.stack([play.preloaded for play in plays], axis=1)
    laws = assembly.contact_laws(study, assembly.reducer(study.design, 0.0))
    looked_at, new = preloaded, _largest(backlash, LARGEST) & ~preloaded
    while np.any(new):
        for number, crank in enumerate(rigid_angles(study)):
            rows = np.flatnonzero(new[:, number])
            if len(rows):
                some = units.some(rows)
                change[rows, number] = drive_of(
                    study, float(crank), None, some.errors, some.clearance, laws
                ).backlash_change
        looked_at = looked_at | new
        new = _largest(np.nan_to_num(backlash + change, nan=np.inf), 1) & ~looked_at
    return change


def _largest(values: np.ndarray, count: int) -> np.ndarray:
    """Which values (n, n_angles) are the ``count`` largest of their row, the first of equal ones."""
    is_largest = np.zeros(values.shape, bool)
    np.put_along_axis(is_largest, np.argsort(-values, axis=1, kind="stable")[:, :count], True, axis=1)
    return is_largest


def _solve(study: Study, chunk: Chunk) -> Tables:
    sampled_errors = errors_of_columns({name: chunk.tables[f"sample/{name}"] for name in SAMPLED_TABLES})
    number, cranks = np.arange(chunk.start, chunk.stop), rigid_angles(study)
    plays, gaps = [], {}
    for angle, drive, play in rigid_plays(study, sampled_errors):
        plays.append(play)
        if angle in study.cycle.curve_crank_deg:
            gaps[angle] = drive.gap
    sample, crank, contact = repeated_axes(number, np.array(list(gaps)), np.arange(next(iter(gaps.values())).shape[1]))
    rows_sample, rows_crank = repeated_axes(number, cranks)
    return {
        "contacts": _nominal_contacts(study) if chunk.start == 0 else CONTACTS.empty(),
        "gaps": {
            "sample": sample,
            "crank_deg": crank,
            "contact": contact,
            "clearance_um": UM_PER_MM * np.stack(list(gaps.values()), axis=1).ravel(),
        },
        "kinematic": {
            "sample": rows_sample,
            "crank_deg": rows_crank,
            "backlash_arcmin": ARCMIN * np.stack([play.backlash for play in plays], axis=1).ravel(),
            "angle_minus_arcmin": ARCMIN * np.stack([play.ends[1] for play in plays], axis=1).ravel(),
            "angle_plus_arcmin": ARCMIN * np.stack([play.ends[0] for play in plays], axis=1).ravel(),
            "finite_motion_arcmin": ARCMIN * _finite_motion(study, sampled_errors, plays).ravel(),
            "overlap_um": UM_PER_MM * np.stack([play.overlap for play in plays], axis=1).ravel(),
            "preloaded": np.stack([play.preloaded for play in plays], axis=1).ravel(),
        },
    }


def _nominal_contacts(study: Study) -> dict[str, np.ndarray]:
    parts = [contact_columns(assembly.reducer(study.design, crank), crank) for crank in study.cycle.crank_deg]
    return joined_columns(parts)


CLEARANCE = Stage(
    name="clearance",
    reads=("sample",),
    sections=(
        "samples",
        "design",
        "springs",
        "reduce",
        "clearance",
        "cycle.crank_deg",
        "cycle.curve_crank_deg",
        "cycle.rigid_crank_deg",
    ),
    tables=(CONTACTS, GAPS, KINEMATIC),
    module="stages.clearance",
    unit="samples",
    items=lambda job: job.study.samples.rows,
    prepare=lambda job: job.study,
    solve=_solve,
    chunk_reads=tuple(f"sample/{name}" for name in SAMPLED_TABLES),
    chunk_factor=4,
    proportional_to=("cycle.rigid_crank_deg", "design.cycloid.pins"),
    unit_seconds=2e-7,
)
