"""Commands for the people downstream: joints of simulators, where a run comes from, tables, flanks of designs."""

import argparse
import io
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.dataset as ds

from pipeline import assembly, settings
from pipeline.cli.arguments import workers
from pipeline.config import load_design, load_study
from pipeline.decisions.joint import FORMATS, JOINTS, joints
from pipeline.engine.finished_run import FILE, crate, mixed_stages
from pipeline.engine.store import write_atomic, write_json
from pipeline.engine.table import columns_of_frame
from pipeline.errors import InputError
from pipeline.figures.mesh import outlines_dxf
from pipeline.library.running import up_to_date
from pipeline.model.geometry.cycloid_profile import CycloidProfile
from pipeline.model.geometry.drawn_flank import drawn_flank

MOST_ROWS = 1_048_575
"""Rows of a sheet below its header, by the file format."""
LONGEST_NAME = 31
"""Characters of a sheet's name, by the file format."""


def write_workbook(folder: Path, file: Path) -> tuple[list[str], list[str]]:
    """Write the Parquet tables of a folder of results as a workbook.

    Parameters
    ----------
    folder : of a page, or of a run, whose stages' tables are then taken.

    Returns
    -------
    Names of the tables written, and a sentence for each that was left out.

    Raises
    ------
    InputError
        If the folder has no table.
    """
    tables = dict(_tables(folder))
    if not tables:
        raise InputError(
            f"{folder}: no table; give a folder of results, as data/runs/quick or data/runs/allocate/paper"
        )
    sink = io.BytesIO()
    written_tables: list[str] = []
    left_out: list[str] = []
    with pd.ExcelWriter(sink, engine="xlsxwriter") as book:
        for name, path in tables.items():
            try:
                dataset = ds.dataset(path, format="parquet")
            except pa.ArrowInvalid:
                left_out.append(f"{name}: {path.name} is no Parquet file")
                continue
            rows = dataset.count_rows()
            if rows > MOST_ROWS:
                left_out.append(
                    f"{name}: {rows:,} rows; a sheet has at most {MOST_ROWS:,}; read {path.name} with pandas"
                )
                continue
            frame = dataset.to_table().to_pandas()
            frame.columns = [_header(dataset.schema.field(column)) for column in frame]
            frame.to_excel(book, sheet_name=_sheet_name(name, written_tables), index=False, freeze_panes=(1, 0))
            written_tables.append(name)
    write_atomic(file, sink.getvalue())
    return written_tables, left_out


def _tables(folder: Path) -> Iterator[tuple[str, Path]]:
    """Tables of a folder, by ``table`` or ``stage table``."""
    for path in sorted(folder.glob("*.parquet")):
        yield path.stem, path
    for path in sorted(folder.glob("*/*.parquet")):
        yield f"{path.parent.name} {path.stem}", path


def _header(field: pa.Field) -> str:
    """Name of a column with its unit."""
    unit = (field.metadata or {}).get(b"unit", b"").decode()
    return f"{field.name} ({unit})" if unit and unit not in ("1", "") else field.name


def _sheet_name(name: str, taken_names: list[str]) -> str:
    """A name that the format allows and no other table has."""
    short = re.sub(r"[\[\]:*?/\\]", "_", name)[:LONGEST_NAME]
    return short if short not in taken_names else f"{short[: LONGEST_NAME - 3]}{len(taken_names)}"


def write_joints(options: argparse.Namespace) -> None:
    """Write backlash, stiffness and friction of a study's quantiles for simulators."""
    study = load_study(options.study, settings.ROOT)
    outputs = up_to_date(study, ["aggregate"], workers(options)).outputs
    units = pd.DataFrame(outputs["aggregate"].read("units")).iloc[int(study.samples.nominal_first) :]
    joint_rows = joints(units, assembly.definitions(study).lost_motion)
    folder = settings.RUNS / "joints" / study.name
    rows = pd.DataFrame([vars(joint) for joint in joint_rows])
    write_atomic(folder / "joints.parquet", JOINTS.part(columns_of_frame(rows)).data)
    write_atomic(folder / "joints.csv", rows.to_csv(index=False, float_format="%.9g").encode())
    for joint in joint_rows:
        for ending, text in FORMATS.items():
            write_atomic(folder / f"{joint.quantile}.{ending}", text(joint).encode())
    print(rows.to_string(index=False, float_format=lambda value: f"{value:.5g}"))
    if warning := missing_units(units):
        print(f"Warning: {warning}")
    print(f"files: {settings.shown(folder)}")


def missing_units(units: pd.DataFrame) -> str:
    """A sentence on units without a result, which the quantiles of a joint leave out; empty if there are none."""
    missing = int((units["status"] != "ok").sum())
    if not missing:
        return ""
    return (
        f"{missing:,} of {len(units):,} units have a remark in place of a result (column status of aggregate/units) "
        "and count nowhere; they may be the loosest ones"
    )


def write_provenance(options: argparse.Namespace) -> None:
    """Write what a run was made from, beside its stages."""
    folder = Path(options.run) if Path(options.run).is_dir() else settings.RUNS / options.run
    write_json(folder / FILE, crate(folder))
    print(f"RO-Crate: {settings.shown(folder / FILE)}")


def write_spreadsheet(options: argparse.Namespace) -> None:
    """Write the tables of a folder of results as a workbook."""
    folder = Path(options.folder) if Path(options.folder).is_dir() else settings.RUNS / options.folder
    if not folder.is_dir():
        raise InputError(f"{options.folder}: no folder of results; run a study or a command first")
    file = options.out or folder / f"{folder.name}.xlsx"
    if file.suffix.lower() != ".xlsx" or file.is_dir():
        raise InputError(f"--out = {file}; must be a file that ends in .xlsx")
    written_tables, left_out = write_workbook(folder, file)
    print(f"{settings.shown(file)}: {', '.join(written_tables)}")
    for sentence in left_out:
        print(f"left out: {sentence}")
    for warning in mixed_stages(folder):
        print(f"Warning: {warning}")


SMALLEST_COUNT, LARGEST_COUNT = 8, 100_000
"""Points of a lobe."""
PHASE_STEP = 1e-5
"""Step [rad] of the phase of a lobe for the tangent."""


def write_flank(options: argparse.Namespace) -> None:
    """Write ``drawn.csv``, ``measured.csv`` where a deviation was measured, and ``flank.dxf`` with a layer of each."""
    if not SMALLEST_COUNT <= options.points <= LARGEST_COUNT:
        raise InputError(f"--points = {options.points}; must be {SMALLEST_COUNT} to {LARGEST_COUNT} of a lobe")
    profile = assembly.profile(load_design(options.design, settings.ROOT))
    drawn_profile = replace(profile, modification=replace(profile.modification, measured_flank=None))
    tables = {"drawn": flank_points(drawn_profile, options.points)}
    if profile.modification.measured_flank is not None:
        tables["measured"] = flank_points(profile, options.points)
    for name, table in tables.items():
        write_atomic(options.out / f"{name}.csv", table.to_csv(index=False, float_format="%.9f").encode())
    outlines = {name: (table["x_mm"] + 1j * table["y_mm"]).to_numpy() for name, table in tables.items()}
    write_atomic(options.out / "flank.dxf", outlines_dxf(outlines))
    for name in (*(f"{name}.csv" for name in tables), "flank.dxf"):
        print(settings.shown(options.out / name))
    print("the flank of the design alone: allowances of a study (tolerances.disk_profile.allowance_um) are not in it")


def flank_points(profile: CycloidProfile, points: int) -> pd.DataFrame:
    """So many points of each lobe in the disk's frame, clockwise from the root at angle 0, equally far in phase.

    The normals, outward, are those of this flank, by central differences: one that was rotated or measured has others
    than the curve that generates it. At a kink they halve the angle between both sides.
    """
    lobe = np.repeat(np.arange(profile.lobes), points)
    phase = np.tile(2 * np.pi * np.arange(points) / points, profile.lobes)
    flank = drawn_flank(profile, lobe, phase)
    tangent = drawn_flank(profile, lobe, phase + PHASE_STEP) - drawn_flank(profile, lobe, phase - PHASE_STEP)
    outward = 1j * tangent / np.abs(tangent)
    return pd.DataFrame(
        {
            "lobe": lobe,
            "phase_deg": np.degrees(phase),
            "x_mm": flank.real,
            "y_mm": flank.imag,
            "normal_x": outward.real,
            "normal_y": outward.imag,
        }
    )
